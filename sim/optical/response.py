"""Camera response: encodes light as grey levels, adds noise and rounds.

grey = 255 light^(1 / gamma), with the optics file's gamma.

White noise is from a counter-based generator (Salmon et al., Parallel random numbers: as easy as 1,
2, 3, SC 2011). The index of a value and two keys of the frame are hashed; the hash's upper bits
select a normal quantile. So a loop needs no state and no array of samples. The hash is the
finalizer of MurmurHash3 (Appleby, 2011) with the second key added between its two rounds.

Measured noise is correlated between neighboring pixels and between colors: white noise of each
pixel and color is smoothed along both axes and mixed over the colors.
"""

import math
from dataclasses import dataclass
from functools import cache, reduce

import numpy as np

from t2twin.core.arrays import Record
from t2twin.core.errors import T2TwinError
from t2twin.sim.optical.compiled import inlined, jit, jit_finite

BITS = 12  # of a hash, select one of 4,096 quantiles, the outermost at 3.7 standard deviations
REACH = 2
"""Radius of the smoothing of measured noise, px: the correlation of real noise is small beyond (0.2
at 3 px, measured on a real unit)."""
TAPS = 2 * REACH + 1
MAX_MIX_GREY = 64.0  # largest entry of a mix, grey levels (assumed: a DIGIT's noise has 2 to 4)
ENCODING_STEPS = 4096  # grey levels over the root of linear light, at most 0.12 apart

_ZERO, _ONE, _HALF = np.float32(0.0), np.float32(1.0), np.float32(0.5)
_BRIGHTEST = np.float32(255.0)
_NEAR, _APART = np.float32(0.75), np.float32(0.25)

Keys = tuple[np.uint32, np.uint32]  # the keys of one frame's noise

_GOLDEN, _FIRST, _SECOND = (np.uint32(n) for n in (0x9E3779B9, 0x85EBCA6B, 0xC2B2AE35))
_HALF_WORD, _THIRTEEN = np.uint32(16), np.uint32(13)
_UPPER, _MIDDLE, _MASK = np.uint32(32 - BITS), np.uint32(32 - 2 * BITS), np.uint32(2**BITS - 1)


def keys(rng: np.random.Generator) -> Keys:
    """Keys for one frame."""
    first, second = rng.integers(2**32, size=2, dtype=np.uint32)
    return first, second


@cache
def quantiles() -> np.ndarray:
    """(2^BITS,) float32 standard normal quantiles, at the middles of equal probabilities."""
    from scipy.special import ndtri  # slow to import

    count = 2**BITS
    return ndtri((np.arange(count) + 0.5) / count).astype(np.float32)


def standard_normal(rng: np.random.Generator, shape: tuple[int, ...]) -> np.ndarray:
    """Independent standard normal values of a shape, float32."""
    count = math.prod(shape)
    out = np.empty((1, count + count % 2), dtype=np.float32)
    _fill_white(*keys(rng), quantiles(), out)
    return out[0, :count].reshape(shape)


@inlined
def choose(first, key, other_key, chosen):
    """Fill chosen (n,) uint32, n even, with indices of quantiles for values from `first`, even, on.
    The upper and middle bits of one hash give two values, half a row apart."""
    half = chosen.size // 2
    start = np.uint32(first)
    for n in range(half):
        # numba widens results of uint32; the casts keep the loop vectorized
        word = np.uint32(np.uint32((start + np.uint32(n)) * _GOLDEN) + key)
        word = np.uint32(np.uint32(word ^ np.uint32(word >> _HALF_WORD)) * _FIRST)
        word = np.uint32(word + other_key)
        word = np.uint32(np.uint32(word ^ np.uint32(word >> _THIRTEEN)) * _SECOND)
        word = np.uint32(word ^ np.uint32(word >> _HALF_WORD))
        chosen[n] = word >> _UPPER
        chosen[half + n] = (word >> _MIDDLE) & _MASK


@jit
def _fill_white(key, other_key, quantiles, out):
    """Fill out (rows, n), n even, with white noise."""
    chosen = np.empty(out.shape[1], dtype=np.uint32)
    for row in range(out.shape[0]):
        choose(row * chosen.size, key, other_key, chosen)
        for n in range(chosen.size):
            out[row, n] = quantiles[chosen[n]]


