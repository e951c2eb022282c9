"""Bodies of a file, checked and put together."""

from collections.abc import Iterable

import numpy as np
import trimesh

MAX_TRIANGLES = 2_000_000
"""Most triangles of a file's solid (assumed: finer than any print, and minutes of work)."""

MAX_CORNERS = 3 * MAX_TRIANGLES
"""Most corners: as many as there are where no triangles share any."""

MAX_PLACES = 10_000
"""Most places at which parts may stand, groups of parts included (assumed)."""

FARTHEST = 1e10
"""Largest coordinate, in the file's units (assumed: corners so far out cannot be told apart)."""

NOT_NUMBERS = "it has corners that are not numbers"

Body = tuple[np.ndarray, np.ndarray]
"""Corners (n, 3) float64 and triangles (m, 3) int64, which count corners from 0."""


def joined(bodies: Iterable[Body]) -> trimesh.Trimesh:
    """One mesh of all bodies, each with its equal corners made one.

    Raises ValueError for corners that are not numbers or not there, and for too many triangles.
    """
    meshes, triangles = [], 0
    for corners, faces in bodies:
        triangles += len(faces)
        check_triangles(triangles)
        if not len(faces):
            continue
        check_places(corners)
        if faces.min() < 0 or faces.max() >= len(corners):
            raise ValueError("its faces name corners that it lacks")
        meshes.append(trimesh.Trimesh(corners, faces))
    if not meshes:
        raise ValueError("it holds no triangles")
    return trimesh.util.concatenate(meshes)  # pyright: ignore[reportArgumentType, reportReturnType]


def check_places(corners: np.ndarray) -> None:
    """Raises ValueError for corners (n, 3) that are not finite or too far out."""
    if not np.isfinite(corners).all():
        raise ValueError(NOT_NUMBERS)
    if len(corners) and np.abs(corners).max() > FARTHEST:
        raise ValueError(f"it has corners farther out than {FARTHEST:g}")


def check_triangles(number: int) -> None:
    """Raises ValueError for more triangles than are read."""
    if number > MAX_TRIANGLES:
        raise ValueError(f"it has more than the {MAX_TRIANGLES:,} triangles that are allowed")


def check_corners(number: int) -> None:
    """Raises ValueError for more corners than are read."""
    if number > MAX_CORNERS:
        raise ValueError(f"it has more than the {MAX_CORNERS:,} corners that are allowed")


def moved(body: Body, transform: np.ndarray) -> Body:
    """A body through a (4, 4) transform; one that mirrors turns its triangles round.

    Raises ValueError for a transform that is not of finite numbers.
    """
    corners, faces = body
    turn = transform[:3, :3]
    if not np.isfinite(transform).all():
        raise ValueError("it places a part by numbers that are not finite")
    with np.errstate(over="ignore", invalid="ignore"):  # what becomes of it is checked by `joined`
        mirrored = np.linalg.det(turn) < 0.0
        return corners @ turn.T + transform[:3, 3], faces[:, ::-1] if mirrored else faces
