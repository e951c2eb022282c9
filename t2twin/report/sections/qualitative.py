"""The paper's qualitative figure: DIGIT image, predicted and true tactile images."""

from typing import Any

import numpy as np

from t2twin.report.data import ReportData
from t2twin.report.html.figures import Panel, draw_panels, figure
from t2twin.report.html.labels import name_of

QUANTILES = {"val": (0.1, 0.5, 0.9, 1.0), "test": (0.1, 0.3, 0.5, 0.7, 0.9, 1.0)}
"""Quantiles of the error at which samples are shown."""

PANEL_IN, ROW_IN, BARS_IN = 1.25, 2.5, 0.9
"""Width of a panel, height of a row, width of the color bars, inches."""


def section(report: ReportData) -> dict[str, Any]:
    """Split, quantile, values, errors by run, and figure of each sample."""
    return {
        "samples": [
            (
                split,
                quantile,
                report.row(split, row),
                {name: report.predictions[split].rmse_counts(name)[row] for name in report.runs},
                sample_image(report, split, row),
            )
            for split in report.evaluations
            for row, quantile in samples_at_quantiles(report, split)
        ]
    }


def samples_at_quantiles(report: ReportData, split: str) -> list[tuple[int, float]]:
    """Unique rows at QUANTILES of the error, with their quantile."""
    predictions = report.predictions[split]
    error = np.mean([predictions.rmse_counts(name) for name in report.runs], axis=0)
    order = np.argsort(error, kind="stable")
    rows: dict[int, float] = {}
    for quantile in QUANTILES[split]:
        rows.setdefault(int(order[round(quantile * (order.size - 1))]), quantile)
    return list(rows.items())


def sample_image(report: ReportData, split: str, row: int) -> bytes:
    """One sample as PNG: X, generated images, phi of the predicted counts, differences, and I."""
    predictions, phi, layout = report.predictions[split], report.phi, report.layout
    digit, truth = report.image(split, row), phi(predictions.truth[row])
    panels = [Panel("X\nDIGIT", digit)]
    for name, run in report.runs.items():
        predicted, title = phi(predictions.by_model[name][row]), name_of(name)
        if run.reads_any_layout:
            panels.append(Panel(f"{title}\ngenerated", run.tactile_images([digit])[0]))
        error = predictions.rmse_counts(name)[row]
        panels.append(Panel(f"φ(Ŷ) {title}\n{error:,.0f} counts", predicted))
        panels.append(Panel("φ(Ŷ) − I\n", predicted - truth, is_difference=True))
    panels.append(Panel("I = φ(Y)\ntrue", truth))
    return figure(
        "png",
        PANEL_IN * sum(panel.width for panel in panels) + BARS_IN,
        ROW_IN,
        lambda page: draw_panels(page, panels, phi, layout.x_mm, layout.y_mm),
    )
