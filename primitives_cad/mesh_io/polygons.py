"""Cuts faces of several corners into triangles within their outlines."""

from collections.abc import Sequence

import numpy as np

FLAT = 1e-9
"""Share of a face's area below which one of its triangles counts as a line (assumed)."""

MAX_FACE_CORNERS = 1000
"""Limit on the corners of a face (assumed: a fine circle)."""

MAX_TRIED_CORNERS = 50_000_000
"""Limit on corners times attempts to triangulate their face (assumed: some seconds)."""

CHUNK_CORNERS = 300_000
"""Corners of the faces that are triangulated at a time (assumed: tens of MB)."""


def triangles(faces: Sequence[np.ndarray], corners: np.ndarray) -> np.ndarray:
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
