"""Surfaces of a MuJoCo model: triangles of its geoms, and height maps of its bodies over a sensor.

The sensor frame and the shape frame are those of t2twin.primitives_cad.shape. A height map of a
body is in the shape frame of a press at x = y = yaw = 0. Its x is the sensor's x, its y is minus
the sensor's y, and its height is minus the sensor's z.
"""

# MuJoCo defines its names at import, where pyright does not find them.
# pyright: reportAttributeAccessIssue=false

from collections.abc import Collection
from dataclasses import dataclass
from functools import cache
from typing import TYPE_CHECKING, Literal, NamedTuple, get_args
from weakref import WeakKeyDictionary

import numpy as np

from t2twin.attachment.rasterize import (
    CAPSULE,
    CYLINDER,
    ELLIPSOID,
    PLANE,
    SPHERE,
    lower_to_top,
    raise_to_primitive,
)
from t2twin.core import arguments
from t2twin.core.errors import T2TwinError
from t2twin.primitives_cad.height_map import PITCH_MM
from t2twin.primitives_cad.shape import NOTHING_MM, HeightMap
from t2twin.primitives_cad.triangles import EDGE_MM, Triangles, in_blocks, raise_to_triangles
from t2twin.sim.contact.elastomer import Elastomer

if TYPE_CHECKING:
    import mujoco

Geometry = Literal["collision", "visual"]

Asset = tuple[int, int, bool]
"""A geom's type, its asset, and whether of the asset's convex hull."""

MARGIN_MM = 1.0
"""Width of a map beyond the pad's outline, mm (assumed: more than a surface moves by shear)."""

DEPTH = 1.5
"""Depth of a map below the highest point, in thicknesses of the layer (assumed). A contact is at
most one thickness below the apex; the rest is for points beyond the pad."""

BEHIND_MM = 10.0
"""Depth below the apex, mm, from which on surfaces belong to other parts of a body (assumed: more
than MuJoCo's contacts penetrate)."""

SHAPE_FROM_SENSOR = np.array([[1.0], [-1.0], [-1.0]])
"""Signs of the shape frame's axes in the sensor frame."""

HFIELD, BOX, MESH, SDF = 1, 6, 7, 8
"""Values of MuJoCo's mjtGeom."""

MM_PER_M = 1000.0


@dataclass(frozen=True)
class Region:
    """The part of a sensor's surroundings in which a body can touch it.

    half_x_mm, half_y_mm: half extents, centered on the sensor frame's origin. depth_mm: depth below
    a body's highest point that the map includes. pitch_mm: of the map.
    """

    half_x_mm: float
    half_y_mm: float
    depth_mm: float
    pitch_mm: float = PITCH_MM

    @classmethod
    def of(cls, elastomer: Elastomer, pitch_mm: float = PITCH_MM) -> "Region":
        """The region of a layer: its outline and MARGIN_MM, and DEPTH times its thickness."""
        half_x, half_y = elastomer.width_mm / 2, elastomer.length_mm / 2
        depth_mm = DEPTH * elastomer.thickness_mm
        return cls(half_x + MARGIN_MM, half_y + MARGIN_MM, depth_mm, pitch_mm)


class BodySurface(NamedTuple):
    """The surface of a body that faces a sensor.

    surface: in the shape frame at x = y = yaw = 0. z_mm: place of its highest point along the
    sensor's z; negative where MuJoCo's contacts penetrate.
    """

    surface: HeightMap
    z_mm: float


def body_surface(
    model: "mujoco.MjModel",
    data: "mujoco.MjData",
    body_id: int,
    rotation: np.ndarray,
    position_m: np.ndarray,
    region: Region,
    geometry: Geometry = "collision",
    excluded: Collection[int] = (),
) -> BodySurface | None:
    """The surface of a body, and of all bodies welded to it, over a sensor; None without any.

    rotation: (3, 3), its columns the sensor's x, y and z in the world. position_m: (3,) of the
    sensor's origin in the world, m. geometry: see `body_geoms`. excluded: ids of geoms that are
    left out. Poses are those of the last forward kinematics of `data`, which is not changed.
    A plane is a half space. A mesh that MuJoCo collides has the faces of its convex hull, and with
    "visual" its own.
    """
    geoms = body_geoms(model, body_id, geometry)
    to_shape = SHAPE_FROM_SENSOR * np.asarray(rotation, float).T
    centers_mm = MM_PER_M * (data.geom_xpos[geoms] - position_m) @ to_shape.T
    half_mm = np.array((region.half_x_mm, region.half_y_mm))
    near = _near(model, geoms, centers_mm, half_mm)
    geoms, centers_mm = geoms[near], centers_mm[near]
    rotations = np.ascontiguousarray(to_shape @ data.geom_xmat[geoms].reshape(-1, 3, 3))
    pitch = region.pitch_mm
    columns, rows = np.floor(half_mm / pitch + EDGE_MM).astype(int)
    heights = np.full((2 * rows + 3, 2 * columns + 3), NOTHING_MM, np.float32)
    top = NOTHING_MM
    for geom, center, turn in zip(geoms.tolist(), centers_mm, rotations, strict=True):
        if geom in excluded:
            continue
        place = turn, center, pitch, BEHIND_MM, top, heights
        kind = int(model.geom_type[geom])
        if kind in (PLANE, SPHERE, CAPSULE, ELLIPSOID, CYLINDER):
            top = raise_to_primitive(kind, MM_PER_M * model.geom_size[geom], *place)
        else:
            mesh = triangles_of(model, geom, geometry == "collision")
            lowest_mm = top - region.depth_mm
            blocks = mesh.blocks_near(turn, center, half_mm, lowest_mm, BEHIND_MM)
            solid = mesh.triangles_mm, mesh.normals, *blocks, mesh.is_closed
            top = raise_to_triangles(*solid, region.depth_mm, *place)
    if top == NOTHING_MM:
        return None
    used_rows, used_columns = (np.zeros(size, bool) for size in heights.shape)
    lower_to_top(heights, top, region.depth_mm, used_rows, used_columns)
    (first_row, last_row), (first, last) = (
        np.flatnonzero(used)[[0, -1]] for used in (used_rows, used_columns)
    )
    surface = HeightMap(
        heights[first_row - 1 : last_row + 2, first - 1 : last + 2].copy(),
        x_mm=(np.arange(first - 1, last + 2) - (columns + 1)) * pitch,
        y_mm=(np.arange(first_row - 1, last_row + 2) - (rows + 1)) * pitch,
    )
    return BodySurface(surface, -top)


