"""Checks the bodies of a file, cuts their faces into triangles, and merges them into one mesh."""

from collections.abc import Iterable, Sequence
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

FLAT = 1e-9
"""Share of a face's area below which one of its triangles counts as a line (assumed)."""

MAX_FACE_CORNERS = 1000
"""Limit on the corners of a face (assumed: a fine circle)."""

MAX_TRIED_CORNERS = 50_000_000
"""Limit on corners times attempts to triangulate their face (assumed: some seconds)."""

CHUNK_CORNERS = 300_000
"""Corners of the faces that are triangulated at a time (assumed: tens of MB)."""

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


def triangles_of_faces(faces: Sequence[np.ndarray], corners: np.ndarray) -> np.ndarray:
    """Triangles (m, 3) of faces, arrays (k, n) of indices of corners (c, 3), n >= 3.

    Raises ValueError for faces with notches, with missing corners and with too many.
    """
    rows = [_cut(each, corners) for each in faces]
    return np.concatenate(rows) if rows else np.zeros((0, 3), dtype=np.int64)


def _cut(faces: np.ndarray, corners: np.ndarray) -> np.ndarray:
    """Triangles (m, 3) within the outlines of faces (k, n) with n corners each."""
    size = faces.shape[1]
    if size > MAX_FACE_CORNERS:
        raise ValueError(
            f"it has a face of {size:,} corners; at most {MAX_FACE_CORNERS:,} are allowed; export "
            "it with triangles for faces"
        )
    if faces.min() < 0 or faces.max() >= len(corners):
        raise ValueError("its faces name corners that it lacks")
    if size == 3:
        return faces
    batch = max(CHUNK_CORNERS // size, 1)
    tried, cut = 0, []
    for start in range(0, len(faces), batch):
        waiting = faces[start : start + batch]
        for _ in range(size):
            tried += waiting.size
            good = _is_fan(waiting, corners)
            cut.append(_fans(waiting[good]))
            waiting = np.roll(waiting[~good], -1, axis=1)
            if not len(waiting) or tried > MAX_TRIED_CORNERS:
                break
        if len(waiting):
            raise ValueError("it has faces with notches; export it with triangles for faces")
    return np.concatenate(cut)


def _is_fan(faces: np.ndarray, corners: np.ndarray) -> np.ndarray:
    """(k,) whether the fan of triangles from each face's first corner lies within its outline."""
    spokes = corners[faces[:, 1:]] - corners[faces[:, :1]]
    areas = np.cross(spokes[:, :-1], spokes[:, 1:])
    whole = areas.sum(axis=1)
    along = np.einsum("kni,ki->kn", areas, whole)
    return (along >= -FLAT * (whole**2).sum(axis=1, keepdims=True)).all(axis=1)


def _fans(faces: np.ndarray) -> np.ndarray:
    """(k * (n - 2), 3) fans of triangles from the first corner of each face (k, n)."""
    first = np.broadcast_to(faces[:, :1], faces[:, 2:].shape)
    return np.stack([first, faces[:, 1:-1], faces[:, 2:]], axis=-1).reshape(-1, 3)
