"""PLY: corners and faces, text or binary, without units; mm is assumed. trimesh reads it."""

import io
from pathlib import Path

import numpy as np
import trimesh

from t2twin.primitives_cad.mesh_io.bodies import joined

FOLDED_RAD = np.pi - 1e-6
"""Angle between the normals of neighboring triangles that lie on one another (assumed)."""


def read(path: Path) -> tuple[trimesh.Trimesh, float]:
    """The faces of a PLY file and 1 mm; see this package. Its pictures are not looked at."""
    content = path.read_bytes()
    if not content.startswith(b"ply"):
        raise ValueError("it is not PLY: it does not begin with the word ply")
    try:
        # Where corners and faces are not as the head says, the reader's errors are of many kinds.
        scene = trimesh.load_scene(
            io.BytesIO(content), file_type="ply", skip_materials=True, process=False
        )
    except Exception as error:
        raise ValueError("it is damaged, or its faces are not all triangles") from error
    parts = [part for part in scene.geometry.values() if isinstance(part, trimesh.Trimesh)]
    mesh = joined([(part.vertices.view(np.ndarray), part.faces.view(np.ndarray)) for part in parts])
    # Faces of more corners come cut from their first one, which is wrong for those with notches.
    if (mesh.face_adjacency_angles > FOLDED_RAD).any():
        raise ValueError("it has faces folded onto others; export it with triangles for faces")
    return mesh, 1.0