def body_geoms(model: "mujoco.MjModel", body_id: int, geometry: Geometry) -> np.ndarray:
    """Ids of the geoms of a body and of all bodies welded to it.

    geometry: "collision" for those that can collide.
    "visual" for those that cannot, or all of a body that has only geoms that can.
    """
    arguments.choice(geometry, "geometry", get_args(Geometry))
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


def _near(
    model: "mujoco.MjModel", geoms: np.ndarray, centers_mm: np.ndarray, half_mm: np.ndarray
) -> np.ndarray:
    """Which geoms may be over the region; the radius of a plane is 0."""
    radius_mm = MM_PER_M * model.geom_rbound[geoms]
    reached = (np.abs(centers_mm[:, :2]) <= half_mm + radius_mm[:, None]).all(axis=1)
    reached &= centers_mm[:, 2] - radius_mm <= BEHIND_MM
    return reached | (model.geom_type[geoms] == PLANE)


_known: "WeakKeyDictionary[mujoco.MjModel, dict[Asset, tuple[np.ndarray, Triangles]]]" = (
    WeakKeyDictionary()
)
"""Triangles of living models, with a height field's data."""


def triangles_of(model: "mujoco.MjModel", geom: int, hull: bool = False) -> Triangles:
    """The triangles of a box, mesh, sdf or hfield. hull: of a mesh, those of its convex hull, which
    MuJoCo collides, if the model has it.

    Those of an asset are computed once, and again for a height field whose data has changed.
    Raises T2TwinError for other geoms.
    """
    kind, asset = int(model.geom_type[geom]), int(model.geom_dataid[geom])
    if kind == BOX:
        return _box(MM_PER_M * model.geom_size[geom])
    if asset < 0 or kind not in (HFIELD, MESH, SDF):
        raise T2TwinError(
            f"a geom of MuJoCo's type {kind} has no surface; expected a plane, sphere, capsule, "
            "ellipsoid, cylinder or box, or a mesh, sdf or hfield with its asset"
        )
    found = _known.setdefault(model, {})
    data = _hfield_data(model, asset) if kind == HFIELD else np.empty(0)
    key = kind, asset, hull and kind == MESH and model.mesh_graphadr[asset] >= 0
    if key not in found or not np.array_equal(found[key][0], data):
        triangles = _of_hfield(model, asset) if kind == HFIELD else _of_mesh(model, asset, key[2])
        found[key] = data.copy(), in_blocks(MM_PER_M * triangles)
    return found[key][1]


def _box(half_mm: np.ndarray) -> Triangles:
    cube = _cube()
    triangles_mm = (cube.triangles_mm * half_mm).astype(np.float32)
    return cube._replace(triangles_mm=triangles_mm, boxes_mm=cube.boxes_mm * half_mm)


@cache
def _cube() -> Triangles:
    """A box with half extents of 1 mm."""
    return in_blocks(_of_field(np.ones((2, 2)), np.ones(2), 1.0))


def _hfield_data(model: "mujoco.MjModel", hfield: int) -> np.ndarray:
    start, size = model.hfield_adr[hfield], model.hfield_nrow[hfield] * model.hfield_ncol[hfield]
    return model.hfield_data[start : start + size]


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


def _of_hfield(model: "mujoco.MjModel", hfield: int) -> np.ndarray:
    """Triangles of a height field, (n, 3, 3), m."""
    half_x, half_y, scale, base = model.hfield_size[hfield]
    shape = int(model.hfield_nrow[hfield]), int(model.hfield_ncol[hfield])
    heights = scale * _hfield_data(model, hfield).reshape(shape)
    return _of_field(heights, np.array([half_x, half_y]), base)


def _of_field(heights: np.ndarray, half: np.ndarray, base: float) -> np.ndarray:
    """Triangles, (n, 3, 3), of the solid between heights (rows, columns) over x and y, and -base.

    half: (2,) half extents along x and y.
    """
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
