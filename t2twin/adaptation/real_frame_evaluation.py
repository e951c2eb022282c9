"""What a translator makes of real frames, beside what the twin says that a CySkin feels.

Nobody has measured a CySkin under these very presses: the truth is the twin's own, at the place and
depth that the calibration found in each frame.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import cast

import numpy as np
from skimage.measure import label

from t2twin.primitives_cad.shape import Shape
from t2twin.sim.contact.depth import force_at_depth
from t2twin.sim.contact.types import PressCommand
from t2twin.sim.cyskin.phi import Phi
from t2twin.sim.sensors import SensorPair
from t2twin.translate.evaluation.metrics.reliability import REPORTED_LEVEL
from t2twin.translate.inference.field_predictor import FieldPredictor
from t2twin.translate.inference.predictor import CountsPredictor

BLOB_SHARE = 0.2
"""Part of its largest count above which a tactile image counts as touched (assumed)."""
FAINT_COUNTS = 400.0
"""Counts below which nothing is felt: a hundredth of full scale."""


@dataclass(frozen=True)
class Felt:
    """A real frame and its twin.

    pose: x_mm, y_mm, depth_mm, as found in the frame. force_n: the twin's for that depth. frame,
    simulated: (320, 240, 3) uint8, the real picture and the twin's with one frame's noise. counts:
    (N,) the twin's CySkin.
    """

    name: str
    pose: tuple[float, float, float]
    force_n: float
    frame: np.ndarray
    simulated: np.ndarray
    counts: np.ndarray


@dataclass(frozen=True)
class Judgement:
    """A translator on one picture, against the twin's CySkin.

    rmse_percent: of full scale. centroid_mm: between both middles of what is felt. blobs: places
    that are felt apart from each other. force_part: the force it says over the twin's, less one;
    of a run that says none, all its counts over all of the truth's, as the twin's go with the
    force. held: share of the taxels whose interval of 90 % holds the truth, None of a run that says
    none.
    """

    counts: np.ndarray
    rmse_percent: float
    centroid_mm: float
    blobs: int
    force_part: float
    held: float | None = None


@dataclass(frozen=True)
class Judged:
    """A press, and a translator on both of its pictures."""

    felt: Felt
    real: Judgement
    simulated: Judgement


def simulate_reference(
    names: Sequence[str],
    poses: np.ndarray,
    frames: np.ndarray,
    balls: Sequence[Shape],
    sensors: SensorPair,
    seed: int = 0,
) -> list[Felt]:
    """The twin's press of each frame. poses: (n, 3) x_mm, y_mm, depth_mm. frames: (n, 320, 240, 3).
    balls: what is pressed in each.

    Raises T2TwinError for a depth that no force gives.
    """
    return [
        _felt(name, pose, frame, ball, sensors, np.random.default_rng((seed, number)))
        for number, (name, pose, frame, ball) in enumerate(
            zip(names, poses, frames, balls, strict=True)
        )
    ]


def _felt(
    name: str,
    pose: np.ndarray,
    frame: np.ndarray,
    ball: Shape,
    sensors: SensorPair,
    rng: np.random.Generator,
) -> Felt:
    x_mm, y_mm, depth_mm = (float(value) for value in pose)
    command = PressCommand(ball.name, x_mm, y_mm, 0.0, 1.0)
    force_n = force_at_depth(lambda at: sensors.digit.press(ball, at), command, depth_mm)
    command = PressCommand(ball.name, x_mm, y_mm, 0.0, force_n)
    sample = sensors.press(ball, command)
    noisy = sensors.digit.image(sample.digit, rng)
    return Felt(name, (x_mm, y_mm, depth_mm), force_n, frame, noisy, sample.counts.astype(float))


def judge_each(run: CountsPredictor, felt: Sequence[Felt], untouched: np.ndarray) -> list[Judged]:
    """A translator on the real and the simulated picture of every press. untouched: (320, 240, 3)
    uint8, the unit's own frame, which a field run looks at."""
    return [
        Judged(
            one,
            judge(run, one.frame, one.counts, one.force_n, untouched),
            judge(run, one.simulated, one.counts, one.force_n, untouched),
        )
        for one in felt
    ]


def judge(
    run: CountsPredictor,
    image: np.ndarray,
    truth: np.ndarray,
    force_n: float,
    untouched: np.ndarray,
) -> Judgement:
    """A translator on a picture, (320, 240, 3) uint8. truth: (N,) counts, of the run's layout.
    force_n: the truth's. untouched: as for `judge_each`."""
    layout = run.config.data
    counts, said_n, held = _said(run, image, truth, untouched)
    places = np.stack([layout.x_mm, layout.y_mm], axis=1)
    rmse = float(np.sqrt(np.mean((counts - truth) ** 2)))
    return Judgement(
        counts=counts,
        rmse_percent=100.0 * rmse / layout.full_scale_counts,
        centroid_mm=float(np.linalg.norm(_middle(counts, places) - _middle(truth, places))),
        blobs=_blobs(Phi(layout.x_mm, layout.y_mm)(counts)),
        force_part=float(counts.sum() / truth.sum() if said_n is None else said_n / force_n) - 1.0,
        held=held,
    )


def counts_of(run: CountsPredictor, image: np.ndarray, untouched: np.ndarray) -> np.ndarray:
    """(N,) of a picture, the unit's untouched frame beside it where the run looks at one."""
    own = untouched if isinstance(run, FieldPredictor) else None
    return np.asarray(run.predict(image, own), dtype=float)


def _said(
    run: CountsPredictor, image: np.ndarray, truth: np.ndarray, untouched: np.ndarray
) -> tuple[np.ndarray, float | None, float | None]:
    """Counts, force in newtons, and the share of the truth that its intervals hold."""
    if not isinstance(run, FieldPredictor):
        return counts_of(run, image, untouched), None, None
    told = run.estimate(image, untouched)
    low, high = told.interval(REPORTED_LEVEL)
    held = float(((low <= truth) & (truth <= high)).mean())
    force_n = None if told.force_n is None else float(told.force_n)
    return told.counts.astype(float), force_n, held


def _middle(counts: np.ndarray, places: np.ndarray) -> np.ndarray:
    """(2,) where an array is touched, mm: the mean place, by what is felt; its middle of none."""
    weight = np.where(counts > FAINT_COUNTS, counts, 0.0)
    return weight @ places / weight.sum() if weight.any() else places.mean(axis=0)


def _blobs(image: np.ndarray) -> int:
    """Places of a tactile image (R, C) that are felt apart."""
    most = float(image.max())
    touched = image > max(BLOB_SHARE * most, FAINT_COUNTS)
    return int(cast(np.ndarray, label(touched)).max())
