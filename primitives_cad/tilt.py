"""Tilted shapes: a solid turned about its origin, and the height map that it then has.

A shape that is known by its height map only is all that lies under this map, two triangles a cell,
with vertical sides where the map ends or steps.
"""

from dataclasses import replace
from functools import partial

import numpy as np

from t2twin.core.errors import T2TwinError
from t2twin.core.jit import compiled
from t2twin.primitives_cad.height_map import (
    EDGE_MM,
    MAX_CELLS,
    OUTLINE,
    REACH_MM,
    STEEP,
    in_blocks,
    moved,
    raise_to_triangle,
    raise_to_triangles,
)
from t2twin.primitives_cad.shape import NOTHING_MM, HeightMap, Shape

MAX_TILT_DEG = 30.0  # about either axis (assumed: several times what a robot's press is off)
FAR_MM = 1.0e4  # a height beyond every solid, mm
# height of the sides below the lowest point of the map (assumed: more than any layer)
SIDE_MM = 10.0
# distance from a plane within which neighboring cells of a row are one part (assumed)
EVEN_MM = 1.0e-4
NOT_SOLID = np.float32(-2.0)  # marks a cell without four solid corners in place of a normal
SIDES_NOTE = "{} has no mesh; its sides are taken as vertical where a tilt turns them up"


def tilted(shape: Shape, tilt_x_rad: float, tilt_y_rad: float) -> Shape:
    """A shape, which keeps its last tilt, tilted about its origin; itself without a tilt."""
    if tilt_x_rad == 0.0 == tilt_y_rad:
        return shape
    tilt = tilt_x_rad, tilt_y_rad
    known = shape.prepared.get("tilted")
    if known is None or known[0] != tilt:
        known = shape.prepared["tilted"] = tilt, _turned(shape, rotation_of(*tilt))
    return known[1]


def _turned(upright: Shape, rotation: np.ndarray) -> Shape:
    """A shape with its points turned by a rotation (3, 3), and its highest point at 0 again."""
    is_bare = not (upright.is_under_surface or len(upright.triangles[1]))
    surface, rise_mm = _surface(upright, rotation, upright.is_under_surface or is_bare)
    base_mm, slope, up = upright.base_mm, (0.0, 0.0), rotation[:, 2]
    if base_mm is not None:
        base_mm = float(base_mm / up[2] - rise_mm)
        slope = (float(-up[0] / up[2]), float(-up[1] / up[2]))
    return replace(
        upright,
        solid=partial(_turned_solid, upright, rotation, rise_mm),
        surface=surface,
        base_mm=base_mm,
        base_slope=slope,
        notes=(*upright.notes, *([SIDES_NOTE.format(upright.name)] if is_bare else ())),
        rise_mm=rise_mm,
        is_under_surface=False,
    )


def _turned_solid(
    upright: Shape, rotation: np.ndarray, rise_mm: float
) -> tuple[np.ndarray, np.ndarray]:
    vertices, faces = upright.triangles
    return vertices @ rotation.T - (0.0, 0.0, rise_mm), faces


def rotation_of(tilt_x_rad: float, tilt_y_rad: float) -> np.ndarray:
    """(3, 3) F Ry(tilt_y) Rx(tilt_x) F with F = diag(1, -1, -1), a tilt in the shape frame."""
    cos_x, sin_x = np.cos(tilt_x_rad), np.sin(tilt_x_rad)
    cos_y, sin_y = np.cos(tilt_y_rad), np.sin(tilt_y_rad)
    about_x = np.array([[1.0, 0.0, 0.0], [0.0, cos_x, -sin_x], [0.0, sin_x, cos_x]])
    about_y = np.array([[cos_y, 0.0, -sin_y], [0.0, 1.0, 0.0], [sin_y, 0.0, cos_y]])
    return about_y @ about_x


def quaternion_of(tilt_x_rad: float, tilt_y_rad: float, yaw_rad: float) -> np.ndarray:
    """w, x, y, z, (4,), of the rotation of a press from the shape frame to the sensor frame."""
    # Turning over and tilting about x add up. SciPy's rotations are slow to import.
    halves = np.array([tilt_x_rad + np.pi, tilt_y_rad, yaw_rad]) / 2
    (a, b, c), (x, y, z) = np.cos(halves), np.sin(halves)
    w, first = a * b * c + x * y * z, x * b * c - a * y * z
    return np.array([w, first, a * y * c + x * b * z, a * b * z - x * y * c])


