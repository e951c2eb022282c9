"""Writes the bundled meshes and height maps from the CAD solids.

    python -m t2twin.primitives_cad.write_bundled [NAME ...]

Run it after a change to a solid, its tessellation or the height maps. Without names it writes all.
"""

import io
import sys
import zipfile
from pathlib import Path

import numpy as np

from t2twin.core.files import atomic_write
from t2twin.primitives_cad import catalogue, tools
from t2twin.primitives_cad.bundled_shapes import packed, path_of
from t2twin.primitives_cad.shape import HeightMap


def write(names: tuple[str, ...] = catalogue.NAMES) -> None:
    """Write the files of catalogue shapes and of their tools."""
    meshes = {tool: tools.mesh(tool) for tool in sorted({_tool(name) for name in names} - {""})}
    for tool, mesh in meshes.items():
        _write(path_of(tool), _mesh_arrays(mesh.vertices, mesh.faces))
    for name in names:
        tool = meshes.get(_tool(name))
        shape = catalogue.build(name, tool)
        if tool is None:
            arrays = _mesh_arrays(shape.mesh.vertices, shape.mesh.faces)
        else:
            transform = catalogue.keypoint_transform(name)
            upright = tool.vertices @ transform[:3, :3].T + transform[:3, 3]
            # the height by which `height_map.aligned` has moved the mesh
            transform[2, 3] += (shape.mesh.vertices[0] - upright[0])[2]
            arrays = {"transform": transform}
        _write(path_of(name), arrays | _surface_arrays(shape.surface))


def _tool(name: str) -> str:
    """The tool of a shape, "" for a primitive."""
    return name.partition("/")[0] if name in catalogue.OBJECTS else ""


def _mesh_arrays(vertices: np.ndarray, faces: np.ndarray) -> dict[str, np.ndarray]:
    return {
        "vertices": packed(np.asarray(vertices, np.float64)),
        "faces": packed(np.asarray(faces, np.int32)),
    }


def _surface_arrays(surface: HeightMap) -> dict[str, np.ndarray]:
    return {
        "heights": packed(np.asarray(surface.heights_mm, np.float32)),
        "shape": np.array(surface.heights_mm.shape),
        "pitch_mm": surface.x_mm[surface.x_mm.size // 2 + 1],
    }


def _write(path: Path, arrays: dict[str, np.ndarray]) -> None:
    """Write an .npz with LZMA compression and fixed dates, so that its bytes are reproducible."""
    with atomic_write(path) as temporary, zipfile.ZipFile(temporary, "w") as archive:
        for name, values in arrays.items():
            content = io.BytesIO()
            np.save(content, values)
            entry = zipfile.ZipInfo(f"{name}.npy")  # dated 1980
            entry.compress_type = zipfile.ZIP_LZMA
            archive.writestr(entry, content.getvalue())


if __name__ == "__main__":
    write(tuple(sys.argv[1:]) or catalogue.NAMES)
