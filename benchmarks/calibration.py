"""How near a calibration comes to frames of a real DIGIT that it was not fitted to.

    python -m benchmarks.calibration FRAMES

FRAMES holds background.png and press_*.png of a 4.70 mm ball; it is no part of the project.
"""

from argparse import Namespace
from dataclasses import asdict
from typing import Any

from benchmarks.declared import CALIBRATION
from benchmarks.evidence.run import main
from t2twin.sim.digit.calibrate.calibrate import calibrate

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
    main(CALIBRATION)
