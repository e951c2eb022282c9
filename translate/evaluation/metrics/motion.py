"""Figures of still presses and of moving touches, and of the predicted shear force.

A touch moves if it follows the press that its path started with.

Shape letters: P pairs, N taxels.
"""

from collections.abc import Mapping

import numpy as np

from t2twin.translate.data.pairs import Pairs
from t2twin.translate.evaluation.metrics.array_errors import PairFigures
from t2twin.translate.evaluation.motion_records import MotionFigures, ShearMetrics
from t2twin.translate.evaluation.records import ModelRow
from t2twin.translate.uncertainty.estimate import Estimate, half_width

LEVEL = 0.9
"""Nominal coverage of the intervals."""

MIN_SHEAR_N = 0.3
"""True shear force above which its direction and magnitude are compared, N (assumed)."""


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
            within = errors <= half_width(LEVEL) * estimate.counts_std[which]
            coverage = float(100.0 * within.mean())
        found[name] = MotionFigures(
            summary.pairs, summary.rmse_counts, summary.rmse_percent, coverage
        )
    return found


def shear_metrics(estimate: Estimate, pairs: Pairs) -> ShearMetrics | None:
    """Errors of the predicted shear force on the moving pairs, None where there are none."""
    if estimate.shear_n is None or estimate.shear_std_n is None or pairs.shear_n is None:
        return None
    assert pairs.is_moving is not None
    if not pairs.is_moving.any():
        return None
    true, found = pairs.shear_n[pairs.is_moving], estimate.shear_n[pairs.is_moving].astype(float)
    std = estimate.shear_std_n[pairs.is_moving]
    within = np.abs(found - true) <= half_width(LEVEL) * std
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


def motion_text(models: Mapping[str, ModelRow]) -> list[str]:
    """Lines on still and moving pairs and on the shear force, for the runs that have them."""
    lines = []
    for name, row in models.items():
        if row.run is None or row.by_motion is None:
            continue
        parts = []
        for kind, found in row.by_motion.items():
            covered = ""
            if found.coverage_percent is not None:
                covered = (
                    f", {found.coverage_percent:.1f} % within the {100 * LEVEL:.0f} % interval"
                )
            parts.append(f"{found.pairs} {kind} pairs: RMSE {found.rmse_counts:.0f}{covered}")
        lines.append(f"{name}: {'; '.join(parts)}.")
        shear = row.shear
        if shear is not None and shear.direction_error_deg is not None:
            lines.append(
                f"{name}: shear force above {shear.min_shear_n:g} N, {shear.pairs} moving pairs: "
                f"median error {shear.direction_error_deg:.1f} degrees and "
                f"{shear.magnitude_error_percent:.1f} %; the intervals cover "
                f"{shear.coverage_percent:.1f} % of the components of all moving pairs."
            )
    return lines
