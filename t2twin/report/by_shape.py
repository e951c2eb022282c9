"""The error of every validation primitive and of every keypoint of the tools."""

from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from t2twin.primitives_cad import catalogue
from t2twin.report import markup
from t2twin.report.figures import figure
from t2twin.report.names import BASELINE_COLOURS, colours, name_of
from t2twin.report.report_data import SHOWN, ReportData
from t2twin.translate.evaluation.baselines import MEAN_ARRAY, NEAREST_NEIGHBOUR

WIDTH_IN, BAR_IN, FURNITURE_IN = 9.0, 0.30, 1.0
TITLES = {"val": "validation primitives", "test": "tools at their keypoints"}
MARKS: dict[str, dict[str, Any]] = {
    MEAN_ARRAY: {"marker": "|", "markersize": 13, "markeredgewidth": 2.0},
    NEAREST_NEIGHBOUR: {"marker": "D", "markersize": 5, "markeredgecolor": "white"},
}


def section(report: ReportData) -> str:
    """Bars for the runs, marks for the trivial predictors."""
    most = max(len(_shapes(report, split)) for split in SHOWN)
    content = figure(
        "svg", WIDTH_IN, FURNITURE_IN + BAR_IN * most, lambda page: _draw(page, report)
    )
    return markup.section(
        "by-shape",
        "Error by shape",
        [
            markup.picture(
                content,
                "svg",
                "Bar chart of the error of every validation primitive and tool keypoint",
                note="RMSE over the pairs of each shape. Bars: the trained models; marks: what "
                "the trivial predictors reach on the same pairs.",
            )
        ],
    )


def _shapes(report: ReportData, split: str) -> list[str]:
    """In the catalogue's order."""
    there = report.evaluations[split].models[MEAN_ARRAY].by_shape
    return [name for name in catalogue.NAMES if name in there] + [
        name for name in there if name not in catalogue.NAMES
    ]


def _draw(page: Figure, report: ReportData) -> None:
    axes = page.subplots(1, len(SHOWN), sharex=True)
    for place, split in zip(axes, SHOWN, strict=True):
        _bars(place, report, split)
    # As many places on both sides, so that bars are equally thick.
    most = max(len(_shapes(report, split)) for split in SHOWN)
    for place in axes:
        place.set_ylim(most - 0.4, -0.6)
    page.legend(*axes[0].get_legend_handles_labels(), loc="outside lower center", ncols=4)


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
    axes.set_yticks(places, shapes)
    axes.set(xlabel="RMSE, counts", title=TITLES[split])
    axes.xaxis.set_major_formatter("{x:,.0f}")
