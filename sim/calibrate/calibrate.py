"""Calibrates a gel camera's optics to a user's unit: fits some presses, scores on others.

From a background frame alone, an optics file is the mean light of sampled units. The background
frame does not determine how LEDs shade and shadow a press. The sampled units whose LEDs explain it
best predict a real unit's presses no better than the others. The mean over many units predicts them
better than any one unit.
"""

from collections.abc import Callable, Sequence
from dataclasses import asdict, astuple, dataclass, replace
from pathlib import Path
from typing import cast

import numpy as np
from scipy.ndimage import shift
from skimage.metrics import structural_similarity

from t2twin.core import arguments
from t2twin.core.errors import T2TwinError
from t2twin.core.files import atomic_write, write_json
from t2twin.core.images import is_colored
from t2twin.sim.calibrate.coverage import Coverage, coverage_of, coverage_picture
from t2twin.sim.calibrate.fit import GAMMA, BallFit, Presses
from t2twin.sim.calibrate.frames import (
    check_usable,
    clean_background,
    contact_patch,
    crop,
    measure_noise,
    read_frame,
    read_frames,
    upright_frame,
)
from t2twin.sim.calibrate.measurements import (
    DEEPEST_SIGN,
    FORCES,
    SHALLOWEST_SIGN,
    Fit,
    OpticsUncertainty,
    Tolerance,
    estimate_uncertainty,
    fit_presses,
    read_measurements,
    shifted,
)
from t2twin.sim.contact.elastomer import Elastomer
from t2twin.sim.optical.camera import Camera
from t2twin.sim.optical.gel_camera import GelCamera
from t2twin.sim.optical.image_renderer import ImageRenderer
from t2twin.sim.optical.optics import Optics
from t2twin.sim.optical.spec import KIND
from t2twin.sim.optical.units import UnitRanges, sample_unit
from t2twin.sim.sensors.defaults import SOURCE
from t2twin.sim.sensors.files import load_sensor

MIN_TRAINING = 6  # smallest number of presses to fit to: each LED's light varies over the gel
HELD_OUT_SHARE = 3  # by default one in so many presses is held out, the last ones
UNIT_COUNT = 300
"""Number of units that are averaged (assumed: twice as many change the mean by little)."""
RANGES = UnitRanges(linear_amount=1.0, linear_gamma=(GAMMA, GAMMA))
"""Ranges of the units: their gamma is the one of a fit. Only responses of one gamma can be
averaged."""
OPTICS, RECORD, COVERAGE = "optics.npz", "optics.json", "optics_coverage.png"
"""Names of the files of a fit."""
FORMAT = 1  # format of optics.json

DEFAULT_TOLERANCE = Tolerance()

Report = Callable[[str], object]  # called with progress messages


@dataclass(frozen=True)
class Score:
    """l1: mean absolute difference, grey levels. psnr_db: peak signal-to-noise ratio."""

    l1: float
    ssim: float
    psnr_db: float


@dataclass(frozen=True)
class OpticsScores:
    """Mean scores on the contact crops of the held-out frames.

    calibrated: of the simulated frames. cut_and_paste: of the training presses' mean change, moved
    to the held-out positions. do_nothing: of the background frame.
    """

    calibrated: Score
    cut_and_paste: Score
    do_nothing: Score


@dataclass(frozen=True)
class HeldOutPress:
    """A held-out press, and the score of its image, simulated with an optics file without it."""

    name: str
    x_mm: float
    y_mm: float
    depth_mm: float
    l1: float
    ssim: float
    psnr_db: float


@dataclass(frozen=True)
class OpticsRecord:
    """Content of optics.json.

    trained, repeated: names of the frames that were fitted, and of excluded duplicates. covered,
    next_mm: see Coverage. inputs_sha256: of the frames and numbers, for an adaptation that resumes.
    """

    format: int
    trained: list[str]
    repeated: list[str]
    held_out: tuple[HeldOutPress, ...]
    scores: OpticsScores
    covered: float
    next_mm: list[tuple[float, float]]
    uncertainty: OpticsUncertainty | None
    inputs_sha256: str | None = None


