"""Calibrating the DIGIT's optics to a user's own sensor: fit on some presses, scored on others."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from t2twin.core import arguments
from t2twin.core.errors import T2TwinError
from t2twin.sim.digit.calibrate.frames import clean_background, read_frames, touched_patch
from t2twin.sim.digit.calibrate.measurements import FORCES, Measurements, Tolerance, read_known
from t2twin.sim.digit.calibrate.noise import measured_noise
from t2twin.sim.digit.calibrate.scale import Presses, fitted
from t2twin.sim.digit.calibrate.scores import (
    CalibrationScores,
    Score,
    crop_scores,
    cut_and_paste,
    mean_score,
    repeats_floor,
    untouched_floor,
)
from t2twin.sim.digit.calibrate.uncertainty import (
    CalibrationUncertainty,
    certainty_of,
    check_tolerance,
)
from t2twin.sim.digit.calibration import Calibration
from t2twin.sim.digit.camera.pinhole import Camera
from t2twin.sim.digit.optics import DigitOptics

MIN_TRAINING = 6
"""Fewest presses that a fit takes: each LED's light needs several places to vary over."""
HELD_OUT_SHARE = 3
"""One in so many presses, the last ones, is held out unless the user says how many."""
DEFAULT_TOLERANCE = Tolerance()


@dataclass(frozen=True)
class CalibrationReport:
    """A fitted calibration and how good it is. Arrays are over the held-out presses, but for
    training_poses.

    calibration: fitted to all presses, with the noise of their frames. scored_by: fitted without
    the held-out ones, which simulated and the scores are of.
    trained, held_out: names of the frames that were fitted to and scored on. repeated: of those
    that were left out as copies. training_poses, poses: (n, 3) x_mm, y_mm, depth_mm, each seen in
    its own frame. surfaces_mm: (n, grid) the deflections that the poses stand for, on
    optical_grid(). real, simulated: (n, ROWS, COLUMNS, 3) uint8. scores: means. each: the
    calibration's score press by press. certainty: how sure the presses' depths and forces are.
    """

    calibration: Calibration
    scored_by: Calibration
    trained: list[str]
    training_poses: np.ndarray
    held_out: list[str]
    repeated: list[str]
    poses: np.ndarray
    surfaces_mm: np.ndarray
    real: np.ndarray
    simulated: np.ndarray
    scores: CalibrationScores
    each: list[Score]
    certainty: CalibrationUncertainty | None


@dataclass(frozen=True)
class Inputs:
    """What a calibration is fitted to, checked.

    untouched: (ROWS, COLUMNS, 3) uint8, the background. frames: (n, ROWS, COLUMNS, 3) uint8, the
    presses, and names, their files'. known: what else is known of each. patches: (n, 2) row and
    column of each contact, px. train, test: indices of the presses to fit to and of those held out.
    """

    untouched: np.ndarray
    frames: np.ndarray
    names: list[str]
    known: Measurements
    patches: np.ndarray
    train: list[int]
    test: list[int]


@dataclass(frozen=True)
class _Placed:
    """Frames (n, ROWS, COLUMNS, 3) uint8, where they are touched (n, 2) rows and columns, px, and
    their poses (n, 3)."""

    frames: np.ndarray
    patches: np.ndarray
    poses: np.ndarray


def read_inputs(
    background: Path,
    presses: Path,
    ball_diameter_mm: float,
    held_out: int | None,
    camera: Camera,
    tolerance: Tolerance | None,
) -> Inputs:
    """Reads all that a calibration is fitted to; see `calibrate`.

    Raises T2TwinError for frames or numbers that cannot be used.
    """
    untouched, frames, names = read_frames(background, presses)
    known = read_known(presses, names, ball_diameter_mm)
    if tolerance is not None:
        check_tolerance(known, camera, tolerance)
    first_held_out = _first_held_out(len(frames), held_out, presses)
    patches = _patches(frames, untouched, names)
    train, test = _different(frames, first_held_out, presses)
    if known.has_depths and not known.of(train).has_depths:
        raise T2TwinError(
            f"{presses / FORCES} gives displacements of presses that are held out only; give some "
            "of earlier ones"
        )
    return Inputs(untouched, frames, names, known, patches, train, test)


