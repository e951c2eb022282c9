"""Errors of predicted counts and of their tactile images, in groups of pairs, with intervals.

RMSE is the root of the mean squared error of the counts, over pairs and taxels. Its square, as a
fraction of full scale, is the loss that Grella et al. 2023 call L3.

Presses of one shape are similar, so the bootstrap resamples whole shapes. Percentile intervals
(Efron and Tibshirani 1993) of few shapes are too narrow: with eight shapes they are a guide only.

A touch moves if it follows the press that its path started with.

Uncertainty has two metrics. Reliability: observed coverage of intervals by their nominal coverage.
Sparsification (risk against coverage, El-Yaniv and Wiener 2010): RMSE over the most certain presses
by their share. The uncertainty of a press is the root mean square of its taxels' standard
deviations.

Shape letters: P pairs, N taxels, K groups of pairs, often shapes, B resamples.
"""

from abc import ABC, abstractmethod
from collections.abc import Mapping
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, fields

import numpy as np

from t2twin.core.machine import cores
from t2twin.core.progress import Progress
from t2twin.sim.taxels.phi import Phi
from t2twin.translate.data.pairs import Pairs
from t2twin.translate.evaluation.baselines import GROUPS, ForceBin
from t2twin.translate.evaluation.records import (
    FigureName,
    Figures,
    ForceFigures,
    Interval,
    Intervals,
    MotionFigures,
    ShearMetrics,
    UncertaintyMetrics,
)
from t2twin.translate.evaluation.ssim import image_scores
from t2twin.translate.uncertainty.estimate import Estimate, half_width

CONTACT_LEVEL = 0.1
"""Fraction of its image's maximum above which a pixel is in contact (assumed)."""

BATCH_SIZE = 64
"""Pairs whose tactile images are computed together; bounds memory to 50 MB."""

Sums = dict[str, tuple[np.ndarray, np.ndarray]]
"""Sum of each quantity over groups of pairs, and number of pairs that have it; (K,) each."""

GroupedFigures = dict[FigureName, np.ndarray]
"""The figures of records.Figures for K groups of pairs: (K,) each, NaN for none."""

NO_FIGURES = dict.fromkeys(each.name for each in fields(Figures) if each.name != "pairs")
"""The figures of records.Figures, all unknown."""

RESAMPLES = 1000
SEED = 0
CONFIDENCE = 0.95
"""Number and seed of the resamples, and share of them in an interval."""

LEVELS = (0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 0.95, 0.99)
"""Nominal coverages of the intervals."""

RETAINED = tuple(round(1.0 - 0.05 * n, 2) for n in range(18))
"""Shares of the presses that are retained, the most certain ones."""

REPORTED_LEVEL, REPORTED_SHARE = 0.9, 0.8
"""Coverage and retained share in tables."""

MIN_SHEAR_N = 0.3
"""True shear force above which its direction and magnitude are compared, N (assumed)."""


