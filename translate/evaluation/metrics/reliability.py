"""Whether a run that says how sure it is says it rightly, and what is won by leaving out where it
is not sure.

Reliability: of intervals that are said to hold a share of the counts, the share that they do hold.
Risk against coverage (El-Yaniv and Wiener 2010): the RMSE over the presses that it is surest of,
against how many those are. A press's own sureness is the root mean square of its taxels' standard
deviations.

Shape letters: P pairs, N taxels.
"""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from t2twin.translate.evaluation.records import ModelRow, UncertaintyMetrics
from t2twin.translate.uncertainty.estimate import Estimate, half_width

LEVELS = (0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 0.95, 0.99)
"""What the intervals are said to hold."""

KEPT = tuple(round(1.0 - 0.05 * n, 2) for n in range(18))
"""Shares of the presses that are kept, the surest."""

NAMED_LEVEL, NAMED_KEPT = 0.9, 0.8
"""Those that tables name."""


def certainty(estimate: Estimate, counts: np.ndarray, force_n: np.ndarray) -> UncertaintyMetrics:
    """Of what a run says of P pairs, at the layout of their counts, (P, N). force_n: (P,)."""
    off = np.abs(counts - estimate.counts.astype(float))
    # A count of zero or of full scale may well lie on an interval's end, which is cut off there.
    held = [float((off <= half_width(level) * estimate.counts_std).mean()) for level in LEVELS]
    squares = np.square(off).mean(axis=1)
    spread = np.sqrt(np.square(estimate.counts_std.astype(float)).mean(axis=1))
    surest = np.argsort(spread, kind="stable")
    keep = [max(1, round(share * surest.size)) for share in KEPT]
    return UncertaintyMetrics(
        levels=LEVELS,
        held=tuple(held),
        kept=KEPT,
        kept_rmse_counts=tuple(float(np.sqrt(squares[surest[:n]].mean())) for n in keep),
        said_rmse_counts=float(np.sqrt(np.square(spread).mean())),
        **_of_force(estimate, force_n),
    )


def _of_force(estimate: Estimate, force_n: np.ndarray) -> dict[str, float | None]:
    touching = force_n > 0
    if estimate.force_n is None or estimate.force_std_n is None or not touching.any():
        return {"force_median_error_percent": None, "force_held_percent": None}
    off = np.abs(estimate.force_n - force_n)[touching]
    within = off <= half_width(NAMED_LEVEL) * estimate.force_std_n[touching]
    return {
        "force_median_error_percent": float(100.0 * np.median(off / force_n[touching])),
        "force_held_percent": float(100.0 * within.mean()),
    }


def with_certainty(
    models: Mapping[str, ModelRow],
    estimates: Mapping[str, Estimate],
    counts: np.ndarray,
    force_n: np.ndarray,
) -> dict[str, ModelRow]:
    """The rows, those of `estimates` with how sure they are. counts: (P, N). force_n: (P,)."""
    return {
        name: replace(row, certainty=certainty(estimates[name], counts, force_n))
        if name in estimates
        else row
        for name, row in models.items()
    }


def certainty_text(models: Mapping[str, ModelRow]) -> list[str]:
    """A line a run that says how sure it is."""
    lines = []
    for name, row in models.items():
        if row.certainty is None:
            continue
        sure = row.certainty
        line = (
            f"{name}: its {100 * NAMED_LEVEL:.0f} % intervals hold "
            f"{100 * sure.held_at(NAMED_LEVEL):.1f} % of the counts; without the least sure fifth "
            f"of the presses its RMSE is {100 * sure.falls_by(NAMED_KEPT):.0f} % lower."
        )
        if sure.force_median_error_percent is not None:
            line += (
                f" Its force is off by {sure.force_median_error_percent:.1f} % in the median, and "
                f"its interval holds {sure.force_held_percent:.1f} % of them."
            )
        lines.append(line)
    return lines
