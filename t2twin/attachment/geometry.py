"""Surfaces of a MuJoCo model: triangles of its geoms, and height maps of its bodies over a sensor.

A height map is in the shape frame of a press at x = y = yaw = 0. Its x is the sensor's x; its y
and its height are minus the sensor's y and z.
"""

# MuJoCo defines its names at import, where pyright does not find them.
# pyright: reportAttributeAccessIssue=false

from dataclasses import dataclass
from functools import cache
from typing import TYPE_CHECKING, Literal
from weakref import WeakKeyDictionary

import numpy as np

from t2twin.core.errors import T2TwinError
from t2twin.core.jit import compiled
from t2twin.primitives_cad.height_map import (
    EDGE_MM,
    FAST,
    OUTLINE,
    PITCH_MM,
    STEEP,
    Triangles,
    in_blocks,
    raise_to_triangles,
)
from t2twin.primitives_cad.shape import NOTHING_MM, HeightMap
from t2twin.sim.contact.elastomer import Elastomer
from t2twin.sim.contact.grid import extent

if TYPE_CHECKING:
    import mujoco

Geometry = Literal["collision", "visual"]

# A geom's type, its asset, and whether of the asset's convex hull.
Asset = tuple[int, int, bool]
# Width of a map beyond the pad's outline, mm (assumed: more than a surface moves by shear).
MARGIN_MM = 1.0
# Depth of a map below the highest point, in thicknesses of the layer (assumed). A contact is at
# most one thickness below the apex; the rest is for points beyond the pad.
DEPTH = 1.5
# Depth below the apex, mm, from which on surfaces belong to other parts of a body (assumed: more
# than MuJoCo's contacts penetrate).
BEHIND_MM = 10.0
SHAPE_FROM_SENSOR = np.array([[1.0], [-1.0], [-1.0]])  # signs of the shape frame's axes
PLANE, HFIELD, SPHERE, CAPSULE, ELLIPSOID, CYLINDER, BOX, MESH, SDF = range(9)  # MuJoCo's mjtGeom
MM_PER_M = 1000.0
MEAN_ALONG_AXES = 4 / np.pi  # mean over directions of a unit vector's sum of absolute components
# Smallest component of the vertical in a geom's frame, in place of smaller ones (assumed: it moves
# no surface of a meter by more than 1e-6 mm).
PARALLEL = 1.0e-9
FAR_MM = 1.0e6  # beyond every geom, mm
# Pitch at which geoms in the soft layer are searched, and how deep they are at least, mm (assumed).
LAYER_PITCH_MM, IN_LAYER_MM = 0.25, 0.05
LEVEL = 1.0e-12  # rounding of a place on the outline of a ball of radius 1


@dataclass(frozen=True)
class Region:
    """The part of a sensor's surroundings in which a body can touch it, about its origin."""

    half_x_mm: float
    half_y_mm: float
    depth_mm: float  # below a body's highest point
    pitch_mm: float = PITCH_MM
    behind_mm: float = BEHIND_MM

    @classmethod
    def of(cls, elastomer: Elastomer) -> "Region":
        """The region of a layer: its outline and MARGIN_MM, and DEPTH times its thickness."""
        half_x, half_y = elastomer.width_mm / 2, elastomer.length_mm / 2
        depth_mm = DEPTH * elastomer.thickness_mm
        return cls(half_x + MARGIN_MM, half_y + MARGIN_MM, depth_mm)


