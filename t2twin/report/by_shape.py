"""The error of every shape of validation and test: primitives, and tools at their keypoints."""

from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from t2twin.primitives_cad import catalogue
from t2twin.report import markup
from t2twin.report.figures import figure
from t2twin.report.names import BASELINE_COLOURS, SPLIT_NAMES, colours, name_of, shape_name
from t2twin.report.report_data import ReportData
from t2twin.translate.evaluation.baselines import MEAN_ARRAY, NEAREST_NEIGHBOUR

WIDTH_IN, BAR_IN, FURNITURE_IN = 4.2, 0.30, 1.3
"""Width of a split's chart, which is whole on a phone; height of a shape, and of the rest."""

TITLES = {"val": "validation primitives", "test": "tools at their keypoints"}
"""Of simulated pairs."""
COUNTS_TICKS = 4
MARKS: dict[str, dict[str, Any]] = {
    MEAN_ARRAY: {"marker": "|", "markersize": 13, "markeredgewidth": 2.0},
    NEAREST_NEIGHBOUR: {"marker": "D", "markersize": 5, "markeredgecolor": "white"},
}


def section(report: ReportData) -> str:
    """A chart a split: bars for the runs, marks for the trivial predictors."""
    text = (
        "RMSE over the pairs of each shape. Bars: the trained models; marks: what the trivial "
        "predictors reach on the same pairs."
    )
    charts = [_chart(report, split) for split in report.evaluations]
    return markup.section(
        "by-shape",
        "Error by shape",
        [markup.paragraph(text, "note"), markup.grid(charts, "grid halves")],
    )


def _chart(report: ReportData, split: str) -> str:
    height = FURNITURE_IN + BAR_IN * len(_shapes(report, split))
    content = figure("svg", WIDTH_IN, height, lambda page: _draw(page, report, split))
    alt = f"Bar chart of the error of every shape, {SPLIT_NAMES[split]}"
    return markup.picture(content, "svg", alt, width="narrow")


def _shapes(report: ReportData, split: str) -> list[str]:
    """In the catalogue's order."""
    there = report.evaluations[split].models[MEAN_ARRAY].by_shape
    return [name for name in catalogue.NAMES if name in there] + [
        name for name in there if name not in catalogue.NAMES
    ]


def _draw(page: Figure, report: ReportData, split: str) -> None:
    axes = page.subplots()
    _bars(axes, report, split)
    rows = [row for one in report.evaluations.values() for row in one.models.values()]
    most = max(shape.rmse_counts for row in rows for shape in row.by_shape.values())
    axes.set(xlim=(0, 1.05 * most or 1), ylim=(len(_shapes(report, split)) - 0.4, -0.6))
    page.legend(*axes.get_legend_handles_labels(), loc="outside lower center", ncols=2)


def _bars(axes: Axes, report: ReportData, split: str) -> None:
    shapes = _shapes(report, split)
    models = report.evaluations[split].models
    colour_of = colours(list(report.runs))
    places = np.arange(len(shapes))
    height = 0.8 / len(report.runs)

    def errors(name: str) -> list[float]:
        return [models[name].by_shape[shape].rmse_counts for shape in shapes]

    for i, name in enumerate(report.runs):
        offset = (i - (len(report.runs) - 1) / 2) * height
        axes.barh(places + offset, errors(name), height, color=colour_of[name], label=name_of(name))
    for name, style in MARKS.items():
        axes.plot(
            errors(name), places, color=BASELINE_COLOURS[name], label=name_of(name),
            linestyle="none", **style,
        )  # fmt: skip
    axes.set_yticks(places, [shape_name(shape) for shape in shapes])
    titles = TITLES if report.info.is_simulated else SPLIT_NAMES
    axes.set(xlabel="RMSE, counts", title=titles[split])
    axes.xaxis.set_major_locator(MaxNLocator(COUNTS_TICKS))
    axes.xaxis.set_major_formatter("{x:,.0f}")
