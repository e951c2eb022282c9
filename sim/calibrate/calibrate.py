"""Calibrates a gel camera's optics to a user's unit: fits some presses, scores on others.

From a background frame alone, an optics file is the mean light of sampled units. The frame does not
determine how LEDs shade a press, which the mean of units predicts better than any one.

Frames alone hardly determine the scale: the same ball pressed deeper at a smaller scale gives the
same image. Measured depths determine it: at a given contact width in pixels, a ball's depth is
inversely proportional to its square. For bounds, all presses are fitted twice more, with all inputs
at the end of their tolerances where presses come out deepest, or shallowest.
"""

from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import asdict, dataclass, fields, replace
from functools import partial
from itertools import compress
from os.path import lexists
from pathlib import Path
from typing import Annotated, Any, cast

import numpy as np
from msgspec import Meta, structs

from t2twin.core import arguments
from t2twin.core.errors import T2TwinError, counted, warn
from t2twin.core.files import atomic_write, write_json
from t2twin.core.frame_order import UPRIGHT, FrameOrder
from t2twin.core.images import is_colored
from t2twin.core.records import FORMAT
from t2twin.core.tables import Table
from t2twin.primitives_cad.shape import ball
from t2twin.sim.calibrate import frames as images
from t2twin.sim.calibrate.fit import GAMMA, BallFit, Presses, State, is_at_limit, too_small
from t2twin.sim.contact.contact_solver import force_at_depth, solve_contact
from t2twin.sim.contact.elastomer import Elastomer
from t2twin.sim.contact.types import FORCE_RANGE_N, PressCommand
from t2twin.sim.optical.camera import Camera
from t2twin.sim.optical.gel_camera import GelCamera
from t2twin.sim.optical.image_renderer import ImageRenderer
from t2twin.sim.optical.optics import Optics
from t2twin.sim.optical.spec import KIND
from t2twin.sim.optical.units import UnitRanges, sample_unit
from t2twin.sim.sensors.defaults import SOURCE
from t2twin.sim.sensors.files import load_sensor
from t2twin.sim.tables import read_rows

MIN_TRAINING = 6  # smallest number of places to fit to: each LED's light varies over the gel
HELD_OUT_SHARE = 3  # by default one in so many places is held out, the last ones
WIDEST = 2.0  # largest visible width of a contact, in diameters (measured: 1.8 at the equator)
UNIT_COUNT = 300  # averaged units (assumed: twice as many change the mean by little)
# Ranges of the units: only responses of one gamma, that of a fit, can be averaged.
RANGES = UnitRanges(linear_amount=1.0, linear_gamma=(GAMMA, GAMMA))
OPTICS, RECORD, COVERAGE = "optics.npz", "optics.json", "optics_coverage.png"  # files of a fit
FORCES = "forces.csv"  # measurements in the folder of the frames: see _Row; cells may be empty
MARKED = (
    "the frames show printed markers, which are filled in before the fit: optics and scores are "
    "those of a gel without markers, and the noise is up to a fifth too low"
)
NOISELESS = "the noise was not measured: no frame shows enough of the gel without contact"
SMALLEST_BALL_MM = 1.0  # smallest diameter of a ball, mm (assumed); the largest fits into the image
SCALES = (0.5, 2.0)  # range of scales, in parts of the sensor's (assumed)
# Default tolerances of scale, if a file has no range of it, and modulus, in parts of the file's
SCALE_SHARE, YOUNG_SHARE = 0.1, 0.2  # values (assumed; of Gent's range, Shore 10A to 15A)
DEPTH_RATIO_TOLERANCE = 2e-3  # of the ratio of fitted to measured depths (assumed)
MAX_FITS = 6  # fits, each at the scale that follows from the last one; three are common
SHALLOWEST_SIGN, DEEPEST_SIGN = 1.0, -1.0  # of errors of ball and scale that give such depths


