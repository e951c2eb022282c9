"""Error by force, of datasets with several forces."""

from collections.abc import Sequence
from typing import Any

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from t2twin.report.data import ReportData
from t2twin.report.html import markup
from t2twin.report.html.figures import figure, force_axis
from t2twin.report.html.labels import BASELINE_COLORS, SPLIT_NAMES, colors, name_of
from t2twin.translate.evaluation.metrics.baselines import MEAN_ARRAY, NEAREST_NEIGHBOR
from t2twin.translate.evaluation.metrics.floors import NOISE_FLOOR
from t2twin.translate.evaluation.metrics.forces import (
    MEAN_ARRAY_OF_FORCE,
    MIN_PRESSES,
)
from t2twin.translate.evaluation.records import Evaluation, ForceFigures
from t2twin.translate.evaluation.table import force_cell, force_rows

WIDTH_IN, HEIGHT_IN, LEGEND_IN = 9.0, 2.7, 0.4
"""Width of the chart, height per split and of the legend, inches."""

MAX_PERCENT = 150.0
"""Upper end of the relative error's axis, percent (assumed)."""

DASHED: dict[str, Any] = {"linestyle": (0, (6, 3)), "linewidth": 1.0}


def section(report: ReportData) -> str:
    """Chart and table of each split with several forces."""
    evaluations = {s: one for s, one in report.evaluations.items() if one.has_forces}
    height = LEGEND_IN + HEIGHT_IN * len(evaluations)
    content = figure("svg", WIDTH_IN, height, lambda page: _draw(page, report, evaluations))
    text = (
        "Small forces cause small counts, and small absolute errors. The error is therefore given "
        "by force, and relative to that of the mean array of the same force: a predictor that uses "
        "the force but not the image."
    )
    note = (
        "Left: RMSE in counts, with a bootstrap interval over shapes. Right: RMSE relative to that "
        f"of the mean array of the force; the axis ends at {MAX_PERCENT:g} %. Points are at the "
        "mean force of their pairs. The mean array is computed from training presses of similar "
        f"force, or, with fewer than {MIN_PRESSES} of them, from the evaluated presses."
    )
    tables = [_table(split, one) for split, one in evaluations.items()]
    return markup.section(
        "by-force",
        "Error by force",
        [
            markup.paragraph(text),
            markup.embed(content, "svg", "Error against force, in counts and relative", note=note),
            markup.items(sentences(evaluations)),
            *tables,
        ],
    )


def sentences(evaluations: dict[str, Evaluation]) -> list[str]:
    """Errors of each run at the smallest and the largest force, and without contact."""
    result = []
    for split, evaluation in evaluations.items():
        for name, row in evaluation.runs.items():
            relative = [one for one in row.by_force if one.of_mean_array is not None]
            parts = [
                f"{100 * (one.of_mean_array or 0):.0f} % of the mean array's RMSE at "
                f"{one.mean_n:.3g} N"
                for one in dict.fromkeys((relative[0], relative[-1]) if relative else ())
            ]
            parts += [
                f"without contact {one.phantom_counts:,.0f} counts in sum, RMSE "
                f"{one.rmse_counts:,.0f} counts"
                for one in row.by_force
                if one.phantom_counts is not None
            ]
            title = f"{SPLIT_NAMES[split].capitalize()}, {name_of(name)}"
            result.append(f"{title}: {'; '.join(parts)}.")
    return result


def _table(split: str, evaluation: Evaluation) -> str:
    """Table of forces (rows) and models (columns), with intervals in additional rows."""
    rows = {name: row for name, row in evaluation.models.items() if name != NOISE_FLOOR}
    heads = [[(SPLIT_NAMES[split].capitalize(), 1), *((name_of(name), 1) for name in rows)]]
    titles = force_rows(evaluation)[0][1:]
    lines = []
    for place, title in enumerate(titles):
        cells = [row.by_force[place] for row in rows.values()]
        lines.append([title.replace("-", "–"), *(force_cell(one) for one in cells)])
        lines.append(["", *(_span(one) for one in cells)])
    return markup.table(heads, [("", lines)])


def _span(one: ForceFigures) -> str:
    return "" if one.interval is None else f"{one.interval.low:,.0f}–{one.interval.high:,.0f}"


def _draw(page: Figure, report: ReportData, evaluations: dict[str, Evaluation]) -> None:
    grid = page.subplots(len(evaluations), 2, squeeze=False)
    for (counts, percents), (split, evaluation) in zip(grid, evaluations.items(), strict=True):
        _lines(counts, report, evaluation, percent=False)
        _lines(percents, report, evaluation, percent=True)
        counts.set(title=SPLIT_NAMES[split], xlabel="force, N", ylabel="RMSE, counts")
        counts.set_yscale("log")
        percents.set(title=SPLIT_NAMES[split], xlabel="force, N", ylabel="% of mean array's RMSE")
        percents.set_ylim(0, MAX_PERCENT)
    page.legend(*grid[0, 0].get_legend_handles_labels(), loc="outside lower center", ncols=5)


def _lines(axes: Axes, report: ReportData, evaluation: Evaluation, percent: bool) -> None:
    color_of = BASELINE_COLORS | colors(list(report.runs))
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
