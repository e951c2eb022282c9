"""The adaptation's page: its figures in a few sentences, and every held-out press in pictures."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from t2twin.adaptation.real_frame_evaluation import FAINT_COUNTS, Judged
from t2twin.adaptation.record import AdaptationScores, Adapted
from t2twin.report.html import markup
from t2twin.report.html.figures import (
    color_bar,
    digit_picture,
    digit_width,
    figure,
    rings,
    tactile_image,
)
from t2twin.report.page import write_page
from t2twin.report.sections.qualitative import BAR_WIDTH, PANEL_IN, ROW_IN
from t2twin.sim.cyskin.phi import Phi
from t2twin.sim.digit.calibrate.record import sentences_of
from t2twin.sim.digit.calibrate.uncertainty import Bounds
from t2twin.translate.inference.predictor import CountsPredictor

TITLE = "A translator of this DIGIT"
BAR_IN = 0.6
"""Width of the color bar, inches."""


def write_adapt_page(
    out: Path, run: CountsPredictor, judged: Sequence[Judged], adapted: Adapted
) -> Path:
    """Writes out/index.html and returns its path."""
    return write_page(
        out,
        TITLE,
        lambda: _opening(adapted),
        {
            "presses": lambda: _presses(run, judged),
            "certainty": lambda: _certainty(adapted),
            "steps": lambda: _steps(adapted),
        },
        {"presses": "Presses", "certainty": "How sure", "steps": "Steps"},
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
        "frame: nobody measured a real CySkin here, and depth and force are only as sure as "
        "what was stated says (see How sure).",
    )
    rows = [("real frames", *_cells(real)), ("simulated frames", *_cells(simulated))]
    heads = [[("", 1), ("RMSE %", 1), ("centroid mm", 1), ("force off %", 1), ("one blob", 1)]]
    return markup.items(sentences) + markup.table(heads, [("", rows)])


def _cells(scores: AdaptationScores) -> tuple[str, ...]:
    return (
        f"{scores.rmse_percent:.2f}",
        f"{scores.centroid_mm:.2f}",
        f"{100 * scores.force_part:.0f}",
        f"{scores.one_blob}",
    )


def _presses(run: CountsPredictor, judged: Sequence[Judged]) -> str:
    text = (
        "For each press: the real frame and what the translator makes of it, the twin's frame of "
        "the same press and what it makes of that, and what the twin's CySkin feels. Rings mark "
        "the taxels; colors are the same along a row."
    )
    figures = [_press(run, one) for one in judged]
    return markup.section("presses", "Presses", [markup.paragraph(text, "note"), *figures])


def _press(run: CountsPredictor, judged: Judged) -> str:
    felt, real, simulated = judged.felt, judged.real, judged.simulated
    width = PANEL_IN * (3 + 2 * digit_width(felt.frame)) + BAR_IN
    content = figure("png", width, ROW_IN, lambda page: _draw(page, run, judged))
    x_mm, y_mm, depth_mm = felt.pose
    note = (
        f"x {x_mm:.1f} mm, y {y_mm:.1f} mm, {depth_mm:.2f} mm deep, {felt.force_n:.1f} N. From "
        f"the real frame {real.rmse_percent:.2f} % off, from the simulated one "
        f"{simulated.rmse_percent:.2f} %."
    )
    alt = f"real and simulated frame of {felt.name} and the tactile images made of them"
    return markup.picture(content, "png", alt, felt.name, note=note)


def _draw(page: Figure, run: CountsPredictor, judged: Judged) -> None:
    felt, real, simulated = judged.felt, judged.real, judged.simulated
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
    color_bar(page, drawn, axes[4], BAR_WIDTH, "counts")


def _certainty(adapted: Adapted) -> str:
    certainty = adapted.certainty
    heads = [[("press", 1), ("depth mm", 1), ("from", 1), ("to", 1), ("force N", 1), ("from", 1),
              ("to", 1)]]  # fmt: skip
    rows = [
        (press.name, *_cells_of(press.depth_mm), *_cells_of(press.force_n))
        for press in certainty.presses
    ]
    return markup.section(
        "certainty",
        "How sure",
        [markup.items(sentences_of(certainty)), markup.table(heads, [("", rows)])],
    )


def _cells_of(span: Bounds | None) -> tuple[str, str, str]:
    if span is None:
        return "", "", ""
    return f"{span.at:.2f}", f"{span.low:.2f}", f"{span.high:.2f}"


def _steps(adapted: Adapted) -> str:
    rows = [(name, f"{minutes:.1f} minutes") for name, minutes in adapted.minutes.items()]
    return markup.section("steps", "Steps", [markup.facts(rows)])
