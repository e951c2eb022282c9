"""What the scene is made of: an elastomer's deformed surface in the colors of its pressure, with
the taxels on it, and the shape, whole or cut open."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Any, Literal

import numpy as np
import trimesh
from numpy.typing import ArrayLike
from trimesh.exchange.gltf import export_glb
from trimesh.intersections import slice_faces_plane

from t2twin.primitives_cad.shape import NOTHING_MM, Shape
from t2twin.sim.contact.types import Contact
from t2twin.sim.cyskin.layout import Layout
from t2twin.studio.view.colors import colored

ShownAs = Literal["glass", "solid", "cut open", "hidden"]
"""How the shape is drawn."""

SIDE_RGB = (96, 101, 110)
"""Colour of an elastomer's sides."""

RIM_RGB = (235, 235, 235)
"""Colour of the ring round a taxel's disc."""

RIM, RIM_ABOVE_MM, PAD_ABOVE_MM = 1.12, 0.08, 0.12
"""Diameter of that ring over the disc's, and how far above the surface either is drawn, mm, so that
they are seen."""

PAD_CORNERS = 32
"""Corners of a taxel's disc."""

LIGHT, SHADE = np.array([-0.35, -0.45, 0.82]), 0.3
"""Where the light on a surface comes from, and the share of its color that depends on that: enough
to see the shape, little enough to read the colors."""

REACH_MM = 19.5
"""How far from the press axis a shape is drawn, mm, so that two sensors fit side by side."""

MAX_FACES = 200_000
"""Triangles of a shape that are drawn (assumed: some MB for the browser); of one with more, its
pressing surface."""

UNLIT = "KHR_materials_unlit"
"""glTF's extension for colors that no light of the scene changes."""


@dataclass(frozen=True)
class SceneMesh:
    """Corners, (V, 3) mm, their colors, (V, 3) uint8, and triangles, (F, 3)."""

    corners: np.ndarray
    colors: np.ndarray
    faces: np.ndarray


def elastomer_part(contact: Contact, most_kpa: float) -> SceneMesh:
    """An elastomer in the sensor frame: its deformed surface in colors from 0 to most_kpa, and its
    sides."""
    z = _surface_mm(contact)
    x, y = np.meshgrid(contact.x_mm, contact.y_mm)
    top = np.stack([x, y, z], axis=-1).reshape(-1, 3)
    faces, rim = _grid_faces(*z.shape)
    bottom = top[rim] * (1, 1, 0) - (0, 0, contact.elastomer.thickness_mm)
    n = rim.size
    upper, lower = len(top) + np.arange(n), len(top) + n + np.arange(n)
    beside = np.roll(np.arange(n), -1)
    sides = np.concatenate([
        np.stack([upper, lower, lower[beside]], axis=-1),
        np.stack([upper, lower[beside], upper[beside]], axis=-1),
    ])  # fmt: skip
    slope_y, slope_x = np.gradient(z, contact.pitch_mm)
    normals = np.stack([-slope_x, -slope_y, np.ones_like(z)], axis=-1)
    lit = (normals @ LIGHT) / np.linalg.norm(normals, axis=-1) / LIGHT[2]
    share = np.clip(1 - SHADE + SHADE * lit, 0.0, 1.2).reshape(-1, 1)
    shaded = np.clip(share * colored(contact.pressure_kpa.ravel(), most_kpa), 0, 255)
    return SceneMesh(
        np.concatenate([top, top[rim], bottom]),
        np.concatenate([shaded, np.tile(SIDE_RGB, (2 * n, 1))]).astype(np.uint8),
        np.concatenate([faces, sides]),
    )


def taxels_part(contact: Contact, layout: Layout, counts: np.ndarray, most: float) -> SceneMesh:
    """The taxels as discs on the surface, in colors from 0 to most, counts."""
    radius = layout.pad_diameter_mm / 2
    x, y = np.meshgrid(contact.x_mm, contact.y_mm)
    far = np.hypot(x - layout.x_mm[:, None, None], y - layout.y_mm[:, None, None])
    under = np.where(far <= RIM * radius[:, None, None], _surface_mm(contact), -np.inf)
    places = np.stack([layout.x_mm, layout.y_mm, under.max(axis=(1, 2))], axis=-1)
    disc, faces = _disc()
    colors = colored(counts.astype(np.float32), most)
    corners, painted = [], []
    for size, above_mm, rgb in (
        (RIM * radius, RIM_ABOVE_MM, np.tile(RIM_RGB, (layout.size, 1))),
        (radius, PAD_ABOVE_MM, colors),
    ):
        each = places[:, None] + disc * size[:, None, None] + (0.0, 0.0, above_mm)
        corners.append(each.reshape(-1, 3))
        painted.append(np.repeat(rgb, len(disc), axis=0).astype(np.uint8))
    starts = len(disc) * np.arange(2 * layout.size)
    return SceneMesh(
        np.concatenate(corners),
        np.concatenate(painted),
        (faces[None] + starts[:, None, None]).reshape(-1, 3),
    )