class FiguresOfPairs(ABC):
    """Figures of each pair, (P,) arrays, and how they combine in groups of pairs."""

    @abstractmethod
    def figures_of(self, sums: Sums, full_scale: float) -> GroupedFigures:
        """Figures from `sums`. full_scale: of the target, counts or grey levels."""

    def summary(self, full_scale: float, which: np.ndarray | None = None) -> Figures:
        """Figures over the pairs `which`, (P,) bool, by default all."""
        pairs = next(iter(vars(self).values())).size
        chosen = np.ones(pairs, bool) if which is None else which
        return self._summaries(full_scale, chosen.astype(int), 2)[1]

    def by_name(self, full_scale: float, names: np.ndarray) -> dict[str, Figures]:
        """Figures over the pairs of each name. names: (P,), as of shapes."""
        unique, place = np.unique(names, return_inverse=True)
        figures = self._summaries(full_scale, place, unique.size)
        return dict(zip(map(str, unique), figures, strict=True))

    def _summaries(self, full_scale: float, place: np.ndarray, groups: int) -> list[Figures]:
        """place, groups: as for `sums`."""
        grouped = self.figures_of(self.sums(place, groups), full_scale)
        summaries = []
        for group, pairs in enumerate(np.bincount(place, minlength=groups)):
            values = {name: float(figure[group]) for name, figure in grouped.items()}
            known = {name: None if np.isnan(value) else value for name, value in values.items()}
            summaries.append(Figures(pairs=int(pairs), **NO_FIGURES | known))  # pyright: ignore[reportArgumentType]
        return summaries

    def sums(self, place: np.ndarray, groups: int) -> Sums:
        """Sums by group, (K,); figures of any union of groups follow from them.

        place: (P,) the group of each pair, 0 to groups - 1.
        """
        sums = {}
        for name, values in vars(self).items():
            known = ~np.isnan(values)
            pairs = np.bincount(place[known], minlength=groups).astype(float)
            sums[name] = np.bincount(place[known], values[known], groups), pairs
        return sums


@dataclass(frozen=True)
class PairFigures(FiguresOfPairs):
    """Figures of each pair, (P,) each.

    squared_error: mean over the taxels, counts^2. ssim: of phi(predicted) and phi(true), over the
    image. ssim_contact: over the true contact. contact_iou: intersection over union of the two
    contacts. centroid_error_mm: between the images' centroids. total_error: absolute difference of
    the summed counts. total: the true sum. Figures of the contact are NaN without contact.
    squared_error_under and so on: over the groups of taxels in GROUPS, NaN for empty groups.
    """

    squared_error: np.ndarray
    ssim: np.ndarray
    ssim_contact: np.ndarray
    contact_iou: np.ndarray
    centroid_error_mm: np.ndarray
    total_error: np.ndarray
    total: np.ndarray
    squared_error_under: np.ndarray
    squared_error_near: np.ndarray
    squared_error_beyond: np.ndarray

    def figures_of(self, sums: Sums, full_scale: float) -> GroupedFigures:
        """See FiguresOfPairs."""
        means = {name: mean_of(*of_name) for name, of_name in sums.items()}
        rmse = np.sqrt(means["squared_error"])
        return {
            "rmse_counts": rmse,
            "rmse_percent": 100.0 * rmse / full_scale,
            "ssim": means["ssim"],
            "ssim_contact": means["ssim_contact"],
            "contact_iou": means["contact_iou"],
            "centroid_error_mm": means["centroid_error_mm"],
            "total_error_percent": mean_of(100.0 * sums["total_error"][0], sums["total"][0]),
            "rmse_under_counts": np.sqrt(means["squared_error_under"]),
            "rmse_near_counts": np.sqrt(means["squared_error_near"]),
            "rmse_beyond_counts": np.sqrt(means["squared_error_beyond"]),
        }


def mean_of(total: np.ndarray, pairs: np.ndarray) -> np.ndarray:
    """total / pairs; NaN without pairs."""
    return np.divide(total, pairs, out=np.full(total.shape, np.nan), where=pairs > 0)


def compare(
    predicted: np.ndarray,
    true: np.ndarray,
    phi: Phi,
    full_scale: float,
    progress: str | None = None,
    taxel_groups: Mapping[str, np.ndarray] | None = None,
) -> PairFigures:
    """Figures of each pair. predicted, true: (P, N), counts; full_scale: SSIM's data range.

    progress: title of a progress bar, or None. taxel_groups: (N,) bool by the names in
    GROUPS, for errors by group.
    """
    groups, nothing = taxel_groups or {}, np.full(len(true), np.nan)
    predicted, true = predicted.astype(float), true.astype(float)
    squares = np.square(predicted - true)
    scores = _scores_of_images(predicted, true, phi, full_scale, progress)
    return PairFigures(
        squared_error=squares.mean(axis=1),
        ssim=scores[:, 0],
        ssim_contact=scores[:, 1],
        contact_iou=scores[:, 2],
        centroid_error_mm=_centroid_error_mm(predicted, true, phi),
        total_error=np.abs(predicted.sum(axis=1) - true.sum(axis=1)),
        total=true.sum(axis=1),
        **{
            f"squared_error_{name}": squares[:, groups[name]].mean(axis=1)
            if name in groups and groups[name].any()
            else nothing
            for name in GROUPS
        },
    )


