"""Scores of a calibration on presses that the fit did not use, with reference rows."""

from dataclasses import dataclass

import numpy as np
from skimage.metrics import structural_similarity

from t2twin.sim.digit.calibrate.frames import CROP_PX, crop

SAME_PLACE_MM = 0.05
"""Places and depths nearer than this make two frames repeats of one press, mm: a pixel."""


@dataclass(frozen=True)
class Score:
    """l1: mean absolute difference, grey levels. psnr_db: peak signal-to-noise ratio."""

    l1: float
    ssim: float
    psnr_db: float


@dataclass(frozen=True)
class CalibrationScores:
    """Mean scores against the held-out frames, on their contact crops.

    calibrated: of the simulated frames. cut_and_paste: of the training presses' mean change, moved
    to the held-out places. do_nothing: of the untouched background. repeats_floor: of two real
    frames of one press, untouched_floor: of two away from their contacts; None where there are no
    two.
    """

    calibrated: Score
    cut_and_paste: Score
    do_nothing: Score
    repeats_floor: Score | None
    untouched_floor: Score | None


def score(wanted: np.ndarray, given: np.ndarray) -> Score:
    """Of two uint8 pictures of one shape (rows, columns, 3)."""
    difference = wanted.astype(float) - given
    error = max(float(np.mean(difference**2)), 1e-12)
    return Score(
        l1=float(np.abs(difference).mean()),
        ssim=float(np.mean(structural_similarity(wanted, given, channel_axis=2, data_range=255))),
        psnr_db=float(10.0 * np.log10(255.0**2 / error)),
    )


def mean_score(scores: list[Score]) -> Score:
    """Each figure's mean."""
    return Score(
        l1=float(np.mean([score.l1 for score in scores])),
        ssim=float(np.mean([score.ssim for score in scores])),
        psnr_db=float(np.mean([score.psnr_db for score in scores])),
    )


def crop_scores(wanted: np.ndarray, given: np.ndarray, places: np.ndarray) -> list[Score]:
    """Scores of frames (n, ...) on the contact crop around their places (n, 2), row, column."""
    return [
        score(crop(a, place), crop(b, place))
        for a, b, place in zip(wanted, given, places, strict=True)
    ]


def cut_and_paste(
    background: np.ndarray, training: np.ndarray, from_px: np.ndarray, to_px: np.ndarray
) -> np.ndarray:
    """(m, ...) uint8: the mean change of the training presses, moved to other places.

    from_px, to_px: (n, 2), (m, 2) rows and columns of the presses. Moves are whole pixels.
    """
    rows, columns = background.shape[:2]
    wide = np.zeros((3 * rows, 3 * columns, 3))
    seen = np.zeros((3 * rows, 3 * columns, 1))
    for frame, (row, column) in zip(training, np.rint(from_px).astype(int), strict=True):
        top, left = rows + rows // 2 - row, columns + columns // 2 - column
        wide[top : top + rows, left : left + columns] += frame.astype(float) - background
        seen[top : top + rows, left : left + columns] += 1.0
    mean = wide / np.maximum(seen, 1.0)
    pasted = []
    for row, column in np.rint(to_px).astype(int):
        top, left = rows + rows // 2 - row, columns + columns // 2 - column
        pasted.append(background + mean[top : top + rows, left : left + columns])
    return np.clip(np.rint(pasted), 0, 255).astype(np.uint8)


def repeats_floor(frames: np.ndarray, poses: np.ndarray, places: np.ndarray) -> Score | None:
    """Two frames of one press against each other, on the contact crop; None if there are none."""
    scores = [
        score(crop(frames[i], places[i]), crop(frames[j], places[i]))
        for i in range(len(frames))
        for j in range(i)
        if np.abs(poses[i] - poses[j]).max() < SAME_PLACE_MM
    ]
    return mean_score(scores) if scores else None


def untouched_floor(frames: np.ndarray, places: np.ndarray) -> Score | None:
    """Neighbouring frames against each other, on the crop farthest from both contacts."""
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