def _surface(
    upright: Shape, rotation: np.ndarray, is_under_surface: bool
) -> tuple[HeightMap, float]:
    """The height map of a turned solid, with the highest point at 0, and its height before, mm."""
    flat, pitch = upright.surface, upright.surface.pitch_mm
    if is_under_surface:
        lowest = flat.heights_mm.min(where=flat.heights_mm > NOTHING_MM / 2, initial=0.0)
        floor = float(lowest) - SIDE_MM  # where the sides of the solid end
        x_mm, y_mm = flat.x_mm[[0, -1]], flat.y_mm[[0, -1]]
        corners = np.array([(x, y, z) for x in x_mm for y in y_mm for z in (0.0, floor)])
    else:
        corners = upright.triangles[0]
    half_mm = np.minimum(np.abs(corners @ rotation[:2].T).max(axis=0), REACH_MM)
    while np.prod(2 * half_mm / pitch + 3) > 2 * MAX_CELLS:
        pitch *= 2.0
    columns, rows = np.floor(half_mm / pitch + 0.5 + EDGE_MM).astype(int).tolist()
    heights = np.full((2 * rows + 3, 2 * columns + 3), NOTHING_MM, np.float32)
    if is_under_surface:
        source = np.ascontiguousarray(flat.heights_mm, np.float32)
        place = floor, float(flat.x_mm[0]), float(flat.y_mm[0]), flat.pitch_mm
        top = raise_to_map(source, *place, rotation, pitch, heights)
    else:
        if "blocks" not in upright.prepared:
            vertices, faces = upright.triangles
            upright.prepared["blocks"] = in_blocks(np.asarray(vertices)[faces], np.asarray(faces))
        solid, center = upright.prepared["blocks"], np.zeros(3)
        blocks = solid.blocks_near(rotation, center, half_mm, -FAR_MM, FAR_MM)
        mesh = solid.triangles_mm, solid.normals, *blocks, solid.is_closed
        place = rotation, center, pitch, FAR_MM, NOTHING_MM, heights
        top = raise_to_triangles(*mesh, 2 * FAR_MM, *place)
    if top == NOTHING_MM:
        raise T2TwinError(
            f"{upright.name} has no surface within {REACH_MM:g} mm of the press axis at this tilt"
        )
    heights -= np.float32(top)
    heights[heights < NOTHING_MM / 2] = NOTHING_MM
    x_mm, y_mm = (np.arange(-half - 1, half + 2) * pitch for half in (columns, rows))
    return HeightMap(heights, x_mm, y_mm), float(top)