@dataclass(frozen=True, eq=False)
class Noise(Record):
    """Noise of one frame. Raises T2TwinError for other shapes and values out of range."""

    mix: np.ndarray  # (3, 3) grey levels, weights of three independent noises for each color
    taps: np.ndarray  # (TAPS,) weights of the smoothing along each axis, of unit energy

    def __post_init__(self) -> None:
        super().__post_init__()
        for name, value, shape, most in (
            ("mix", self.mix, (3, 3), MAX_MIX_GREY),
            ("taps", self.taps, (TAPS,), 1.0),
        ):
            if value.shape != shape or value.dtype.kind not in "fiu":
                raise T2TwinError(f"the noise's {name} must be {shape} numbers")
            if not np.abs(value).max() <= most:  # nor is nan
                raise T2TwinError(f"the noise's {name} must lie between -{most:g} and {most:g}")

    @property
    def grey(self) -> float:
        """Standard deviation over all colors, grey levels."""
        return float(np.sqrt(np.mean(np.sum(self.mix**2, axis=1))))

    def sample(self, rng: np.random.Generator, rows: int, columns: int) -> np.ndarray:
        """(rows, columns, 3) float32: noise of one frame, grey levels."""
        # white noise covers the image and a margin of the smoothing's radius
        even = columns + columns % 2
        white = np.empty((rows + 2 * REACH, (even + 2 * REACH) * 3), dtype=np.float32)
        _fill_white(*keys(rng), quantiles(), white)
        taps, mix = self.taps.astype(np.float32), self.mix.astype(np.float32)
        down = reduce(np.add, (tap * white[k : k + rows] for k, tap in enumerate(taps)))
        sides = (tap * down[:, 3 * k : 3 * (k + columns)] for k, tap in enumerate(taps))
        independent = reduce(np.add, sides).reshape(rows, columns, 3, 1)
        return reduce(np.add, (independent[:, :, k] * mix[:, k] for k in range(3)))


def linear(grey: np.ndarray, gamma: float) -> np.ndarray:
    """Light, 0 to 1, of grey levels, 0 to 255."""
    return (np.asarray(grey) / 255.0) ** gamma


@jit_finite
def encode(
    change, background, light, table, region, shade, keys, quantiles, sigma, noise, lines, values,
    indices, out,
):  # fmt: skip
    """Fill out (rows, columns * RGB) uint8: the encoded sum of background light and change, plus
    noise.

    S is the image's lattice of samples as in t2twin.sim.optical.illumination. change: (RGB, S)
    linear light, interpolated to the pixels of a region; the others show the background, grey
    levels. light: like out, linear light of the background. table: of ENCODING_STEPS. shade: (rows,
    columns) factors of the grey levels, or empty. noise: like out, multiplied by sigma; if it is
    empty, white noise of standard deviation sigma, grey levels, from keys and quantiles. lines: (3,
    columns of S), values, indices: (2, RGB of whole pairs of columns), are work arrays.
    """
    last = np.float32(table.size - 1)
    rows, columns = background.shape[0], background.shape[1] // 3
    is_white = noise.size == 0 and sigma > _ZERO
    grey, value, entry, chosen = values[0], values[1], indices[0], indices[1]
    # in pairs of columns, so that no loop starts within a sample; indices of slices are never
    # negative, so their loops are vectorized
    pairs, end = region[2] // 2, (region[3] + 1) // 2
    for row in range(rows):
        still, filled = background[row], out[row]
        for n in range(3 * columns):
            grey[n] = still[n]
        if region[0] <= row < region[1]:
            _interpolate(change, row, pairs, end, lines, value)
            under, shown = light[row, 6 * pairs : 6 * end], grey[6 * pairs : 6 * end]
            # table lookups have separate loops, so that the others are vectorized
            for n in range(under.size):
                root = np.sqrt(min(max(value[n] + under[n], _ZERO), _ONE))
                entry[n] = np.uint32(np.int32(root * last + _HALF))
            for n in range(under.size):
                shown[n] = table[entry[n]]
        if shade.size > 0:
            factors = shade[row]
            for n in range(columns):
                for color in range(3):
                    grey[3 * n + color] *= factors[n]
        if is_white:
            choose(chosen.size * row, keys[0], keys[1], chosen)
            for n in range(3 * columns):
                grey[n] += sigma * quantiles[chosen[n]]
        elif noise.size > 0:
            added = noise[row]
            for n in range(3 * columns):
                grey[n] += sigma * added[n]
        for n in range(3 * columns):
            filled[n] = np.uint8(min(max(grey[n], _ZERO), _BRIGHTEST) + _HALF)


@inlined
def _interpolate(change, row, first, end, lines, value):
    """Fill value (columns * RGB) with a row of the change (RGB, S), from column pair `first` on;
    lines is a buffer for a row of each color."""
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