@dataclass(frozen=True)
class Tolerance:
    """Largest errors, in either direction; the defaults are assumed: a caliper for the ball, a
    stage zeroed by eye, and a kitchen scale. Raises T2TwinError for a negative value."""

    ball_mm: float = 0.1  # of the ball diameters
    # of the scale, without measured displacements; by default the file's range, or SCALE_SHARE
    scale_px_per_mm: float | None = None
    depth_mm: float = 0.03  # of the displacements, mainly of their zero at first contact
    force_n: float = 0.05
    # of the modulus in the sensor's file, without measured forces; by default YOUNG_SHARE
    young_mpa: float | None = None

    def __post_init__(self) -> None:
        for name, value in vars(self).items():
            if value is not None:
                arguments.number(value, f"the tolerance {name}", low=0.0)

    def of(self, sensor: GelCamera) -> "Tolerance":
        """The same, complete, for a sensor."""
        scale, units = sensor.camera.scale_px_per_mm, sensor.spec.units
        low, high = ((1 - SCALE_SHARE) * scale, (1 + SCALE_SHARE) * scale)
        if units is not None:
            low, high = units.scale_px_per_mm
        defaults = {
            "scale_px_per_mm": max(scale - low, high - scale),
            "young_mpa": YOUNG_SHARE * sensor.own_gel.young_mpa,
        }
        given = {name: value for name, value in vars(self).items() if value is not None}
        return replace(self, **(defaults | given))


@dataclass(frozen=True)
class _Row:
    """One press of the file."""

    file: str
    force_n: Annotated[float, Meta(ge=FORCE_RANGE_N[0], le=FORCE_RANGE_N[1])] | None = None
    depth_mm: Annotated[float, Meta(gt=0.0)] | None = None
    ball_diameter_mm: float | None = None


