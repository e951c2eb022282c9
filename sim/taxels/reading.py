"""Readings of a real array, with noise, wandering baselines and other imperfections.

Shape letters: R readings, N taxels, M terms of the memory.
"""

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from msgspec import structs
from scipy.special import ndtr, ndtri

from t2twin.core import arguments
from t2twin.core.errors import T2TwinError
from t2twin.sim.taxels.layout import Layout
from t2twin.sim.taxels.spec import CountsTable, Imperfections, Percentiles

SAME_LINE_MM = 1e-3  # tolerance of the places of a row or a column, mm

FAR_FROM_ZERO = 40.0  # level over its deviation at which clipping to 0 has no effect in float64
ARRAY_STREAM = 19  # random stream of an array's seed: the taxels' noise, offsets and memory
Presets = dict[str, Imperfections]  # imperfections of an array by name
NONE = "none"  # name of the preset without imperfections, which every array has
WHITE = "white"  # name of the preset that an array has unless another is given, if its file has it
DATASET_DEFAULT = "recorded"  # imperfections of datasets that name none, if the array has them


def chosen(presets: Presets, name: str, dead: tuple[int, ...], taxels: int) -> Imperfections:
    """A preset by name, with dead taxels added. taxels: number of them."""
    if arguments.text(name, "imperfections") not in presets and name != NONE:
        allowed = ", ".join(dict.fromkeys((NONE, *presets)))
        raise T2TwinError(f"no imperfections called {name!r}; allowed are {allowed}")
    flaws = presets.get(name, Imperfections())
    flaws = structs.replace(flaws, dead=tuple(dict.fromkeys((*flaws.dead, *dead))))
    flaws.check_dead(taxels)
    return flaws


def read_after(
    memory: np.ndarray | None, true_counts: np.ndarray, layout: Layout, flaws: Imperfections,
    counts: CountsTable, rng: np.random.Generator, array_seed: int = 0,
    seconds: float | None = None, readings: int | None = None,
) -> tuple[np.ndarray, np.ndarray | None]:  # fmt: skip
    """One sample of an array, the rounded mean of its readings, (N,) uint16, and its memory.

    memory: (M, N) after the sample before; None for an array that has long had these counts.
    true_counts: (N,) noiseless. array_seed: of the taxels' permanent properties. seconds: since the
    sample before; None for the readings' duration. readings: None for the number of the counts.
    """
    n, readings = layout.size, readings or counts.readings
    seconds = counts.sample_s if seconds is None else seconds
    gains = 1 + flaws.gain_spread * np.random.default_rng(array_seed).standard_normal(n)
    mixed = true_counts + flaws.crosstalk * (_neighbors(layout) @ true_counts)
    if flaws.line_crosstalk:
        mixed = mixed + flaws.line_crosstalk * (_lines(layout) @ true_counts)
    signal = gains * mixed
    signal *= 1 - flaws.hysteresis * rng.random(n)
    signal[list(flaws.dead)] = 0.0
    taxels = _taxels(flaws, n, array_seed)
    levels, memory = _remember(signal, memory, taxels, flaws, seconds / readings, readings)
    wandered = rng.random(n) < flaws.drift_share
    signals = levels + wandered * flaws.drift_counts * rng.standard_normal(n)
    found = signals + _deviation(flaws, taxels, levels) * rng.standard_normal((readings, n))
    if flaws.offset_counts:
        found += taxels.at_rest(rng.standard_normal((readings, n)))
    mean = np.clip(found, 0, counts.full_scale).mean(axis=0)
    return np.rint(mean).astype(np.uint16), memory


def expected_reading(
    flaws: Imperfections, counts: CountsTable, true_counts: np.ndarray, array_seed: int = 0
) -> tuple[np.ndarray, np.ndarray]:
    """Mean and standard deviation of readings of a static contact, (..., N) each.

    true_counts: (..., N) noiseless. Only offsets, noise and clipping to 0 are included.
    """
    array = _taxels(flaws, true_counts.shape[-1], array_seed)
    deviation = _deviation(flaws, array, true_counts)
    level = true_counts + array.offset_counts
    far = np.full_like(level, FAR_FROM_ZERO)
    score = np.divide(level, deviation, where=deviation > 0, out=far)
    density = np.exp(-(score**2) / 2) / np.sqrt(2 * np.pi)
    mean = level * ndtr(score) + deviation * density
    square = (level**2 + deviation**2) * ndtr(score) + level * deviation * density
    variance = np.maximum(square - mean**2, 0.0) + array.noise_counts**2
    std = np.sqrt(variance / counts.readings)
    return np.minimum(mean, counts.full_scale), std