@dataclass(frozen=True)
class OpticsReport:
    """A fitted optics file and its evaluation. All arrays but training_poses are over the held-out
    presses.

    optics: fitted to all presses, with their noise. scored_by: fitted without the held-out
    presses; `simulated` and the scores are of this one.
    trained, held_out: names of the frames. repeated: names of duplicates, which are excluded.
    training_poses, poses: (n, 3) x_mm, y_mm, depth_mm, each fitted to its own frame. surfaces_mm:
    (n, grid) deflections at the poses, on optical_grid(gel). real, simulated: (n, rows, columns, 3)
    uint8. scores: means. each: the score of each press. coverage: by all presses, in the order of
    training_poses and poses. uncertainty: bounds of depths and forces.
    """

    optics: Optics
    scored_by: Optics
    trained: list[str]
    training_poses: np.ndarray
    held_out: list[str]
    repeated: list[str]
    poses: np.ndarray
    surfaces_mm: np.ndarray
    real: np.ndarray
    simulated: np.ndarray
    scores: OpticsScores
    each: list[Score]
    coverage: Coverage
    uncertainty: OpticsUncertainty | None


def read_presses(
    background: Path,
    presses: Path,
    ball_diameter_mm: float,
    held_out: int | None,
    sensor: GelCamera,
    camera: Camera,
    tolerance: Tolerance | None,
) -> tuple[Presses, list[int], list[int]]:
    """The presses of `calibrate`, and the indices of those to fit to and of those held out.

    Raises T2TwinError for invalid frames or numbers.
    """
    background_frame, frames, names = read_frames(background, presses, camera)
    colored = is_colored(sensor.background_frame())
    for name, frame in zip([background.name, *names], [background_frame, *frames], strict=True):
        check_usable(frame, name, colored)
    measurements = read_measurements(presses, names, ball_diameter_mm, sensor)
    count = len(frames) // HELD_OUT_SHARE if held_out is None else held_out
    first: dict[bytes, int] = {}  # of each different frame
    for index, frame in enumerate(frames):
        first.setdefault(frame.tobytes(), index)
    train = [index for index in first.values() if index < len(frames) - count]
    test = [index for index in first.values() if index >= len(frames) - count]
    if len(train) < MIN_TRAINING or not test:
        copies = len(frames) - len(first)
        raise T2TwinError(
            f"{presses} holds {len(frames)} presses, of which {count} are held out and {copies} "
            f"are copies of others; at least {MIN_TRAINING} different ones must be left to fit to, "
            "and at least 1 held out"
        )
    patches = [contact_patch(frame, background_frame) for frame in frames]
    if empty := [name for name, patch in zip(names, patches, strict=True) if patch is None]:
        raise T2TwinError(
            f"no contact is visible in {', '.join(empty)}, which do not differ from the "
            "background; remove these frames"
        )
    if measurements.has_depths and not measurements.subset(train).has_depths:
        raise T2TwinError(
            f"{presses / FORCES} has displacements of held-out presses only; add some of earlier "
            "presses"
        )
    found = Presses(sensor, background_frame, frames, np.array(patches), measurements, names)
    if tolerance is not None:
        for sign in (DEEPEST_SIGN, SHALLOWEST_SIGN):  # refuses too large ones
            shifted(found, camera, tolerance.of(sensor), sign)
    return found, train, test


def cleaned(presses: Presses, indices: list[int]) -> Presses:
    """Some presses with the background cleaned with their frames."""
    clean = clean_background(presses.background, presses.frames[indices])
    return presses.subset(indices, clean)


def evaluate(presses: Presses, test: list[int], training: Presses, fit: Fit) -> OpticsReport:
    """The report of a fit without the held-out presses, which are only located.

    Raises T2TwinError for a fit no better than the background.
    """
    held_out = presses.subset(test, training.background)
    model = BallFit(held_out, fit.model.camera)
    poses = np.array([model.pose(fit.state, index) for index in range(len(test))])
    surfaces_mm = np.array(
        [model.surface(fit.state.geometry, index, pose) for index, pose in enumerate(poses)]
    )
    optics = fit.model.optics(fit.state)
    renderer = ImageRenderer(optics, presses.sensor.own_gel, presses.sensor.noise_grey)
    simulated = np.array([renderer.render(surface_mm) for surface_mm in surfaces_mm])
    from_px, to_px = (_pixels(each, fit.model.camera) for each in (fit.state.poses, poses))
    pasted = cut_and_paste(presses.background, training.frames, from_px, to_px)
    still = np.broadcast_to(presses.background, held_out.frames.shape)
    each, *baselines = (
        crop_scores(held_out.frames, other, held_out.patches)
        for other in (simulated, pasted, still)
    )
    scores = OpticsScores(*(mean_score(scored) for scored in (each, *baselines)))
    _check_explains(scores)
    all_poses = np.concatenate([fit.state.poses, poses])
    each_mm = [of.measurements.diameters_mm for of in (training, held_out)]
    diameters_mm = np.concatenate(each_mm)
    coverage = coverage_of(fit.model.camera, presses.sensor.own_gel, all_poses, diameters_mm)
    return OpticsReport(
        optics=optics,
        scored_by=optics,
        trained=[*training.names],
        training_poses=fit.state.poses,
        held_out=[*held_out.names],
        repeated=[n for n in presses.names if n not in (*training.names, *held_out.names)],
        poses=poses,
        surfaces_mm=surfaces_mm,
        real=held_out.frames,
        simulated=simulated,
        scores=scores,
        each=each,
        coverage=coverage,
        uncertainty=None,
    )


