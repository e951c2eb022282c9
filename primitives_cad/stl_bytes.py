"""Triangles as the content of a binary STL file."""

import numpy as np

HEADER_BYTES = 80
"""Before the number of triangles; here all zero (the format)."""

TRIANGLE = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attributes", "<u2")])
"""A triangle in the file (the format)."""


def binary_stl(vertices: np.ndarray, faces: np.ndarray) -> bytes:
    """The content of a file. vertices: (n, 3), mm. faces: (m, 3), counter-clockwise from outside.

    The normal of a triangle without area is zero.
    """
    corners = np.asarray(vertices)[np.asarray(faces)]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    lengths = np.linalg.norm(normals, axis=1, keepdims=True)
    records = np.zeros(len(corners), TRIANGLE)
    records["normal"] = np.divide(normals, lengths, out=np.zeros_like(normals), where=lengths > 0)
    records["corners"] = corners
    return bytes(HEADER_BYTES) + np.uint32(len(corners)).tobytes() + records.tobytes()
