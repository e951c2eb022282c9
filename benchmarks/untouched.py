"""How near lights that were not fitted come to frames of a real DIGIT, beside one that was.

    python -m benchmarks.untouched FRAMES

FRAMES holds background.png and press_*.png of a 4.70 mm ball; it is no part of the project. Every
light shows the last presses at the places and depths that the fitted one finds in them: the light
that ships, it on the unit's own background, the drawn unit whose LEDs explain that background best,
the mean of the best (what `t2twin calibrate --background` gives) and of all drawn ones, and the
light fitted to the first presses.
"""

from argparse import Namespace
from dataclasses import asdict, replace
from typing import Any

import numpy as np

from benchmarks.calibration import BALL_DIAMETER_MM, HELD_OUT
from benchmarks.declared import UNTOUCHED
from benchmarks.evidence.run import main
from t2twin.sim.digit.calibrate.calibrate import CalibrationReport, calibrate
from t2twin.sim.digit.calibrate.frames import read_frame, touched_patch, upright_frame
from t2twin.sim.digit.calibrate.scores import Score, crop_scores, mean_score
from t2twin.sim.digit.calibrate.untouched import NEAREST, candidates, mean_light, nearest
from t2twin.sim.digit.calibration import Calibration
from t2twin.sim.digit.camera import DIGIT_CAMERA
from t2twin.sim.digit.optics import DigitOptics


def measure(options: Namespace) -> dict[str, Any]:
    background = options.frames / "background.png"
    report = calibrate(background, options.frames, BALL_DIAMETER_MM, HELD_OUT, tolerance=None)
    untouched = upright_frame(read_frame(background))
    patches = np.array([touched_patch(frame, untouched) for frame in report.real])
    drawn = candidates(untouched, DIGIT_CAMERA)
    best, shipped = nearest(drawn, NEAREST), Calibration.load()
    lights = {
        "shipped": shipped,
        "shipped_on_own_background": replace(shipped, background=untouched),
        "nearest": best[0].calibration,
        "mean_of_nearest": mean_light(best),
        "mean_of_all": mean_light(drawn),
        "fitted": report.scored_by,
    }
    singly = [_score(report, unit.calibration, patches).psnr_db for unit in best]
    return {
        "held_out": report.held_out,
        "drawn": len(drawn),
        "averaged": NEAREST,
        "scores": {
            "do_nothing": asdict(report.scores.do_nothing),
            **{name: asdict(_score(report, light, patches)) for name, light in lights.items()},
        },
        "nearest_singly_psnr_db": {"mean": float(np.mean(singly)), "most": float(np.max(singly))},
    }


def _score(report: CalibrationReport, light: Calibration, patches: np.ndarray) -> Score:
    optics = DigitOptics(light)
    shown = np.array([optics.render(surface_mm) for surface_mm in report.surfaces_mm])
    return mean_score(crop_scores(report.real, shown, patches))


if __name__ == "__main__":
    main(UNTOUCHED)
