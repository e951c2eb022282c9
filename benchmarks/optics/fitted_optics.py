"""Accuracy of an optics file on frames of a real DIGIT that it was not fitted to.

    python -m benchmarks.optics.fitted_optics FRAMES

FRAMES is a folder with background.png and press_*.png of a 4.70 mm ball. It is not part of the
project.
"""

from argparse import Namespace
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
from scipy.ndimage import gaussian_gradient_magnitude

from benchmarks.evidence import Argument, Benchmark, Figure, main
from t2twin.sim.calibrate.calibrate import (
    Score,
    calibrate,
    cleaned,
    evaluate,
    mean_score,
    read_presses,
    score,
)
from t2twin.sim.calibrate.fit import Presses
from t2twin.sim.calibrate.frames import CROP_PX, contact_patch, crop, read_frames
from t2twin.sim.calibrate.measurements import fit_presses
from t2twin.sim.sensors.pair import SensorPair

BENCHMARK = Benchmark(
    module="benchmarks.optics.fitted_optics",
    measures="Accuracy of an optics file on frames of a real DIGIT that it was not fitted to.",
    minutes=4,
    sources=(
        "sim/calibrate",
        "sim/optical",
    ),
    figures=(
        Figure("rotations.mean.psnr_db", "dB", least=30.5),
        Figure("rotations.mean.ssim", least=0.87),
        Figure("rotations.rim_steepness", least=0.85),
        Figure("blocks.mean.psnr_db", "dB"),
        Figure("blocks.mean.ssim"),
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

SENSOR = SensorPair().camera
BALL_DIAMETER_MM = 4.70
"""Diameter of the ball in the frames, mm."""
HELD_OUT = 7
"""Presses scored, the last ones; all earlier ones are fitted to."""
ROTATIONS = 3
"""Parts of the cross-validation: each is held out once, the presses of the others are fitted to."""
EDGE_BLUR_PX = 2.0
"""Blur of both images before gradients are computed, px (assumed: it removes the noise)."""
EDGE_PERCENT = 98.0
"""Percentile of the gradients outside a contact that is the steepness of shadow rims (assumed)."""
RIM_MM = 2.5
"""Distance from the contact within which rims of shadows are compared, mm (assumed)."""
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


def rim_steepness(real: np.ndarray, simulated: np.ndarray, outside: np.ndarray) -> float:
    """Steepness of the simulated shadow rims over that of the real ones, mean over the colors.

    real, simulated: (rows, columns, 3) uint8. outside: (rows, columns) bool, pixels near the
    contact that the ball does not touch. The steepness is a percentile of the gradient, so a
    displaced rim has the same.
    """
    real_edges, edges = (
        [
            np.percentile(
                gaussian_gradient_magnitude(image[..., c].astype(float), EDGE_BLUR_PX)[outside],
                EDGE_PERCENT,
            )
            for c in range(3)
        ]
        for image in (real, simulated)
    )
    return float(np.mean(np.divide(edges, real_edges)))


def outside_of(pose: np.ndarray) -> np.ndarray:
    """(rows, columns) bool: pixels up to RIM_MM from a ball's contact, but not in it."""
    radius_mm, (x_mm, y_mm, depth_mm) = BALL_DIAMETER_MM / 2, pose
    contact_mm = np.sqrt(radius_mm**2 - (radius_mm - depth_mm) ** 2)
    camera = SENSOR.camera
    x, y, _ = camera.gel_points(SENSOR.own_gel, np.arange(camera.columns), np.arange(camera.rows))
    off_mm = np.hypot(x - x_mm, y - y_mm) - contact_mm
    return (off_mm > 0) & (off_mm < RIM_MM)


def cross_validate(presses: Presses, parts: list[list[int]]) -> dict[str, Any]:
    """Scores on each part of the presses, fitted to the other parts, and their mean.

    parts: indices of frames. The held-out frames are compared as they are, drift included.
    """
    scores, steepness = [], []
    for test in parts:
        train = [index for part in parts if part is not test for index in part]
        training = cleaned(presses, sorted(train))
        report = evaluate(presses, test, training, fit_presses(training, SENSOR.camera))
        scores.append(report.scores.calibrated)
        steepness += [
            rim_steepness(real, simulated, outside_of(pose))
            for real, simulated, pose in zip(
                report.real, report.simulated, report.poses, strict=True
            )
        ]
    return {
        "mean": asdict(mean_score(scores)),
        "each": [asdict(score) for score in scores],
        "rim_steepness": float(np.mean(steepness)),
    }


def measure(options: Namespace) -> dict[str, Any]:
    background = options.frames / "background.png"
    report = calibrate(background, options.frames, BALL_DIAMETER_MM, HELD_OUT, tolerance=None)
    still, frames, names = read_frames(background, options.frames, SENSOR.camera)
    frames = frames[[names.index(name) for name in (*report.trained, *report.held_out)]]
    poses = np.concatenate([report.training_poses, report.poses])
    places = np.array([contact_patch(frame, still) for frame in frames])
    held_out = slice(len(report.trained), None)
    floors = {
        "repeats_floor": repeats_floor(frames, poses, places),
        "background_floor": background_floor(frames[held_out], places[held_out]),
    }
    presses, train, test = read_presses(
        background,
        options.frames,
        BALL_DIAMETER_MM,
        HELD_OUT,
        SENSOR,
        SENSOR.camera,
        tolerance=None,
    )
    different = sorted([*train, *test])
    ours, pasted = report.scores.calibrated, report.scores.cut_and_paste
    return {
        "ball_diameter_mm": BALL_DIAMETER_MM,
        "trained": report.trained,
        "held_out": report.held_out,
        "repeated": report.repeated,
        "scores": asdict(report.scores)
        | {name: None if floor is None else asdict(floor) for name, floor in floors.items()},
        "over_cut_and_paste": {
            "psnr_db": ours.psnr_db - pasted.psnr_db,
            "ssim": ours.ssim - pasted.ssim,
        },
        "each": [asdict(score) for score in report.each],
        # every third press is held out: positions next to fitted ones
        "rotations": cross_validate(presses, [different[n::ROTATIONS] for n in range(ROTATIONS)]),
        # a third of the path over the gel is held out: positions far from fitted ones
        "blocks": cross_validate(
            presses, [part.tolist() for part in np.array_split(different, ROTATIONS)]
        ),
    }


if __name__ == "__main__":
    main(BENCHMARK)
