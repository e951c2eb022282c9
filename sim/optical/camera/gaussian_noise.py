"""Fast Gaussian white noise for all pixels of an image.

A counter-based generator (Salmon et al., Parallel random numbers: as easy as 1, 2, 3, SC 2011). The
index of a value and two keys of the frame are hashed; the hash's upper bits select a normal
quantile. So a loop needs no state and no array of samples. The hash is the finalizer of MurmurHash3
(Appleby, 2011) with the second key added between its two rounds.
"""

import math
from functools import cache

import numpy as np

from t2twin.sim.optical.camera.compiled import inlined, jit

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
    _fill(*keys(rng), quantiles(), out)
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
def _fill(key, other_key, quantiles, out):
    chosen = np.empty(out.size, dtype=np.uint32)
    choose(0, key, other_key, chosen)
    for n in range(chosen.size):
        out[n] = quantiles[chosen[n]]
