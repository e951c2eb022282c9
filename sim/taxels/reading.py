"""Readings of a real array, with noise, wandering baselines and other imperfections.

Shape letters: R readings, N taxels, M terms of the memory.
"""

from functools import lru_cache

import numpy as np

from t2twin.sim.taxels.layout import Layout
from t2twin.sim.taxels.spec import CountsTable, Imperfections, Percentiles, Ratios

SAME_LINE_MM = 1e-3  # tolerance of the places of a row or a column, mm
NEIGHBORS = 1.2  # largest distance of neighbors, divided by the layout's least distance
FAR_FROM_ZERO = 40.0  # level over its deviation at which clipping to 0 has no effect in float64
ARRAY_STREAM = 19  # random stream of an array's seed: the taxels' noise, offsets and memory
NONE = "none"  # name of the preset without imperfections, which every array has
WHITE = "white"  # name of the preset that an array has unless another is given, if its file has it
DATASET_DEFAULT = "recorded"  # imperfections of datasets that name none, if the array has them


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
    if seconds is None:  # only a memory depends on it
        seconds = counts.readings / (counts.rate_hz or 1.0)
    mixed = true_counts
    if flaws.crosstalk:
        apart = layout.distances_mm(layout) + np.diag(np.full(n, np.inf))
        neighbors = (apart < NEIGHBORS * apart.min()).astype(float)
        mixed = mixed + flaws.crosstalk * (neighbors @ true_counts)
    if flaws.line_crosstalk:
        same = [np.abs(v[:, None] - v) < SAME_LINE_MM for v in (layout.x_mm, layout.y_mm)]
        lines = ((same[0] | same[1]) & ~np.eye(n, dtype=bool)).astype(float)
        mixed = mixed + flaws.line_crosstalk * (lines @ true_counts)
    noise, offset, load_noise, factors, gains = _taxels(flaws, n, array_seed)
    signal = gains * mixed
    signal *= 1 - flaws.hysteresis * rng.random(n)
    signal[list(flaws.dead)] = 0.0
    levels, memory = _remember(signal, memory, factors, flaws, seconds / readings, readings)
    wandered = rng.random(n) < flaws.drift_share
    signals = levels + wandered * flaws.drift_counts * rng.standard_normal(n) + offset
    deviation = _deviation(flaws, noise, load_noise, levels)
    found = signals + deviation * rng.standard_normal((readings, n))
    mean = np.clip(found, 0, counts.full_scale).mean(axis=0)
    return np.rint(mean).astype(np.uint16), memory


def expected_reading(
    flaws: Imperfections, counts: CountsTable, true_counts: np.ndarray, array_seed: int = 0
) -> tuple[np.ndarray, np.ndarray]:
    """Mean and standard deviation of readings of a static contact, (..., N) each, with offsets,
    noise and clipping to 0 alone. true_counts: (..., N) noiseless."""
    from scipy.special import ndtr  # slow to import

    noise, offset, load_noise, *_ = _taxels(flaws, true_counts.shape[-1], array_seed)
    deviation = _deviation(flaws, noise, load_noise, true_counts)
    level = true_counts + offset
    far = np.full_like(level, FAR_FROM_ZERO)
    score = np.divide(level, deviation, where=deviation > 0, out=far)
    density = np.exp(-(score**2) / 2) / np.sqrt(2 * np.pi)
    mean = level * ndtr(score) + deviation * density
    square = (level**2 + deviation**2) * ndtr(score) + level * deviation * density
    std = np.sqrt(np.maximum(square - mean**2, 0.0) / counts.readings)
    return np.minimum(mean, counts.full_scale), std


def _deviation(
    flaws: Imperfections, noise: np.ndarray, load_noise: np.ndarray, levels: np.ndarray
) -> np.ndarray:
    """Standard deviation of one reading's normal noise at levels, (..., N)."""
    under_load = -np.expm1(-np.maximum(levels, 0.0) / flaws.load_noise_level_counts)
    loaded = np.hypot(flaws.white_counts, load_noise * under_load)
    return np.hypot(loaded, noise)


@lru_cache(maxsize=64)
def _taxels(flaws: Imperfections, n: int, array_seed: int) -> tuple[np.ndarray, ...]:
    """Noise, offset and load noise of an array's taxels, counts, factors of memory_shares, and
    gains, (n,) each; the evenly spread ranks give each array the whole distribution."""
    from scipy.special import ndtri  # slow to import

    rng = np.random.default_rng((array_seed, ARRAY_STREAM))
    at_rest, loaded, memory, offset = ((rng.permutation(n) + rng.random(n)) / n for _ in range(4))
    is_alive = np.ones(n)
    is_alive[list(flaws.dead)] = 0.0

    def percentiles(at: Percentiles | Ratios, ranks: np.ndarray) -> np.ndarray:
        return is_alive * np.interp(100 * ranks, *np.transpose(at)) if at else np.zeros(n)

    noise = percentiles(flaws.noise_counts, at_rest)
    ratios = percentiles(flaws.offset_ratios, offset)
    return (
        noise,
        percentiles(flaws.offset_counts, at_rest) + ratios * noise,
        is_alive * flaws.load_noise_counts * np.exp(flaws.load_noise_spread * ndtri(loaded)),
        np.exp(flaws.memory_spread * ndtri(memory)),
        1 + flaws.gain_spread * np.random.default_rng(array_seed).standard_normal(n),
    )


def _remember(
    signal: np.ndarray, memory: np.ndarray | None, factors: np.ndarray, flaws: Imperfections,
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
    levels = signal + factors * (shares * decayed).sum(axis=1)
    return levels, signal + decayed[-1]
