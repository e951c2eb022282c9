"""Tilted shapes: a solid turned about its origin, and the height map that it then has.

A solid in any pose has the upper envelope of its mesh. A shape that is known by its height map only
is all that lies under this map. Where the map ends, and where it steps, its sides are vertical.
"""

from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from t2twin.core.errors import T2TwinError
from t2twin.primitives_cad.height_map import EDGE_MM, MAX_CELLS, REACH_MM
from t2twin.primitives_cad.map_solid import SIDE_MM, raise_to_map
from t2twin.primitives_cad.shape import NOTHING_MM, HeightMap, Shape
from t2twin.primitives_cad.triangles import Triangles, in_blocks, raise_to_triangles

if TYPE_CHECKING:
    import trimesh

MAX_TILT_DEG = 30.0
"""Largest tilt about either axis, degrees (assumed: several times what a robot's press is off)."""

FAR_MM = 1.0e4
"""A height beyond every solid, mm."""

SIDES_NOTE = (
    "{} has no mesh; its height map does not show its sides, which are taken as vertical where a "
    "tilt turns them up"
)


class TiltedShape(Shape):
    """A shape tilted about its origin, with its highest point at 0 again.

    upright: the shape before. rotation: (3, 3) that turns its points.
    """

    upright: Shape
    rotation: np.ndarray

    def __init__(self, upright: Shape, tilt_x_rad: float, tilt_y_rad: float) -> None:
        rotation = rotation_of(tilt_x_rad, tilt_y_rad)
        surface, rise_mm = _surface(upright, rotation)
        base_mm, slope, up = upright.base_mm, (0.0, 0.0), rotation[:, 2]
        if base_mm is not None:
            base_mm = float(base_mm / up[2] - rise_mm)
            slope = (float(-up[0] / up[2]), float(-up[1] / up[2]))
        notes = upright.notes
        if not len(upright.triangles[1]):
            notes = (*notes, SIDES_NOTE.format(upright.name))
        fields = {
            "name": upright.name,
            "surface": surface,
            "spacing_mm": upright.spacing_mm,
            "parameters": upright.parameters,
            "base_mm": base_mm,
            "base_slope": slope,
            "notes": notes,
            "upright": upright,
            "rotation": rotation,
            "rise_mm": rise_mm,
        }
        for name, value in fields.items():
            object.__setattr__(self, name, value)

    @cached_property
    def triangles(self) -> tuple[np.ndarray, np.ndarray]:  # pyright: ignore[reportIncompatibleVariableOverride]
        """Vertices (n, 3), mm, and faces (m, 3) of the mesh."""
        vertices, faces = self.upright.triangles
        return vertices @ self.rotation.T - (0.0, 0.0, self.rise_mm), faces

    @cached_property
    def mesh(self) -> "trimesh.Trimesh":  # pyright: ignore[reportIncompatibleVariableOverride]
        """The solid, mm."""
        import trimesh

        return trimesh.Trimesh(*self.triangles, process=False)


def tilted(shape: Shape, tilt_x_rad: float, tilt_y_rad: float) -> Shape:
    """A shape tilted about its origin, see t2twin.primitives_cad.shape; itself without a tilt.

    A shape keeps its last tilt. Raises T2TwinError where the tilt moves the shape out of reach.
    """
    if tilt_x_rad == 0.0 == tilt_y_rad:
        return shape
    tilt = tilt_x_rad, tilt_y_rad
    known = shape.prepared.get("tilted")
    if known is None or known[0] != tilt:
        known = tilt, TiltedShape(shape, *tilt)
        shape.prepared["tilted"] = known
    return known[1]


def rotation_of(tilt_x_rad: float, tilt_y_rad: float) -> np.ndarray:
    """(3, 3) the rotation of a tilt in the shape frame, about x first.

    In the sensor frame both are right-handed: F Ry(tilt_y) Rx(tilt_x) F with F = diag(1, -1, -1).
    """
    cos_x, sin_x = np.cos(tilt_x_rad), np.sin(tilt_x_rad)
    cos_y, sin_y = np.cos(tilt_y_rad), np.sin(tilt_y_rad)
    about_x = np.array([[1.0, 0.0, 0.0], [0.0, cos_x, -sin_x], [0.0, sin_x, cos_x]])
    about_y = np.array([[cos_y, 0.0, -sin_y], [0.0, 1.0, 0.0], [sin_y, 0.0, cos_y]])
    return about_y @ about_x


def quaternion_of(tilt_x_rad: float, tilt_y_rad: float, yaw_rad: float) -> np.ndarray:
    """w, x, y, z, (4,), of the rotation of a press from the shape frame to the sensor frame."""
    x, y, z = tilt_x_rad / 2, tilt_y_rad / 2, yaw_rad / 2
    # Turning over and tilting about x add up.
    over = np.array([-np.sin(x), np.cos(x)])
    (w, along_x), (along_y, along_z) = np.cos(y) * over, np.sin(y) * over * (1.0, -1.0)
    cos, sin = np.cos(z), np.sin(z)
    return np.array([
        cos * w - sin * along_z,
        cos * along_x - sin * along_y,
        cos * along_y + sin * along_x,
        cos * along_z + sin * w,
    ])  # fmt: skip


def _surface(upright: Shape, rotation: np.ndarray) -> tuple[HeightMap, float]:
    """The height map of a turned solid, with the highest point at 0, and its height before, mm."""
    corners = _corners(upright) @ rotation[:2].T
    half_mm = np.minimum(np.abs(corners).max(axis=0), REACH_MM)
    pitch = upright.surface.pitch_mm
    while np.prod(2 * half_mm / pitch + 3) > 2 * MAX_CELLS:
        pitch *= 2.0
    columns, rows = np.floor(half_mm / pitch + 0.5 + EDGE_MM).astype(int).tolist()
    heights = np.full((2 * rows + 3, 2 * columns + 3), NOTHING_MM, np.float32)
    if upright.is_under_surface:
        surface = upright.surface
        flat = np.ascontiguousarray(surface.heights_mm, np.float32)
        place = float(surface.x_mm[0]), float(surface.y_mm[0]), surface.pitch_mm
        top = raise_to_map(flat, *place, rotation, pitch, heights)
    else:
        solid, center = _blocks(upright), np.zeros(3)
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


def _corners(upright: Shape) -> np.ndarray:
    """(n, 3) points whose convex hull contains the solid, mm; of a height map without what its
    sides would have below SIDE_MM."""
    if not upright.is_under_surface:
        return upright.triangles[0]
    surface = upright.surface
    solid = surface.heights_mm[surface.heights_mm > NOTHING_MM / 2]
    heights = 0.0, float(solid.min(initial=0.0)) - SIDE_MM
    return np.array([
        (x, y, z) for x in surface.x_mm[[0, -1]] for y in surface.y_mm[[0, -1]] for z in heights
    ])  # fmt: skip


def _blocks(upright: Shape) -> Triangles:
    """The triangles of a shape's mesh in blocks, made once."""
    if "blocks" not in upright.prepared:
        vertices, faces = upright.triangles
        upright.prepared["blocks"] = in_blocks(np.asarray(vertices)[faces], np.asarray(faces))
    return upright.prepared["blocks"]
