"""Error by shape: of validation primitives, and of test tools at their keypoints."""

from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from t2twin.primitives_cad import catalogue
from t2twin.report.data import ReportData
from t2twin.report.html import markup
from t2twin.report.html.figures import figure
from t2twin.report.html.labels import BASELINE_COLORS, SPLIT_NAMES, colors, name_of, shape_name
from t2twin.translate.evaluation.metrics.baselines import MEAN_ARRAY, NEAREST_NEIGHBOR
from t2twin.translate.evaluation.records import Figures

WIDTH_IN, BAR_IN, MARGINS_IN = 4.2, 0.30, 1.3
"""Width of a chart, which fits on a phone; height of a bar and of the margins, inches."""

TITLES = {"val": "validation primitives", "test": "tools at their keypoints"}
"""Titles of the splits of the paper's protocol."""

MAX_BARS = 60
"""Maximum number of bars of a chart (assumed: a printed page)."""
COUNTS_TICKS = 4
MARKS: dict[str, dict[str, Any]] = {
    MEAN_ARRAY: {"marker": "|", "markersize": 13, "markeredgewidth": 2.0},
    NEAREST_NEIGHBOR: {"marker": "D", "markersize": 5, "markeredgecolor": "white"},
}


def section(report: ReportData) -> str:
    """One chart per split, with bars for the runs and marks for the baselines."""
    many = [split for split in report.evaluations if not _by_shape(report, split)]
    text = (
        f"RMSE over the pairs of each {'shape or family' if many else 'shape'}. Bars: trained "
        "models; marks: baselines."
    )
    if many:
        text += (
            f" Splits with more than {MAX_BARS} shapes are grouped by family: "
            f"{' and '.join(SPLIT_NAMES[split] for split in many)}. At most {MAX_BARS} families, "
            "those with the most pairs, are shown."
        )
    charts = [_chart(report, split) for split in report.evaluations]
    return markup.section(
        "by-shape",
        "Error by shape",
        [markup.paragraph(text, "note"), markup.grid(charts, "grid halves")],
    )


def _chart(report: ReportData, split: str) -> str:
    height = MARGINS_IN + BAR_IN * len(_shapes(report, split))
    content = figure("svg", WIDTH_IN, height, lambda page: _draw(page, report, split))
    alt = f"Bar chart of the error of every shape, {SPLIT_NAMES[split]}"
    return markup.embed(content, "svg", alt, width="narrow")


def _shapes(report: ReportData, split: str) -> list[str]:
    """Shapes or families of a split, in the order of the catalogue."""
    errors = _errors(report, split, MEAN_ARRAY)
    if len(errors) > MAX_BARS:
        return sorted(errors, key=lambda name: -errors[name].pairs)[:MAX_BARS]
    return [name for name in catalogue.NAMES if name in errors] + [
        name for name in errors if name not in catalogue.NAMES
    ]


def _by_shape(report: ReportData, split: str) -> bool:
    return 0 < len(report.evaluations[split].models[MEAN_ARRAY].by_shape) <= MAX_BARS


def _errors(report: ReportData, split: str, model: str) -> dict[str, Figures]:
    """Errors of a model by shape, or by family if there are too many shapes."""
    row = report.evaluations[split].models[model]
    return row.by_shape if _by_shape(report, split) else row.by_family


def _draw(page: Figure, report: ReportData, split: str) -> None:
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
