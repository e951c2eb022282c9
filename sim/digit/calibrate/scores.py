"""Scores of a calibration on held-out presses, with baselines."""

from dataclasses import dataclass

import numpy as np
from skimage.metrics import structural_similarity

from t2twin.sim.digit.calibrate.frames import crop


@dataclass(frozen=True)
class Score:
    """l1: mean absolute difference, grey levels. psnr_db: peak signal-to-noise ratio."""

    l1: float
    ssim: float
    psnr_db: float


@dataclass(frozen=True)
class CalibrationScores:
    """Mean scores on the contact crops of the held-out frames.

    calibrated: of the simulated frames. cut_and_paste: of the training presses' mean change, moved
    to the held-out positions. do_nothing: of the background frame.
    """

    calibrated: Score
    cut_and_paste: Score
    do_nothing: Score


def score(real: np.ndarray, other: np.ndarray) -> Score:
    """The score of two uint8 images of one shape (rows, columns, 3)."""
    difference = real.astype(float) - other
    error = max(float(np.mean(difference**2)), 1e-12)
    return Score(
        l1=float(np.abs(difference).mean()),
        ssim=float(np.mean(structural_similarity(real, other, channel_axis=2, data_range=255))),
        psnr_db=float(10.0 * np.log10(255.0**2 / error)),
    )


def mean_score(scores: list[Score]) -> Score:
    """The mean of each metric."""
    return Score(
        l1=float(np.mean([score.l1 for score in scores])),
        ssim=float(np.mean([score.ssim for score in scores])),
        psnr_db=float(np.mean([score.psnr_db for score in scores])),
    )


def crop_scores(real: np.ndarray, other: np.ndarray, places: np.ndarray) -> list[Score]:
    """Scores of frames (n, ...) on the crops around places (n, 2), row and column."""
    return [
        score(crop(a, place), crop(b, place))
        for a, b, place in zip(real, other, places, strict=True)
    ]


def cut_and_paste(
    background: np.ndarray, training: np.ndarray, from_px: np.ndarray, to_px: np.ndarray
) -> np.ndarray:
    """(m, ...) uint8: the background with the training presses' mean change, moved to other places.

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
