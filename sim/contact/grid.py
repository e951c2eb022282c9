"""Arithmetic of nested grids of square cells: windows, blocks, and values from cell means."""

import numpy as np
from scipy import ndimage

Window = tuple[slice, slice]
"""Rows and columns of a part of a grid."""

WINDOW_STEP = 4
"""Window sizes are multiples of this, cells, so that few sizes occur."""

CENTER_WEIGHTS = np.array([[3, 13, -5, 1], [-1, 7, 7, -1], [1, -5, 13, 3]]) / 12
"""Weights of the means of four cells in a row for the value before the second, third and last cell:
exact for cubics."""


def window_around(mask: np.ndarray) -> Window:
    """The window that contains a mask, (rows, columns) bool, within its grid."""
    rows, columns = np.flatnonzero(mask.any(axis=1)), np.flatnonzero(mask.any(axis=0))
    return (
        side_around(int(rows[0]), int(rows[-1]), mask.shape[0]),
        side_around(int(columns[0]), int(columns[-1]), mask.shape[1]),
    )


def side_around(first: int, last: int, length: int) -> slice:
    """A window's side from a first to a last cell, its size rounded up to WINDOW_STEP."""
    size = min(-(-(last + 1 - first) // WINDOW_STEP) * WINDOW_STEP, length)
    start = min(first, length - size)
    return slice(start, start + size)


def window_shape(window: Window) -> tuple[int, int]:
    """Number of rows and columns of a window."""
    rows, columns = window
    return rows.stop - rows.start, columns.stop - columns.start


def refined(window: Window, per_side: int) -> Window:
    """The same window on a grid whose cells are divided into per_side x per_side."""
    rows, columns = (slice(side.start * per_side, side.stop * per_side) for side in window)
    return rows, columns


def expanded(window: Window, cells: int, shape: tuple[int, ...]) -> Window:
    """The window and this number of cells around it, within a grid of a shape."""
    rows, columns = (
        slice(max(side.start - cells, 0), min(side.stop + cells, length))
        for side, length in zip(window, shape, strict=True)
    )
    return rows, columns


def moved_by(side: slice, cells: int) -> slice:
    """A window's side, moved by a number of cells."""
    return slice(side.start + cells, side.stop + cells)


def intersection(one: Window, other: Window) -> Window:
    """The common part of two windows; empty where they do not overlap."""
    rows, columns = (
        slice(max(a.start, b.start), max(a.start, b.start, min(a.stop, b.stop)))
        for a, b in zip(one, other, strict=True)
    )
    return rows, columns


def relative_window(inner: Window, outer: Window) -> Window:
    """The inner window, in rows and columns of the outer one."""
    rows, columns = (
        slice(small.start - large.start, small.stop - large.start)
        for small, large in zip(inner, outer, strict=True)
    )
    return rows, columns


def dilated(mask: np.ndarray, cells: int) -> np.ndarray:
    """A mask, (rows, columns) bool, dilated by a square of 2 cells + 1 a side."""
    down = mask.copy()
    for step in range(1, cells + 1):
        down[step:] |= mask[:-step]
        down[:-step] |= mask[step:]
    across = down.copy()
    for step in range(1, cells + 1):
        across[:, step:] |= down[:, :-step]
        across[:, :-step] |= down[:, step:]
    return across


def repeated(coarse: np.ndarray, per_side: int) -> np.ndarray:
    """Each cell's value on its per_side x per_side parts."""
    if per_side == 1:
        return coarse
    return np.repeat(np.repeat(coarse, per_side, axis=0), per_side, axis=1)


def block_max(fine: np.ndarray, per_side: int) -> np.ndarray:
    """Maximum of each block of per_side x per_side cells."""
    return _reduced(np.maximum, fine, per_side)


def block_sums(fine: np.ndarray, per_side: int) -> np.ndarray:
    """Sum of each block of per_side x per_side cells."""
    return _reduced(np.add, fine, per_side)


def block_means(fine: np.ndarray, per_side: int) -> np.ndarray:
    """Mean of each block of per_side x per_side cells."""
    return block_sums(fine, per_side) / per_side**2


def _reduced(combine: np.ufunc, fine: np.ndarray, per_side: int) -> np.ndarray:
    if per_side == 1:
        return fine
    # Slices are several times faster here than a reduction over the blocks' axes.
    along = fine[::per_side].copy()
    for part in range(1, per_side):
        combine(along, fine[part::per_side], out=along)
    total = along[:, ::per_side].copy()
    for part in range(1, per_side):
        combine(total, along[:, part::per_side], out=total)
    return total


def center_values(fine: np.ndarray, per_side: int) -> np.ndarray:
    """Values at the centers of blocks of per_side x per_side cells (1 or even), from cell means.

    For an even number the center is a corner of four cells, whose value CENTER_WEIGHTS give along
    each axis. For one cell it is the mean less the second differences over 24.
    """
    if per_side == 1:
        return fine - ndimage.laplace(fine, mode="nearest") / 24
    for _ in range(2):  # along the first axis, transposed in between
        fine = np.ascontiguousarray(fine)
        after = np.arange(len(fine) // per_side) * per_side + per_side // 2
        # The four cells around each center, moved inwards at a rim.
        first = np.clip(after - 2, 0, len(fine) - 4)
        weights = CENTER_WEIGHTS[after - 1 - first]
        values = weights[:, :1] * fine[first]
        for k in range(1, 4):
            values += weights[:, k : k + 1] * fine[first + k]
        fine = values.T
    return fine
