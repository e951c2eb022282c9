"""STL: loose triangles, binary or text, without units; mm is assumed.

Triangles as the content of a binary STL file.
"""

import re
from collections.abc import Iterator
from itertools import islice
from pathlib import Path

import numpy as np
import trimesh

from t2twin.primitives_cad.mesh_io.bodies import Body, check_triangles, joined

HEADER_BYTES = 84
"""Bytes before a binary file's first triangle: 80 of any text and the number of triangles."""

RECORD = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])
"""One triangle of a binary file."""

CORNER = re.compile(rb"vertex[ \t]+(\S+[ \t]+\S+[ \t]+\S+)", re.IGNORECASE)
"""A corner in a text file."""

WORD = re.compile(rb"vertex", re.IGNORECASE)
END = re.compile(rb"endsolid", re.IGNORECASE)
FACET = re.compile(rb"facet", re.IGNORECASE)

BATCH_SIZE = 30_000
"""Corners of a text file that are read at once (assumed: a few MB)."""


def read(path: Path) -> tuple[trimesh.Trimesh, float]:
    """The triangles of an STL file and 1 mm; see this package."""
    content = path.read_bytes()
    announced = int.from_bytes(content[HEADER_BYTES - 4 : HEADER_BYTES], "little")
    room = max(len(content) - HEADER_BYTES, 0)
    if len(content) >= HEADER_BYTES and room == announced * RECORD.itemsize:
        check_triangles(announced)
        return joined([_loose(np.frombuffer(content, RECORD, offset=HEADER_BYTES)["corners"])]), 1.0
    is_text = content[:HEADER_BYTES].lstrip()[:5].lower() == b"solid"
    if is_text and (FACET.search(content) or END.search(content)):
        return joined(_solids(content)), 1.0
    if len(content) < HEADER_BYTES:
        raise ValueError("it is neither text nor binary STL")
    raise ValueError(
        f"it is damaged or not STL: as binary it announces {announced:,} triangles and has room "
        f"for {room // RECORD.itemsize:,}"
    )


def _solids(text: bytes) -> Iterator[Body]:
    """The solids of a text file."""
    start = 0
    for end in END.finditer(text):
        facet = FACET.search(text, start, end.start())  # after the solid's name
        if facet:
            yield _loose(_corners(text, facet.start(), end.start()).reshape(-1, 3, 3))
        start = end.end()
    if not start or CORNER.search(text, start):
        raise ValueError("it is cut short: its last solid has no end")


def _corners(text: bytes, start: int, end: int) -> np.ndarray:
    """(n, 3): the corners between two places of a text, three for each triangle."""
    corners = (found[1] for found in CORNER.finditer(text, start, end))
    parts, count = [np.zeros(0)], 0
    while few := tuple(islice(corners, BATCH_SIZE)):
        count += len(few)
        check_triangles(count // 3)
        parts.append(_numbers(b" ".join(few)))
        if parts[-1].size != 3 * len(few):
            raise ValueError("it has corners that are not numbers")
    if count % 3 or count != sum(1 for _ in WORD.finditer(text, start, end)):
        raise ValueError("it has triangles without three corners")
    return np.concatenate(parts)


def _numbers(text: bytes) -> np.ndarray:
    """The numbers in a text up to its end, or to the first word that is none."""
    try:
        return np.fromstring(text, sep=" ")
    except (ValueError, DeprecationWarning):  # what NumPy makes of such a word, once or later
        return np.zeros(0)


def _loose(triangles: np.ndarray) -> Body:
    """Triangles (n, 3, 3) that share no corners."""
    corners = triangles.reshape(-1, 3).astype(np.float64)
    return corners, np.arange(len(corners)).reshape(-1, 3)


def binary_stl(vertices: np.ndarray, faces: np.ndarray) -> bytes:
    """The content of a file. vertices: (n, 3), mm. faces: (m, 3), counter-clockwise from outside.

    The normal of a triangle without area is zero.
    """
    corners = np.asarray(vertices)[np.asarray(faces)]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    lengths = np.linalg.norm(normals, axis=1, keepdims=True)
    records = np.zeros(len(corners), RECORD)
    records["normal"] = np.divide(normals, lengths, out=np.zeros_like(normals), where=lengths > 0)
    records["corners"] = corners
    return bytes(HEADER_BYTES - 4) + np.uint32(len(corners)).tobytes() + records.tobytes()
