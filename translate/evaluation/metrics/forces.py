"""Force bins of presses, and the predictor of the mean array of each bin.

A few different forces have one bin each; many forces have bins of equal width in the logarithm.
Presses without contact, of force 0, have a bin of their own. Imported pairs with unknown forces are
in no bin.

Shape letters: P pairs, N taxels, b pairs of a bin.
"""

from dataclasses import dataclass

import numpy as np

from t2twin.translate.data.pairs import Pairs
from t2twin.translate.evaluation.metrics.array_errors import PairFigures, interval, rmse_by_group
from t2twin.translate.evaluation.metrics.baselines import mean_array
from t2twin.translate.evaluation.records import ForceFigures, MeanOf

MEAN_ARRAY_OF_FORCE = "mean-array-of-force"
"""Name of the row; only with several forces."""

MAX_FORCES = 12
"""Maximum number of forces with a bin each (assumed: the lines of a table)."""

DECIMALS = 2
"""Decimals to which forces are rounded, N (assumed)."""

BINS_PER_DOUBLING = 2
"""Bins per factor of two of the force: edges at 0.5, 0.71, 1, 1.41, 2 N (assumed)."""

MIN_PRESSES = 50
"""Minimum number of training presses for a mean array (assumed: its standard error is a seventh of
the presses' standard deviation)."""


@dataclass(frozen=True)
class ForceBin:
    """Presses in one range of forces.

    low_n, high_n: its edges, N, equal for a single force; 0 without contact. mean_n: mean force of
    its pairs, N. members: (b,) indices of its pairs. mean_array: (N,), mean counts of the presses
    in this bin, of the training pairs (mean_of "training") or, with fewer than MIN_PRESSES of them,
    of the pairs themselves ("split").
    """

    low_n: float
    high_n: float
    mean_n: float
    members: np.ndarray
    mean_array: np.ndarray
    mean_of: MeanOf

    @property
    def has_contact(self) -> bool:
        return self.high_n > 0


def force_bins(pairs: Pairs, train: Pairs) -> tuple[ForceBin, ...]:
    """The bins of pairs in ascending order of force; empty if no force is known.

    train: the training pairs, for the mean arrays.
    """
    single = _are_few(np.concatenate([pairs.force_n, train.force_n]))
    own, trained = (_low_edges_n(each.force_n, single) for each in (pairs, train))
    bins = []
    for low in np.unique(own[~np.isnan(own)]):
        members = np.flatnonzero(own == low)
        others = np.flatnonzero(trained == low)
        mean_of: MeanOf = "training" if others.size >= MIN_PRESSES else "split"
        counts = train.counts[others] if mean_of == "training" else pairs.counts[members]
        bins.append(
            ForceBin(
                low_n=float(low),
                high_n=float(low if single else low * 2 ** (1 / BINS_PER_DOUBLING)),
                mean_n=float(pairs.force_n[members].mean()),
                members=members,
                mean_array=counts.mean(axis=0, dtype=float).astype(np.float32),
                mean_of=mean_of,
            )
        )
    return tuple(bins)


def mean_array_of_force(bins: tuple[ForceBin, ...], pairs: Pairs, train: Pairs) -> np.ndarray:
    """(P, N) float32, counts: mean array of each pair's bin, or of training if it has no bin."""
    predicted = np.tile(mean_array(train), (len(pairs), 1))
    for one in bins:
        predicted[one.members] = one.mean_array
    return predicted


def by_force(
    predicted: np.ndarray,
    figures: PairFigures,
    pairs: Pairs,
    bins: tuple[ForceBin, ...],
    full_scale: float,
) -> tuple[ForceFigures, ...]:
    """Errors of one model in each bin.

    predicted: (P, N) counts. figures: of each pair (array_errors.compare). full_scale: counts.
    """
    if not bins:
        return ()
    known = np.concatenate([one.members for one in bins])
    place = np.repeat(np.arange(len(bins)), [one.members.size for one in bins])
    samples = rmse_by_group(figures.squared_error[known], pairs.shapes[known], place, len(bins))
    rows = []
    for one, resampled in zip(bins, samples.T, strict=True):
        # The summation of the overall error, so that a single bin has exactly that error.
        summary = figures.summary(full_scale, np.isin(np.arange(len(pairs)), one.members))
        squares = np.square(one.mean_array - pairs.counts[one.members].astype(float))
        level = float(np.sqrt(squares.mean()))
        totals = predicted[one.members].sum(axis=1, dtype=float)
        rows.append(
            ForceFigures(
                low_n=one.low_n,
                high_n=one.high_n,
                mean_n=one.mean_n,
                pairs=summary.pairs,
                rmse_counts=summary.rmse_counts,
                rmse_percent=summary.rmse_percent,
                interval=interval(resampled),
                of_mean_array=summary.rmse_counts / level if one.has_contact and level else None,
                mean_of=one.mean_of if one.has_contact else None,
                phantom_counts=None if one.has_contact else float(totals.mean()),
            )
        )
    return tuple(rows)


def _are_few(force_n: np.ndarray) -> bool:
    touching = force_n[force_n > 0]
    return np.unique(touching.round(DECIMALS)).size <= MAX_FORCES


def _low_edges_n(force_n: np.ndarray, single: bool) -> np.ndarray:
    """(P,) lower edge of each press's bin, N; NaN for unknown forces."""
    if single:
        return force_n.astype(float).round(DECIMALS)
    low = np.where(np.isnan(force_n), np.nan, 0.0)
    touching = force_n > 0
    steps = np.floor(BINS_PER_DOUBLING * np.log2(force_n[touching]))
    low[touching] = 2.0 ** (steps / BINS_PER_DOUBLING)
    return low
