"""Calibrating the DIGIT's optics to a user's own sensor: fit on some presses, scored on others."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from t2twin.primitives_cad.errors import T2TwinError
from t2twin.sim.digit.calibrate.fit import BallFit
from t2twin.sim.digit.calibrate.frames import clean_background, read_frames, touched_patch
from t2twin.sim.digit.calibrate.scores import (
    Place,
    Score,
    crop_scores,
    cut_and_paste,
    mean_score,
    repeats_floor,
    untouched_floor,
)
from t2twin.sim.digit.calibration import Calibration
from t2twin.sim.digit.camera import Camera
from t2twin.sim.digit.optics import DigitOptics

LEAST_TRAINING = 6
"""Fewest presses that a fit takes: each LED's light needs several places to vary over."""
HELD_OUT_SHARE = 3
"""One in so many presses, the last ones, is held out unless the user says how many."""
BALL_MM = (1.0, 12.0)
"""Diameters of balls that press a DIGIT's gel and fit its picture, mm."""


@dataclass(frozen=True)
class Report:
    """What came out. Arrays are over the held-out presses.

    poses: (n, 3) x_mm, y_mm, depth_mm, each found from its own frame. real, simulated:
    (n, ROWS, COLUMNS, 3) uint8. rows: mean scores by name. each: the model's, press by press.
    """

    calibration: Calibration
    trained: list[str]
    training_poses: np.ndarray
    held_out: list[str]
    repeated: list[str]
    poses: np.ndarray
    real: np.ndarray
    simulated: np.ndarray
    rows: dict[str, Score]
    each: list[Score]


def calibrate(
    background: Path,
    presses: Path,
    ball_diameter_mm: float,
    held_out: int | None = None,
    camera: Camera | None = None,
    say: Callable[[str], object] = lambda line: None,
) -> Report:
    """Fit to the presses, in the order of their names, but for the last held_out of them.

    Frames that are equal to an earlier one, byte for byte, are left out. The held-out presses
    have no part in anything but their own poses and the scores.
    Raises T2TwinError for frames or numbers that cannot be used.
    """
    if not BALL_MM[0] <= ball_diameter_mm <= BALL_MM[1]:
        raise T2TwinError(
            f"the ball's diameter is {ball_diameter_mm:g} mm; it must lie between "
            f"{BALL_MM[0]:g} and {BALL_MM[1]:g}"
        )
    untouched, frames, names = read_frames(background, presses)
    count = len(frames) // HELD_OUT_SHARE if held_out is None else held_out
    if count < 1 or len(frames) - count < LEAST_TRAINING:
        raise T2TwinError(
            f"{presses} holds {len(frames)} presses and {count} of them are held out; at least "
            f"{LEAST_TRAINING} must be left to fit to, and at least 1 held out"
        )
    patches = _patches(frames, untouched, names)
    split = len(frames) - count
    first = _first_of_each(frames)
    train = [i for i in first if i < split]
    test = [i for i in first if i >= split]
    repeated = [name for i, name in enumerate(names) if i not in first]
    if len(train) < LEAST_TRAINING or not test:
        raise T2TwinError(
            f"{len(repeated)} presses of {presses} are copies of others; at least "
            f"{LEAST_TRAINING} different ones must be left to fit to, and at least 1 held out"
        )
    camera = camera or Camera()
    say(f"fitting to {len(train)} presses")
    clean = clean_background(untouched, frames[train])
    fitting = BallFit(clean, frames[train], patches[train], ball_diameter_mm / 2, camera)
    state = fitting.fit()
    calibration = fitting.calibration(state)

    unseen = BallFit(clean, frames[test], patches[test], ball_diameter_mm / 2, camera)
    poses = np.array([unseen.pose(state, index) for index in range(len(test))])
    optics = DigitOptics(calibration)
    simulated = np.array([optics.render(unseen.surface(state, pose)) for pose in poses])
    real = frames[test]
    places: list[Place] = [(float(row), float(column)) for row, column in patches[test]]
    each = crop_scores(real, simulated, places)
    still = np.broadcast_to(untouched, real.shape)
    pasted = cut_and_paste(
        untouched, frames[train], _pixels(state.poses, camera), _pixels(poses, camera)
    )
    rows = {
        "calibrated": mean_score(each),
        "cut and paste": mean_score(crop_scores(real, pasted, places)),
        "do nothing": mean_score(crop_scores(real, still, places)),
    }
    training_places: list[Place] = [(float(r), float(c)) for r, c in patches[train]]
    for name, floor in (
        ("noise floor: one press, two frames",
         repeats_floor(np.concatenate([frames[train], real]), np.concatenate([state.poses, poses]),
                       training_places + places)),
        ("noise floor: two frames, away", untouched_floor(real, places)),
    ):  # fmt: skip
        if floor is not None:
            rows[name] = floor
    return Report(
        calibration=calibration,
        trained=[names[i] for i in train],
        training_poses=state.poses,
        held_out=[names[i] for i in test],
        repeated=repeated,
        poses=poses,
        real=real,
        simulated=simulated,
        rows=rows,
        each=each,
    )


def _patches(frames: np.ndarray, background: np.ndarray, names: list[str]) -> np.ndarray:
    """(n, 2) where each frame is touched. Raises T2TwinError naming those that are not."""
    found = [touched_patch(frame, background) for frame in frames]
    empty = [name for name, patch in zip(names, found, strict=True) if patch is None]
    if empty:
        raise T2TwinError(
            f"no contact is visible in {', '.join(empty)}: nothing there differs from the "
            "background; take such frames out"
        )
    return np.array(found)


def _first_of_each(frames: np.ndarray) -> list[int]:
    """Indices of the frames, without those that repeat an earlier one byte for byte."""
    first: dict[bytes, int] = {}
    for index, frame in enumerate(frames):
        first.setdefault(frame.tobytes(), index)
    return sorted(first.values())


def _pixels(poses: np.ndarray, camera: Camera) -> np.ndarray:
    rows, columns = camera.project(poses[:, 0], poses[:, 1], np.zeros(len(poses)))
    return np.stack([rows, columns], axis=1)
