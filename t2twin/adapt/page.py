"""The adaptation's page: its figures in a few sentences, and every held-out press in pictures."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from t2twin.adapt.judged import FAINT_COUNTS, Felt, Judgement, judge
from t2twin.adapt.record import Adapted, Scores
from t2twin.report import markup
from t2twin.report.figures import (
    colour_bar,
    digit_picture,
    digit_width,
    figure,
    rings,
    tactile_image,
)
from t2twin.report.page import write_page
from t2twin.translate.phi import Phi
from t2twin.translate.predict import TrainedTranslator

TITLE = "A translator of this DIGIT"
PANEL_IN, ROW_IN, BARS_IN = 1.25, 2.5, 0.6
"""Width of a tactile image, height of a row, width of the colour bar, inches."""
BAR_WIDTH = 0.12
"""Room for a colour bar, in parts of a tactile image's width."""


def write_adapt_page(
    out: Path, run: TrainedTranslator, felt: Sequence[Felt], adapted: Adapted
) -> Path:
    """Writes out/index.html and returns its path."""
    return write_page(
        out,
        TITLE,
        lambda: _opening(adapted),
        {"presses": lambda: _presses(run, felt), "steps": lambda: _steps(adapted)},
        {"presses": "Presses", "steps": "Steps"},
    )


def _opening(adapted: Adapted) -> str:
    real, simulated = adapted.real, adapted.simulated
    sentences = (
        f"{adapted.presses} presses of the ball had no part in the light that was fitted. Their "
        f"simulated pictures come within {adapted.optics_psnr_db:.1f} dB of the real ones around "
        f"the contact (SSIM {adapted.optics_ssim:.2f}).",
        f"From the real frames the translator is off by {real.rmse_percent:.2f} % of full scale, "
        f"from simulated frames of the same presses by {simulated.rmse_percent:.2f} %. No counts "
        f"at all would be off by {adapted.nothing_rmse_percent:.2f} %, the presses' own mean "
        f"array by {adapted.constant_rmse_percent:.2f} %.",
        f"What it feels lies {real.centroid_mm:.1f} mm from the ball's middle and is "
        f"{100 * real.force_part:.0f} % off in all its counts (medians); {real.one_blob} of "
        f"{adapted.presses} presses are felt as one. On the untouched sensor its largest count "
        f"is {adapted.untouched_counts:.0f}"
        + (", which is nothing." if adapted.untouched_counts < FAINT_COUNTS else "."),
        "The truth is the twin's own CySkin under the ball at the place and depth found in each "
        "frame: nobody measured a real CySkin here, and depth is only as sure as the ball's "
        "diameter and the picture's scale.",
    )
    rows = [("real frames", *_cells(real)), ("simulated frames", *_cells(simulated))]
    heads = [[("", 1), ("RMSE %", 1), ("centroid mm", 1), ("force off %", 1), ("one blob", 1)]]
    return markup.items(sentences) + markup.table(heads, [("", rows)])


def _cells(scores: Scores) -> tuple[str, ...]:
    return (
        f"{scores.rmse_percent:.2f}",
        f"{scores.centroid_mm:.2f}",
        f"{100 * scores.force_part:.0f}",
        f"{scores.one_blob}",
    )


def _presses(run: TrainedTranslator, felt: Sequence[Felt]) -> str:
    text = (
        "For each press: the real frame and what the translator makes of it, the twin's frame of "
        "the same press and what it makes of that, and what the twin's CySkin feels. Rings mark "
        "the taxels; colours are the same along a row."
    )
    figures = [_press(run, one) for one in felt]
    return markup.section("presses", "Presses", [markup.paragraph(text, "note"), *figures])


def _press(run: TrainedTranslator, felt: Felt) -> str:
    real = judge(run, felt.frame, felt.counts)
    simulated = judge(run, felt.simulated, felt.counts)
    width = PANEL_IN * (3 + 2 * digit_width(felt.frame)) + BARS_IN
    content = figure("png", width, ROW_IN, lambda page: _draw(page, run, felt, real, simulated))
    x_mm, y_mm, depth_mm = felt.pose
    note = (
        f"x {x_mm:.1f} mm, y {y_mm:.1f} mm, {depth_mm:.2f} mm deep, {felt.force_n:.1f} N. From "
        f"the real frame {real.rmse_percent:.2f} % off, from the simulated one "
        f"{simulated.rmse_percent:.2f} %."
    )
    alt = f"real and simulated frame of {felt.name} and the tactile images made of them"
    return markup.picture(content, "png", alt, felt.name, note=note)


def _draw(
    page: Figure, run: TrainedTranslator, felt: Felt, real: Judgement, simulated: Judgement
) -> None:
    layout = run.config.data
    phi = Phi(layout.x_mm, layout.y_mm)
    wide = digit_width(felt.frame)
    axes = page.subplots(1, 5, width_ratios=(wide, 1.0, wide, 1.0, 1.0))
    most = max(1.0, *(float(np.max(of)) for of in (real.counts, simulated.counts, felt.counts)))
    for place, title, picture in (
        (axes[0], "real frame", felt.frame),
        (axes[2], "simulated frame", felt.simulated),
    ):
        place.set_title(title)
        digit_picture(place, picture)
    for place, title, counts in (
        (axes[1], "translated", real.counts),
        (axes[3], "translated", simulated.counts),
        (axes[4], "the twin's CySkin", felt.counts),
    ):
        place.set_title(title)
        drawn = tactile_image(place, phi(counts), phi, (0.0, most))
        rings(place, layout.x_mm, layout.y_mm)
    colour_bar(page, drawn, axes[4], BAR_WIDTH, "counts")


def _steps(adapted: Adapted) -> str:
    rows = [(name, f"{minutes:.1f} minutes") for name, minutes in adapted.minutes.items()]
    return markup.section("steps", "Steps", [markup.facts(rows)])
