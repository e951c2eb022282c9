"""Intervals by bootstrap over shapes: presses of one shape are alike, so whole shapes are drawn.

With few shapes such intervals are too narrow rather than too wide: of eight they are a guide, not
a promise (Efron and Tibshirani 1993, percentile intervals).

Shape letters: B resamples, K shapes.
"""

import numpy as np

from t2twin.translate.evaluation.metrics import Figures

RESAMPLES = 1000
SEED = 0
CONFIDENCE = 0.95


def draws(shapes: int, seed: int = SEED, resamples: int = RESAMPLES) -> np.ndarray:
    """How often each shape is drawn in each resample: (B, K), rows summing to K."""
    rng = np.random.default_rng(seed)
    return rng.multinomial(shapes, np.full(shapes, 1.0 / shapes), size=resamples).astype(float)


def replicates(
    figures: Figures, shapes: np.ndarray, full_scale: float, seed: int = SEED
) -> dict[str, np.ndarray]:
    """Every figure of Figures.summary in every resample of the shapes: (B,) by name.

    shapes: (P,) names, a pair's shape each. The same seed and shapes give the same resamples, so
    that differences between two models are paired.
    """
    names, place = np.unique(shapes, return_inverse=True)
    sums = figures.sums(place, names.size)
    return figures.of_sums({k: draws(names.size, seed) @ v for k, v in sums.items()}, full_scale)


def interval(values: np.ndarray) -> list[float] | None:
    """The percentile interval that holds CONFIDENCE of (B,) values.

    None where they are all one, as of a single shape, or where too few are numbers.
    """
    known = values[np.isfinite(values)]
    if known.size < values.size / 2 or np.ptp(known) == 0:
        return None
    low, high = np.quantile(known, [(1 - CONFIDENCE) / 2, (1 + CONFIDENCE) / 2])
    return [float(low), float(high)]