def fit_all(
    presses: Presses,
    background: np.ndarray,
    first: Fit,
    tolerance: Tolerance | None,
    report: Report,
) -> tuple[Optics, OpticsUncertainty | None]:
    """The optics from all presses, with noise and modulus, and its uncertainty.

    background: before it was cleaned.
    """
    report(f"fitting again, to all {len(presses.frames)}")
    fit = fit_presses(presses, first.model.camera, first.state)
    uncertainty = None
    if tolerance is not None:
        uncertainty = estimate_uncertainty(presses, fit, tolerance.of(presses.sensor), report)
    young = None if uncertainty is None else uncertainty.young_mpa
    optics = replace(
        fit.model.optics(fit.state),
        noise=measure_noise(presses.background, presses.frames, background),
        young_mpa=None if young is None else young.value,
    )
    return optics, uncertainty


def _check_explains(scores: OpticsScores) -> None:
    """Raises T2TwinError if the fit is no better than the background, as without a ball."""
    fitted, still = scores.calibrated.psnr_db, scores.do_nothing.psnr_db
    if fitted <= still:
        raise T2TwinError(
            f"the fit does not explain the held-out presses: its PSNR is {fitted:.1f} dB, and "
            f"{still:.1f} dB for the background; use frames of one ball, pressed into the sensor "
            "of the background"
        )


def _pixels(poses: np.ndarray, camera: Camera) -> np.ndarray:
    """(n, 2) rows and columns, px, of poses (n, 3)."""
    rows, columns = camera.project(poses[:, 0], poses[:, 1], np.zeros(len(poses)))
    return np.stack([rows, columns], axis=1)


def score(real: np.ndarray, other: np.ndarray) -> Score:
    """The score of two uint8 images of one shape (rows, columns, 3)."""
    difference = real.astype(float) - other
    error = max(float(np.mean(difference**2)), 1e-12)
    return Score(
        l1=float(np.abs(difference).mean()),
        ssim=float(np.mean(structural_similarity(real, other, channel_axis=2, data_range=255))),
        psnr_db=float(10.0 * np.log10(255.0**2 / error)),
    )


def mean_score(scores: Sequence[Score]) -> Score:
    """The mean of each metric."""
    return Score(*np.mean([astuple(each) for each in scores], axis=0).tolist())


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
    changes = np.concatenate(  # the last channel counts the presses that a pixel shows
        [training.astype(float) - background, np.ones((*training.shape[:3], 1))], axis=-1
    )
    pasted = []
    for place in np.rint(to_px):
        moves = place - np.rint(from_px)
        moved = sum(shift(each, (*by, 0), order=0) for each, by in zip(changes, moves, strict=True))
        change, count = np.split(np.asarray(moved), [3], axis=-1)
        pasted.append(background + change / np.maximum(count, 1.0))
    return np.clip(np.rint(pasted), 0, 255).astype(np.uint8)


def write_fit(
    folder: Path, report: OpticsReport, gel: Elastomer, inputs_sha256: str | None = None
) -> OpticsRecord:
    """Write the picture of the coverage, optics.npz, and last optics.json, whose content is
    returned.

    gel: of the sensor. Raises T2TwinError where they cannot be written.
    """
    with atomic_write(folder / COVERAGE) as temporary:
        coverage_picture(report.coverage, report.optics, gel).save(temporary)
    report.optics.save(folder / OPTICS)
    held_out = zip(report.held_out, report.poses.tolist(), report.each, strict=True)
    record = OpticsRecord(
        format=FORMAT,
        trained=report.trained,
        repeated=report.repeated,
        held_out=tuple(
            HeldOutPress(name, *pose, *astuple(scored)) for name, pose, scored in held_out
        ),
        scores=report.scores,
        covered=report.coverage.covered,
        next_mm=[(x, y) for x, y in report.coverage.next_mm.tolist()],
        uncertainty=report.uncertainty,
        inputs_sha256=inputs_sha256,
    )
    write_json(folder / RECORD, asdict(record))
    return record


