"""Calibration and sharpness of predicted uncertainty.

Reliability: observed coverage of intervals by their nominal coverage. Sparsification (risk against
coverage, El-Yaniv and Wiener 2010): RMSE over the most certain presses by their share. The
uncertainty of a press is the root mean square of its taxels' standard deviations.

Shape letters: P pairs, N taxels.
"""

from collections.abc import Mapping

import numpy as np

from t2twin.translate.evaluation.records import ModelRow, UncertaintyMetrics
from t2twin.translate.uncertainty.estimate import Estimate, half_width

LEVELS = (0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 0.95, 0.99)
"""Nominal coverages of the intervals."""

RETAINED = tuple(round(1.0 - 0.05 * n, 2) for n in range(18))
"""Shares of the presses that are retained, the most certain ones."""

REPORTED_LEVEL, REPORTED_SHARE = 0.9, 0.8
"""Coverage and retained share in tables."""


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


def uncertainty_text(models: Mapping[str, ModelRow]) -> list[str]:
    """One line per run that predicts uncertainty."""
    lines = []
    for name, row in models.items():
        if row.uncertainty is None:
            continue
        found = row.uncertainty
        line = (
            f"{name}: its {100 * REPORTED_LEVEL:.0f} % intervals cover "
            f"{100 * found.coverage_at(REPORTED_LEVEL):.1f} % of the counts; without the least "
            f"certain fifth of the presses its RMSE is "
            f"{100 * found.sparsification_gain(REPORTED_SHARE):.0f} % lower."
        )
        if found.force_median_error_percent is not None:
            line += (
                f" The median error of its force is {found.force_median_error_percent:.1f} %; the "
                f"intervals cover {found.force_coverage_percent:.1f} % of the forces."
            )
        lines.append(line)
    return lines
