"""Predicted uncertainty."""

from typing import Any

from matplotlib.figure import Figure

from t2twin.report.data import ReportData
from t2twin.report.html.figures import figure
from t2twin.report.html.labels import SPLIT_COLORS, SPLIT_NAMES, name_of
from t2twin.translate.evaluation.metrics.reliability import REPORTED_SHARE
from t2twin.translate.evaluation.records import Evaluation
from t2twin.translate.evaluation.table import uncertainty_text

WIDTH_IN, HEIGHT_IN = 9.0, 3.4
"""Size of the charts, inches."""

STYLES = ("-", "--", ":")
"""Line styles of the runs with uncertainty."""


def has_uncertainty(evaluations: dict[str, Evaluation]) -> bool:
    """Whether any run predicts uncertainty."""
    return any(
        row.uncertainty is not None for one in evaluations.values() for row in one.runs.values()
    )


def section(report: ReportData) -> dict[str, Any]:
    """Reliability diagram, risk-coverage curve, and a summary of each run and split."""
    evaluations = report.evaluations
    return {
        "chart": figure("svg", WIDTH_IN, HEIGHT_IN, lambda page: _draw(page, evaluations)),
        "summaries": [
            (split, line)
            for split, one in evaluations.items()
            for line in uncertainty_text({name_of(name): row for name, row in one.runs.items()})
        ],
    }


def _draw(page: Figure, evaluations: dict[str, Evaluation]) -> None:
    left, right = page.subplots(1, 2)
    for split, evaluation in evaluations.items():
        rows = {
            n: row.uncertainty for n, row in evaluation.runs.items() if row.uncertainty is not None
        }
        for style, (name, metrics) in zip(STYLES * len(rows), rows.items(), strict=False):
            nominal, observed, kept = (
                [100 * share for share in shares]
                for shares in (metrics.levels, metrics.coverage, metrics.retained)
            )
            look = {"color": SPLIT_COLORS[split], "label": f"{name_of(name)}, {SPLIT_NAMES[split]}"}
            left.plot(nominal, observed, style, marker="o", markersize=3, **look)
            right.plot(kept, metrics.retained_rmse_counts, style, **look)
    left.plot((0, 100), (0, 100), color="#999999", linewidth=0.8)
    left.set(
        xlabel="nominal coverage, %", ylabel="observed coverage, %", xlim=(0, 100), ylim=(0, 100)
    )
    right.axvline(100 * REPORTED_SHARE, color="#999999", linewidth=0.8)
    right.set(
        xlabel="presses with the lowest uncertainty, %", ylabel="RMSE, counts", xlim=(0, 100),
        ylim=(0, None),
    )  # fmt: skip
    right.yaxis.set_major_formatter("{x:,.0f}")
    left.legend()
    right.legend()
