"""HTML page of an adaptation: its scores, and images of every held-out press."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from t2twin.adaptation.real_frame_evaluation import MIN_CONTACT_COUNTS, PressComparison
from t2twin.adaptation.record import AdaptationResult
from t2twin.core.tables import Table
from t2twin.report.html.figures import Panel, draw_panels, figure
from t2twin.report.html.page import Sections, write_page
from t2twin.report.sections.qualitative import PANEL_IN, ROW_IN
from t2twin.sim.cyskin.phi import Phi
from t2twin.sim.digit.calibrate.record import uncertainty_sentences
from t2twin.sim.digit.calibrate.uncertainty import Bounds, CalibrationUncertainty
from t2twin.translate.inference.predictor import CountsPredictor

TITLE = "Translator adapted to this DIGIT"
LINKS = {"presses": "Presses", "uncertainty": "Uncertainty"}
BAR_IN = 0.6
"""Width of the color bar, inches."""


def write_adapt_page(
    out: Path,
    run: CountsPredictor,
    comparisons: Sequence[PressComparison],
    result: AdaptationResult,
) -> Path:
    """Writes out/index.html and returns its path."""
    values = {
        "summary": lambda: _summary(result),
        "presses": lambda: {"presses": [(one, _figure(run, one)) for one in comparisons]},
        "uncertainty": lambda: _uncertainty(result.uncertainty),
    }
    sections: Sections = {
        name: (f"adaptation/templates/{name}.html", compute) for name, compute in values.items()
    }
    return write_page(out, TITLE, sections, LINKS, result=result)


def _summary(result: AdaptationResult) -> dict[str, Any]:
    rows = [
        [
            name,
            f"{scores.rmse_percent:.2f}",
            f"{scores.centroid_mm:.2f}",
            f"{100 * scores.force_error:.0f}",
            f"{scores.single_region}",
        ]
        for run, each in result.runs.items()
        for name, scores in (
            (f"{run} run, real frames", each.real),
            (f"{run} run, simulated frames", each.simulated),
        )
    ]
    heads = ["", "RMSE, %", "centroid, mm", "force error, %", "one region"]
    return {"table": Table(heads, {"": rows}), "min_contact_counts": MIN_CONTACT_COUNTS}


def _uncertainty(uncertainty: CalibrationUncertainty) -> dict[str, Any]:
    rows = [
        [press.name, *_bounds(press.depth_mm), *_bounds(press.force_n)]
        for press in uncertainty.presses
    ]
    heads = ["press", "depth, mm", "low", "high", "force, N", "low", "high"]
    return {"table": Table(heads, {"": rows}), "sentences": uncertainty_sentences(uncertainty)}


def _bounds(bounds: Bounds | None) -> list[str]:
    values = (bounds.value, bounds.low, bounds.high) if bounds else ()
    return [f"{value:.2f}" for value in values] or [""] * 3


def _figure(run: CountsPredictor, comparison: PressComparison) -> bytes:
    """Content of a PNG file with both frames of a press, their translations and the reference."""
    reference, layout = comparison.reference, run.config.data
    phi = Phi(layout.x_mm, layout.y_mm)
    panels = [
        Panel("real frame", reference.frame),
        Panel("translated", phi(comparison.real.counts)),
        Panel("simulated frame", reference.simulated),
        Panel("translated", phi(comparison.simulated.counts)),
        Panel("simulated CySkin", phi(reference.counts)),
    ]
    return figure(
        "png",
        PANEL_IN * sum(panel.width for panel in panels) + BAR_IN,
        ROW_IN,
        lambda page: draw_panels(page, panels, phi, layout.x_mm, layout.y_mm),
    )