def calibrate(
    background: str | Path,
    presses: str | Path,
    ball_diameter_mm: float,
    held_out: int | None = None,
    camera: Camera | None = None,
    say: Callable[[str], object] = lambda line: None,
    tolerance: Tolerance | None = DEFAULT_TOLERANCE,
) -> CalibrationReport:
    """Fit to the presses, in the order of their names, but for the last held_out of them.

    background: a frame of the untouched sensor. presses: a folder of frames of a ball pressed
    in, 240 wide, 320 high, PNG or JPEG, and, if some of it is known, `forces.csv` (see
    t2twin.sim.digit.calibrate.measurements). camera: its scale and distance; known displacements
    settle the scale, those of the fitted presses for the scores. say: told how far it is.
    tolerance: of what is stated; None leaves the ranges that follow from it out, which take most of
    the time, and with them the gel's modulus.
    Frames that are equal to an earlier one, byte for byte, are left out. The held-out presses
    have no part in anything that is scored but their own poses; then a last fit takes them all.
    Raises T2TwinError for frames or numbers that cannot be used, and for a fit that explains
    nothing.
    """
    background, presses = (
        arguments.path(background, "background"),
        arguments.path(presses, "presses"),
    )
    camera = Camera() if camera is None else arguments.instance(camera, "camera", Camera)
    if held_out is not None:
        arguments.whole_number(held_out, "held_out")
    if tolerance is not None:
        arguments.instance(tolerance, "tolerance", Tolerance)
    arguments.function(say, "say")
    given = read_inputs(background, presses, ball_diameter_mm, held_out, camera, tolerance)
    untouched, frames, names, patches = given.untouched, given.frames, given.names, given.patches
    train, test = given.train, given.test

    def chosen(presses: list[int], clean: np.ndarray) -> Presses:
        return Presses(clean, frames[presses], patches[presses], given.known.of(presses))

    say(f"fitting to {len(train)} presses")
    clean = clean_background(untouched, frames[train])
    fit = fitted(chosen(train, clean), camera)
    unseen = chosen(test, clean).model(fit.model.camera)
    poses = np.array([unseen.pose(fit.state, index) for index in range(len(test))])
    scored_by = fit.model.calibration(fit.state)
    optics = DigitOptics(scored_by)
    surfaces_mm = np.array(
        [unseen.surface(fit.state, index, pose) for index, pose in enumerate(poses)]
    )
    simulated = np.array([optics.render(surface_mm) for surface_mm in surfaces_mm])
    trained = _Placed(frames[train], patches[train], fit.state.poses)
    scored = _Placed(frames[test], patches[test], poses)
    scores = _scores(untouched, trained, scored, simulated, fit.model.camera)
    _check_explains(scores)
    everything = [*train, *test]
    say(f"fitting once more, to all {len(everything)}")
    clean = clean_background(untouched, frames[everything])
    all_presses = chosen(everything, clean)
    last = fitted(all_presses, fit.model.camera, fit.state)
    all_names = [names[i] for i in everything]
    certainty = (
        None if tolerance is None else certainty_of(all_presses, all_names, last, tolerance, say)
    )
    young = None if certainty is None else certainty.young_mpa
    calibration = replace(
        last.model.calibration(last.state),
        noise=measured_noise(clean, frames[everything], untouched),
        young_mpa=None if young is None else young.at,
    )
    return CalibrationReport(
        calibration=calibration,
        scored_by=scored_by,
        trained=[names[i] for i in train],
        training_poses=fit.state.poses,
        held_out=[names[i] for i in test],
        repeated=[name for i, name in enumerate(names) if i not in (*train, *test)],
        poses=poses,
        surfaces_mm=surfaces_mm,
        real=scored.frames,
        simulated=simulated,
        scores=scores,
        each=crop_scores(scored.frames, simulated, scored.patches),
        certainty=certainty,
    )