def body_surface(
    model: "mujoco.MjModel",
    data: "mujoco.MjData",
    body_id: int,
    rotation: np.ndarray,
    position_m: np.ndarray,
    region: Region,
    geometry: Geometry = "collision",
) -> tuple[HeightMap, float] | None:
    """The surface of a body, and of all bodies welded to it, over a sensor.

    With it comes the z of its highest point in the sensor frame, mm, negative where contacts
    penetrate. None without any. The surface is in the shape frame at x = y = yaw = 0.

    rotation, (3, 3), position_m, (3,): pose of the sensor in the world. geometry: see `body_geoms`.
    A plane is a half space. A mesh that MuJoCo collides has the faces of its convex hull, and with
    "visual" its own.
    """
    geoms, pitch = body_geoms(model, body_id, geometry), region.pitch_mm
    heights, top = _raised(model, data, geoms, rotation, position_m, region, geometry)
    if top == NOTHING_MM:
        return None
    heights -= np.float32(top)
    np.copyto(heights, NOTHING_MM, where=heights < -region.depth_mm)
    first_row, last_row, first, last = extent(heights > NOTHING_MM)
    surface = HeightMap(
        heights[first_row - 1 : last_row + 2, first - 1 : last + 2],
        x_mm=(np.arange(first - 1, last + 2) - heights.shape[1] // 2) * pitch,
        y_mm=(np.arange(first_row - 1, last_row + 2) - heights.shape[0] // 2) * pitch,
    )
    return surface, -top


def lying_in(
    model: "mujoco.MjModel", data: "mujoco.MjData", geoms: np.ndarray, rotation: np.ndarray,
    position_m: np.ndarray, elastomer: Elastomer,
) -> list[int]:  # fmt: skip
    """Those of the geoms that contain a part of the undeformed surface of a layer in a pose."""
    half_mm = np.array((elastomer.width_mm / 2, elastomer.length_mm / 2))
    region = Region(half_mm[0], half_mm[1], FAR_MM, LAYER_PITCH_MM, FAR_MM)
    low_mm, high_mm = _boxes(model, data, geoms, rotation, position_m)
    x, y = half_mm + LAYER_PITCH_MM
    near = (low_mm < (x, y, 0.0)) & (high_mm > (-x, -y, IN_LAYER_MM / 2 - elastomer.thickness_mm))
    found = []
    for geom in geoms[near.all(axis=1)].tolist():
        of_geom = model, data, np.array([geom])
        low, _ = _raised(*of_geom, rotation, position_m, region)
        high, _ = _raised(*of_geom, rotation * SHAPE_FROM_SENSOR.T, position_m, region)
        if model.geom_type[geom] == PLANE:
            low[low == NOTHING_MM], high[high == NOTHING_MM] = FAR_MM, FAR_MM
        y, x = (LAYER_PITCH_MM * (np.arange(size) - size // 2) for size in low.shape)
        rest = elastomer.rest_surface_mm(*np.meshgrid(x, y))
        is_under = (low[::-1] > NOTHING_MM) & (-low[::-1] < rest - IN_LAYER_MM)
        if (is_under & (high > rest + IN_LAYER_MM))[1:-1, 1:-1].any():
            found.append(geom)
    return found


def _raised(
    model: "mujoco.MjModel", data: "mujoco.MjData", geoms: np.ndarray, rotation: np.ndarray,
    position_m: np.ndarray, region: Region, geometry: Geometry = "collision",
) -> tuple[np.ndarray, float]:  # fmt: skip
    """The height map of geoms, with a rim, and its highest point, of none NOTHING_MM."""
    to_shape, pitch = SHAPE_FROM_SENSOR * np.asarray(rotation, float).T, region.pitch_mm
    half_mm = np.array((region.half_x_mm, region.half_y_mm))
    low_mm, high_mm = _boxes(model, data, geoms, to_shape.T, position_m)
    near = low_mm <= (*half_mm + pitch, region.behind_mm)
    near = near.all(axis=1) & (high_mm[:, :2] >= -half_mm - pitch).all(axis=1)
    reaches_mm = np.maximum(high_mm, -low_mm)[near, :2] + pitch
    half_mm, geoms = np.minimum(half_mm, reaches_mm.max(axis=0, initial=0.0)), geoms[near]
    centers_mm = MM_PER_M * (data.geom_xpos[geoms] - position_m) @ to_shape.T
    rotations = np.ascontiguousarray(to_shape @ data.geom_xmat[geoms].reshape(-1, 3, 3))
    columns, rows = np.floor(half_mm / pitch + EDGE_MM).astype(int)
    heights = np.full((2 * rows + 3, 2 * columns + 3), NOTHING_MM, np.float32)
    top = NOTHING_MM
    for geom, center, turn in zip(geoms.tolist(), centers_mm, rotations, strict=True):
        place = turn, center, pitch, region.behind_mm, top, heights
        kind = int(model.geom_type[geom])
        if kind in (PLANE, SPHERE, CAPSULE, ELLIPSOID, CYLINDER):
            top = raise_to_primitive(kind, MM_PER_M * model.geom_size[geom], *place)
        else:
            mesh = triangles_of(model, geom, geometry == "collision")
            lowest_mm = top - region.depth_mm
            blocks = mesh.blocks_near(turn, center, half_mm, lowest_mm, region.behind_mm)
            solid = mesh.triangles_mm, mesh.normals, *blocks, mesh.is_closed
            top = raise_to_triangles(*solid, region.depth_mm, *place)
    return heights, top


@compiled(nogil=True)
def covers_square(heights_mm, cells):
    """Whether a shape covers a square of cells x cells points of its map."""
    largest = np.zeros(heights_mm.shape[1] + 1, np.int64)  # squares that end in a row
    for i in range(heights_mm.shape[0]):
        before = 0
        for j in range(heights_mm.shape[1]):
            side = min(before, largest[j], largest[j + 1]) + 1
            before = largest[j + 1]
            largest[j + 1] = side if heights_mm[i, j] > NOTHING_MM / 2 else 0
            if largest[j + 1] >= cells:
                return True
    return False


def body_geoms(model: "mujoco.MjModel", body_id: int, geometry: Geometry) -> np.ndarray:
    """Ids of the geoms of a body and of all bodies welded to it.

    geometry: "collision" for those that can collide; "visual" for those that cannot, or all of a
    body that has only geoms that can.
    """
    welded = model.body_weldid[model.geom_bodyid] == model.body_weldid[body_id]
    collides = colliding(model)
    if geometry == "collision":
        return np.flatnonzero(welded & collides)
    has_visual = np.zeros(model.nbody, bool)
    has_visual[model.geom_bodyid[~collides]] = True
    return np.flatnonzero(welded & ~(collides & has_visual[model.geom_bodyid]))


def colliding(model: "mujoco.MjModel") -> np.ndarray:
    """(geoms,) bool: those that can collide, by their masks or in an explicit pair."""
    found = (model.geom_contype != 0) | (model.geom_conaffinity != 0)
    found[model.pair_geom1] = found[model.pair_geom2] = True
    return found


def _boxes(
    model: "mujoco.MjModel", data: "mujoco.MjData", geoms: np.ndarray, rotation: np.ndarray,
    position_m: np.ndarray,
) -> tuple[np.ndarray, np.ndarray]:  # fmt: skip
    """Least and greatest coordinates, (n, 3) mm, of geoms along a frame's axes."""
    turns, boxes_m = data.geom_xmat[geoms].reshape(-1, 3, 3), model.geom_aabb[geoms, :, None]
    centers_m = (turns @ boxes_m[:, :3])[..., 0] + data.geom_xpos[geoms] - position_m
    centers_mm = MM_PER_M * centers_m @ rotation
    halves_mm = MM_PER_M * (np.abs(rotation.T @ turns) @ boxes_m[:, 3:])[..., 0]
    return centers_mm - halves_mm, centers_mm + halves_mm


# Triangles of living models, with a height field's data.
_known: "WeakKeyDictionary[mujoco.MjModel, dict[Asset, tuple[np.ndarray, Triangles]]]" = (
    WeakKeyDictionary()
)


def triangles_of(model: "mujoco.MjModel", geom: int, hull: bool = False) -> Triangles:
    """The triangles of a box, mesh or its hull, sdf or hfield, computed once for each state of its
    data."""
    kind, asset = int(model.geom_type[geom]), int(model.geom_dataid[geom])
    if kind == BOX:
        cube, half_mm = _cube(), MM_PER_M * model.geom_size[geom]
        triangles_mm = (cube.triangles_mm * half_mm).astype(np.float32)
        return cube._replace(triangles_mm=triangles_mm, boxes_mm=cube.boxes_mm * half_mm)
    if asset < 0 or kind not in (HFIELD, MESH, SDF):
        raise T2TwinError(
            f"a geom of MuJoCo's type {kind} has no surface; expected a plane, sphere, capsule, "
            "ellipsoid, cylinder or box, or a mesh, sdf or hfield with its asset"
        )
    found = _known.setdefault(model, {})
    data = np.empty(0)
    if kind == HFIELD:
        start, size = model.hfield_adr[asset], model.hfield_nrow[asset] * model.hfield_ncol[asset]
        data = model.hfield_data[start : start + size]
    key = kind, asset, hull and kind == MESH and model.mesh_graphadr[asset] >= 0
    if key not in found or not np.array_equal(found[key][0], data):
        if kind == HFIELD:
            *half, scale, base = model.hfield_size[asset]
            shape = int(model.hfield_nrow[asset]), int(model.hfield_ncol[asset])
            triangles = _of_field(scale * data.reshape(shape), np.array(half), base)
        else:
            triangles = _of_mesh(model, asset, key[2])
        found[key] = data.copy(), in_blocks(MM_PER_M * triangles)
    return found[key][1]


@cache
def _cube() -> Triangles:
    """A box with half extents of 1 mm."""
    return in_blocks(_of_field(np.ones((2, 2)), np.ones(2), 1.0))


def _of_mesh(model: "mujoco.MjModel", mesh: int, hull: bool) -> np.ndarray:
    """Triangles of a mesh or of its convex hull, (n, 3, 3), m."""
    vertex, face = model.mesh_vertadr[mesh], model.mesh_faceadr[mesh]
    vertices = model.mesh_vert[vertex : vertex + model.mesh_vertnum[mesh]]
    if not hull:
        return vertices[model.mesh_face[face : face + model.mesh_facenum[mesh]]]
    # the graph: numbers of vertices and faces, two addresses a vertex, edges, and the faces
    graph = model.mesh_graph[model.mesh_graphadr[mesh] :]
    points, faces = int(graph[0]), int(graph[1])
    start = 2 + 3 * points + 3 * faces
    return vertices[graph[start : start + 3 * faces].reshape(-1, 3)]


def _of_field(heights: np.ndarray, half: np.ndarray, base: float) -> np.ndarray:
    """Triangles, (n, 3, 3), of the solid between heights over half extents and -base."""
    rows, columns = heights.shape
    x, y = np.linspace(-half[0], half[0], columns), np.linspace(-half[1], half[1], rows)
    x, y = np.meshgrid(x, y)
    top = np.stack((x, y, heights), axis=2)
    bottom = np.stack((x, y, np.full_like(x, -base)), axis=2)
    faces = (
        top,
        bottom[:, ::-1],
        np.stack((bottom[0], top[0])),
        np.stack((top[-1], bottom[-1])),
        np.stack((top[:, 0], bottom[:, 0])),
        np.stack((bottom[:, -1], top[:, -1])),
    )
    return np.concatenate([_of_grid(points) for points in faces])


def _of_grid(points: np.ndarray) -> np.ndarray:
    """Two triangles a cell of a grid of points, (rows, columns, 3): (n, 3, 3)."""
    first, right = points[:-1, :-1], points[:-1, 1:]
    below, across = points[1:, :-1], points[1:, 1:]
    halves = np.stack((first, right, across)), np.stack((first, across, below))
    return np.stack(halves).transpose(0, 2, 3, 1, 4).reshape(-1, 3, 3)


# Loops that raise a map, (2 rows + 3, 2 columns + 3) float32, centered on the axis, with a rim of
# NOTHING_MM, to a geom with a formula; for triangles see t2twin.primitives_cad.height_map. A geom's
# pose is its rotation to the shape frame, (3, 3), and its center, (3,). Surfaces above `behind` are
# left out. Each loop takes the greatest height so far and returns the new one.


@compiled(nogil=True)
def raise_to_primitive(kind, size, rotation, center, pitch, behind, top, heights):
    """Raise a map to a geom with a formula. size: (3,) as geom_size, mm."""
    size = size.copy()
    if kind == CYLINDER:
        is_upright, is_lying = abs(rotation[2, 2]) > 1.0 - STEEP**2 / 2, abs(rotation[2, 2]) < STEEP
        along_axes = abs(rotation[0, 2]) + abs(rotation[1, 2])
        size[0] += OUTLINE * pitch * MEAN_ALONG_AXES if is_upright else EDGE_MM
        size[1] += OUTLINE * pitch * along_axes if is_lying else EDGE_MM
    middle_row, middle_column = heights.shape[0] // 2, heights.shape[1] // 2
    reach = _half_extent(kind, size, rotation[1])
    first_row, last_row = _grid_lines(center[1], reach, pitch, middle_row)
    reach = _half_extent(kind, size, rotation[0])
    first, last = _grid_lines(center[0], reach, pitch, middle_column)
    if last < first:
        return top
    x, found = np.empty(last - first + 1), np.empty(last - first + 1)
    for n in range(x.size):
        x[n] = (first + n) * pitch - center[0]
    start, up, per_mm = np.empty(3), np.empty(3), np.zeros(3)
    for axis in range(3):
        up[axis] = rotation[2, axis] if abs(rotation[2, axis]) > PARALLEL else PARALLEL
        per_mm[axis] = 1.0 / size[axis if kind == ELLIPSOID else 0]
    round_per_mm = per_mm.copy()
    per_mm[2] = 0.0 if kind in (CYLINDER, CAPSULE) else per_mm[2]
    half = size[1] if kind in (CYLINDER, CAPSULE) else np.inf
    for row in range(first_row, last_row + 1):
        y = row * pitch - center[1]
        for axis in range(3):
            start[axis] = rotation[1, axis] * y
        for n in range(x.size):
            found[n] = NOTHING_MM
        if kind == PLANE:
            for n in range(x.size):
                if up[2] > PARALLEL:  # else its surface faces away
                    found[n] = -(start[2] + rotation[0, 2] * x[n]) / up[2]
        else:
            _solid(x, start, rotation[0], up, per_mm, half, found)
        if kind == CAPSULE:
            for sign in (-1.0, 1.0):
                start[2] = rotation[1, 2] * y + sign * size[1]
                _solid(x, start, rotation[0], up, round_per_mm, np.inf, found)
        out = heights[row + middle_row, first + middle_column : last + middle_column + 1]
        top = _raise_row(found, center[2], behind, top, out)
    return top


@compiled(**FAST)
def _solid(x, start, along, up, per_mm, half, found):
    """Raise heights to an ellipsoid, or to a cylinder if per_mm is 0 along z, within half."""
    o0, o1, o2 = start[0] * per_mm[0], start[1] * per_mm[1], start[2] * per_mm[2]
    a0, a1, a2 = along[0] * per_mm[0], along[1] * per_mm[1], along[2] * per_mm[2]
    u0, u1, u2 = up[0] * per_mm[0], up[1] * per_mm[1], up[2] * per_mm[2]
    square = u0 * u0 + u1 * u1 + u2 * u2
    dot, change, per_square = o0 * u0 + o1 * u1 + o2 * u2, a0 * u0 + a1 * u1 + a2 * u2, 1 / square
    per_up, half = 1 / up[2], half / abs(up[2])
    for n in range(x.size):
        p0, p1, p2 = o0 + a0 * x[n], o1 + a1 * x[n], o2 + a2 * x[n]
        c0, c1, c2 = p1 * u2 - p2 * u1, p2 * u0 - p0 * u2, p0 * u1 - p1 * u0
        root = square - c0 * c0 - c1 * c1 - c2 * c2
        reach = np.sqrt(root if root > 0.0 else 0.0) * per_square
        middle, cap = -(dot + change * x[n]) * per_square, -(start[2] + along[2] * x[n]) * per_up
        upper, lower = min(middle + reach, cap + half), max(middle - reach, cap - half)
        height = upper if root >= -LEVEL * square and upper >= lower else NOTHING_MM
        found[n] = found[n] if found[n] > height else height


@compiled(**FAST)
def _raise_row(found, middle, behind, top, out):
    """Raise a row of a map to heights above `middle`; a NOTHING_MM among them is left out."""
    highest = np.float32(top)
    for n in range(out.size):
        height = np.float32(found[n] + middle if found[n] > NOTHING_MM else NOTHING_MM)
        height = height if height <= behind else np.float32(NOTHING_MM)
        out[n] = out[n] if out[n] > height else height
        highest = highest if highest > height else height
    return highest


@compiled(nogil=True)
def _grid_lines(center, reach, pitch, limit):
    """First and last grid line within reach of a center, which are within -limit and limit."""
    low, high = max(center - reach, -limit * pitch), min(center + reach, limit * pitch)
    first, last = int(np.ceil((low - EDGE_MM) / pitch)), int(np.floor((high + EDGE_MM) / pitch))
    return max(first, 1 - limit), min(last, limit - 1)


@compiled(nogil=True)
def _half_extent(kind, size, direction):
    """Half the extent of a geom, mm, along a unit vector in its frame."""
    x, y, z = abs(direction[0]), abs(direction[1]), abs(direction[2])
    if kind == PLANE:
        return np.inf
    if kind == ELLIPSOID:
        return np.sqrt((size[0] * x) ** 2 + (size[1] * y) ** 2 + (size[2] * z) ** 2)
    if kind == CYLINDER:
        return size[0] * np.sqrt(x * x + y * y) + size[1] * z
    return size[0] + (size[1] * z if kind == CAPSULE else 0.0)