def _scores_of_images(
    predicted: np.ndarray, true: np.ndarray, phi: Phi, full_scale: float, progress: str | None
) -> np.ndarray:
    """ImageScores of the tactile images of all pairs, (P, 3)."""
    scores = np.empty((len(true), 3))
    with (
        ThreadPoolExecutor(cores()) as pool,
        Progress(total=len(true), desc=progress, unit="pair", disable=progress is None) as bar,
    ):
        for start in range(0, len(true), BATCH_SIZE):
            part = slice(start, start + BATCH_SIZE)
            of_part = pool.map(
                lambda a, b: image_scores(a, b, full_scale, CONTACT_LEVEL),
                phi(predicted[part]),
                phi(true[part]),
            )
            for row, of_pair in enumerate(of_part, start):
                scores[row] = of_pair
            bar.update(len(true[part]))
    return scores


def _centroid_error_mm(predicted: np.ndarray, true: np.ndarray, phi: Phi) -> np.ndarray:
    """(P,) distance, mm; the centroid of an empty prediction is the center of the image.

    phi is linear, so the moments of the images are products of the counts with those of phi.
    """
    columns_mm, rows_mm = phi.centers_mm
    x_mm, y_mm = np.meshgrid(columns_mm, rows_mm)
    weights = np.column_stack([np.ones(x_mm.size), x_mm.ravel(), y_mm.ravel()])
    moments = phi.matrix.T @ weights  # (N, 3)
    of_predicted, of_true = predicted @ moments, true @ moments
    empty = of_true[:, 0] <= 0
    a = of_predicted[:, 1:] / np.where(of_predicted[:, :1] > 0, of_predicted[:, :1], np.inf)
    b = of_true[:, 1:] / np.where(empty[:, None], np.inf, of_true[:, :1])
    return np.where(empty, np.nan, np.linalg.norm(a - b, axis=1))


def resample_weights(shapes: int, seed: int = SEED) -> np.ndarray:
    """Multiplicity of each shape in each resample: (B, K); rows sum to K."""
    shares = np.full(shapes, 1.0 / shapes)
    return np.random.default_rng(seed).multinomial(shapes, shares, size=RESAMPLES).astype(float)


def replicates(figures: FiguresOfPairs, shapes: np.ndarray, full_scale: float) -> GroupedFigures:
    """Every figure in each resample of the shapes: (B,) each.

    shapes: (P,) names. Equal shapes result in equal resamples, so that differences between two
    models are paired.
    """
    names, place = np.unique(shapes, return_inverse=True)
    sums, weights = figures.sums(place, names.size), resample_weights(names.size)
    resampled = {name: (weights @ total, weights @ pairs) for name, (total, pairs) in sums.items()}
    return figures.figures_of(resampled, full_scale)


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
    weights = resample_weights(names.size)
    return np.sqrt(mean_of(weights @ total, weights @ pairs))


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
                rmse_counts=summary.counts,
                rmse_percent=summary.rmse_percent,
                interval=interval(resampled),
                of_mean_array=summary.counts / level if one.has_contact and level else None,
                mean_of=one.mean_of if one.has_contact else None,
                phantom_counts=None if one.has_contact else float(totals.mean()),
            )
        )
    return tuple(rows)


