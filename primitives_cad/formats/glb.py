"""GLB, the one-file form of glTF 2.0: metres, y up. trimesh reads it.

Only what lies in the file itself is read: no other file, no address, no picture.
"""

import io
import json
from pathlib import Path
from typing import Any

import numpy as np
import trimesh

from t2twin.primitives_cad.formats.bodies import Body, joined, moved

METRE_MM = 1000.0
"""glTF's unit of length, mm (glTF 2.0, 3.4, Coordinate System and Units)."""

UPRIGHT = np.array([[1, 0, 0, 0], [0, 0, -1, 0], [0, 1, 0, 0], [0, 0, 0, 1]], dtype=np.float64)
"""From glTF's frame, y up (the same section), to one with z up."""

HEAD_BYTES = 20
"""Bytes before the JSON text: three words on the file, two on this chunk (glTF 2.0, 4.4)."""

FLOAT = 5126
"""The number by which glTF names single precision (glTF 2.0, 3.6.2.2)."""


def read(path: Path) -> tuple[trimesh.Trimesh, float]:
    """The triangles of a GLB file, turned so that its y is z, and METRE_MM; see this package."""
    content = path.read_bytes()
    if not content.startswith(b"glTF"):
        raise ValueError("it is not GLB: it does not begin with the word glTF")
    try:
        length = int.from_bytes(content[12:16], "little")
        refusal = _refusal(json.loads(content[HEAD_BYTES : HEAD_BYTES + length]))
        scene = None
        if refusal is None:
            scene = trimesh.load_scene(io.BytesIO(content), file_type="glb", skip_materials=True)
    except Exception as error:  # the reader's errors are of many unrelated kinds
        raise ValueError("it is damaged: its parts do not hold together") from error
    if scene is None:
        raise ValueError(refusal)
    return joined(_body(scene, node) for node in scene.graph.nodes_geometry), METRE_MM


def _refusal(about: dict[str, Any]) -> str | None:
    """Why a file of this description is not read, or None where it is."""
    for buffer in about.get("buffers", []):
        if not buffer.get("uri", "data:").startswith("data:"):
            return "it keeps its triangles in another file; all must be in one"
    for mesh in about.get("meshes", []):
        for part in mesh["primitives"]:
            corners = part["attributes"]["POSITION"]
            used = [about["accessors"][each] for each in (corners, part.get("indices", corners))]
            plain = all("bufferView" in each and "sparse" not in each for each in used) and not any(
                "extensions" in about["bufferViews"][each["bufferView"]] for each in used
            )
            if not plain or used[0]["componentType"] != FLOAT:
                return "its triangles are compressed; export it without compression"
    return None


def _body(scene: trimesh.Scene, node: str) -> Body:
    transform, name = scene.graph[node]
    part = scene.geometry[name]
    if not isinstance(part, trimesh.Trimesh):
        return np.zeros((0, 3)), np.zeros((0, 3), dtype=np.int64)
    body = part.vertices.view(np.ndarray).astype(np.float64), part.faces.view(np.ndarray)
    return moved(body, UPRIGHT @ transform)
