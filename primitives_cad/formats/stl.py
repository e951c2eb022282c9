"""STL: loose triangles, binary or text, without units; mm is assumed."""

import re
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import trimesh

from t2twin.primitives_cad.formats.bodies import Body, check_triangles, joined

HEADER_BYTES = 84
"""Bytes before a binary file's first triangle: 80 of any text and the number of triangles."""

RECORD = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])
"""One triangle of a binary file."""

CORNER = re.compile(rb"vertex[ \t]+(\S+[ \t]+\S+[ \t]+\S+)")
"""A corner in a text file."""


def read(path: Path) -> tuple[trimesh.Trimesh, float]:
    """The triangles of an STL file and 1 mm; see this package."""
    content = path.read_bytes()
    announced = int.from_bytes(content[HEADER_BYTES - 4 : HEADER_BYTES], "little")
    room = max(len(content) - HEADER_BYTES, 0)
    if len(content) >= HEADER_BYTES and room == announced * RECORD.itemsize:
        check_triangles(announced)
        return joined([_loose(np.frombuffer(content, RECORD, offset=HEADER_BYTES)["corners"])]), 1.0
    text = content.lower()
    if text.lstrip().startswith(b"solid") and (b"facet" in text or b"endsolid" in text):
        return joined(_solids(text)), 1.0
    if len(content) < HEADER_BYTES:
        raise ValueError("it is neither text nor binary STL")
    raise ValueError(
        f"it is damaged or not STL: as binary it announces {announced:,} triangles and has room "
        f"for {room // RECORD.itemsize:,}"
    )


def _solids(text: bytes) -> Iterator[Body]:
    """The solids of a text file, in lower case."""
    *solids, rest = text.split(b"endsolid")
    if not solids or CORNER.search(rest):
        raise ValueError("it is cut short: its last solid has no end")
    for solid in solids:
        start = max(solid.find(b"facet"), 0)  # after the solid's name
        corners = CORNER.findall(solid, start)
        if len(corners) % 3 or len(corners) != solid.count(b"vertex", start):
            raise ValueError("it has triangles without three corners")
        numbers = _numbers(b" ".join(corners))
        if numbers.size != 3 * len(corners):
            raise ValueError("it has corners that are not numbers")
        yield _loose(numbers.reshape(-1, 3, 3))


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
