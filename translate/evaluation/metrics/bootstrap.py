"""Intervals by bootstrap over shapes: presses of one shape are alike, so whole shapes are drawn.

With few shapes such intervals are too narrow rather than too wide: of eight they are a guide, not
a promise (Efron and Tibshirani 1993, percentile intervals).

Shape letters: B resamples, K shapes.
"""

from collections.abc import Iterator
from dataclasses import fields

import numpy as np

from t2twin.translate.evaluation.metrics.array_errors import (
    GroupedFigures,
    PairFigures,
    Sum,
    figures_of,
)
from t2twin.translate.evaluation.records import Interval, Intervals

RESAMPLES = 1000
SEED = 0
CONFIDENCE = 0.95


NUMBERS_AT_ONCE = 20_000_000
"""Numbers that are drawn together; bounds memory to 160 MB where shapes are many."""


def draws(shapes: int, seed: int = SEED, resamples: int = RESAMPLES) -> np.ndarray:
    """How often each shape is drawn in each resample: (B, K), rows summing to K."""
    return np.concatenate(list(_parts_of_draws(shapes, seed, resamples)))


def replicates(
    figures: PairFigures, shapes: np.ndarray, full_scale: float, seed: int = SEED
) -> GroupedFigures:
    """Every figure in every resample of the shapes: (B,) each.

    shapes: (P,) names, a pair's shape each. The same seed and shapes give the same resamples, so
    that differences between two models are paired.
    """
    names, place = np.unique(shapes, return_inverse=True)
    sums = figures.sums(place, names.size)
    parts = [
        {name: Sum(drawn @ one.total, drawn @ one.pairs) for name, one in sums.items()}
        for drawn in _parts_of_draws(names.size, seed)
    ]
    return figures_of(
        {
            name: Sum(
                np.concatenate([part[name].total for part in parts]),
                np.concatenate([part[name].pairs for part in parts]),
            )
            for name in sums
        },
        full_scale,
    )


def rmse_by_group(
    squared_error: np.ndarray, shapes: np.ndarray, place: np.ndarray, groups: int
) -> np.ndarray:
    """The RMSE of groups of pairs in every resample of the shapes: (B, groups), counts.

    squared_error: (P,) of each pair, counts^2. shapes: (P,) names. place: (P,) the group of each
    pair, 0 to groups - 1. NaN where a resample has no pair of a group.
    """
    names, of_shape = np.unique(shapes, return_inverse=True)
    cell, cells = of_shape * groups + place, names.size * groups
    total = np.bincount(cell, squared_error, cells).reshape(-1, groups)
    pairs = np.bincount(cell, minlength=cells).reshape(-1, groups).astype(float)
    sums = [Sum(drawn @ total, drawn @ pairs) for drawn in _parts_of_draws(names.size, SEED)]
    return np.sqrt(np.concatenate([one.mean for one in sums]))


def _parts_of_draws(shapes: int, seed: int, resamples: int = RESAMPLES) -> Iterator[np.ndarray]:
    """`draws`, (b, K) at a time."""
    rng = np.random.default_rng(seed)
    shares = np.full(shapes, 1.0 / shapes)
    at_once = max(1, NUMBERS_AT_ONCE // shapes)
    for start in range(0, resamples, at_once):
        size = min(at_once, resamples - start)
        yield rng.multinomial(shapes, shares, size=size).astype(float)


def interval(values: np.ndarray) -> Interval | None:
    """The percentile interval that holds CONFIDENCE of (B,) values.

    None where they are all one, as of a single shape, or where too few are numbers.
    """
    known = values[np.isfinite(values)]
    if known.size < values.size / 2 or np.ptp(known) == 0:
        return None
    low, high = np.quantile(known, [(1 - CONFIDENCE) / 2, (1 + CONFIDENCE) / 2])
    return Interval(float(low), float(high))


def intervals(resampled: GroupedFigures) -> Intervals:
    """The interval of every figure of `replicates`."""
    return Intervals(
        **{each.name: interval(getattr(resampled, each.name)) for each in fields(Intervals)}
    )
