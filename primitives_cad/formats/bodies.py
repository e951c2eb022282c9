"""Bodies of a file, checked and put together."""

from collections.abc import Iterable

import numpy as np
import trimesh

MOST_TRIANGLES = 5_000_000
"""Most triangles of a file's solid (assumed: finer than any print, and minutes of work)."""

FARTHEST = 1e10
"""Largest coordinate, in the file's units (assumed: corners so far out cannot be told apart)."""

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
        if not np.isfinite(corners).all():
            raise ValueError("it has corners that are not numbers")
        if np.abs(corners).max() > FARTHEST:
            raise ValueError(f"it has corners farther out than {FARTHEST:g}")
        if faces.min() < 0 or faces.max() >= len(corners):
            raise ValueError("its faces name corners that it lacks")
        meshes.append(trimesh.Trimesh(corners, faces))
    if not meshes:
        raise ValueError("it holds no triangles")
    return trimesh.util.concatenate(meshes)  # pyright: ignore[reportArgumentType, reportReturnType]


def check_triangles(number: int) -> None:
    """Raises ValueError for more triangles than are read."""
    if number > MOST_TRIANGLES:
        raise ValueError(f"it has more than the {MOST_TRIANGLES:,} triangles that are allowed")


def moved(body: Body, transform: np.ndarray) -> Body:
    """A body through a (4, 4) transform; one that mirrors turns its triangles round."""
    corners, faces = body
    turn = transform[:3, :3]
    mirrored = np.linalg.det(turn) < 0.0
    return corners @ turn.T + transform[:3, 3], faces[:, ::-1] if mirrored else faces
