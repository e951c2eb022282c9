"""Learning curves from the logs of the runs."""

import math
from functools import partial
from typing import Any

from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from t2twin.report.data import ReportData
from t2twin.report.html.figures import figure
from t2twin.report.html.labels import colors, name_of
from t2twin.translate.evaluation.metrics.baselines import MEAN_ARRAY, NEAREST_NEIGHBOR
from t2twin.translate.runs.log import best_epoch

WIDTH_IN, HEIGHT_IN = 9.0, 3.4


def section(report: ReportData) -> dict[str, Any]:
    """Chart of the RMSE by epoch."""
    draw = partial(_errors, report=report)
    return {"chart": figure("svg", WIDTH_IN, HEIGHT_IN, draw)}


def _errors(page: Figure, report: ReportData) -> None:
    axes = page.subplots()
    color_of = colors(list(report.runs))
    full_scale = report.layout.full_scale_counts
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
                evaluation.models[name].overall.rmse_counts, color=color_of[name], linewidth=1,
                linestyle=(0, (6, 3)), label=f"{name_of(name)}, validation",
            )  # fmt: skip
    axes.set(xlabel="epoch", ylabel="RMSE, counts", ylim=(0, None))
    axes.yaxis.set_major_formatter("{x:,.0f}")
    axes.xaxis.set_major_locator(MaxNLocator(integer=True))
    axes.legend()
