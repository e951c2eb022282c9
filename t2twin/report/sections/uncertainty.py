"""Predicted uncertainty, and an estimate of the irreducible error."""

from collections.abc import Mapping
from typing import Any

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from t2twin.report.data import ReportData
from t2twin.report.html.figures import figure
from t2twin.report.html.labels import SPLIT_COLORS, SPLIT_NAMES, colors, name_of
from t2twin.translate.evaluation.metrics.baselines import FEATURE_SIZE
from t2twin.translate.evaluation.metrics.irreducible_error import (
    CLOSE,
    FITTED_SHARE,
    NEIGHBORS,
)
from t2twin.translate.evaluation.metrics.reliability import REPORTED_SHARE, uncertainty_text
from t2twin.translate.evaluation.records import (
    Evaluation,
    IrreducibleError,
    IrreducibleErrorFloor,
)

WIDTH_IN, HEIGHT_IN, ERROR_IN = 9.0, 3.4, 3.6
"""Width of the charts; heights of those of uncertainty and irreducible error, inches."""

STYLES = ("-", "--", ":")
"""Line styles of the runs with uncertainty."""

SPLIT_STYLE, TRAINING_STYLE = ("#222222", "o"), ("#009e73", "D")
"""Color and marker of the nearest neighbors in the split and in the training pairs."""


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


def irreducible_error(report: ReportData) -> dict[str, Any]:
    """Differences of counts against distances of images, of the splits with an estimate."""
    estimates = {
        split: one.irreducible_error
        for split, one in report.evaluations.items()
        if one.irreducible_error is not None
    }
    return {
        "estimates": estimates,
        "chart": figure("svg", WIDTH_IN, ERROR_IN, lambda page: _errors(page, report, estimates)),
        "size_px": FEATURE_SIZE,
        "neighbors": NEIGHBORS,
        "fitted_share": FITTED_SHARE,
        "close": CLOSE,
    }


def _errors(page: Figure, report: ReportData, estimates: Mapping[str, IrreducibleError]) -> None:
    places = page.subplots(1, len(estimates), sharey=True, squeeze=False)[0]
    for axes, split in zip(places, estimates, strict=True):
        _curves(axes, report, split, estimates[split])
    places[0].set_ylim(0, None)
    places[0].set_ylabel("sqrt(mean squared difference / 2), counts")
    page.legend(*places[0].get_legend_handles_labels(), loc="outside lower center", ncols=4)


def _curves(axes: Axes, report: ReportData, split: str, estimate: IrreducibleError) -> None:
    noise = estimate.noise_grey
    for floor, style, label in (
        (estimate.split, SPLIT_STYLE, "other shapes of the split"),
        (estimate.training, TRAINING_STYLE, "training pairs"),
    ):
        if floor is not None:
            _curve(axes, floor, style, label, noise)
    models = report.evaluations[split].models
    for name, color in colors(list(report.runs)).items():
        if name in report.runs:
            level = models[name].overall.rmse_counts
            axes.axhline(level, color=color, linewidth=1, label=name_of(name))
    axes.axvline(noise, color="#999999", linewidth=0.8, linestyle=":", label="noise")
    axes.set(xlabel="distance of the images, grey levels", title=SPLIT_NAMES[split])
    axes.set_xlim(0, None)
    axes.yaxis.set_major_formatter("{x:,.0f}")


def _curve(
    axes: Axes, floor: IrreducibleErrorFloor, style: tuple[str, str], label: str, noise_grey: float
) -> None:
    color, mark = style
    drawn = [
        (group.distance_grey, group.rmse_counts)
        for group in floor.curve
        if group.distance_grey is not None and group.rmse_counts is not None
    ]
    axes.plot(*zip(*drawn, strict=True), mark, color=color, markersize=4, label=label)
    value = floor.extrapolated_rmse_counts
    if value is not None:
        low, high = floor.interval or (value, value)
        axes.errorbar(
            noise_grey, value, [[max(value - low, 0.0)], [max(high - value, 0.0)]],
            color=color, marker="s", markersize=5, capsize=3, linewidth=1,
        )  # fmt: skip
