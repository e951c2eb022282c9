"""Accuracy of an optics file on frames of a real DIGIT that it was not fitted to.

    python -m benchmarks fitted_optics FRAMES

FRAMES is a folder with background.png and press_*.png of a 4.70 mm ball. It is not part of the
project.
"""

from argparse import Namespace
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.evidence import Argument, Benchmark, Figure
from t2twin.sim.calibrate.calibrate import calibrate
from t2twin.sim.calibrate.frames import (
    CROP_PX,
    Score,
    contact_patch,
    crop,
    mean_score,
    read_frames,
    score,
)
from t2twin.sim.sensors.pair import SensorPair

BENCHMARK = Benchmark(
    module="benchmarks.optics.fitted_optics",
    minutes=4,
    sources=("sim/calibrate", "sim/optical"),
    figures=(
        Figure("scores.calibrated.psnr_db", "dB", least=30.5),
        Figure("scores.calibrated.ssim", least=0.87),
        Figure("scores.calibrated.l1", "grey levels"),
        Figure("scores.*.psnr_db", "dB"),
    ),
    arguments=(Argument("frames", "folder of background.png and press_*.png", Path),),
)

SENSOR = SensorPair().camera
BALL_DIAMETER_MM = 4.70
"""Diameter of the ball in the frames, mm."""
HELD_OUT = 7
"""Presses scored, the last ones; all earlier ones are fitted to."""
ROTATIONS = 3
"""Parts of a cross-validation, each of which is held out once."""
SAME_POSE_MM = 0.05
"""Largest difference of position and depth between two frames of one press, mm: a pixel."""


def repeats_floor(frames: np.ndarray, poses: np.ndarray, places: np.ndarray) -> Score | None:
    """Between two frames of one press, on the contact crop; None if there are none."""
    scores = [
        score(crop(frames[i], places[i]), crop(frames[j], places[i]))
        for i in range(len(frames))
        for j in range(i)
        if np.abs(poses[i] - poses[j]).max() < SAME_POSE_MM
    ]
    return mean_score(scores) if scores else None


def background_floor(frames: np.ndarray, places: np.ndarray) -> Score | None:
    """Between consecutive frames, on the crop farthest from both contacts."""
    if len(frames) < 2:
        return None
    half = CROP_PX // 2
    rows, columns = frames.shape[1:3]
    middles = np.array(
        [
            (row, column)
            for row in range(half, rows - half + 1, 10)
            for column in range(half, columns - half + 1, 10)
        ]
    )
    scores = []
    for i in range(len(frames) - 1):
        away = [np.hypot(*(places[i : i + 2] - middle).T).min() for middle in middles]
        middle = middles[int(np.argmax(away))]
        scores.append(score(crop(frames[i], middle), crop(frames[i + 1], middle)))
    return mean_score(scores)


def measure(options: Namespace) -> dict[str, Any]:
    background = options.frames / "background.png"
    report = calibrate(background, options.frames, BALL_DIAMETER_MM, HELD_OUT, tolerance=None)
    still, frames, names = read_frames(background, options.frames, SENSOR.camera)
    held_out_names = [press.name for press in report.held_out]
    frames = frames[[names.index(name) for name in (*report.trained, *held_out_names)]]
    places = np.array([contact_patch(frame, still) for frame in frames])
    held_out = slice(len(report.trained), None)
    floors = {
        "repeats_floor": repeats_floor(frames, report.poses, places),
        "background_floor": background_floor(frames[held_out], places[held_out]),
    }
    return {
        "trained": report.trained,
        "held_out": held_out_names,
        "scores": {
            name: None if each is None else asdict(each)
            for name, each in (report.scores | floors).items()
        },
    }
