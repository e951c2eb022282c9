"""Arithmetic of nested grids of square cells: windows, blocks, and values from cell means."""

from functools import reduce

import numpy as np

from t2twin.core.jit import compiled

Window = tuple[slice, slice]  # rows and columns of a part of a grid
WINDOW_STEP = 4  # window sizes are multiples of this, cells, so that few sizes occur
# Weights of the means of four cells in a row for the value before the second, third and last cell:
# exact for cubics.
CENTER_WEIGHTS = np.array([[3, 13, -5, 1], [-1, 7, 7, -1], [1, -5, 13, 3]]) / 12


def window_around(mask: np.ndarray) -> Window:
    """The window that contains a mask, (rows, columns) bool, within its grid."""
    top, bottom, left, right = extent(mask)
    return side_around(top, bottom, mask.shape[0]), side_around(left, right, mask.shape[1])


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


def relative_window(inner: Window, outer: Window) -> Window:
    """The inner window, in rows and columns of the outer one."""
    rows, columns = (
        slice(small.start - large.start, small.stop - large.start)
        for small, large in zip(inner, outer, strict=True)
    )
    return rows, columns


def block_means(fine: np.ndarray, per_side: int) -> np.ndarray:
    """Mean of each block of per_side x per_side cells."""
    if per_side == 1:
        return fine
    places = range(per_side)
    parts = (fine[i::per_side, j::per_side] for i in places for j in places)
    return reduce(np.add, parts) / per_side**2


def center_values(fine: np.ndarray, per_side: int) -> np.ndarray:
    """Values at the centers of blocks of per_side x per_side cells (1 or even), from cell means.

    For an even number a center is a corner of four cells, whose value CENTER_WEIGHTS give along
    each axis. For one cell it is the mean less the second differences over 24.
    """
    if per_side == 1:
        centers = np.empty(fine.shape)
        _without_curvature(fine, centers)
        return centers
    rows, columns = (length // per_side for length in fine.shape)
    between, found = np.empty((rows, fine.shape[1])), np.empty((columns, rows))
    _middle_rows(fine, per_side, CENTER_WEIGHTS, between)
    _middle_rows(np.ascontiguousarray(between.T), per_side, CENTER_WEIGHTS, found)
    return np.ascontiguousarray(found.T)


@compiled(nogil=True)
def _middle_rows(fine, per_side, weights, values):
    """Write the values between the two rows in the middle of each block of an even number."""
    for i in range(values.shape[0]):
        after = i * per_side + per_side // 2
        # The four cells around the middle, moved inwards at a rim.
        first = min(max(after - 2, 0), fine.shape[0] - 4)
        own = weights[after - 1 - first]
        for j in range(values.shape[1]):
            value = 0.0
            for k in range(4):
                value += own[k] * fine[first + k, j]
            values[i, j] = value


@compiled(nogil=True)
def _without_curvature(means, centers):
    """Write means less the second differences over 24, which are one-sided at a rim."""
    rows, columns = means.shape
    for i in range(rows):
        above, below = max(i - 1, 0), min(i + 1, rows - 1)
        for j in range(columns):
            left, right = max(j - 1, 0), min(j + 1, columns - 1)
            around = means[above, j] + means[below, j] + means[i, left] + means[i, right]
            centers[i, j] = means[i, j] - (around - 4 * means[i, j]) / 24


@compiled(nogil=True)
def extent(mask):
    """First and last row, first and last column of a mask; the last ones are -1 without any."""
    top, bottom, left, right = mask.shape[0], -1, mask.shape[1], -1
    for i in range(mask.shape[0]):
        row, some = mask[i], False
        for j in range(row.size):
            some |= row[j]
        if some:
            top, bottom = min(top, i), i
            for j in range(row.size):
                if row[j]:
                    left, right = min(left, j), max(right, j)
    return top, bottom, left, right


@compiled(nogil=True)
def dilated(mask, cells):
    """A mask, (rows, columns) bool, dilated by a square of 2 cells + 1 a side."""
    rows, columns = mask.shape
    wider = np.zeros(mask.shape, np.bool_)
    for i in range(rows):
        for j in range(columns):
            if mask[i, j]:
                for k in range(max(i - cells, 0), min(i + cells + 1, rows)):
                    for m in range(max(j - cells, 0), min(j + cells + 1, columns)):
                        wider[k, m] = True
    return wider


@compiled(nogil=True)
def interpolated(values, own_y, own_x, y, x):
    """Values, (n, rows, columns), on other axes, linear between the points and constant beyond."""
    found = np.empty((values.shape[0], y.size, x.size))
    columns, across = np.empty(x.size, np.int64), np.empty(x.size)
    for j in range(x.size):
        columns[j], across[j] = _place_on(own_x, x[j])
    for i in range(y.size):
        row, share = _place_on(own_y, y[i])
        for k in range(found.shape[0]):
            upper, lower = values[k, row], values[k, row + 1]
            for j in range(x.size):
                n, m = columns[j], columns[j] + 1
                left = upper[n] * (1 - share) + lower[n] * share
                right = upper[m] * (1 - share) + lower[m] * share
                found[k, i, j] = left * (1 - across[j]) + right * across[j]
    return found


@compiled(inline="always")
def _place_on(axis, wanted):
    """Index of the point of an axis before a place, and the share of the way to the next."""
    steps = min(max((wanted - axis[0]) / (axis[1] - axis[0]), 0.0), axis.size - 1.0)
    first = min(int(steps), axis.size - 2)
    return first, steps - first
