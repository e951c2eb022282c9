"""Bootstrap intervals over shapes: presses of one shape are similar, so whole shapes are resampled.

Percentile intervals (Efron and Tibshirani 1993) of few shapes are too narrow: with eight shapes
they are a guide only.

Shape letters: B resamples, K shapes, P pairs.
"""

from collections.abc import Iterator

import numpy as np

from t2twin.translate.evaluation.metrics.array_errors import (
    GroupedFigures,
    PairFigures,
    figures_of,
    mean_of,
)
from t2twin.translate.evaluation.records import Interval, Intervals

RESAMPLES = 1000
SEED = 0
CONFIDENCE = 0.95


MAX_NUMBERS = 20_000_000
"""Maximum size of an array of weights; bounds memory to 160 MB with many shapes."""


def resample_weights(shapes: int, seed: int = SEED, resamples: int = RESAMPLES) -> np.ndarray:
    """Multiplicity of each shape in each resample: (B, K); rows sum to K."""
    return np.concatenate(list(_weights_in_parts(shapes, seed, resamples)))


def replicates(
    figures: PairFigures, shapes: np.ndarray, full_scale: float, seed: int = SEED
) -> GroupedFigures:
    """Every figure in each resample of the shapes: (B,) each.

    shapes: (P,) names. Equal seeds and shapes result in equal resamples, so that differences
    between two models are paired.
    """
    names, place = np.unique(shapes, return_inverse=True)
    sums = figures.sums(place, names.size)
    weights = list(_weights_in_parts(names.size, seed))
    resampled = {
        name: (
            np.concatenate([part @ total for part in weights]),
            np.concatenate([part @ pairs for part in weights]),
        )
        for name, (total, pairs) in sums.items()
    }
    return figures_of(resampled, full_scale)


def rmse_by_group(
    squared_error: np.ndarray, shapes: np.ndarray, place: np.ndarray, groups: int
) -> np.ndarray:
    """RMSE of groups of pairs in each resample of the shapes: (B, groups), counts.

    squared_error: (P,), counts^2. shapes: (P,) names. place: (P,) the group of each pair, 0 to
    groups - 1. NaN if a resample has no pair of a group.
    """
    names, of_shape = np.unique(shapes, return_inverse=True)
    cell, cells = of_shape * groups + place, names.size * groups
    total = np.bincount(cell, squared_error, cells).reshape(-1, groups)
    pairs = np.bincount(cell, minlength=cells).reshape(-1, groups).astype(float)
    means = [
        mean_of(weights @ total, weights @ pairs) for weights in _weights_in_parts(names.size, SEED)
    ]
    return np.sqrt(np.concatenate(means))


def _weights_in_parts(shapes: int, seed: int, resamples: int = RESAMPLES) -> Iterator[np.ndarray]:
    """`resample_weights` in parts, (b, K) each."""
    rng = np.random.default_rng(seed)
    shares = np.full(shapes, 1.0 / shapes)
    rows = max(1, MAX_NUMBERS // shapes)
    for start in range(0, resamples, rows):
        size = min(rows, resamples - start)
        yield rng.multinomial(shapes, shares, size=size).astype(float)


def interval(values: np.ndarray) -> Interval | None:
    """The percentile interval that contains CONFIDENCE of (B,) values.

    None if all values are equal, as for a single shape, or if less than half are finite.
    """
    known = values[np.isfinite(values)]
    if known.size < values.size / 2 or np.ptp(known) == 0:
        return None
    low, high = np.quantile(known, [(1 - CONFIDENCE) / 2, (1 + CONFIDENCE) / 2])
    return Interval(float(low), float(high))


def intervals(resampled: GroupedFigures) -> Intervals:
    """The intervals of all figures of `replicates`."""
    return {name: interval(values) for name, values in resampled.items()}
