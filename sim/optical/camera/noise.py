"""Camera noise: fast Gaussian white noise, and measured noise with correlations.

White noise is from a counter-based generator (Salmon et al., Parallel random numbers: as easy as 1,
2, 3, SC 2011). The index of a value and two keys of the frame are hashed; the hash's upper bits
select a normal quantile. So a loop needs no state and no array of samples. The hash is the
finalizer of MurmurHash3 (Appleby, 2011) with the second key added between its two rounds.

Measured noise is correlated between neighboring pixels and between colors: white noise of each
pixel and color is smoothed along both axes and mixed over the colors.
"""

import math
from dataclasses import dataclass
from functools import cache

import numpy as np

from t2twin.core.errors import T2TwinError
from t2twin.sim.optical.camera.compiled import inlined, jit, jit_finite

BITS = 12
"""Bits of a hash that select a quantile: one of 4,096, the outermost at 3.7 standard deviations."""

Keys = tuple[np.uint32, np.uint32]
"""The keys of one frame's noise."""

_GOLDEN, _FIRST, _SECOND = (np.uint32(n) for n in (0x9E3779B9, 0x85EBCA6B, 0xC2B2AE35))
_HALF_WORD, _THIRTEEN = np.uint32(16), np.uint32(13)
_UPPER, _MIDDLE, _MASK = np.uint32(32 - BITS), np.uint32(32 - 2 * BITS), np.uint32(2**BITS - 1)


def keys(rng: np.random.Generator) -> Keys:
    """Keys for one frame."""
    first, second = rng.integers(2**32, size=2, dtype=np.uint32)
    return first, second


@cache
def quantiles() -> np.ndarray:
    """(2^BITS,) float32 standard normal quantiles, at the middles of equal probabilities.

    After rounding to grey levels, samples of them are as good as normal samples.
    """
    from scipy.special import ndtri

    count = 2**BITS
    return ndtri((np.arange(count) + 0.5) / count).astype(np.float32)


def standard_normal(rng: np.random.Generator, shape: tuple[int, ...]) -> np.ndarray:
    """Independent standard normal values of a shape, float32."""
    count = math.prod(shape)
    out = np.empty(count + count % 2, dtype=np.float32)
    _fill_white(*keys(rng), quantiles(), out)
    return out[:count].reshape(shape)


@inlined
def choose(first, key, other_key, chosen):
    """Fill chosen (n,) uint32, n even, with indices of quantiles for n values from `first` on.

    first: even. The upper and middle bits of one hash give two values, half a row apart.
    """
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
    chosen = np.empty(out.size, dtype=np.uint32)
    choose(0, key, other_key, chosen)
    for n in range(chosen.size):
        out[n] = quantiles[chosen[n]]


REACH = 2
"""Radius of the smoothing, px: the correlation of real noise is small beyond (0.2 at 3 px, measured
on a real unit)."""
TAPS = 2 * REACH + 1
MAX_MIX_GREY = 64.0
"""Largest entry of a mix, grey levels (assumed: a DIGIT's noise has 2 to 4)."""


@dataclass(frozen=True, eq=False)
class Noise:
    """Noise of one frame.

    mix: (3, 3) grey levels, weights of three independent noises of unit variance for each color.
    taps: (TAPS,) weights of the smoothing along each axis, of unit energy.
    Raises T2TwinError for other shapes and values out of range.
    """

    mix: np.ndarray
    taps: np.ndarray

    def __post_init__(self) -> None:
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
        out = np.empty((rows, columns, 3), dtype=np.float32)
        taps, mix = self.taps.astype(np.float32), self.mix.astype(np.float32)
        _fill_measured(keys(rng), quantiles(), taps, mix, out)
        return out


@jit_finite
def _fill_measured(keys, quantiles, taps, mix, out):
    """Fill out (P, RGB) with Gaussian noise, smoothed and mixed.

    The white noise covers the image and a margin of the smoothing's radius.
    """
    columns, reach = out.shape[1], taps.size // 2
    down = np.empty((columns + 2 * reach) * 3, dtype=np.float32)
    across = np.empty(columns * 3, dtype=np.float32)
    rows = np.empty((taps.size, down.size), dtype=np.float32)
    chosen = np.empty(down.size, dtype=np.uint32)
    for row in range(out.shape[0] + 2 * reach):
        line = rows[row % taps.size]
        choose(row * down.size, keys[0], keys[1], chosen)
        for n in range(line.size):
            line[n] = quantiles[chosen[n]]
        if row < 2 * reach:
            continue
        down[:] = np.float32(0.0)
        for k in range(taps.size):
            tap, line = taps[k], rows[(row - 2 * reach + k) % taps.size]
            for n in range(down.size):
                down[n] += tap * line[n]
        across[:] = np.float32(0.0)
        for k in range(taps.size):
            tap, shifted = taps[k], down[3 * k : 3 * k + across.size]
            for n in range(across.size):
                across[n] += tap * shifted[n]
        filled = out[row - 2 * reach]
        for n in range(columns):
            a, b, c = across[3 * n], across[3 * n + 1], across[3 * n + 2]
            for color in range(3):
                filled[n, color] = mix[color, 0] * a + mix[color, 1] * b + mix[color, 2] * c
