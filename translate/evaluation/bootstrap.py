"""Intervals by bootstrap over shapes: presses of one shape are alike, so whole shapes are drawn.

With few shapes such intervals are too narrow rather than too wide: of eight they are a guide, not
a promise (Efron and Tibshirani 1993, percentile intervals).

Shape letters: B resamples, K shapes.
"""

from dataclasses import fields

import numpy as np

from t2twin.translate.evaluation.metrics import GroupedFigures, PairFigures, Sum, figures_of
from t2twin.translate.evaluation.records import Interval, Intervals

RESAMPLES = 1000
SEED = 0
CONFIDENCE = 0.95


def draws(shapes: int, seed: int = SEED, resamples: int = RESAMPLES) -> np.ndarray:
    """How often each shape is drawn in each resample: (B, K), rows summing to K."""
    rng = np.random.default_rng(seed)
    return rng.multinomial(shapes, np.full(shapes, 1.0 / shapes), size=resamples).astype(float)


def replicates(
    figures: PairFigures, shapes: np.ndarray, full_scale: float, seed: int = SEED
) -> GroupedFigures:
    """Every figure in every resample of the shapes: (B,) each.

    shapes: (P,) names, a pair's shape each. The same seed and shapes give the same resamples, so
    that differences between two models are paired.
    """
    names, place = np.unique(shapes, return_inverse=True)
    drawn = draws(names.size, seed)
    sums = figures.sums(place, names.size)
    return figures_of(
        {name: Sum(drawn @ one.total, drawn @ one.pairs) for name, one in sums.items()}, full_scale
    )


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