def _check_explains(scores: CalibrationScores) -> None:
    """A fit to frames that show no ball is worth nothing, however it came out."""
    fitted, still = scores.calibrated.psnr_db, scores.do_nothing.psnr_db
    if fitted <= still:
        raise T2TwinError(
            f"the fit explains nothing of the held-out presses: they are {fitted:.1f} dB from it "
            f"and {still:.1f} dB from the untouched background; frames of one ball, pressed into "
            "this very sensor, are needed"
        )


def _first_held_out(frames: int, held_out: int | None, presses: Path) -> int:
    """Index of the first frame that is held out. Raises T2TwinError where too few are left."""
    count = frames // HELD_OUT_SHARE if held_out is None else held_out
    if count < 1 or frames - count < MIN_TRAINING:
        raise T2TwinError(
            f"{presses} holds {frames} presses and {count} of them are held out; at least "
            f"{MIN_TRAINING} must be left to fit to, and at least 1 held out"
        )
    return frames - count


def _different(
    frames: np.ndarray, first_held_out: int, presses: Path
) -> tuple[list[int], list[int]]:
    """Indices of the frames to fit to and of those held out, each frame's copies left out.

    Raises T2TwinError where too few are left.
    """
    first: dict[bytes, int] = {}
    for index, frame in enumerate(frames):
        first.setdefault(frame.tobytes(), index)
    train = [i for i in first.values() if i < first_held_out]
    test = [i for i in first.values() if i >= first_held_out]
    if len(train) < MIN_TRAINING or not test:
        raise T2TwinError(
            f"{len(frames) - len(first)} presses of {presses} are copies of others; at least "
            f"{MIN_TRAINING} different ones must be left to fit to, and at least 1 held out"
        )
    return train, test


def _patches(frames: np.ndarray, background: np.ndarray, names: list[str]) -> np.ndarray:
    """(n, 2) where each frame is touched. Raises T2TwinError naming those that are not."""
    patches = [touched_patch(frame, background) for frame in frames]
    empty = [name for name, patch in zip(names, patches, strict=True) if patch is None]
    if empty:
        raise T2TwinError(
            f"no contact is visible in {', '.join(empty)}: nothing there differs from the "
            "background; take such frames out"
        )
    return np.array(patches)


def _scores(
    untouched: np.ndarray,
    trained: _Placed,
    held_out: _Placed,
    simulated: np.ndarray,
    camera: Camera,
) -> CalibrationScores:
    """Of the simulated held-out frames, and the rows that judge them."""
    real, places = held_out.frames, held_out.patches
    pasted = cut_and_paste(
        untouched, trained.frames, _pixels(trained.poses, camera), _pixels(held_out.poses, camera)
    )
    still = np.broadcast_to(untouched, real.shape)
    return CalibrationScores(
        calibrated=mean_score(crop_scores(real, simulated, places)),
        cut_and_paste=mean_score(crop_scores(real, pasted, places)),
        do_nothing=mean_score(crop_scores(real, still, places)),
        repeats_floor=repeats_floor(
            np.concatenate([trained.frames, real]),
            np.concatenate([trained.poses, held_out.poses]),
            np.concatenate([trained.patches, places]),
        ),
        untouched_floor=untouched_floor(real, places),
    )


def _pixels(poses: np.ndarray, camera: Camera) -> np.ndarray:
    """(n, 2) rows and columns, px, of poses (n, 3)."""
    rows, columns = camera.project(poses[:, 0], poses[:, 1], np.zeros(len(poses)))
    return np.stack([rows, columns], axis=1)
