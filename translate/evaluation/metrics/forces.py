"""Presses by their force, and the predictor that knows the force of a press and nothing else.

Few forces are bins of their own; of many, bins are as wide in the logarithm. Presses that touch
nothing, of force 0, are a bin of their own. Imported pairs may not say their forces; they are in no
bin.

Shape letters: P pairs, N taxels, b pairs of a bin.
"""

from dataclasses import dataclass

import numpy as np

from t2twin.translate.data.pairs import Pairs
from t2twin.translate.evaluation.metrics.array_errors import PairFigures
from t2twin.translate.evaluation.metrics.baselines import mean_array
from t2twin.translate.evaluation.metrics.bootstrap import interval, rmse_by_group
from t2twin.translate.evaluation.records import ForceFigures, MeanOf

MEAN_ARRAY_OF_FORCE = "mean-array-of-force"
"""The row's name among the models; only where there are several forces."""

MAX_FORCES = 12
"""Different forces that are each a bin of its own (assumed: as many lines as a table has room
for)."""

DECIMALS = 2
"""Forces that are the same to so many decimals of a newton are one (assumed)."""

BINS_PER_DOUBLING = 2
"""Bins of many forces, a doubling of the force: edges at 0.5, 0.71, 1, 1.41, 2 N (assumed)."""

MIN_PRESSES = 50
"""Training presses of a bin that make a mean array (assumed: its own error is a seventh of the
spread of the presses)."""


@dataclass(frozen=True)
class ForceBin:
    """Presses of about one force.

    low_n, high_n: its edges, N, the same where it is of one force; 0 of presses that touch nothing.
    mean_n: mean force of its pairs, N. members: (b,) their places among the pairs. mean_array:
    (N,) counts that the mean of the presses in this bin has: mean_of "training" or, where training
    has fewer than MIN_PRESSES, of the pairs themselves, "split".
    """

    low_n: float
    high_n: float
    mean_n: float
    members: np.ndarray
    mean_array: np.ndarray
    mean_of: MeanOf

    @property
    def touches(self) -> bool:
        return self.high_n > 0


def force_bins(pairs: Pairs, train: Pairs) -> tuple[ForceBin, ...]:
    """The bins that these pairs lie in, by rising force; none where no force is known.

    train: the training pairs, from which the mean arrays are.
    """
    apart = _are_few(np.concatenate([pairs.force_n, train.force_n]))
    own, trained = (_low_edges_n(each.force_n, apart) for each in (pairs, train))
    bins = []
    for low in np.unique(own[~np.isnan(own)]):
        members = np.flatnonzero(own == low)
        taught = np.flatnonzero(trained == low)
        mean_of: MeanOf = "training" if taught.size >= MIN_PRESSES else "split"
        counts = train.counts[taught] if mean_of == "training" else pairs.counts[members]
        bins.append(
            ForceBin(
                low_n=float(low),
                high_n=float(low if apart else low * 2 ** (1 / BINS_PER_DOUBLING)),
                mean_n=float(pairs.force_n[members].mean()),
                members=members,
                mean_array=counts.mean(axis=0, dtype=float).astype(np.float32),
                mean_of=mean_of,
            )
        )
    return tuple(bins)


def mean_array_of_force(bins: tuple[ForceBin, ...], pairs: Pairs, train: Pairs) -> np.ndarray:
    """(P, N) float32, counts: each pair's bin's mean array; of an unknown force, training's."""
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
    """The errors of one model in each bin.

    predicted: (P, N) counts. figures: of each pair (metrics.compare). full_scale: counts.
    """
    if not bins:
        return ()
    known = np.concatenate([one.members for one in bins])
    place = np.repeat(np.arange(len(bins)), [one.members.size for one in bins])
    drawn = rmse_by_group(figures.squared_error[known], pairs.shapes[known], place, len(bins))
    rows = []
    for one, resampled in zip(bins, drawn.T, strict=True):
        # Summed as the overall error is, so that of one force it is the same to the last digit.
        summary = figures.summary(full_scale, np.isin(np.arange(len(pairs)), one.members))
        mean_off = np.square(one.mean_array - pairs.counts[one.members].astype(float))
        level = float(np.sqrt(mean_off.mean()))
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
                of_mean_array=summary.rmse_counts / level if one.touches and level else None,
                mean_of=one.mean_of if one.touches else None,
                phantom_counts=None if one.touches else float(totals.mean()),
            )
        )
    return tuple(rows)


def _are_few(force_n: np.ndarray) -> bool:
    touching = force_n[force_n > 0]
    return np.unique(touching.round(DECIMALS)).size <= MAX_FORCES


def _low_edges_n(force_n: np.ndarray, apart: bool) -> np.ndarray:
    """(P,) the lower edge of each press's bin, N; NaN of an unknown force."""
    if apart:
        return force_n.astype(float).round(DECIMALS)
    low = np.where(np.isnan(force_n), np.nan, 0.0)
    touching = force_n > 0
    steps = np.floor(BINS_PER_DOUBLING * np.log2(force_n[touching]))
    low[touching] = 2.0 ** (steps / BINS_PER_DOUBLING)
    return low