def as_glb(parts: Sequence[SceneMesh]) -> bytes:
    """Parts as one GLB, whose colors are as given, whatever the light."""
    starts = np.cumsum([0, *(len(part.corners) for part in parts[:-1])])
    # glTF has the colors of corners linear, screens have not (IEC 61966-2-1).
    srgb = np.concatenate([part.colors for part in parts]) / 255.0
    linear = np.where(srgb <= 0.04045, srgb / 12.92, ((srgb + 0.055) / 1.055) ** 2.4)
    mesh = trimesh.Trimesh(
        np.concatenate([part.corners for part in parts]),
        np.concatenate([part.faces + start for part, start in zip(parts, starts, strict=True)]),
        vertex_colors=np.rint(255.0 * linear).astype(np.uint8),
        process=False,
    )
    return export_glb(mesh.scene(), include_normals=False, tree_postprocessor=_unlit)


def cut_open(mesh: trimesh.Trimesh, yaw_rad: float) -> trimesh.Trimesh:
    """Of a mesh in the shape frame the half that is farther from one who looks along the sensor's
    y."""
    # The sensor's y in the shape frame: turned back by yaw, then over about x.
    across = (np.sin(yaw_rad), -np.cos(yaw_rad), 0.0)
    return _half(mesh, across, (0.0, 0.0, 0.0))


def without_plate(mesh: trimesh.Trimesh, shape: Shape) -> trimesh.Trimesh:
    """Of a shape's mesh what stands above its base plate, which would hide the rest."""
    if shape.base_mm is None:
        return mesh
    return _half(mesh, (0.0, 0.0, 1.0), (0.0, 0.0, shape.base_mm))


def shape_pose(contact: Contact) -> tuple[np.ndarray, np.ndarray]:
    """Turn, (4,) as w, x, y, z, and place, (3,) mm, of the pressed shape in the sensor frame."""
    command, half = contact.command, contact.command.yaw_rad / 2
    # Over about x is the quaternion (0, 1, 0, 0); turned by yaw about z after that.
    turn = np.array([0.0, np.cos(half), np.sin(half), 0.0])
    return turn, np.array([command.x_mm, command.y_mm, -contact.shape_depth_mm])


def _unlit(tree: dict[str, Any]) -> None:
    tree["extensionsUsed"] = [UNLIT]
    tree["materials"] = [{"doubleSided": True, "extensions": {UNLIT: {}}}]
    for mesh in tree["meshes"]:
        for primitive in mesh["primitives"]:
            primitive["material"] = 0


@lru_cache(maxsize=8)
def _grid_faces(rows: int, columns: int) -> tuple[np.ndarray, np.ndarray]:
    """Triangles of a grid's corners, (F, 3), and its rim, (n,), all the way round."""
    at = np.arange(rows * columns).reshape(rows, columns)
    corners = at[:-1, :-1], at[:-1, 1:], at[1:, 1:], at[1:, :-1]
    a, b, c, d = (each.ravel() for each in corners)
    faces = np.concatenate([np.stack([a, b, c], axis=-1), np.stack([a, c, d], axis=-1)])
    rim = np.concatenate([at[0, :-1], at[:-1, -1], at[-1, :0:-1], at[:0:-1, 0]])
    return faces, rim


def near_mesh(shape: Shape) -> trimesh.Trimesh:
    """What is drawn of a shape, uncut, mm in the shape frame."""
    mesh = shape.mesh
    if len(mesh.faces) > MAX_FACES:
        mesh = _pressing_surface(shape)
    for normal in ((1.0, 0.0, 0.0), (-1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, -1.0, 0.0)):
        if np.abs(mesh.bounds[:, :2]).max() > REACH_MM:
            mesh = _half(mesh, normal, -REACH_MM * np.array(normal))
    return mesh


def _half(
    mesh: trimesh.Trimesh, normal: tuple[float, float, float], origin: ArrayLike
) -> trimesh.Trimesh:
    """What lies on a plane's normal's side; all of a mesh of which nothing does."""
    # The function for whole meshes needs shapely, for caps that are not wanted here.
    corners, faces, _ = slice_faces_plane(mesh.vertices, mesh.faces, normal, origin)
    return trimesh.Trimesh(corners, faces, process=False) if len(faces) else mesh


def _surface_mm(contact: Contact) -> np.ndarray:
    """(ny, nx): heights of the deformed surface in the sensor frame, mm."""
    rest = contact.elastomer.rest_surface_mm(*np.meshgrid(contact.x_mm, contact.y_mm))
    return rest - contact.surface_mm


def _disc() -> tuple[np.ndarray, np.ndarray]:
    """Corners and triangles of a disc of radius 1 in the plane z = 0."""
    angles = 2 * np.pi * np.arange(PAD_CORNERS) / PAD_CORNERS
    rim = np.stack([np.cos(angles), np.sin(angles), np.zeros(PAD_CORNERS)], axis=-1)
    here = 1 + np.arange(PAD_CORNERS)
    faces = np.stack([np.zeros(PAD_CORNERS, int), here, np.roll(here, -1)], axis=-1)
    return np.concatenate([np.zeros((1, 3)), rim]), faces


def _pressing_surface(shape: Shape) -> trimesh.Trimesh:
    """The height map, thinned to MAX_FACES, without what is not there."""
    surface = shape.surface
    step = int(np.ceil(np.sqrt(2 * surface.heights_mm.size / MAX_FACES)))
    heights = surface.heights_mm[::step, ::step]
    x, y = np.meshgrid(surface.x_mm[::step], surface.y_mm[::step])
    faces, _ = _grid_faces(*heights.shape)
    there = (heights > NOTHING_MM / 2).ravel()
    faces = faces[there[faces].all(axis=1)]
    return trimesh.Trimesh(np.stack([x, y, heights], axis=-1).reshape(-1, 3), faces, process=False)
