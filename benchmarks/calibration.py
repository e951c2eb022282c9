"""Accuracy of a calibration on frames of a real DIGIT that it was not fitted to.

    python -m benchmarks.calibration FRAMES

FRAMES is a folder with background.png and press_*.png of a 4.70 mm ball. It is not part of the
project.
"""

from argparse import Namespace
from dataclasses import asdict
from pathlib import Path
from typing import Any

from benchmarks.evidence.record import Argument, Benchmark, Figure
from benchmarks.evidence.run import main
from t2twin.sim.digit.calibrate.calibrate import calibrate

BENCHMARK = Benchmark(
    name="calibration",
    measures="Accuracy of a calibration on frames of a real DIGIT that it was not fitted to.",
    minutes=1,
    sources=("sim/digit",),
    figures=(
        Figure("scores.calibrated.psnr_db", "dB", least=30.5),
        Figure("scores.calibrated.ssim", least=0.87),
        Figure("scores.calibrated.l1", "grey levels"),
        # Nearer than cut and paste, or the model has learnt no optics.
        Figure("over_cut_and_paste.psnr_db", "dB", least=3.0),
        Figure("over_cut_and_paste.ssim", least=0.04),
        Figure("scores.do_nothing.psnr_db", "dB"),
    ),
    arguments=(Argument("frames", "folder of background.png and press_*.png", Path),),
)

BALL_DIAMETER_MM = 4.70
"""Diameter of the ball in the frames, mm."""
HELD_OUT = 7
"""Presses scored, the last ones; all earlier ones are fitted to."""


def measure(options: Namespace) -> dict[str, Any]:
    background = options.frames / "background.png"
    report = calibrate(background, options.frames, BALL_DIAMETER_MM, HELD_OUT, tolerance=None)
    scores = asdict(report.scores)
    ours, pasted = report.scores.calibrated, report.scores.cut_and_paste
    return {
        "ball_diameter_mm": BALL_DIAMETER_MM,
        "trained": report.trained,
        "held_out": report.held_out,
        "repeated": report.repeated,
        "scores": scores,
        "over_cut_and_paste": {
            "psnr_db": ours.psnr_db - pasted.psnr_db,
            "ssim": ours.ssim - pasted.ssim,
        },
        "each": [asdict(score) for score in report.each],
    }


if __name__ == "__main__":
    main(BENCHMARK)
