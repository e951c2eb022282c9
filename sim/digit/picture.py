"""Grey levels from light: encoding, the camera's noise, rounding.

Light and grey levels are linked by the calibration's gamma: grey = 255 light^(1 / gamma).
"""

from functools import cache

import numpy as np
from scipy.special import ndtri

from t2twin.sim.digit.compiled import inlined, jit_finite

ENCODING_STEPS = 4096
"""Entries of the encoding's table, over the square root of the light: 0.12 grey levels apart at
most."""

_ZERO, _ONE, _HALF = np.float32(0.0), np.float32(1.0), np.float32(0.5)
_BRIGHTEST = np.float32(255.0)
_NEAR, _APART = np.float32(0.75), np.float32(0.25)


def linear(grey: np.ndarray, gamma: float) -> np.ndarray:
    """Light, 0 to 1, of grey levels, 0 to 255."""
    return (np.asarray(grey) / 255.0) ** gamma


@cache
def normal_quantiles() -> np.ndarray:
    """(65536,) float32 standard normal quantiles of 16-bit uniform draws, at mid-steps.

    Inverse-transform sampling: several times as fast as drawing normals, and as good once the
    result is rounded to grey levels.
    """
    return ndtri((np.arange(65536) + 0.5) / 65536).astype(np.float32)


def encoding_table(gamma: float) -> np.ndarray:
    """(ENCODING_STEPS,) float32 grey levels over the square root of linear light, 0 to 1."""
    return (255.0 * np.linspace(0.0, 1.0, ENCODING_STEPS) ** (2.0 / gamma)).astype(np.float32)


@jit_finite
def encode(change, background, rest, table, region, draws, quantiles, sigma, noise, out):
    """Fill out (P, RGB) uint8: the background's light and the change, encoded, noisy, rounded.

    P is the picture (rows, columns), S its lattice of samples as in t2twin.sim.digit.illumination.
    change: (RGB, S) linear light, interpolated to the pixels of a region (first row, end row,
    first column, end column); the others show the background (P, RGB) grey levels.
    rest: (P, RGB) the background's linear light.
    table: grey levels over the square root of linear light, 0 to 1.
    draws: (P * RGB,) uint16, each turned into noise by quantiles, sigma grey levels; or (0,).
    noise: (P, RGB) float32 that is added, sigma times; or (0, 0, 0).
    """
    last = np.float32(table.size - 1)
    rows, columns = background.shape[0], background.shape[1]
    noisy = draws.size > 0
    line = np.empty(change.shape[2], dtype=np.float32)
    grey, value = np.empty(3 * columns, dtype=np.float32), np.empty(3 * columns, dtype=np.float32)
    entry = np.empty(3 * columns, dtype=np.int32)
    for row in range(rows):
        still, lit, filled = background[row].ravel(), rest[row].ravel(), out[row].ravel()
        for n in range(3 * columns):
            grey[n] = still[n]
        if region[0] <= row < region[1]:
            _interpolate(change, row, line, value)
            for n in range(3 * columns):
                root = np.sqrt(min(max(value[n] + lit[n], _ZERO), _ONE))
                entry[n] = np.int32(root * last + _HALF)
            for n in range(3 * region[2], 3 * region[3]):
                grey[n] = table[entry[n]]
        if noisy:
            drawn = draws[3 * columns * row : 3 * columns * (row + 1)]
            for n in range(3 * columns):
                grey[n] += sigma * quantiles[drawn[n]]
        if noise.size > 0:
            added = noise[row].ravel()
            for n in range(3 * columns):
                grey[n] += sigma * added[n]
        for n in range(3 * columns):
            filled[n] = np.uint8(min(max(grey[n], _ZERO), _BRIGHTEST) + _HALF)


@inlined
def _interpolate(change, row, line, value):
    """Fill value (columns * RGB) with a row of the change (RGB, S). line: (columns of S) room."""
    i = (row + 1) // 2
    u, w = (_APART, _NEAR) if row % 2 == 0 else (_NEAR, _APART)
    for c in range(3):
        above, below = change[c, i], change[c, i + 1]
        for n in range(line.size):
            line[n] = u * above[n] + w * below[n]
        # a pair of columns lies about its sample in the middle, n + 1
        for n in range(value.size // 6):
            value[6 * n + c] = _APART * line[n] + _NEAR * line[n + 1]
            value[6 * n + 3 + c] = _NEAR * line[n + 1] + _APART * line[n + 2]
