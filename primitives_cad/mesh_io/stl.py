"""Reads STL, binary or text, and writes binary STL: triangles without units.

trimesh's reader is not used for text (trimesh 5.2, 2026-11-23): it drops a solid without an end and
accepts corners that are not numbers. It rejects old Macintosh line ends, and 330,000 triangles take
350 MB more memory. Of binary files it reads the same array.
"""

import re
from codecs import BOM_UTF8
from collections.abc import Iterator
from itertools import islice
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from t2twin.primitives_cad.mesh_io.bodies import Body, check_triangles, merged

if TYPE_CHECKING:
    import trimesh

HEADER_BYTES = 84
"""Bytes before the first triangle of a binary file: 80 of text, then the number of triangles."""

RECORD = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])
"""One triangle of a binary file."""

CORNER = re.compile(rb"vertex[ \t]+(\S+[ \t]+\S+[ \t]+\S+)", re.IGNORECASE)
"""A corner in a text file."""

WORD = re.compile(rb"vertex", re.IGNORECASE)
END = re.compile(rb"endsolid", re.IGNORECASE)
FACET = re.compile(rb"facet", re.IGNORECASE)

BATCH_SIZE = 30_000
"""Corners of a text file that are converted at a time (assumed: a few MB)."""


def read(path: Path) -> tuple["trimesh.Trimesh", float]:
    """The triangles of an STL file, and 1 mm; see this package."""
    content = path.read_bytes().removeprefix(BOM_UTF8)
    announced = int.from_bytes(content[HEADER_BYTES - 4 : HEADER_BYTES], "little")
    room = max(len(content) - HEADER_BYTES, 0)
    if len(content) >= HEADER_BYTES and room == announced * RECORD.itemsize:
        check_triangles(announced)
        return merged([_loose(np.frombuffer(content, RECORD, offset=HEADER_BYTES)["corners"])]), 1.0
    is_text = content[:HEADER_BYTES].lstrip()[:5].lower() == b"solid"
    if is_text and (FACET.search(content) or END.search(content)):
        return merged(_solids(content)), 1.0
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
        facet = FACET.search(text, start, end.start())  # skips the solid's name
        if facet:
            yield _loose(_corners(text, facet.start(), end.start()).reshape(-1, 3, 3))
        start = end.end()
    if not start or CORNER.search(text, start):
        raise ValueError("it is cut short: its last solid has no end")


def _corners(text: bytes, start: int, end: int) -> np.ndarray:
    """Corners (n, 3) between two positions in a text, three for each triangle."""
    corners = (found[1] for found in CORNER.finditer(text, start, end))
    parts, count = [np.zeros(0)], 0
    while few := tuple(islice(corners, BATCH_SIZE)):
        count += len(few)
        check_triangles(count // 3)
        parts.append(numbers(b" ".join(few)))
        if parts[-1].size != 3 * len(few):
            raise ValueError("it has corners that are not numbers")
    if count % 3 or count != sum(1 for _ in WORD.finditer(text, start, end)):
        raise ValueError("it has triangles without three corners")
    return np.concatenate(parts)


def numbers(text: bytes) -> np.ndarray:
    """The numbers in a text, or fewer where a word is not a number."""
    try:
        return np.fromstring(text, sep=" ")
    except (ValueError, DeprecationWarning):  # NumPy's reactions to such a word
        return np.zeros(0)


def _loose(triangles: np.ndarray) -> Body:
    """The body of triangles (n, 3, 3) without shared corners."""
    corners = triangles.reshape(-1, 3).astype(np.float64)
    return corners, np.arange(len(corners)).reshape(-1, 3)


def binary_stl(vertices: np.ndarray, faces: np.ndarray) -> bytes:
    """A binary STL file. vertices: (n, 3), mm. faces: (m, 3), counterclockwise from outside.

    Triangles without area have a zero normal.
    """
    corners = np.asarray(vertices)[np.asarray(faces)]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    lengths = np.linalg.norm(normals, axis=1, keepdims=True)
    records = np.zeros(len(corners), RECORD)
    records["normal"] = np.divide(normals, lengths, out=np.zeros_like(normals), where=lengths > 0)
    records["corners"] = corners
    return bytes(HEADER_BYTES - 4) + np.uint32(len(corners)).tobytes() + records.tobytes()
