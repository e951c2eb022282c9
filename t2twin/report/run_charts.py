"""Sections of runs with a chart: errors by force and shape, learning, predicted uncertainty."""

import math
from functools import partial
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from t2twin.core.draw import figure, force_axis
from t2twin.primitives_cad import catalogue
from t2twin.report.data import ReportData
from t2twin.report.page import (
    BASELINE_COLORS,
    SPLIT_COLORS,
    SPLIT_NAMES,
    colors,
    name_of,
    shape_name,
)
from t2twin.translate.evaluation.baselines import (
    MEAN_ARRAY,
    MEAN_ARRAY_OF_FORCE,
    MIN_PRESSES,
    NEAREST_NEIGHBOR,
)
from t2twin.translate.evaluation.metrics import REPORTED_SHARE
from t2twin.translate.evaluation.records import Evaluation
from t2twin.translate.evaluation.table import outputs_table
from t2twin.translate.runs.log import best_epoch

FORCE_IN, SPLIT_IN, LEGEND_IN = 9.0, 2.7, 0.4
"""Width of the chart by force, height per split and of the legend, inches."""

MAX_PERCENT = 150.0
"""Upper end of the relative error's axis, percent (assumed)."""

DASHED: dict[str, Any] = {"linestyle": (0, (6, 3)), "linewidth": 1.0}

SHAPES_IN, BAR_IN, MARGINS_IN = 4.2, 0.30, 1.3
"""Width of a chart by shape, which fits on a phone; height of a bar and of the margins, inches."""

TITLES = {"val": "validation primitives", "test": "tools at their keypoints"}
"""Titles of the splits of the paper's protocol."""

MAX_SHAPES = 60
"""Maximum number of bars of a chart (assumed: a printed page)."""

COUNTS_TICKS = 4
MARKS: dict[str, dict[str, Any]] = {
    MEAN_ARRAY: {"marker": "|", "markersize": 13, "markeredgewidth": 2.0},
    NEAREST_NEIGHBOR: {"marker": "D", "markersize": 5, "markeredgecolor": "white"},
}

WIDTH_IN, HEIGHT_IN = 9.0, 3.4
"""Size of the other charts, inches."""

STYLES = ("-", "--", ":")
"""Line styles of the runs with uncertainty."""


def by_force(report: ReportData) -> dict[str, Any] | None:
    """Chart of the splits with several forces; None without one."""
    evaluations = {s: one for s, one in report.evaluations.items() if one.has_forces}
    if not evaluations:
        return None
    height = LEGEND_IN + SPLIT_IN * len(evaluations)
    return {
        "evaluations": evaluations,
        "chart": figure("svg", FORCE_IN, height, lambda page: _forces(page, report, evaluations)),
        "max_percent": MAX_PERCENT,
        "min_presses": MIN_PRESSES,
    }


def _forces(page: Figure, report: ReportData, evaluations: dict[str, Evaluation]) -> None:
    grid = page.subplots(len(evaluations), 2, squeeze=False)
    for (counts, percents), (split, evaluation) in zip(grid, evaluations.items(), strict=True):
        _force_lines(counts, report, evaluation, percent=False)
        _force_lines(percents, report, evaluation, percent=True)
        counts.set(title=SPLIT_NAMES[split], xlabel="force, N", ylabel="RMSE, counts")
        counts.set_yscale("log")
        percents.set(title=SPLIT_NAMES[split], xlabel="force, N", ylabel="% of mean array's RMSE")
        percents.set_ylim(0, MAX_PERCENT)
    page.legend(*grid[0, 0].get_legend_handles_labels(), loc="outside lower center", ncols=5)


def _force_lines(axes: Axes, report: ReportData, evaluation: Evaluation, percent: bool) -> None:
    color_of = colors(list(report.runs))
    ends = []
    for name in (MEAN_ARRAY, MEAN_ARRAY_OF_FORCE, NEAREST_NEIGHBOR, *report.runs):
        contact = [one for one in evaluation.models[name].by_force if one.phantom_counts is None]
        drawn = [one for one in contact if not percent or one.of_mean_array is not None]
        forces = [one.mean_n for one in drawn]
        values = [100 * (one.of_mean_array or 0) if percent else one.rmse_counts for one in drawn]
        style = DASHED if name in BASELINE_COLORS else {"marker": "o", "markersize": 3}
        axes.plot(forces, values, color=color_of[name], label=name_of(name), **style)
        known = [(one.mean_n, *one.interval) for one in drawn if one.interval is not None]
        if known and name in report.runs and not percent:
            at, low, high = zip(*known, strict=True)
            axes.fill_between(at, low, high, color=color_of[name], alpha=0.15, linewidth=0)
        ends += forces
    force_axis(axes, min(ends), max(ends))


def by_shape(report: ReportData) -> dict[str, Any]:
    """A chart per split, with bars for the runs and marks for the baselines."""
    charts = {}
    for split, evaluation in report.evaluations.items():
        height = MARGINS_IN + BAR_IN * len(_names(evaluation))
        draw = partial(_shape_bars, report=report, split=split)
        charts[split] = figure("svg", SHAPES_IN, height, draw)
    return {
        "by_family": [split for split, one in report.evaluations.items() if _by_family(one)],
        "max_shapes": MAX_SHAPES,
        "charts": charts,
    }


