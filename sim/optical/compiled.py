"""Compilation of the optics' inner loops, and their bilinear interpolation."""

import subprocess
import sys
from pathlib import Path

import numba
import numpy as np

from t2twin.core.jit import code_folder, compiled
from t2twin.core.machine import cores

AHEAD = """
import gc
gc.disable()
from t2twin.sim.optical.surface import ball_surface
from t2twin.sim.sensors.pair import SensorPair
camera = SensorPair().camera
camera.image_renderer.render(ball_surface(camera.elastomer, 0.0, 0.0, 1.0))
"""  # a program that renders an image
_OPTIONS = {"nogil": True, "error_model": "numpy"}

jit = compiled(**_OPTIONS)
jit_finite = compiled(fastmath={"nnan", "ninf", "nsz"}, **_OPTIONS)
"""For finite numbers only: minima and maxima are vectorized; rounding does not change."""
inlined = compiled(inline="always", **_OPTIONS)  # A function that is inlined into such a loop


def compile_ahead() -> subprocess.Popen | None:
    """Start a process that compiles these loops, where none is cached and a second core exists.

    In one process, numba compiles one loop at a time.
    """
    folder = code_folder(numba.config.CACHE_DIR, Path(__file__).parent)
    if folder is None or any(folder.rglob("*.nbi")) or cores() < 2:
        return None
    nothing = subprocess.DEVNULL
    return subprocess.Popen([sys.executable, "-c", AHEAD], stdout=nothing, stderr=nothing)


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
