"""Checks the bodies of a file and merges them into one mesh."""

from collections.abc import Iterable
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    import trimesh

MAX_TRIANGLES = 2_000_000
"""Limit on the triangles of a file (assumed: finer than any print, and minutes of computing)."""

MAX_CORNERS = 3 * MAX_TRIANGLES
"""Limit on the corners: the number without shared ones."""

MAX_PLACES = 10_000
"""Limit on the placements of parts and groups of parts (assumed)."""

FARTHEST = 1e10
"""Largest coordinate, in the file's units (assumed: beyond it corners lose their precision)."""

NOT_NUMBERS = "it has corners that are not numbers"

Body = tuple[np.ndarray, np.ndarray]
"""Corners (n, 3) float64 and triangles (m, 3) int64, as indices of corners."""


def merged(bodies: Iterable[Body]) -> "trimesh.Trimesh":
    """One mesh of all bodies, with the equal corners of each merged.

    Raises ValueError for corners that are not numbers or missing, and for too many triangles.
    """
    import trimesh

    meshes, triangles = [], 0
    for corners, faces in bodies:
        triangles += len(faces)
        check_triangles(triangles)
        if not len(faces):
            continue
        check_coordinates(corners)
        if faces.min() < 0 or faces.max() >= len(corners):
            raise ValueError("its faces name corners that it lacks")
        meshes.append(trimesh.Trimesh(corners, faces))
    if not meshes:
        raise ValueError("it holds no triangles")
    return trimesh.util.concatenate(meshes)  # pyright: ignore[reportArgumentType, reportReturnType]


def check_coordinates(corners: np.ndarray) -> None:
    """Raises ValueError for corners (n, 3) that are not finite or beyond FARTHEST."""
    if not np.isfinite(corners).all():
        raise ValueError(NOT_NUMBERS)
    if len(corners) and np.abs(corners).max() > FARTHEST:
        raise ValueError(f"it has corners farther out than {FARTHEST:g}")


def check_triangles(number: int) -> None:
    """Raises ValueError for more triangles than MAX_TRIANGLES."""
    if number > MAX_TRIANGLES:
        raise ValueError(f"it has more than the {MAX_TRIANGLES:,} triangles that are allowed")


def check_corners(number: int) -> None:
    """Raises ValueError for more corners than MAX_CORNERS."""
    if number > MAX_CORNERS:
        raise ValueError(f"it has more than the {MAX_CORNERS:,} corners that are allowed")


def transformed(body: Body, transform: np.ndarray) -> Body:
    """A body after a (4, 4) transform; a reflection reverses its triangles.

    Raises ValueError for a transform that is not finite.
    """
    corners, faces = body
    turn = transform[:3, :3]
    if not np.isfinite(transform).all():
        raise ValueError("it places a part by numbers that are not finite")
    with np.errstate(over="ignore", invalid="ignore"):  # `merged` checks the result
        mirrored = np.linalg.det(turn) < 0.0
        return corners @ turn.T + transform[:3, 3], faces[:, ::-1] if mirrored else faces