def sample_lights(
    background: np.ndarray, sensor: GelCamera, camera: Camera, count: int = UNIT_COUNT
) -> list[Optics]:
    """Sampled units, all with one camera and one background (rows, columns, 3) uint8."""
    rngs = (np.random.default_rng((0, number)) for number in range(count))
    units = (sample_unit(rng, sensor.spec, RANGES).optics for rng in rngs)
    return [replace(unit, background=background, **camera.placement) for unit in units]


def mean_light(units: Sequence[Optics]) -> Optics:
    """The mean LED positions and response, and the geometric mean of the LED sizes."""
    return replace(
        units[0],
        leds_mm=np.mean([unit.leds_mm for unit in units], axis=0),
        sizes_mm=np.exp(np.mean([np.log(unit.sizes_mm) for unit in units], axis=0)),
        response=np.mean([unit.response for unit in units], axis=0),
    )


def calibrate(
    background: str | Path,
    presses: str | Path,
    ball_diameter_mm: float,
    held_out: int | None = None,
    camera: Camera | None = None,
    report: Report = lambda line: None,
    tolerance: Tolerance | None = DEFAULT_TOLERANCE,
    sensor: str | Path | GelCamera = SOURCE,
) -> OpticsReport:
    """Fit the presses, score on the last held_out of them by name, then fit all of them.

    background: a background frame. presses: folder of frames of a ball, in the size of the sensor's
    images, PNG or JPEG, and optionally `forces.csv` (see measurements). camera: its scale and
    distance; None for those of the sensor; measured displacements replace the scale. report: called
    with progress messages. tolerance: of the inputs; None skips the uncertainty, which takes most
    of the time, and the gel's modulus. sensor: a gel camera, by name or file; its record has the
    images' size, the gel, the camera, and the LEDs from which the fit starts.
    Frames that equal an earlier one are excluded.
    Raises T2TwinError for invalid frames or numbers, and for a fit no better than the background.
    """
    own, camera = sensor_and_camera(sensor, camera)
    if held_out is not None:
        arguments.whole_number(held_out, "held_out")
    if tolerance is not None:
        arguments.instance(tolerance, "tolerance", Tolerance)
    arguments.function(report, "report")
    given, train, test = read_presses(
        arguments.path(background, "background"), arguments.path(presses, "presses"),
        ball_diameter_mm, held_out, own, camera, tolerance,
    )  # fmt: skip
    report(f"fitting to {len(train)} presses")
    training = cleaned(given, train)
    fit = fit_presses(training, camera)
    evaluated = evaluate(given, test, training, fit)
    every = cleaned(given, [*train, *test])
    optics, uncertainty = fit_all(every, given.background, fit, tolerance, report)
    return replace(evaluated, optics=optics, uncertainty=uncertainty)


def guess_light(
    background: str | Path,
    camera: Camera | None = None,
    report: Report = lambda line: None,
    sensor: str | Path | GelCamera = SOURCE,
) -> Optics:
    """An optics file with the user's background and the mean light of sampled units.

    background: a background frame, in the size of the sensor's images, PNG or JPEG, whose noise is
    kept. camera: scale and distance, which a frame does not determine; None for those of the
    sensor. report: called with progress messages. sensor: as for `calibrate`.
    Raises T2TwinError for an invalid frame, and for a sensor whose units cannot be sampled.
    """
    own, camera = sensor_and_camera(sensor, camera)
    arguments.function(report, "report")
    frame = upright_frame(read_frame(arguments.path(background, "background")), camera)
    if not own.spec.light.leds or own.spec.units is None:
        raise T2TwinError(
            f"the file of {own.name} has no {'table [units]' if own.spec.light.leds else 'LEDs'}, "
            "from which light is sampled for a background alone; give presses of a ball"
        )
    check_usable(frame, str(background), is_colored(own.background_frame()))
    report(f"sampling {UNIT_COUNT} units of {own.name}, some seconds")
    return mean_light(sample_lights(frame, own, camera))


def sensor_and_camera(
    sensor: str | Path | GelCamera, camera: Camera | None
) -> tuple[GelCamera, Camera]:
    """The gel camera of a name or file, and the camera in place of its own; None for its own.

    Raises T2TwinError for a sensor of another kind and for a camera of another image size.
    """
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