def _deviation(flaws: Imperfections, taxels: "_Taxels", levels: np.ndarray) -> np.ndarray:
    """Standard deviation of one reading's normal noise at levels, (..., N)."""
    under_load = -np.expm1(-np.maximum(levels, 0.0) / flaws.load_noise_level_counts)
    return np.hypot(flaws.white_counts, taxels.load_noise_counts * under_load)


@dataclass(frozen=True)
class _Taxels:
    """Permanent properties of an array's taxels, (N,) each. memory: factor of memory_shares."""

    noise_counts: np.ndarray
    offset_counts: np.ndarray
    load_noise_counts: np.ndarray
    memory: np.ndarray

    def at_rest(self, scores: np.ndarray) -> np.ndarray:
        """Readings without contact, (R, N), of standard normal numbers of that shape."""
        # lognormal of mean m and deviation d: s^2 = ln(1 + d^2/m^2) and ln m - s^2/2
        mean = self.offset_counts
        ratio = np.divide(self.noise_counts, mean, where=mean > 0, out=np.zeros_like(mean))
        variance = np.log1p(ratio**2)
        return mean * np.exp(np.sqrt(variance) * scores - variance / 2)


@lru_cache(maxsize=64)
def _taxels(flaws: Imperfections, n: int, array_seed: int) -> _Taxels:
    """The taxels of an array; their evenly spread ranks give each array the whole distribution."""
    rng = np.random.default_rng((array_seed, ARRAY_STREAM))
    at_rest, loaded, memory = ((rng.permutation(n) + rng.random(n)) / n for _ in range(3))
    is_alive = np.ones(n)
    is_alive[list(flaws.dead)] = 0.0
    return _Taxels(
        is_alive * _percentiles(at_rest, flaws.noise_counts),
        is_alive * _percentiles(at_rest, flaws.offset_counts),
        is_alive * flaws.load_noise_counts * np.exp(flaws.load_noise_spread * ndtri(loaded)),
        np.exp(flaws.memory_spread * ndtri(memory)),
    )


def _percentiles(ranks: np.ndarray, at: Percentiles) -> np.ndarray:
    return np.interp(100 * ranks, *np.transpose(at)) if at else np.zeros(ranks.size)


def _remember(
    signal: np.ndarray, memory: np.ndarray | None, taxels: _Taxels, flaws: Imperfections,
    seconds: float, readings: int,
) -> tuple[np.ndarray, np.ndarray | None]:  # fmt: skip
    """The levels of readings that are some seconds apart, (R, N), and the memory after them."""
    # each term of the memory follows the signal: fast when it rises, with memory_s when it falls
    if not flaws.memory_shares:
        return np.broadcast_to(signal, (readings, signal.size)), None
    shares, falling_s = (np.array(each)[:, None] for each in (flaws.memory_shares, flaws.memory_s))
    ahead = np.zeros((shares.size, signal.size)) if memory is None else memory - signal
    time_s = np.where(ahead > 0, falling_s, flaws.memory_rise_s)
    times_s = seconds * np.arange(1, readings + 1)[:, None, None]
    decayed = ahead * np.exp(-times_s / time_s)
    levels = signal + taxels.memory * (shares * decayed).sum(axis=1)
    return levels, signal + decayed[-1]


def _neighbors(layout: Layout) -> np.ndarray:
    """(n, n), 1 for nearest neighbors: taxels within 1.2 times the layout's least distance."""
    distance = layout.distances_mm(layout)
    distance[np.diag_indices(layout.size)] = np.inf
    return (distance < 1.2 * distance.min()).astype(float)


def _lines(layout: Layout) -> np.ndarray:
    """(n, n), 1 for other taxels of the same row or column, by their places."""
    same = [np.abs(v[:, None] - v[None]) < SAME_LINE_MM for v in (layout.x_mm, layout.y_mm)]
    lines = (same[0] | same[1]).astype(float)
    lines[np.diag_indices(layout.size)] = 0.0
    return lines
