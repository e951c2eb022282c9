"""Reads PLY with trimesh: corners and faces, text or binary, without units."""

import io
from pathlib import Path

import numpy as np
import trimesh

from t2twin.primitives_cad.mesh_io.bodies import merged

FOLDED_RAD = np.pi - 1e-6
"""Angle between the normals of neighboring triangles that coincide (assumed)."""


def read(path: Path) -> tuple[trimesh.Trimesh, float]:
    """The faces of a PLY file, and 1 mm; see this package. Ignores textures."""
    content = path.read_bytes()
    if not content.startswith(b"ply"):
        raise ValueError("it is not PLY: it does not begin with the word ply")
    try:
        # Content that contradicts the header raises many types of errors.
        scene = trimesh.load_scene(
            io.BytesIO(content), file_type="ply", skip_materials=True, process=False
        )
    except Exception as error:
        raise ValueError("it is damaged, or its faces are not all triangles") from error
    parts = [part for part in scene.geometry.values() if isinstance(part, trimesh.Trimesh)]
    mesh = merged([(part.vertices.view(np.ndarray), part.faces.view(np.ndarray)) for part in parts])
    # trimesh splits polygons into fans, which is wrong for polygons with notches.
    if (mesh.face_adjacency_angles > FOLDED_RAD).any():
        raise ValueError("it has faces folded onto others; export it with triangles for faces")
    return mesh, 1.0