def by_motion(
    figures: PairFigures, pairs: Pairs, full_scale: float, estimate: Estimate | None
) -> dict[str, MotionFigures] | None:
    """Figures of the pairs that are "still" and "moving", None for a dataset without motion.

    figures: of each pair (array_errors.compare). full_scale: counts. estimate: of a run that
    predicts uncertainty.
    """
    if pairs.is_moving is None:
        return None
    found = {}
    for name, which in (("still", ~pairs.is_moving), ("moving", pairs.is_moving)):
        if not which.any():
            continue
        summary, coverage = figures.summary(full_scale, which), None
        if estimate is not None:
            errors = np.abs(pairs.counts - estimate.counts.astype(float))[which]
            within = errors <= half_width(REPORTED_LEVEL) * estimate.counts_std[which]
            coverage = float(100.0 * within.mean())
        found[name] = MotionFigures(summary.pairs, summary.counts, summary.rmse_percent, coverage)
    return found


def uncertainty_metrics(
    estimate: Estimate, counts: np.ndarray, force_n: np.ndarray
) -> UncertaintyMetrics:
    """Metrics of an estimate of P pairs. counts: (P, N), true. force_n: (P,), true."""
    errors = np.abs(counts - estimate.counts.astype(float))
    # Unclipped intervals: counts of zero and full scale lie on the ends of clipped ones.
    coverage = [
        float((errors <= half_width(level) * estimate.counts_std).mean()) for level in LEVELS
    ]
    squares = np.square(errors).mean(axis=1)
    uncertainty = np.sqrt(np.square(estimate.counts_std.astype(float)).mean(axis=1))
    order = np.argsort(uncertainty, kind="stable")
    numbers = [max(1, round(share * order.size)) for share in RETAINED]
    return UncertaintyMetrics(
        levels=LEVELS,
        coverage=tuple(coverage),
        retained=RETAINED,
        retained_rmse_counts=tuple(float(np.sqrt(squares[order[:n]].mean())) for n in numbers),
        predicted_rmse_counts=float(np.sqrt(np.square(uncertainty).mean())),
        **_force_metrics(estimate, force_n),
    )


def _force_metrics(estimate: Estimate, force_n: np.ndarray) -> dict[str, float | None]:
    touching = force_n > 0
    if estimate.force_n is None or estimate.force_std_n is None or not touching.any():
        return {"force_median_error_percent": None, "force_coverage_percent": None}
    errors = np.abs(estimate.force_n - force_n)[touching]
    within = errors <= half_width(REPORTED_LEVEL) * estimate.force_std_n[touching]
    return {
        "force_median_error_percent": float(100.0 * np.median(errors / force_n[touching])),
        "force_coverage_percent": float(100.0 * within.mean()),
    }


def shear_metrics(estimate: Estimate, pairs: Pairs) -> ShearMetrics | None:
    """Errors of the predicted shear force on the moving pairs, None where there are none."""
    if estimate.shear_n is None or estimate.shear_std_n is None or pairs.shear_n is None:
        return None
    assert pairs.is_moving is not None
    if not pairs.is_moving.any():
        return None
    true, found = pairs.shear_n[pairs.is_moving], estimate.shear_n[pairs.is_moving].astype(float)
    std = estimate.shear_std_n[pairs.is_moving]
    within = np.abs(found - true) <= half_width(REPORTED_LEVEL) * std
    large = np.hypot(*true.T) > MIN_SHEAR_N
    true, found = true[large], found[large]
    turn = np.arctan2(true[:, 0] * found[:, 1] - true[:, 1] * found[:, 0], (true * found).sum(1))
    size = np.hypot(*true.T)
    error = np.abs(np.hypot(*found.T) - size) / size
    return ShearMetrics(
        pairs=int(large.sum()),
        min_shear_n=MIN_SHEAR_N,
        direction_error_deg=float(np.degrees(np.median(np.abs(turn)))) if large.any() else None,
        magnitude_error_percent=float(100.0 * np.median(error)) if large.any() else None,
        coverage_percent=float(100.0 * within.mean()),
    )
