"""HTML page of an adaptation: its scores, and images of every held-out press."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from t2twin.adaptation.real_frame_evaluation import MIN_CONTACT_COUNTS, PressComparison
from t2twin.adaptation.record import AdaptationResult, AdaptationScores
from t2twin.report.html import markup
from t2twin.report.html.figures import (
    color_bar,
    digit_width,
    draw_digit_image,
    draw_tactile_image,
    draw_taxels,
    figure,
)
from t2twin.report.html.page import write_page
from t2twin.report.sections.qualitative import BAR_WIDTH, PANEL_IN, ROW_IN
from t2twin.sim.cyskin.phi import Phi
from t2twin.sim.digit.calibrate.record import uncertainty_sentences
from t2twin.sim.digit.calibrate.uncertainty import Bounds
from t2twin.translate.inference.predictor import CountsPredictor

TITLE = "Translator adapted to this DIGIT"
BAR_IN = 0.6
"""Width of the color bar, inches."""


def write_adapt_page(
    out: Path,
    run: CountsPredictor,
    comparisons: Sequence[PressComparison],
    result: AdaptationResult,
) -> Path:
    """Writes out/index.html and returns its path."""
    return write_page(
        out,
        TITLE,
        lambda: _summary(result),
        {
            "presses": lambda: _presses(run, comparisons),
            "uncertainty": lambda: _uncertainty(result),
            "steps": lambda: _steps(result),
        },
        {"presses": "Presses", "uncertainty": "Uncertainty", "steps": "Steps"},
    )


def _summary(result: AdaptationResult) -> str:
    real, simulated = result.real, result.simulated
    in_contact = result.background_counts >= MIN_CONTACT_COUNTS
    sentences = (
        f"The calibration was not fitted to {result.presses} held-out presses of the ball. Around "
        f"the contact their simulated images reach a PSNR of {result.optics_psnr_db:.1f} dB and an "
        f"SSIM of {result.optics_ssim:.2f} relative to the real images.",
        f"The RMSE is {real.rmse_percent:.2f} % of full scale on the real frames and "
        f"{simulated.rmse_percent:.2f} % on simulated frames of the same presses. Baselines: "
        f"{result.zero_rmse_percent:.2f} % for zero counts, "
        f"{result.mean_array_rmse_percent:.2f} % for the mean array of the presses.",
        f"The median error of the contact's centroid is {real.centroid_mm:.1f} mm, that of the "
        f"force {100 * real.force_error:.0f} %. {real.single_region} of {result.presses} presses "
        "have a single predicted contact region. On the background frame the largest predicted "
        f"count is {result.background_counts:.0f}, "
        f"{'above' if in_contact else 'below'} the contact threshold of {MIN_CONTACT_COUNTS:.0f}.",
        "The reference is the simulated CySkin, pressed by the ball at the position and depth "
        "found in each frame. No real CySkin was measured, so depth and force are only as accurate "
        "as the stated tolerances (see Uncertainty).",
    )
    rows = [("real frames", *_cells(real)), ("simulated frames", *_cells(simulated))]
    heads = [
        [("", 1), ("RMSE, %", 1), ("centroid, mm", 1), ("force error, %", 1), ("one region", 1)]
    ]
    return markup.items(sentences) + markup.table(heads, [("", rows)])


def _cells(scores: AdaptationScores) -> tuple[str, ...]:
    return (
        f"{scores.rmse_percent:.2f}",
        f"{scores.centroid_mm:.2f}",
        f"{100 * scores.force_error:.0f}",
        f"{scores.single_region}",
    )


def _presses(run: CountsPredictor, comparisons: Sequence[PressComparison]) -> str:
    text = (
        "From left to right: the real frame and its translation, the simulated frame of the same "
        "press and its translation, and the tactile image of the simulated CySkin. Rings mark the "
        "taxels. A row has one color scale."
    )
    figures = [_press(run, comparison) for comparison in comparisons]
    return markup.section("presses", "Presses", [markup.paragraph(text, "note"), *figures])


def _press(run: CountsPredictor, comparison: PressComparison) -> str:
    reference, real, simulated = comparison.reference, comparison.real, comparison.simulated
    width = PANEL_IN * (3 + 2 * digit_width(reference.frame)) + BAR_IN
    content = figure("png", width, ROW_IN, lambda page: _draw(page, run, comparison))
    x_mm, y_mm, depth_mm = reference.pose
    note = (
        f"x {x_mm:.1f} mm, y {y_mm:.1f} mm, depth {depth_mm:.2f} mm, {reference.force_n:.1f} N. "
        f"RMSE {real.rmse_percent:.2f} % on the real frame, {simulated.rmse_percent:.2f} % on the "
        "simulated frame."
    )
    alt = f"Real and simulated frame of {reference.name} with their translations"
    return markup.embed(content, "png", alt, reference.name, note=note)


def _draw(page: Figure, run: CountsPredictor, comparison: PressComparison) -> None:
    reference, real, simulated = comparison.reference, comparison.real, comparison.simulated
    layout = run.config.data
    phi = Phi(layout.x_mm, layout.y_mm)
    wide = digit_width(reference.frame)
    axes = page.subplots(1, 5, width_ratios=(wide, 1.0, wide, 1.0, 1.0))
    all_counts = (real.counts, simulated.counts, reference.counts)
    limits = (0.0, max(1.0, *(float(np.max(counts)) for counts in all_counts)))
    for panel, title, image in (
        (axes[0], "real frame", reference.frame),
        (axes[2], "simulated frame", reference.simulated),
    ):
        panel.set_title(title)
        draw_digit_image(panel, image)
    for panel, title, counts in (
        (axes[1], "translated", real.counts),
        (axes[3], "translated", simulated.counts),
        (axes[4], "simulated CySkin", reference.counts),
    ):
        panel.set_title(title)
        drawn = draw_tactile_image(panel, phi(counts), phi, limits)
        draw_taxels(panel, layout.x_mm, layout.y_mm)
    color_bar(page, drawn, axes[4], BAR_WIDTH, "counts")


def _uncertainty(result: AdaptationResult) -> str:
    heads = [
        [("press", 1), ("depth, mm", 1), ("low", 1), ("high", 1), ("force, N", 1), ("low", 1),
         ("high", 1)]
    ]  # fmt: skip
    rows = [
        (press.name, *_bounds(press.depth_mm), *_bounds(press.force_n))
        for press in result.uncertainty.presses
    ]
    return markup.section(
        "uncertainty",
        "Uncertainty",
        [
            markup.items(uncertainty_sentences(result.uncertainty)),
            markup.table(heads, [("", rows)]),
        ],
    )


def _bounds(bounds: Bounds | None) -> tuple[str, str, str]:
    if bounds is None:
        return "", "", ""
    return f"{bounds.value:.2f}", f"{bounds.low:.2f}", f"{bounds.high:.2f}"


def _steps(result: AdaptationResult) -> str:
    rows = [(name, f"{minutes:.1f} minutes") for name, minutes in result.minutes.items()]
    return markup.section("steps", "Steps", [markup.facts(rows)])