def _by_family(evaluation: Evaluation) -> bool:
    """Whether errors are grouped by family, because there are too many shapes or none."""
    return not 0 < len(evaluation.models[MEAN_ARRAY].by_shape) <= MAX_SHAPES


def _names(evaluation: Evaluation) -> list[str]:
    """Shapes in the order of the catalogue, or the families with the most pairs."""
    row = evaluation.models[MEAN_ARRAY]
    if _by_family(evaluation):
        return sorted(row.by_family, key=lambda name: -row.by_family[name].pairs)[:MAX_SHAPES]
    order = {name: place for place, name in enumerate(catalogue.NAMES)}
    return sorted(row.by_shape, key=lambda name: order.get(name, len(order)))


def _errors(evaluation: Evaluation, model: str) -> list[float]:
    """RMSE of a model, counts, in the order of `_names`."""
    row = evaluation.models[model]
    figures = row.by_family if _by_family(evaluation) else row.by_shape
    return [figures[name].counts for name in _names(evaluation)]


def _shape_bars(page: Figure, report: ReportData, split: str) -> None:
    axes, evaluation = page.subplots(), report.evaluations[split]
    names, color_of = _names(evaluation), colors(list(report.runs))
    places, height = np.arange(len(names)), 0.8 / len(report.runs)
    for i, run in enumerate(report.runs):
        offset = (i - (len(report.runs) - 1) / 2) * height
        errors = _errors(evaluation, run)
        axes.barh(places + offset, errors, height, color=color_of[run], label=name_of(run))
    for baseline, style in MARKS.items():
        axes.plot(
            _errors(evaluation, baseline), places, color=color_of[baseline],
            label=name_of(baseline), linestyle="none", **style,
        )  # fmt: skip
    high = max(
        error
        for other in report.evaluations.values()
        for model in other.models
        for error in _errors(other, model)
    )
    axes.set_yticks(places, [shape_name(name) for name in names])
    title = (TITLES if report.info.is_protocol else SPLIT_NAMES)[split]
    axes.set(xlabel="RMSE, counts", title=title)
    axes.set(xlim=(0, 1.05 * high or 1), ylim=(len(names) - 0.4, -0.6))
    axes.xaxis.set_major_locator(MaxNLocator(COUNTS_TICKS))
    axes.xaxis.set_major_formatter("{x:,g}")
    page.legend(*axes.get_legend_handles_labels(), loc="outside lower center", ncols=2)


def learning_curves(report: ReportData) -> dict[str, Any]:
    """Chart of the RMSE by epoch, from the logs of the runs."""
    draw = partial(_epochs, report=report)
    return {"chart": figure("svg", WIDTH_IN, HEIGHT_IN, draw)}


def _epochs(page: Figure, report: ReportData) -> None:
    axes = page.subplots()
    color_of = colors(list(report.runs))
    full_scale = report.array.full_scale
    for name, history in report.histories.items():
        epochs = [record.epoch for record in history]
        validation = [full_scale * record.val_rmse_percent / 100 for record in history]
        marker = "o" if len(history) == 1 else ""
        label = f"{name_of(name)}, validation"
        axes.plot(epochs, validation, color=color_of[name], label=label, marker=marker)
        best = best_epoch(history)
        lowest = full_scale * best.val_rmse_percent / 100
        axes.plot(best.epoch, lowest, "o", color=color_of[name], markersize=5)
        if "l3" in history[0].train:
            seen = [full_scale * math.sqrt(record.train["l3"]) for record in history]
            label = f"{name_of(name)}, training"
            axes.plot(epochs, seen, "--", color=color_of[name], label=label, marker=marker)
    evaluation = report.evaluations.get("val")
    if evaluation is not None and all(row.same_data for row in evaluation.runs.values()):
        for name in (MEAN_ARRAY, NEAREST_NEIGHBOR):
            axes.axhline(
                evaluation.models[name].overall.counts, color=color_of[name], linewidth=1,
                linestyle=(0, (6, 3)), label=f"{name_of(name)}, validation",
            )  # fmt: skip
    axes.set(xlabel="epoch", ylabel="RMSE, counts", ylim=(0, None))
    axes.yaxis.set_major_formatter("{x:,g}")
    axes.xaxis.set_major_locator(MaxNLocator(integer=True))
    axes.legend()


def uncertainty(report: ReportData) -> dict[str, Any] | None:
    """Reliability diagram, risk-coverage curve, and a summary of each run and split.

    None if no run predicts uncertainty.
    """
    evaluations = report.evaluations
    if all(row.uncertainty is None for one in evaluations.values() for row in one.runs.values()):
        return None
    return {
        "chart": figure("svg", WIDTH_IN, HEIGHT_IN, lambda page: _coverage(page, evaluations)),
        "tables": outputs_table(evaluations, name_of),
    }


def _coverage(page: Figure, evaluations: dict[str, Evaluation]) -> None:
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
    right.yaxis.set_major_formatter("{x:,g}")
    left.legend()
    right.legend()
