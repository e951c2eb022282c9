"""Reads Wavefront OBJ: corners and faces as text, without units. Ignores materials.

trimesh's reader takes a third of the time. It is not used, because it returns wrong faces without
an error (trimesh 5.2, 2026-11-23). It does so for faces with notches, a cut-off last face, corners
counted back from the last one, continued lines, and old Macintosh line ends. It rejects comments
in lines.
"""

from array import array
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import trimesh

from t2twin.primitives_cad.mesh_io.bodies import (
    NOT_NUMBERS,
    check_coordinates,
    check_corners,
    check_triangles,
    merged,
    triangles_of_faces,
)

MAX_LINE = 1_000_000
"""Limit on the characters of a line (assumed: far more than a face needs)."""

BYTE_ORDER_MARK = "\u00ef\u00bb\u00bf"
"""The three bytes of UTF-8's byte order mark, read as Latin-1."""


def read(path: Path) -> tuple[trimesh.Trimesh, float]:
    """The faces of an OBJ file, and 1 mm; see this package."""
    corners = array("d")
    faces: dict[int, array[int]] = {}
    triangles = 0
    for word, *fields in _lines(path):
        if word == "v":
            corners.extend(_corner(fields))
            check_corners(len(corners) // 3)
        elif word == "f":
            if len(fields) < 3:
                raise ValueError("it has faces of fewer than three corners")
            triangles += len(fields) - 2
            check_triangles(triangles)
            face = [_index(field, len(corners) // 3) for field in fields]
            faces.setdefault(len(face), array("q")).extend(face)
    places = np.array(corners, dtype=np.float64).reshape(-1, 3)
    check_coordinates(places)
    rows = [np.array(faces[size]).reshape(-1, size) for size in sorted(faces)]
    return merged([(places, triangles_of_faces(rows, places))]), 1.0


def _lines(path: Path) -> Iterator[list[str]]:
    """The words of each nonempty line; a backslash at the end continues a line."""
    with path.open(encoding="latin-1") as file:
        before = ""
        while line := file.readline(MAX_LINE + 1):
            line = before + line
            if len(line) > MAX_LINE:
                raise ValueError(f"it has a line of more than {MAX_LINE:,} characters")
            before = f"{line[:-2]} " if line.endswith("\\\n") else ""
            if not before and (words := line.removeprefix(BYTE_ORDER_MARK).split()):
                yield words


def _corner(fields: list[str]) -> list[float]:
    try:
        x, y, z = (float(field) for field in fields[:3])
    except ValueError:
        raise ValueError("it has corners that are not three numbers") from None
    if not (abs(x) < np.inf and abs(y) < np.inf and abs(z) < np.inf):
        raise ValueError(NOT_NUMBERS)
    return [x, y, z]


def _index(field: str, corners: int) -> int:
    """Index of a face's corner from 0; files count from 1, or back from the last corner."""
    number = field.partition("/")[0]
    try:
        index = int(number)
    except ValueError:
        raise ValueError("it has faces whose corners are not whole numbers") from None
    if abs(index) >= 2**62:
        raise ValueError("its faces name corners that it lacks")
    return index - 1 if index >= 0 else corners + index
