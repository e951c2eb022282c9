"""Wavefront OBJ: corners and faces as text, without units; mm is assumed.

Materials and the files that hold them are not looked at.
"""

from itertools import pairwise
from pathlib import Path

import numpy as np
import trimesh

from t2twin.primitives_cad.formats.bodies import joined

FLAT = 1e-9
"""Share of a face's area below which a triangle of it counts as a line (assumed)."""


def read(path: Path) -> tuple[trimesh.Trimesh, float]:
    """The faces of an OBJ file and 1 mm; see this package."""
    text = path.read_bytes().replace(b"\\\r\n", b" ").replace(b"\\\n", b" ")
    corners: list[list[float]] = []
    faces: list[list[int]] = []
    for line in text.splitlines():
        word, *fields = line.split() or [b""]
        if word == b"v":
            corners.append(_corner(fields))
        elif word == b"f":
            faces.append([_index(field, len(corners)) for field in fields])
    places = np.array(corners, dtype=np.float64).reshape(-1, 3)
    triangles = [triangle for face in faces for triangle in _triangles(face, places)]
    return joined([(places, np.array(triangles, dtype=np.int64).reshape(-1, 3))]), 1.0


def _corner(fields: list[bytes]) -> list[float]:
    try:
        x, y, z = (float(field) for field in fields[:3])
    except ValueError:
        raise ValueError("it has corners that are not three numbers") from None
    return [x, y, z]


def _index(field: bytes, corners: int) -> int:
    """A face's corner, counted from 0; a file counts from 1, or back from the newest corner."""
    number = field.partition(b"/")[0]
    try:
        index = int(number)
    except ValueError:
        raise ValueError("it has faces whose corners are not whole numbers") from None
    return index - 1 if index >= 0 else corners + index


def _triangles(face: list[int], corners: np.ndarray) -> list[list[int]]:
    """A face cut into triangles that all have one corner and lie within its outline."""
    if len(face) < 3:
        raise ValueError("it has faces of fewer than three corners")
    if min(face) < 0 or max(face) >= len(corners):
        raise ValueError("its faces name corners that it lacks")
    if len(face) == 3:
        return [face]
    for start in range(len(face)):
        first, *others = face[start:] + face[:start]
        spokes = corners[others] - corners[first]
        areas = np.cross(spokes[:-1], spokes[1:])
        whole = areas.sum(axis=0)
        if (areas @ whole >= -FLAT * (whole @ whole)).all():
            return [[first, a, b] for a, b in pairwise(others)]
    raise ValueError("it has faces with notches; export it with triangles for faces")
