"""Camera response: encodes light as grey levels, adds noise and rounds.

grey = 255 light^(1 / gamma), with the optics file's gamma.
"""

import numpy as np

from t2twin.sim.optical.camera.compiled import inlined, jit_finite
from t2twin.sim.optical.camera.noise import choose

ENCODING_STEPS = 4096
"""Entries of the encoding table over the square root of the light: at most 0.12 grey levels
apart."""

_ZERO, _ONE, _HALF = np.float32(0.0), np.float32(1.0), np.float32(0.5)
_BRIGHTEST = np.float32(255.0)
_NEAR, _APART = np.float32(0.75), np.float32(0.25)


def linear(grey: np.ndarray, gamma: float) -> np.ndarray:
    """Light, 0 to 1, of grey levels, 0 to 255."""
    return (np.asarray(grey) / 255.0) ** gamma


def encoding_table(gamma: float) -> np.ndarray:
    """(ENCODING_STEPS,) float32 grey levels over the square root of linear light, 0 to 1."""
    return (255.0 * np.linspace(0.0, 1.0, ENCODING_STEPS) ** (2.0 / gamma)).astype(np.float32)


def light_of_greys(gamma: float) -> np.ndarray:
    """(256,) float32 linear light of each grey level."""
    return linear(np.arange(256), gamma).astype(np.float32)


@jit_finite
def encode(change, background, light, table, region, shade, keys, quantiles, sigma, noise, out):
    """Fill out (P, RGB) uint8: the encoded sum of background light and change, plus noise.

    P is the image (rows, columns), S its lattice of samples as in
    t2twin.sim.optical.light.illumination. change: (RGB, S) linear light, interpolated to the pixels
    of a region (first row, end row, first column, end column). The other pixels show the background
    (P, RGB), grey levels. light: (256,) linear light of each grey level. table: grey levels over
    the square root of linear light, 0 to 1. shade: (P) factors of the grey levels, or empty.
    noise: (P, RGB), multiplied by sigma; if it is empty, Gaussian white noise of standard deviation
    sigma, grey levels, from keys and quantiles.
    """
    last = np.float32(table.size - 1)
    rows, columns = background.shape[0], background.shape[1]
    is_white = noise.size == 0 and sigma > _ZERO
    lines = np.empty((3, change.shape[2]), dtype=np.float32)
    grey, value = np.empty(3 * columns, dtype=np.float32), np.empty(3 * columns, dtype=np.float32)
    entry, chosen = np.empty(3 * columns, dtype=np.uint32), np.empty(3 * columns, dtype=np.uint32)
    # in pairs of columns, so that no loop starts within a sample; indices of slices are never
    # negative, so their loops are vectorized
    pairs, end = region[2] // 2, (region[3] + 1) // 2
    for row in range(rows):
        still, filled = background[row].ravel(), out[row].ravel()
        for n in range(3 * columns):
            grey[n] = still[n]
        if region[0] <= row < region[1]:
            _interpolate(change, row, pairs, end, lines, value)
            under, shown = still[6 * pairs : 6 * end], grey[6 * pairs : 6 * end]
            # table lookups have separate loops, so that the others are vectorized
            for n in range(under.size):
                value[n] += light[under[n]]
            for n in range(under.size):
                root = np.sqrt(min(max(value[n], _ZERO), _ONE))
                entry[n] = np.uint32(np.int32(root * last + _HALF))
            for n in range(under.size):
                shown[n] = table[entry[n]]
        if shade.size > 0:
            factors = shade[row]
            for n in range(columns):
                for color in range(3):
                    grey[3 * n + color] *= factors[n]
        if is_white:
            choose(3 * columns * row, keys[0], keys[1], chosen)
            for n in range(3 * columns):
                grey[n] += sigma * quantiles[chosen[n]]
        elif noise.size > 0:
            added = noise[row].ravel()
            for n in range(3 * columns):
                grey[n] += sigma * added[n]
        for n in range(3 * columns):
            filled[n] = np.uint8(min(max(grey[n], _ZERO), _BRIGHTEST) + _HALF)


@inlined
def _interpolate(change, row, first, end, lines, value):
    """Fill value (columns * RGB) with a row of the change (RGB, S), from column pair `first` on.

    lines: buffer for a row of each color.
    """
    i = (row + 1) // 2
    u, w = (_APART, _NEAR) if row % 2 == 0 else (_NEAR, _APART)
    for c in range(3):
        above, below = change[c, i, first : end + 2], change[c, i + 1, first : end + 2]
        line = lines[c]
        for n in range(above.size):
            line[n] = u * above[n] + w * below[n]
    red, green, blue = lines[0], lines[1], lines[2]
    # a pair of columns surrounds sample n + 1; all six values in one loop, so that it is vectorized
    for n in range(end - first):
        value[6 * n] = _APART * red[n] + _NEAR * red[n + 1]
        value[6 * n + 1] = _APART * green[n] + _NEAR * green[n + 1]
        value[6 * n + 2] = _APART * blue[n] + _NEAR * blue[n + 1]
        value[6 * n + 3] = _NEAR * red[n + 1] + _APART * red[n + 2]
        value[6 * n + 4] = _NEAR * green[n + 1] + _APART * green[n + 2]
        value[6 * n + 5] = _NEAR * blue[n + 1] + _APART * blue[n + 2]
