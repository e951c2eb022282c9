"""Meshes and height maps of the catalogue, which are bundled with the package.

`python -m maintenance.write_bundled` writes them from the CAD solids, so that a press
does not need CadQuery. Each file is an .npz; its arrays are byte planes of differences between
neighbors, which compress well.

NAME.npz of a primitive: mesh and height map in the shape frame.
TOOL.npz: a tool's mesh in its own frame.
TOOL--KEYPOINT.npz: a height map, and the transform from the tool's frame to the shape frame.
"""

from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from t2twin.primitives_cad.shape import HeightMap, Shape

if TYPE_CHECKING:
    import trimesh

FOLDER = Path(__file__).parent / "bundled"


class BundledShape(Shape):
    """A shape of the catalogue; reads its mesh at the first use."""

    def __init__(self, name: str, **properties: Any) -> None:
        defaults = {"parameters": {}, "base_mm": None, "notes": ()}
        fields = defaults | properties | {"name": name, "surface": read_surface(name)}
        for field, value in fields.items():
            object.__setattr__(self, field, value)

    @cached_property
    def triangles(self) -> tuple[np.ndarray, np.ndarray]:  # pyright: ignore[reportIncompatibleVariableOverride]
        """Vertices (n, 3) float64, mm, and faces (m, 3) int32 of the mesh."""
        return read_mesh(self.name)

    @cached_property
    def mesh(self) -> "trimesh.Trimesh":  # pyright: ignore[reportIncompatibleVariableOverride]
        """The solid, mm, in the shape frame."""
        import trimesh

        return trimesh.Trimesh(*self.triangles, process=False)


def path_of(name: str) -> Path:
    """The file of a catalogue shape or a tool."""
    return FOLDER / f"{name.replace('/', '--')}.npz"


def read_surface(name: str) -> HeightMap:
    """The height map of a catalogue shape."""
    with np.load(path_of(name), allow_pickle=False) as file:
        rows, columns = (int(side) for side in file["shape"])
        heights = unpacked(file["heights"], np.uint32).view(np.float32).reshape(rows, columns)
        pitch_mm = float(file["pitch_mm"])
    x_mm, y_mm = (np.arange(-(n // 2), n // 2 + 1) * pitch_mm for n in (columns, rows))
    return HeightMap(heights, x_mm, y_mm)


def read_mesh(name: str) -> tuple[np.ndarray, np.ndarray]:
    """Vertices (n, 3) float64, mm, and faces (m, 3) int32 of a catalogue shape in the shape frame,
    or of a tool in its own."""
    with np.load(path_of(name), allow_pickle=False) as file:
        if "transform" in file:
            transform = file["transform"]
        else:
            vertices = unpacked(file["vertices"], np.uint64).view(np.float64).reshape(-1, 3)
            faces = unpacked(file["faces"], np.uint32).view(np.int32).reshape(-1, 3)
            return vertices, faces
    vertices, faces = read_mesh(name.partition("/")[0])
    return vertices @ transform[:3, :3].T + transform[:3, 3], faces


def unpacked(planes: np.ndarray, kind: type[np.unsignedinteger]) -> np.ndarray:
    """The values of maintenance.write_bundled.packed as unsigned integers of a type, (n,)."""
    differences = np.ascontiguousarray(planes.T).view(kind).ravel()
    return np.cumsum(differences, dtype=kind)
