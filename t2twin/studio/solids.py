"""Meshes of the scene: the deformed surface of an elastomer, colored by pressure, the taxels on it,
and the shape, whole or cut open."""

from collections.abc import Sequence
from functools import lru_cache
from typing import Any, Literal

import numpy as np
import trimesh
from numpy.typing import ArrayLike
from trimesh.exchange.gltf import export_glb
from trimesh.intersections import slice_faces_plane

from t2twin.primitives_cad.shape import NOTHING_MM, Shape
from t2twin.primitives_cad.tilt import rotation_of
from t2twin.sim.contact.types import Contact, PressCommand
from t2twin.sim.taxels.layout import Layout
from t2twin.studio.colors import color_values

ShapeStyle = Literal["glass", "solid", "cut open", "hidden"]
"""Style of the shape."""

RIM_RGB = (235, 235, 235)
"""Color of the ring around a taxel's disc."""

RIM, RIM_ABOVE_MM, PAD_ABOVE_MM = 1.12, 0.08, 0.12
"""Diameter of the ring relative to the disc, and heights of both above the surface, mm."""

PAD_VERTICES = 32
"""Number of vertices of a taxel's disc."""

LIGHT, SHADE = np.array([-0.35, -0.45, 0.82]), 0.3
"""Direction of the light, and share of a color that depends on it, small enough to read colors."""

MAX_DISTANCE_MM = 19.5
"""Distance from the press axis up to which a shape is drawn, mm, so that two sensors fit."""

MAX_FACES = 200_000
"""Maximum number of drawn triangles of a shape (assumed: a few MB). Of larger shapes only the
pressing surface is drawn."""

UNLIT = "KHR_materials_unlit"
"""glTF extension for colors that are independent of the light."""


def elastomer_part(
    contact: Contact, max_kpa: float, side_rgba: Sequence[float] = (0.4, 0.4, 0.4, 1.0)
) -> trimesh.Trimesh:
    """Deformed surface of an elastomer in colors from 0 to max_kpa, with its sides."""
    side_rgb = np.rint(255 * np.array(side_rgba[:3]))
    z = surface_mm(contact)
    x, y = np.meshgrid(contact.x_mm, contact.y_mm)
    top = np.stack([x, y, z], axis=-1).reshape(-1, 3)
    faces, rim = _grid_faces(*z.shape)
    bottom = top[rim] * (1, 1, 0) - (0, 0, contact.elastomer.thickness_mm)
    n = rim.size
    upper, lower = len(top) + np.arange(n), len(top) + n + np.arange(n)
    following = np.roll(np.arange(n), -1)
    sides = np.concatenate([
        np.stack([upper, lower, lower[following]], axis=-1),
        np.stack([upper, lower[following], upper[following]], axis=-1),
    ])  # fmt: skip
    slope_y, slope_x = np.gradient(z, contact.pitch_mm)
    normals = np.stack([-slope_x, -slope_y, np.ones_like(z)], axis=-1)
    lit = (normals @ LIGHT) / np.linalg.norm(normals, axis=-1) / LIGHT[2]
    share = np.clip(1 - SHADE + SHADE * lit, 0.0, 1.2).reshape(-1, 1)
    shaded = np.clip(share * color_values(contact.pressure_kpa.ravel(), max_kpa), 0, 255)
    colors = np.concatenate([shaded, np.tile(side_rgb, (2 * n, 1))]).astype(np.uint8)
    vertices = np.concatenate([top, top[rim], bottom])
    return _colored(vertices, np.concatenate([faces, sides]), colors)


def taxels_part(
    contact: Contact, layout: Layout, counts: np.ndarray, max_counts: float
) -> trimesh.Trimesh:
    """Taxels as discs on the surface, in colors from 0 to max_counts."""
    radius = layout.pad_diameter_mm / 2
    x, y = np.meshgrid(contact.x_mm, contact.y_mm)
    far = np.hypot(x - layout.x_mm[:, None, None], y - layout.y_mm[:, None, None])
    under = np.where(far <= RIM * radius[:, None, None], surface_mm(contact), -np.inf)
    places = np.stack([layout.x_mm, layout.y_mm, under.max(axis=(1, 2))], axis=-1)
    disc, faces = _disc()
    colors = color_values(counts.astype(np.float32), max_counts)
    vertices, vertex_colors = [], []
    for size, above_mm, rgb in (
        (RIM * radius, RIM_ABOVE_MM, np.tile(RIM_RGB, (layout.size, 1))),
        (radius, PAD_ABOVE_MM, colors),
    ):
        each = places[:, None] + disc * size[:, None, None] + (0.0, 0.0, above_mm)
        vertices.append(each.reshape(-1, 3))
        vertex_colors.append(np.repeat(rgb, len(disc), axis=0).astype(np.uint8))
    starts = len(disc) * np.arange(2 * layout.size)
    all_faces = (faces[None] + starts[:, None, None]).reshape(-1, 3)
    return _colored(np.concatenate(vertices), all_faces, np.concatenate(vertex_colors))


def _colored(vertices: np.ndarray, faces: np.ndarray, colors: np.ndarray) -> trimesh.Trimesh:
    """A mesh of vertices, (V, 3) mm, and triangles, (F, 3). colors: of the vertices, (V, 3)."""
    return trimesh.Trimesh(vertices, faces, vertex_colors=linear_values(colors), process=False)


