"""Compilation of the optics' inner loops, and their bilinear interpolation."""

import numpy as np

from t2twin.core.jit import compiled

_OPTIONS = {"nogil": True, "error_model": "numpy"}

jit = compiled(**_OPTIONS)
jit_finite = compiled(fastmath={"nnan", "ninf", "nsz"}, **_OPTIONS)
"""For finite numbers only: minima and maxima are vectorized; rounding does not change."""
inlined = compiled(inline="always", **_OPTIONS)  # A function that is inlined into such a loop


@inlined
def bilinear(upper_left, upper_right, lower_left, lower_right, down, across):
    """Bilinear interpolation between four corners. down, across: 0 to 1."""
    upper = upper_left + across * (upper_right - upper_left)
    lower = lower_left + across * (lower_right - lower_left)
    return upper + down * (lower - upper)


@inlined
def at_place(grid, row, column):
    """Value of a grid, (rows, columns), between its points; beyond the rim the value at the rim."""
    row = min(max(row, 0.0), grid.shape[0] - 1.0)
    column = min(max(column, 0.0), grid.shape[1] - 1.0)
    i, j = min(int(row), grid.shape[0] - 2), min(int(column), grid.shape[1] - 2)
    return bilinear(
        grid[i, j], grid[i, j + 1], grid[i + 1, j], grid[i + 1, j + 1], row - i, column - j
    )


@jit
def at_places(grids, rows, columns):
    """(n, k) float64 values of grids (k, rows, columns) between their points, as at_place."""
    out = np.empty((rows.size, grids.shape[0]))
    for n in range(rows.size):
        for k in range(grids.shape[0]):
            out[n, k] = at_place(grids[k], rows[n], columns[n])
    return out