@compiled(nogil=True)
def raise_to_map(source, floor, first_x, first_y, cell, rotation, pitch, heights):
    """Raise a map to the turned solid under another one, source, and return the greatest height."""
    ups = _ups(source, cell, rotation)
    # From here on x is in columns and y in rows of the map.
    turned, top, edge = rotation.copy(), NOTHING_MM, EDGE_MM / pitch
    turned[:2] /= pitch
    middle = np.array([heights.shape[1] // 2, heights.shape[0] // 2, 0.0])
    frame = (turned, middle, first_x, first_y, cell)
    to_right, to_upper = rotation[2, 0], rotation[2, 1]
    for i in range(source.shape[0] - 1):
        end = 0
        while end < source.shape[1] - 1:
            j = end
            end = j + 1
            if ups[i + 1, j + 1] == NOT_SOLID:
                continue
            # Cells of row i from column j to before end are one part; so are sides at them.
            end = _end_of_part(source, ups, i, j)
            lower, upper = ups[i, j + 1], ups[i + 2, j + 1]
            left, right = ups[i + 1, j], ups[i + 1, end + 1]
            a, b = _at(frame, i, j, source[i, j]), _at(frame, i, end, source[i, end])
            c = _at(frame, i + 1, end, source[i + 1, end])
            d = _at(frame, i + 1, j, source[i + 1, j])
            ab, bc = _shift(lower, -to_upper, edge), _shift(right, to_right, edge)
            cd, da = _shift(upper, to_upper, edge), _shift(left, -to_right, edge)
            top = _raise_face(a, b, c, ab, bc, edge, top, heights)
            top = _raise_face(a, c, d, edge, cd, da, top, heights)
            if lower == NOT_SOLID and to_upper < 0.0:
                top = _raise_side(frame, a, b, (i, j), (i, end), floor, edge, top, heights)
            if right == NOT_SOLID and to_right > 0.0:
                top = _raise_side(frame, b, c, (i, end), (i + 1, end), floor, edge, top, heights)
            if upper == NOT_SOLID and to_upper > 0.0:
                top = _raise_side(frame, c, d, (i + 1, end), (i + 1, j), floor, edge, top, heights)
            if left == NOT_SOLID and to_right < 0.0:
                top = _raise_side(frame, d, a, (i + 1, j), (i, j), floor, edge, top, heights)
    return top


@compiled(nogil=True)
def _raise_side(frame, one, other, at, then, floor, edge, top, heights):
    """Raise to the side below two points, at two places of the source."""
    below, after = _at(frame, at[0], at[1], floor), _at(frame, then[0], then[1], floor)
    top = _raise_face(below, after, other, edge, edge, edge, top, heights)
    return _raise_face(below, other, one, edge, edge, edge, top, heights)


@compiled(inline="always")
def _raise_face(a, b, c, ab, bc, ca, top, heights):
    """Raise to a triangle that faces up. ab, bc, ca: columns by which its sides move outward."""
    area = (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])
    if area > 0.0:
        top = raise_to_triangle(a, b, c, area, ab, bc, ca, np.inf, top, heights)
    return top


@compiled(inline="always")
def _shift(beyond, up, edge):
    """Columns by which an edge moves outward. beyond: its neighbor. up: of a side in its place."""
    return OUTLINE if (up if beyond == NOT_SOLID else beyond) < STEEP else edge


@compiled(inline="always")
def _at(frame, i, j, height):
    """The point at a height over a point of the source, in columns, rows and mm of the map."""
    turned, middle, first_x, first_y, cell = frame
    return moved(turned, middle, (first_x + j * cell, first_y + i * cell, height))


@compiled(nogil=True)
def _end_of_part(source, ups, i, j):
    """The column after the plane part of a row from a cell, whose neighbors are of one kind."""
    start, along = np.float64(source[i, j]), np.float64(source[i, j + 1] - source[i, j])
    across = np.float64(source[i + 1, j] - source[i, j])
    end = j + 1
    if abs(source[i + 1, end] - (start + along + across)) > EVEN_MM:
        return end
    lower, upper = _kind(ups[i, j + 1]), _kind(ups[i + 2, j + 1])
    while ups[i + 1, end + 1] != NOT_SOLID:
        expected = start + along * (end + 1 - j)
        if (
            abs(source[i, end + 1] - expected) > EVEN_MM
            or abs(source[i + 1, end + 1] - (expected + across)) > EVEN_MM
            or _kind(ups[i, end + 1]) != lower
            or _kind(ups[i + 2, end + 1]) != upper
        ):
            break
        end += 1
    return end


@compiled(inline="always")
def _kind(up):
    """Whether a cell is not solid, 2; steep, 1; or neither, 0."""
    return 2 if up == NOT_SOLID else (1 if up < STEEP else 0)


@compiled(nogil=True)
def _ups(source, cell, rotation):
    """(ny + 1, nx + 1) vertical components of the cells' turned unit normals, or NOT_SOLID."""
    ups = np.full((source.shape[0] + 1, source.shape[1] + 1), NOT_SOLID)
    for i in range(source.shape[0] - 1):
        for j in range(source.shape[1] - 1):
            a, b = source[i, j], source[i, j + 1]
            c, d = source[i + 1, j], source[i + 1, j + 1]
            if min(a, b, c, d) > NOTHING_MM / 2:
                x, y = (a + c - b - d) / (2 * cell), (a + b - c - d) / (2 * cell)
                up = rotation[2, 0] * x + rotation[2, 1] * y + rotation[2, 2]
                ups[i + 1, j + 1] = up / np.sqrt(x * x + y * y + 1.0)
    return ups
