"""Writes the bundled meshes and height maps: `python -m maintenance.write_bundled [NAME ...]`.

Run it after a change to a solid, its tessellation or the height maps. Without names it writes all.
"""

import io
import sys
import zipfile
from pathlib import Path

import cadquery as cq
import numpy as np
import trimesh

from t2twin.core.files import atomic_write
from t2twin.primitives_cad import catalogue, height_map, mesh_files, solids, tools
from t2twin.primitives_cad.catalogue import path_of
from t2twin.primitives_cad.shape import Shape

SAME_MM = 1.0e-7  # distance below which points coincide, mm: the CAD kernel's tolerance


def write(names: tuple[str, ...] = catalogue.NAMES) -> None:
    """Write the files of catalogue shapes and of their tools."""
    used = {name.partition("/")[0] for name in names if name in catalogue.OBJECTS}
    meshes = {tool: tool_mesh(tool) for tool in sorted(used)}
    for tool, mesh in meshes.items():
        _write(path_of(tool), _mesh_arrays(mesh.vertices, mesh.faces))
    for name in names:
        tool = meshes.get(name.partition("/")[0])
        shape = build(name, tool)
        if tool is None:
            arrays = _mesh_arrays(shape.mesh.vertices, shape.mesh.faces)
        else:
            transform = keypoint_transform(name)
            upright = tool.vertices @ transform[:3, :3].T + transform[:3, 3]
            # the height by which `height_map.aligned` has moved the mesh
            transform[2, 3] += (shape.mesh.vertices[0] - upright[0])[2]
            arrays = {"transform": transform}
        surface = shape.surface
        arrays |= {
            "heights": packed(np.asarray(surface.heights_mm, np.float32)),
            "shape": np.array(surface.heights_mm.shape),
            "pitch_mm": surface.x_mm[surface.x_mm.size // 2 + 1],
        }
        _write(path_of(name), arrays)


def build(name: str, tool: trimesh.Trimesh | None = None) -> Shape:
    """A catalogue shape computed from its CAD solid. tool: the tool's mesh, for its keypoint."""
    if name in catalogue.PRIMITIVES:
        mesh = tessellate_symmetric(solids.primitive(name))
    else:
        assert tool is not None
        mesh = tool.copy().apply_transform(keypoint_transform(name))
    mesh, heights = height_map.aligned(mesh)
    return Shape(name, mesh, heights, **catalogue.properties(name))


def tool_mesh(tool: str) -> trimesh.Trimesh:
    """A watertight mesh of a tool's CAD solid, mm, in the tool's own frame."""
    chordal_mm = tools.CHORDAL_MM.get(tool, mesh_files.CHORDAL_MM)
    return mesh_files.watertight(*mesh_files.triangles_of(tools.solid(tool), chordal_mm))


def tessellate_symmetric(
    solid: cq.Shape, chordal_mm: float = mesh_files.CHORDAL_MM
) -> trimesh.Trimesh:
    """A watertight mesh, exactly mirror symmetric, of a solid symmetric in x and in y, mm."""
    corner = cq.Workplane().box(*3 * [mesh_files.BEYOND_MM], centered=(False, False, True))
    points, triangles = mesh_files.triangles_of(solid.intersect(corner.val()))  # pyright: ignore[reportArgumentType]
    points[np.abs(points) < SAME_MM] = 0.0
    on_cut = (points[triangles][:, :, :2] == 0.0).all(axis=1).any(axis=1)
    triangles = triangles[~on_cut]
    all_points, all_triangles = [], []
    for turn, mirror in enumerate(((1, 1, 1), (-1, 1, 1), (-1, -1, 1), (1, -1, 1))):
        all_points.append(points * mirror)
        # Mirroring turns triangles inwards; reversing their vertices turns them back.
        order = triangles if turn % 2 == 0 else triangles[:, ::-1]
        all_triangles.append(order + turn * len(points))
    return mesh_files.watertight(np.concatenate(all_points), np.concatenate(all_triangles))


def keypoint_transform(name: str) -> np.ndarray:
    """(4, 4) transform from a tool's frame to the frame of one of its shapes, up to the height."""
    tool, _, at = name.partition("/")
    point_mm, (x, y, cosine) = tools.KEYPOINTS[tool][at]
    # The smallest rotation of its direction to +z (Rodrigues), the point to 0; none is downward.
    skew = np.array([[0.0, 0.0, -x], [0.0, 0.0, -y], [x, y, 0.0]])
    turn = np.eye(3) + skew + skew @ skew / (1.0 + cosine)
    transform = np.eye(4)
    transform[:3, :3] = turn
    transform[:3, 3] = -turn @ np.asarray(point_mm)
    return transform


def packed(values: np.ndarray) -> np.ndarray:
    """Differences of values' bits, as unsigned integers, in byte planes, (bytes, n) uint8."""
    numbers = np.ascontiguousarray(values).ravel().view(f"u{values.itemsize}")
    differences = np.diff(numbers, prepend=numbers.dtype.type(0))
    return np.ascontiguousarray(differences.view(np.uint8).reshape(-1, values.itemsize).T)


def _mesh_arrays(vertices: np.ndarray, faces: np.ndarray) -> dict[str, np.ndarray]:
    return {
        "vertices": packed(np.asarray(vertices, np.float64)),
        "faces": packed(np.asarray(faces, np.int32)),
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
