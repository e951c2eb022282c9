"""Errors by force, by shape, and by position of the taxels relative to the field of view."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from t2twin.primitives_cad import catalogue
from t2twin.report.data import ReportData
from t2twin.report.html.figures import figure, force_axis
from t2twin.report.html.labels import BASELINE_COLORS, SPLIT_NAMES, colors, name_of, shape_name
from t2twin.translate.evaluation.metrics.baselines import MEAN_ARRAY, NEAREST_NEIGHBOR
from t2twin.translate.evaluation.metrics.floors import GROUPS, NOISE_FLOOR
from t2twin.translate.evaluation.metrics.forces import MEAN_ARRAY_OF_FORCE, MIN_PRESSES
from t2twin.translate.evaluation.records import (
    Evaluation,
    FigureName,
    Figures,
    ForceFigures,
    ModelRow,
)
from t2twin.translate.evaluation.table import force_cell, force_rows

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
"""Maximum number of bars of a chart, and of rows of a table (assumed: a printed page)."""

VIEW_FIGURES: tuple[FigureName, ...] = (
    "rmse_under_counts", "rmse_near_counts", "rmse_beyond_counts",
)  # fmt: skip
COUNTS_TICKS = 4
MARKS: dict[str, dict[str, Any]] = {
    MEAN_ARRAY: {"marker": "|", "markersize": 13, "markeredgewidth": 2.0},
    NEAREST_NEIGHBOR: {"marker": "D", "markersize": 5, "markeredgecolor": "white"},
}


def by_force(report: ReportData) -> dict[str, Any]:
    """Chart and tables of the splits with several forces."""
    evaluations = {s: one for s, one in report.evaluations.items() if one.has_forces}
    height = LEGEND_IN + SPLIT_IN * len(evaluations)
    return {
        "evaluations": evaluations,
        "chart": figure("svg", FORCE_IN, height, lambda page: _forces(page, report, evaluations)),
        "max_percent": MAX_PERCENT,
        "min_presses": MIN_PRESSES,
        "tables": [_force_table(split, one) for split, one in evaluations.items()],
    }


def _force_table(split: str, evaluation: Evaluation) -> tuple[list, list]:
    """Forces (rows) and models (columns), with intervals in additional rows."""
    rows = {name: row for name, row in evaluation.models.items() if name != NOISE_FLOOR}
    titles = force_rows(evaluation)[0][1:]
    lines = []
    for place, title in enumerate(titles):
        cells = [row.by_force[place] for row in rows.values()]
        lines.append([title.replace("-", "–"), *(force_cell(one) for one in cells)])
        lines.append(["", *(_span(one) for one in cells)])
    return [[SPLIT_NAMES[split].capitalize(), *map(name_of, rows)]], [("", lines)]


def _span(one: ForceFigures) -> str:
    return "" if one.interval is None else f"{one.interval.low:,.0f}–{one.interval.high:,.0f}"


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
        if name in report.runs and not percent:
            _band(axes, drawn, color_of[name])
        ends += forces
    force_axis(axes, min(ends), max(ends))


def _band(axes: Axes, drawn: Sequence[ForceFigures], color: str) -> None:
    known = [(one.mean_n, *one.interval) for one in drawn if one.interval is not None]
    if known:
        forces, low, high = zip(*known, strict=True)
        axes.fill_between(forces, low, high, color=color, alpha=0.15, linewidth=0)


def by_shape(report: ReportData) -> dict[str, Any]:
    """A chart per split, with bars for the runs and marks for the baselines."""
    return {
        "by_family": [split for split in report.evaluations if not _has_shapes(report, split)],
        "max_shapes": MAX_SHAPES,
        "charts": {split: _shape_chart(report, split) for split in report.evaluations},
    }


def _shape_chart(report: ReportData, split: str) -> bytes:
    height = MARGINS_IN + BAR_IN * len(_shapes(report, split))
    return figure("svg", SHAPES_IN, height, lambda page: _shape_bars(page, report, split))


def _shapes(report: ReportData, split: str) -> list[str]:
    """Shapes or families of a split, in the order of the catalogue."""
    errors = _errors(report, split, MEAN_ARRAY)
    if len(errors) > MAX_SHAPES:
        return sorted(errors, key=lambda name: -errors[name].pairs)[:MAX_SHAPES]
    return [name for name in catalogue.NAMES if name in errors] + [
        name for name in errors if name not in catalogue.NAMES
    ]


def _has_shapes(report: ReportData, split: str) -> bool:
    return 0 < len(report.evaluations[split].models[MEAN_ARRAY].by_shape) <= MAX_SHAPES


def _errors(report: ReportData, split: str, model: str) -> dict[str, Figures]:
    """Errors of a model by shape, or by family if there are too many shapes."""
    row = report.evaluations[split].models[model]
    return row.by_shape if _has_shapes(report, split) else row.by_family


def _shape_bars(page: Figure, report: ReportData, split: str) -> None:
    axes = page.subplots()
    _bars(axes, report, split)
    high = max(
        figures.rmse_counts
        for other, evaluation in report.evaluations.items()
        for model in evaluation.models
        for figures in _errors(report, other, model).values()
    )
    axes.set(xlim=(0, 1.05 * high or 1), ylim=(len(_shapes(report, split)) - 0.4, -0.6))
    page.legend(*axes.get_legend_handles_labels(), loc="outside lower center", ncols=2)


def _bars(axes: Axes, report: ReportData, split: str) -> None:
    shapes = _shapes(report, split)
    color_of = colors(list(report.runs))
    places = np.arange(len(shapes))
    height = 0.8 / len(report.runs)

    def errors(name: str) -> list[float]:
        figures = _errors(report, split, name)
        return [figures[shape].rmse_counts for shape in shapes]

    for i, name in enumerate(report.runs):
        offset = (i - (len(report.runs) - 1) / 2) * height
        axes.barh(places + offset, errors(name), height, color=color_of[name], label=name_of(name))
    for name, style in MARKS.items():
        axes.plot(
            errors(name), places, color=BASELINE_COLORS[name], label=name_of(name),
            linestyle="none", **style,
        )  # fmt: skip
    axes.set_yticks(places, [shape_name(shape) for shape in shapes])
    titles = TITLES if report.info.is_protocol else SPLIT_NAMES
    axes.set(xlabel="RMSE, counts", title=titles[split])
    axes.xaxis.set_major_locator(MaxNLocator(COUNTS_TICKS))
    axes.xaxis.set_major_formatter("{x:,.0f}")


def by_view(report: ReportData) -> dict[str, Any]:
    """A table per split: shapes (rows), models and groups of taxels (columns)."""
    models = report.evaluation.models.values()
    return {
        "view": report.evaluation.view,
        "max_rows": MAX_SHAPES,
        "shortened": any(len(row.by_family) > MAX_SHAPES for row in models),
        "tables": [_view_table(one, split) for split, one in report.evaluations.items()],
    }


def _view_table(evaluation: Evaluation, split: str) -> tuple[list, list]:
    models = {name: row for name, row in evaluation.models.items() if name != NOISE_FLOOR}
    heads = [
        ["", *((name_of(name), len(GROUPS)) for name in models)],
        ["", *[*GROUPS] * len(models)],
    ]
    parts = [_by_name(row, split) for row in models.values()]
    whole = _view_row("all", [row.overall for row in models.values()])
    each = [_view_row(shape_name(name), [part[name] for part in parts]) for name in parts[0]]
    return heads, [(SPLIT_NAMES[split].capitalize(), [whole, *each])]


def _by_name(row: ModelRow, split: str) -> dict[str, Figures]:
    """Errors by shape, or by family: of the test split and of too many shapes."""
    if split != "test" and 0 < len(row.by_shape) <= MAX_SHAPES:
        return row.by_shape
    if len(row.by_family) <= MAX_SHAPES:
        return row.by_family
    return dict(sorted(row.by_family.items(), key=lambda item: -item[1].pairs)[:MAX_SHAPES])


def _view_row(name: str, figures: Sequence[Figures]) -> list[str]:
    values = [one.value(group) for one in figures for group in VIEW_FIGURES]
    return [name, *("–" if value is None else f"{value:,.0f}" for value in values)]