def as_glb(parts: Sequence[trimesh.Trimesh]) -> bytes:
    """Parts as one GLB file with unlit colors."""
    mesh: Any = trimesh.util.concatenate(list(parts))
    return export_glb(mesh.scene(), include_normals=False, tree_postprocessor=_unlit)


def linear_values(colors: np.ndarray) -> np.ndarray:
    """(..., 3) uint8: linear values of sRGB colors (IEC 61966-2-1), which glTF and arrows have."""
    srgb = colors / 255.0
    linear = np.where(srgb <= 0.04045, srgb / 12.92, ((srgb + 0.055) / 1.055) ** 2.4)
    return np.rint(255.0 * linear).astype(np.uint8)


def cut_open(mesh: trimesh.Trimesh, command: PressCommand) -> trimesh.Trimesh:
    """The half of a mesh in the shape frame on the positive side of the sensor's y axis."""
    # The sensor's y axis in the shape frame: rotated back by the yaw, turned over, and tilted back.
    across = np.array((np.sin(command.yaw_rad), -np.cos(command.yaw_rad), 0.0))
    return _half(mesh, across @ rotation_of(*command.tilt_rad), (0.0, 0.0, 0.0))


def without_plate(mesh: trimesh.Trimesh, shape: Shape) -> trimesh.Trimesh:
    """The part of a shape's mesh above its base plate, which would hide the rest."""
    if shape.base_mm is None:
        return mesh
    return _half(mesh, (0.0, 0.0, 1.0), (0.0, 0.0, shape.base_mm))


def _unlit(tree: dict[str, Any]) -> None:
    tree["extensionsUsed"] = [UNLIT]
    tree["materials"] = [{"doubleSided": True, "extensions": {UNLIT: {}}}]
    for mesh in tree["meshes"]:
        for primitive in mesh["primitives"]:
            primitive["material"] = 0


@lru_cache(maxsize=8)
def _grid_faces(rows: int, columns: int) -> tuple[np.ndarray, np.ndarray]:
    """Triangles of a grid, (F, 3), and the vertices of its closed boundary, (n,)."""
    at = np.arange(rows * columns).reshape(rows, columns)
    cells = at[:-1, :-1], at[:-1, 1:], at[1:, 1:], at[1:, :-1]
    a, b, c, d = (each.ravel() for each in cells)
    faces = np.concatenate([np.stack([a, b, c], axis=-1), np.stack([a, c, d], axis=-1)])
    rim = np.concatenate([at[0, :-1], at[:-1, -1], at[-1, :0:-1], at[:0:-1, 0]])
    return faces, rim


def near_mesh(shape: Shape) -> trimesh.Trimesh:
    """Drawn mesh of a shape near the press axis, mm in the shape frame."""
    mesh = shape.mesh
    if len(mesh.faces) > MAX_FACES:
        mesh = _pressing_surface(shape)
    for normal in ((1.0, 0.0, 0.0), (-1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, -1.0, 0.0)):
        if np.abs(mesh.bounds[:, :2]).max() > MAX_DISTANCE_MM:
            mesh = _half(mesh, normal, -MAX_DISTANCE_MM * np.array(normal))
    return mesh


def _half(mesh: trimesh.Trimesh, normal: ArrayLike, origin: ArrayLike) -> trimesh.Trimesh:
    """The part of a mesh on the positive side of a plane; the whole mesh if there is none."""
    # trimesh's function for whole meshes requires shapely, for caps that are not needed here.
    vertices, faces, _ = slice_faces_plane(mesh.vertices, mesh.faces, normal, origin)
    return trimesh.Trimesh(vertices, faces, process=False) if len(faces) else mesh


def surface_mm(contact: Contact) -> np.ndarray:
    """(ny, nx) heights of the deformed surface in the sensor frame, mm."""
    rest = contact.elastomer.rest_surface_mm(*np.meshgrid(contact.x_mm, contact.y_mm))
    return rest - contact.surface_mm


def _disc() -> tuple[np.ndarray, np.ndarray]:
    """Vertices and triangles of a disc of radius 1 in the plane z = 0."""
    angles = 2 * np.pi * np.arange(PAD_VERTICES) / PAD_VERTICES
    rim = np.stack([np.cos(angles), np.sin(angles), np.zeros(PAD_VERTICES)], axis=-1)
    at = 1 + np.arange(PAD_VERTICES)
    faces = np.stack([np.zeros(PAD_VERTICES, int), at, np.roll(at, -1)], axis=-1)
    return np.concatenate([np.zeros((1, 3)), rim]), faces


def _pressing_surface(shape: Shape) -> trimesh.Trimesh:
    """Mesh of the height map, reduced to MAX_FACES triangles, without empty cells."""
    surface = shape.surface
    step = int(np.ceil(np.sqrt(2 * surface.heights_mm.size / MAX_FACES)))
    heights = surface.heights_mm[::step, ::step]
    x, y = np.meshgrid(surface.x_mm[::step], surface.y_mm[::step])
    faces, _ = _grid_faces(*heights.shape)
    exists = (heights > NOTHING_MM / 2).ravel()
    faces = faces[exists[faces].all(axis=1)]
    return trimesh.Trimesh(np.stack([x, y, heights], axis=-1).reshape(-1, 3), faces, process=False)