def read_measurements(
    folder: Path, names: Sequence[str], ball_diameter_mm: float, sensor: GelCamera
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Diameters, depths and forces of the named frames of a folder, as in `Presses`. The folder's
    FORCES may be missing; ball_diameter_mm is of presses without a diameter in it."""
    check_ball(ball_diameter_mm, "the ball's diameter in mm", sensor)
    path, rows = folder / FORCES, {}
    thickness_mm = sensor.own_gel.thickness_mm
    for other in () if lexists(path) else folder.iterdir():
        if other.suffix.lower() in (".csv", ".tsv", ".xlsx"):
            warn(f"{other} is not read; the table of measurements must be named {FORCES}")
    for row in read_rows(path, _Row) if lexists(path) else ():  # a broken link is an error
        if row.file not in names:
            raise T2TwinError(f"{path} names {row.file}, which is not a frame in {folder}")
        if row.file in rows:
            raise T2TwinError(f"{path} names {row.file} twice; each frame has one row")
        rows[row.file] = row
        if row.ball_diameter_mm is not None:
            check_ball(row.ball_diameter_mm, f"{path}: ball_diameter_mm of {row.file}", sensor)
        if row.depth_mm is not None and row.depth_mm > thickness_mm:
            raise T2TwinError(
                f"{path}: depth_mm of {row.file} is {row.depth_mm:g}; it must be at most "
                f"{thickness_mm:g}, the gel's thickness"
            )
    if lexists(path) and all(row == _Row(row.file) for row in rows.values()):
        raise T2TwinError(
            f"{path} has no measurement; expected force_n, depth_mm or ball_diameter_mm of a "
            "frame, or no such file"
        )
    found = [rows.get(name, _Row(name)) for name in names]
    diameters = [row.ball_diameter_mm or ball_diameter_mm for row in found]
    return (
        np.array(diameters, float),
        np.array([row.depth_mm for row in found], float),
        np.array([row.force_n for row in found], float),
    )


def check_ball(diameter_mm: float, name: str, sensor: GelCamera) -> None:
    """Raises T2TwinError for a diameter that is below SMALLEST_BALL_MM or wider than the image."""
    largest_mm = 2.0 * min(sensor.camera.seen_half_extent_mm())
    arguments.number(diameter_mm, name, SMALLEST_BALL_MM, max(largest_mm, SMALLEST_BALL_MM))


def fit_presses(presses: Presses, camera: Camera, start: State | None = None) -> State:
    """The fit at the camera's scale, or at that of displacements; it starts from another's LEDs."""
    fit = BallFit(presses, camera).fit(start)
    if not presses.has_depths:
        return fit
    low, high = (share * presses.sensor.camera.scale_px_per_mm for share in SCALES)
    is_measured, scale = np.isfinite(presses.depths_mm), camera.scale_px_per_mm
    measured_mm = presses.depths_mm[is_measured]
    for _ in range(MAX_FITS):
        # fitted over measured depths, by least squares
        fitted_mm = fit.poses[is_measured, 2]
        ratio = float(fitted_mm @ measured_mm / (measured_mm @ measured_mm))
        if abs(ratio - 1.0) < DEPTH_RATIO_TOLERANCE:
            return fit
        scale = camera.scale_px_per_mm * float(np.sqrt(ratio))
        if not low <= scale <= high:
            break
        camera = structs.replace(camera, scale_px_per_mm=scale)
        fit = BallFit(presses, camera).fit(fit)
    raise T2TwinError(
        f"the displacements do not fit the frames at any scale from {low:g} to {high:g} px/mm, "
        f"rather at {scale:.3g}; they must be in mm, from the ball's first contact"
    )


@dataclass(frozen=True)
class Bounds:
    """A value, and the bounds of the true one if all errors are within the tolerances."""

    value: float
    low: float
    high: float

    def __str__(self) -> str:
        return f"{self.value:.2f} ({self.low:.2f} to {self.high:.2f})"


@dataclass(frozen=True)
class PressBounds:
    """Bounds of one press, from the fit to all presses."""

    name: str
    ball_diameter_mm: float
    depth_mm: Bounds
    # the twin's at the depth, for the fitted modulus if any; None where no allowed force reaches it
    force_n: Bounds | None


@dataclass(frozen=True)
class OpticsUncertainty:
    """Bounds of all presses, the scale and the modulus."""

    tolerance: Tolerance  # complete
    presses: tuple[PressBounds, ...]
    scale_px_per_mm: Bounds  # of the given scale, or the fitted one if displacements are measured
    depth_measurements: int  # how many presses have one
    depth_residual_mm: float | None  # root mean square error of the fit on them
    own_young_mpa: float  # modulus in the sensor's file
    young_mpa: Bounds | None  # the gel's modulus, if forces are measured
    force_measurements: int
    force_residual_n: float | None


def estimate_uncertainty(
    presses: Presses, fit: State, tolerance: Tolerance, report: Callable[[str], object]
) -> OpticsUncertainty:
    """Bounds around a fit to all presses. tolerance: complete."""
    assert tolerance.young_mpa is not None
    own_mpa = presses.sensor.own_gel.young_mpa
    estimates = [_estimate(presses, fit, own_mpa)]
    for sign, word in ((DEEPEST_SIGN, "deepest"), (SHALLOWEST_SIGN, "shallowest")):
        report(f"fitting within the tolerances, {word}")
        moved, camera = shifted(presses, fit.camera, tolerance, sign)
        try:
            moved_fit = fit_presses(moved, camera, fit)
        except T2TwinError as error:
            raise T2TwinError(
                f"with all inputs at the end of their tolerances where presses are {word}, "
                f"{error}; or give smaller tolerances"
            ) from error
        estimates.append(_estimate(moved, moved_fit, own_mpa - sign * tolerance.young_mpa))
    depths_mm, forces_n, scales, moduli_mpa = zip(*estimates, strict=True)
    press_bounds = tuple(
        PressBounds(
            name, float(diameter), _bounds(depths),
            _bounds(forces) if np.isfinite(forces).all() else None,
        )
        for name, diameter, depths, forces in zip(
            presses.names, presses.diameters_mm, np.transpose(depths_mm),
            np.transpose(forces_n), strict=True,
        )
    )  # fmt: skip
    return OpticsUncertainty(
        tolerance=tolerance, presses=press_bounds, scale_px_per_mm=_bounds(scales),
        depth_measurements=int(np.isfinite(presses.depths_mm).sum()),
        depth_residual_mm=_residual(depths_mm[0], presses.depths_mm), own_young_mpa=own_mpa,
        young_mpa=_bounds(moduli_mpa) if np.isfinite(presses.forces_n).any() else None,
        force_measurements=int(np.isfinite(presses.forces_n).sum()),
        force_residual_n=_residual(forces_n[0], presses.forces_n),
    )  # fmt: skip


def shifted(
    presses: Presses, camera: Camera, tolerance: Tolerance, sign: float
) -> tuple[Presses, Camera]:
    """The presses and camera with every input at one end of its tolerance, which is complete."""
    assert tolerance.scale_px_per_mm is not None and tolerance.young_mpa is not None
    own_mpa = presses.sensor.own_gel.young_mpa
    moved = replace(
        presses, diameters_mm=presses.diameters_mm + sign * tolerance.ball_mm,
        depths_mm=np.maximum(presses.depths_mm - sign * tolerance.depth_mm, tolerance.depth_mm),
        forces_n=np.maximum(presses.forces_n + sign * tolerance.force_n, FORCE_RANGE_N[0]),
    )  # fmt: skip
    for diameter_mm in moved.diameters_mm.tolist():
        check_ball(diameter_mm, "the ball's diameter in mm, within its tolerance,", presses.sensor)
    if not presses.has_depths:
        scale = camera.scale_px_per_mm + sign * tolerance.scale_px_per_mm
        low, high = (share * presses.sensor.camera.scale_px_per_mm for share in SCALES)
        if not low <= scale <= high:
            found = f"the scale within its tolerance, {scale:g} px/mm,"
            raise T2TwinError(f"{found} is beyond {low:g} to {high:g} px/mm")
        camera = structs.replace(camera, scale_px_per_mm=scale)
    if not tolerance.young_mpa < own_mpa:
        raise T2TwinError(
            f"the tolerance of the modulus is {tolerance.young_mpa:g} MPa; it must be less than "
            f"the sensor's modulus, {own_mpa:g} MPa"
        )
    return moved, camera


def _estimate(
    presses: Presses, fit: State, young_mpa: float
) -> tuple[np.ndarray, np.ndarray, float, float]:
    """Depths and forces (n,), scale and modulus; young_mpa is used where no force is measured."""
    own_mpa = presses.sensor.own_gel.young_mpa
    forces_n = ball_forces_n(presses.sensor, fit.poses, presses.diameters_mm)
    if np.isfinite(presses.forces_n).any():
        young_mpa = own_mpa * force_ratio(presses.forces_n, forces_n)
    forces_n = forces_n * young_mpa / own_mpa
    return fit.poses[:, 2], forces_n, fit.camera.scale_px_per_mm, young_mpa


def _bounds(values: Sequence[float] | np.ndarray) -> Bounds:
    """The first of these values, their minimum and their maximum."""
    return Bounds(float(values[0]), float(min(values)), float(max(values)))


def _residual(fitted: np.ndarray, measured: np.ndarray) -> float | None:
    """Root mean square difference where both are finite; None where they never are."""
    residual = (fitted - measured)[np.isfinite(fitted - measured)]
    return float(np.sqrt(np.mean(residual**2))) if residual.size else None


def ball_forces_n(sensor: GelCamera, poses: np.ndarray, diameters_mm: np.ndarray) -> np.ndarray:
    """(n,) N: forces at poses (n, 3) in the sensor's gel; NaN where no allowed force reaches."""
    forces_n = np.full(len(poses), np.nan)
    for index, (x_mm, y_mm, depth_mm) in enumerate(poses.tolist()):
        shape = ball(float(diameters_mm[index]) / 2)
        command = PressCommand(shape.name, x_mm, y_mm, 0.0, 1.0)
        press = partial(solve_contact, shape, elastomer=sensor.own_gel, pitch_mm=sensor.pitch_mm)
        with suppress(T2TwinError):
            forces_n[index] = force_at_depth(press, command, depth_mm)
    return forces_n


def force_ratio(measured_n: np.ndarray, own_n: np.ndarray) -> float:
    """Modulus in parts of the sensor's, by least squares over forces (n,), measured or NaN and the
    twin's. At a given depth they are proportional to it, as stiffening is by strain."""
    both = np.isfinite(measured_n) & np.isfinite(own_n)
    if not both.any():
        raise T2TwinError("no press with a measured force can be pressed that deep in the twin")
    measured, own = measured_n[both], own_n[both]
    return float((measured @ own) / (own @ own))


DEFAULT_TOLERANCE = Tolerance()


@dataclass(frozen=True)
class HeldOutPress(images.Score):
    """A held-out press, and the score of its image, simulated with an optics file without it."""

    name: str
    x_mm: float
    y_mm: float
    depth_mm: float


@dataclass(frozen=True)
class OpticsRecord:
    """Content of optics.json."""

    trained: list[str]  # names of the fitted frames
    repeated: list[str]  # and of excluded duplicates
    held_out: tuple[HeldOutPress, ...]
    # Means on the contact crops of the held-out frames: "calibrated" of the simulated frames,
    # "cut_and_paste" of the training presses' mean change, moved to the held-out ones, "do_nothing"
    # of the background frame
    scores: dict[str, images.Score]
    covered: float  # share of the gel in the image that contacts cover
    next_mm: list[tuple[float, float]]  # places of presses that would cover the rest, best first
    uncertainty: OpticsUncertainty | None = None  # bounds of depths and forces
    inputs_sha256: str | None = None  # of the frames and numbers, for an adaptation that resumes
    notes: tuple[str, ...] = ()  # what limits the result, in words
    format: str = FORMAT


@dataclass(frozen=True, kw_only=True)
class OpticsReport(OpticsRecord):
    """A fitted optics file and its evaluation."""

    optics: Optics  # fitted to all presses, with their noise
    scored_by: Optics  # fitted without the held-out presses; scores and `simulated` are of these
    poses: np.ndarray  # (n, 3) x_mm, y_mm, depth_mm of all presses, the held-out ones last
    radii_mm: np.ndarray  # (n,) of their contacts
    surfaces_mm: np.ndarray  # (held out, grid) deflections at the poses, on optical_grid(gel)
    real: np.ndarray  # (held out, rows, columns, 3) uint8 frames
    simulated: np.ndarray  # the same, simulated


def read_presses(
    background: Path, presses: Path, ball_diameter_mm: float, held_out: int | None,
    sensor: GelCamera, camera: Camera, tolerance: Tolerance | None, order: FrameOrder = UPRIGHT,
) -> tuple[Presses, list[int], list[int]]:  # fmt: skip
    """The presses of `calibrate`, and the indices of those to fit to and of those held out."""
    background_frame, frames, names = images.read_frames(background, presses, camera, order)
    colored = is_colored(sensor.background_frame())
    for name, frame in zip([background.name, *names], [background_frame, *frames], strict=True):
        images.check_usable(frame, name, colored)
    (background_frame, *rest), is_marked = images.without_markers(
        [background_frame, *frames], camera
    )
    measured = read_measurements(presses, names, ball_diameter_mm, sensor)
    frames = np.array(rest)
    patches = [images.contact_patch(frame, background_frame) for frame in frames]
    if empty := [name for name, patch in zip(names, patches, strict=True) if patch is None]:
        raise T2TwinError(
            f"no contact is visible in {', '.join(empty)}: the change of the background is below "
            f"{images.VISIBLE_GREY:g} grey levels; remove these frames, or press deeper"
        )
    found = Presses(sensor, background_frame, frames, np.array(patches), *measured, names)
    train, test, notes = _parts(found, presses, held_out, camera)
    found = replace(found, notes=[*[MARKED] * is_marked, *notes])
    if found.has_depths and not np.isfinite(found.depths_mm[train]).any():
        raise T2TwinError(
            f"{presses / FORCES} has displacements of held-out presses only; add one of "
            f"{', '.join(names[index] for index in train)}"
        )
    for index in (*train, *test):
        width_mm = images.contact_width_px(frames[index], background_frame) / camera.scale_px_per_mm
        if width_mm > WIDEST * found.diameters_mm[index]:  # before the long fit
            raise too_small(found, index, camera)
    if tolerance is not None:
        _check_used(tolerance, found)
        for sign in (DEEPEST_SIGN, SHALLOWEST_SIGN):  # refuses too large ones
            shifted(found, camera, tolerance.of(sensor), sign)
    return found, train, test


def _check_used(tolerance: Tolerance, presses: Presses) -> None:
    """Raises T2TwinError for a tolerance, other than the default, that has no effect."""
    has_forces = bool(np.isfinite(presses.forces_n).any())
    for name, is_used, state in (
        ("depth_mm", presses.has_depths, f"without a depth_mm in {FORCES}"),
        ("force_n", has_forces, f"without a force_n in {FORCES}"),
        ("scale_px_per_mm", not presses.has_depths, f"as depth_mm in {FORCES} determines it"),
        ("young_mpa", not has_forces, f"as force_n in {FORCES} determines it"),
    ):
        if not is_used and getattr(tolerance, name) != getattr(DEFAULT_TOLERANCE, name):
            raise T2TwinError(f"the tolerance {name} has no effect, {state}; leave it out")


def _parts(
    presses: Presses, folder: Path, held_out: int | None, camera: Camera
) -> tuple[list[int], list[int], list[str]]:
    """Indices of the frames to fit to and to hold out, without copies, and what was found."""
    places = images.same_places(presses.patches / camera.scale_px_per_mm)
    first: dict[bytes, int] = {}  # of each different frame
    for index, frame in enumerate(presses.frames):
        first.setdefault(frame.tobytes(), index)
    last, wanted = int(places.max()), held_out or 1
    # Frames of a place are in one part: fitted, if any of them is not among the last ones. Where
    # these show hardly any other places, and by default, the last places are held out.
    fitted = set(places[: max(len(places) - wanted, 0)].tolist())
    if held_out is None:
        count = last + 1
        fitted = set(range(count - max(1, min(count // HELD_OUT_SHARE, count - MIN_TRAINING))))
    elif 2 * np.count_nonzero(~np.isin(places, [*fitted])) < wanted:
        count = last
        while count and np.count_nonzero(places >= count - 1) <= wanted:
            count -= 1
        fitted = set(range(count))
    train, test = (
        [index for index in first.values() if (places[index] in fitted) == is_fitted]
        for is_fitted in (True, False)
    )
    if len(fitted) < MIN_TRAINING or not test:
        raise T2TwinError(
            f"{folder} holds {counted(len(places), 'frame')} of presses at "
            f"{counted(last + 1, 'place')}, of which {wanted} must be held out; at least "
            f"{MIN_TRAINING} places must be left to fit to; {MIN_TRAINING + wanted} places would do"
        )
    groups = [[presses.names[index] for index in first.values() if places[index] == place]
              for place in range(last + 1)]  # fmt: skip
    repeats = "; ".join(", ".join(names) for names in groups if len(names) > 1)
    note = f"frames of one place are all fitted or all held out: {repeats}"
    return train, test, [note] if repeats else []


def cleaned(presses: Presses, indices: list[int]) -> Presses:
    """Some presses with the background cleaned with their frames."""
    clean = images.clean_background(presses.background, presses.frames[indices])
    return presses.subset(indices, clean)


def evaluate(presses: Presses, test: list[int], training: Presses, fit: State) -> OpticsReport:
    """The report of a fit without the held-out presses, which are only located."""
    held_out, camera = presses.subset(test, training.background), fit.camera
    model = BallFit(held_out, camera)
    poses = np.array([model.pose(fit, index) for index in range(len(test))])
    surfaces_mm = np.array([model.surface(fit.geometry, *each) for each in enumerate(poses)])
    optics = fit.optics(training.background)
    renderer = ImageRenderer(optics, presses.sensor.own_gel, presses.sensor.noise_grey)
    simulated = np.array([renderer.render(surface_mm) for surface_mm in surfaces_mm])
    from_px, to_px = (
        np.stack(camera.project(x, y, np.zeros(x.size)), axis=1)
        for x, y, _ in (fit.poses.T, poses.T)
    )
    pasted = images.cut_and_paste(presses.background, training.frames, from_px, to_px)
    still = np.broadcast_to(presses.background, held_out.frames.shape)
    others = {"calibrated": simulated, "cut_and_paste": pasted, "do_nothing": still}
    crops = {n: images.crop_scores(held_out.frames, o, held_out.patches) for n, o in others.items()}
    scores, each = {n: images.mean_score(s) for n, s in crops.items()}, crops["calibrated"]
    gel, all_poses = presses.sensor.own_gel, np.concatenate([fit.poses, poses])
    diameters_mm = np.concatenate([of.diameters_mm for of in (training, held_out)])
    worst = held_out.names[int(np.argmin([one.psnr_db for one in each]))]
    names = [*training.names, *held_out.names]
    limited = list(compress(names, is_at_limit(all_poses, diameters_mm)))
    radii_mm, covered, next_mm = images.coverage_of(camera, gel, all_poses, diameters_mm)
    found = zip(each, held_out.names, *poses.T.tolist(), strict=True)
    return OpticsReport(
        trained=[*training.names],
        repeated=[n for n in presses.names if n not in names],
        held_out=tuple(HeldOutPress(one.l1, one.ssim, one.psnr_db, *at) for one, *at in found),
        scores=scores, covered=covered, next_mm=next_mm,
        notes=(*presses.notes, *_warnings(scores, worst, limited)), optics=optics, scored_by=optics,
        poses=all_poses, radii_mm=radii_mm, surfaces_mm=surfaces_mm, real=held_out.frames,
        simulated=simulated,
    )  # fmt: skip


def _warnings(scores: dict[str, images.Score], worst: str, limited: list[str]) -> list[str]:
    """What limits a fit. worst: of the held-out frames. limited: frames with depths at a limit."""
    ours, pasted, still = scores.values()
    if ours.psnr_db <= still.psnr_db:
        raise T2TwinError(
            f"the fit does not explain the held-out presses, least {worst}: its PSNR is "
            f"{ours.psnr_db:.1f} dB, and {still.psnr_db:.1f} dB for the background; use frames of "
            "one ball, pressed into the sensor of the background"
        )
    found, advice = [], "check the ball's diameter and the sensor's file, or press at more places"
    if ours.psnr_db <= pasted.psnr_db or ours.ssim <= max(pasted.ssim, still.ssim):
        found.append(
            f"the fitted light is no better than a baseline: {ours}; moved presses {pasted}; "
            f"background {still}; the worst frame is {worst}; {advice}"
        )
    if limited:
        found.append(f"the depth of {', '.join(limited)} is at a limit of the fit; {advice}")
    return found


def write_fit(
    folder: Path, report: OpticsReport, gel: Elastomer, inputs_sha256: str | None = None
) -> OpticsRecord:
    """Write the picture of the coverage, optics.npz, and last optics.json, which is returned."""
    with atomic_write(folder / COVERAGE) as temporary:
        picture = images.coverage_picture(
            report.optics, gel, report.poses, report.radii_mm, report.next_mm
        )
        picture.save(temporary)
    report.optics.save(folder / OPTICS)
    own: Any = {field.name: getattr(report, field.name) for field in fields(OpticsRecord)}
    record = replace(OpticsRecord(**own), inputs_sha256=inputs_sha256)
    write_json(folder / RECORD, asdict(record))
    return record


def uncertainty_table(uncertainty: OpticsUncertainty) -> Table:
    """The bounds of the presses; below, the assumptions: balls, scale, modulus."""
    one, tolerance = uncertainty, uncertainty.tolerance
    rows = [
        [each.name]
        + [f"{value:.2f}" for value in vars(each.depth_mm).values()]
        + ([f"{value:.2f}" for value in vars(each.force_n).values()] if each.force_n else [""] * 3)
        for each in one.presses
    ]
    heads = ["press", "depth, mm", "low", "high", "force, N", "low", "high"]
    scale = (
        f"The scale is {one.scale_px_per_mm.value:g} px/mm within {tolerance.scale_px_per_mm:g}, "
        f"as given; measured displacements in {FORCES} would determine it."
    )
    if one.depth_measurements:
        scale = (
            f"The scale is {one.scale_px_per_mm} px/mm, from "
            f"{one.depth_measurements} displacements measured within {tolerance.depth_mm:g} mm; "
            f"their residual is {one.depth_residual_mm:.3f} mm (root mean square)."
        )
    modulus = (
        f"The gel's modulus is the sensor's, {one.own_young_mpa:g} MPa, within "
        f"{tolerance.young_mpa:g}; measured forces in {FORCES} would determine it."
    )
    if one.young_mpa is not None:
        modulus = (
            f"The gel's modulus is {one.young_mpa} MPa, from "
            f"{one.force_measurements} forces measured within {tolerance.force_n:g} N; their "
            f"residual is {one.force_residual_n:.2f} N. A twin with these optics has such a gel."
        )
    balls = f"The balls' diameters are assumed to be correct within {tolerance.ball_mm:g} mm."
    return Table(heads, {"": rows}, notes=[balls, scale, modulus])


def sample_lights(
    background: np.ndarray, sensor: GelCamera, camera: Camera, count: int = UNIT_COUNT
) -> list[Optics]:
    """Sampled units, all with one camera and one background (rows, columns, 3) uint8."""
    rngs = (np.random.default_rng((0, number)) for number in range(count))
    units = (sample_unit(rng, sensor.spec, RANGES).optics for rng in rngs)
    return [replace(unit, background=background, camera=camera) for unit in units]


def mean_light(units: Sequence[Optics]) -> Optics:
    """The mean LED positions and response, and the geometric mean of the LED sizes."""
    return replace(
        units[0], leds_mm=np.mean([unit.leds_mm for unit in units], axis=0),
        sizes_mm=np.exp(np.mean([np.log(unit.sizes_mm) for unit in units], axis=0)),
        response=np.mean([unit.response for unit in units], axis=0),
    )  # fmt: skip


def calibrate(
    background: str | Path, presses: str | Path, ball_diameter_mm: float,
    held_out: int | None = None, camera: Camera | None = None,
    report: Callable[[str], object] = lambda line: None,
    tolerance: Tolerance | None = DEFAULT_TOLERANCE, sensor: str | Path | GelCamera = SOURCE,
    order: FrameOrder = UPRIGHT,
) -> OpticsReport:  # fmt: skip
    """Fit the presses, score on the last held_out by name (a third of the places), then fit all.

    background: a background frame. presses: folder of frames of a ball, in the size of the sensor's
    images, PNG or JPEG, and optionally `forces.csv` (see measurements). ball_diameter_mm: of all
    presses without a diameter in it. held_out: number of held-out presses. camera: its scale and
    distance; None for those of the sensor; measured displacements replace the scale. report: called
    with progress messages. tolerance: of the inputs; None skips the uncertainty, which takes most
    of the time, and the gel's modulus. sensor: a gel camera, by name or file; its record has the
    images' size, the gel, the camera, and the LEDs from which the fit starts. order: of all frames.
    Frames that equal an earlier one are excluded, printed markers are filled in, and the frames of
    one place are all fitted or all held out. Warns with T2TwinWarning of what limits the result.
    Raises T2TwinError for invalid frames or numbers, and for a fit no better than the background.
    """
    own, camera = sensor_and_camera(sensor, camera)
    arguments.whole_number(1 if held_out is None else held_out, "held_out", 1)
    if tolerance is not None:
        arguments.instance(tolerance, "tolerance", Tolerance)
    arguments.function(report, "report")
    given, train, test = read_presses(
        arguments.path(background, "background"), arguments.path(presses, "presses"),
        ball_diameter_mm, held_out, own, camera, tolerance, order,
    )  # fmt: skip
    report(f"fitting to {len(train)} presses")
    training = cleaned(given, train)
    fit = fit_presses(training, camera)
    evaluated = evaluate(given, test, training, fit)
    every = cleaned(given, [*train, *test])
    report(f"fitting again, to all {len(every.frames)}")
    fit, uncertainty = fit_presses(every, fit.camera, fit), None
    if tolerance is not None:
        uncertainty = estimate_uncertainty(every, fit, tolerance.of(own), report)
    young = None if uncertainty is None else uncertainty.young_mpa
    optics = replace(
        fit.optics(every.background),
        noise=images.measure_noise(every.background, every.frames, given.background),
        young_mpa=None if young is None else young.value,
    )
    notes = (*evaluated.notes, *[NOISELESS] * (optics.noise is None))
    warn(*notes)
    return replace(evaluated, optics=optics, uncertainty=uncertainty, notes=notes)


def guess_light(
    background: str | Path, camera: Camera | None = None,
    report: Callable[[str], object] = lambda line: None, sensor: str | Path | GelCamera = SOURCE,
    order: FrameOrder = UPRIGHT,
) -> Optics:  # fmt: skip
    """An optics file with the user's background and the mean light of sampled units.

    background: a background frame, in the size of the sensor's images, PNG or JPEG, whose noise is
    kept. camera: scale and distance, which a frame does not determine; None for those of the
    sensor. report, sensor, order: as for `calibrate`.
    Printed markers are filled in, with a T2TwinWarning.
    Raises T2TwinError for an invalid frame, and for a sensor whose units cannot be sampled.
    """
    own, camera = sensor_and_camera(sensor, camera)
    arguments.function(report, "report")
    frame = images.read_frame(arguments.path(background, "background"), order)
    frame = images.sized_frame(frame, camera)
    images.check_usable(frame, str(background), is_colored(own.background_frame()))
    (frame,), is_marked = images.without_markers([frame], camera)
    warn(MARKED if is_marked else None)
    report(f"sampling {UNIT_COUNT} units of {own.name}, some seconds")
    return mean_light(sample_lights(frame, own, camera))


def sensor_and_camera(
    sensor: str | Path | GelCamera, camera: Camera | None
) -> tuple[GelCamera, Camera]:
    """The gel camera of a name or file, and the camera in place of its own; None for its own."""
    loaded = load_sensor(sensor)
    if loaded.spec.kind != KIND:
        raise T2TwinError(
            f"{loaded.name} is a {loaded.spec.kind.replace('-', ' ')}; expected a gel camera, "
            "whose optics are fitted to frames"
        )
    gel_camera = cast(GelCamera, loaded)
    own = gel_camera.camera
    if camera is None:
        return gel_camera, own
    arguments.instance(camera, "camera", Camera)
    if (camera.rows, camera.columns) != (own.rows, own.columns):
        raise T2TwinError(
            f"the camera has {camera.rows} rows and {camera.columns} columns; expected {own.rows} "
            f"and {own.columns}, those of {loaded.name}"
        )
    return gel_camera, camera
