"""Adapts a translator to one gel camera, from about ten minutes of presses of a ball.

There are four steps, which are also separate commands. A finished step is not repeated.

1. light: calibrates the optics, first without the held-out presses, then on all.
2. data: simulates a dataset of random shapes and primitives, pressed with 0.5 to 12 N. Its light is
   sampled around the optics, and its images have the noise of single frames.
3. training: trains a translator on this dataset, with the contact if the run that initializes it
   predicts it. The weights of a field run are then averaged with those of that run.
4. check: evaluates the trained run and the run that initialized it on the held-out presses, and
   keeps the more accurate one.
"""

import hashlib
import shutil
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import asdict, dataclass, replace
from pathlib import Path

import numpy as np

from t2twin.adaptation.real_frame_evaluation import (
    INITIAL,
    TRAINED,
    AdaptationResult,
    Candidate,
    SimulatedReference,
    baseline_rmse_percent,
    choose,
    publish,
    simulate_reference,
    write_adapt_page,
)
from t2twin.core import arguments
from t2twin.core.errors import T2TwinError
from t2twin.core.files import atomic_write, is_empty, locked, write_json
from t2twin.core.records import read_json
from t2twin.primitives_cad import catalogue
from t2twin.primitives_cad.export import write_ball
from t2twin.primitives_cad.shape import Shape
from t2twin.sim.calibrate.calibrate import (
    DEFAULT_TOLERANCE,
    FORMAT,
    OPTICS,
    RECORD,
    OpticsRecord,
    calibrate,
    read_presses,
    sensor_and_camera,
    write_fit,
)
from t2twin.sim.calibrate.coverage import coverage_sentences
from t2twin.sim.calibrate.fit import Presses
from t2twin.sim.calibrate.measurements import Tolerance
from t2twin.sim.dataset.generate import check_workers, make_dataset
from t2twin.sim.optical.camera import Camera
from t2twin.sim.optical.gel_camera import GelCamera
from t2twin.sim.sensors.defaults import SOURCE, TARGET
from t2twin.sim.sensors.pair import SensorPair
from t2twin.translate.inference.load import contact_warnings
from t2twin.translate.models.presets import Preset, find_preset
from t2twin.translate.runs.checkpoint import average_runs
from t2twin.translate.runs.config import HOME, load_config, pretrained_runs
from t2twin.translate.training.train import recalibrate, run_of_model, train

STEPS = ("light", "data", "training", "check")
BALL, RECIPE, DATA, TRAINING = "ball.step", "recipe.toml", "data", "training"
AVERAGED, ADAPTED = "averaged", "adapted.json"
MIN_MINUTES, MAX_MINUTES = 1.0, 6000.0

TRAINING_SHARE = 0.5  # share of the minutes that the training takes (assumed)

LEARNING_RATE = 1e-4
"""Learning rate of the training from a field run, before its reduction after a warm start (assumed:
a third of the preset's is enough for small changes)."""

DRIFT = 0.04
"""Relative changes of the light since the background frame was taken, standard deviation (measured:
0 to 8 % in the red of 21 presses of one real unit, 0 to 5 % in green, -2 to 2 % in blue)."""

TRAINED_SHARE = 0.7
"""Share of the trained weights in the mean with the initial ones. RMSE of `field@3` on held-out
frames of a real unit with shares of 0.35, 0.5, 0.7 and 1, over that of the initial run: 0.97, 0.97,
1.00 and 1.08 after 20 minutes, mean of three rotations of the frames. On simulated frames of the
same presses it is 0.87, 0.81, 0.74 and 0.66. With 0.7 it is 0.93 after 20 and 0.88 after 60
minutes, mean of two rotations (measured)."""

SHAPES_PER_MINUTE = 90
"""Random shapes of the dataset per minute of the adaptation. Pressing them, four times each, takes
a third of the time on two cores of a virtual machine (measured: 0.1 s of a core for a pair)."""

PRIMITIVE_PRESSES_PER_MINUTE = 1.5
"""Presses of each primitive per minute of the adaptation (assumed)."""

RECIPE_TEXT = """# Recipe of the dataset that {model} is adapted on, in the light of one unit.
format = 1
name = "adapted"
source = {source}
target = {target}
contact_maps = {contact_maps}

[[parts]]
shapes = "random"
count = {shapes}
presses = 4
place = {{ normal_mm = 2.5 }}
force_n = {{ low = 0.5, high = 12.0 }}
background_share = 0.05
val_share = 0.04

[[parts]]
shapes = "primitives"
presses = {presses}
place = {{ normal_mm = 2.5 }}
force_n = {{ low = 0.5, high = 12.0 }}

[light]
kind = "drawn"
each = "press"
optics = {optics}
frames = 1
"""


@dataclass(frozen=True)
class AdaptConfig:
    """Options of an adaptation; see `adapt`."""

    background: Path
    presses: Path
    ball_diameter_mm: float
    out: Path
    held_out: int | None
    minutes: float
    camera: Camera
    model: str
    init_from: Path | None
    workers: int | None
    tolerance: Tolerance
    source: str
    sensor: GelCamera

    def __post_init__(self) -> None:
        find_preset(self.model, "cpu")
        for name, value in (("held_out", self.held_out), ("workers", self.workers)):
            if value is not None:
                arguments.whole_number(value, name, low=1)
        if not MIN_MINUTES <= self.minutes <= MAX_MINUTES:
            raise T2TwinError(
                f"minutes is {self.minutes:g}; it must be from {MIN_MINUTES:g} to {MAX_MINUTES:g}"
            )
        check_workers(self.workers)

    @property
    def preset(self) -> Preset:
        """Settings of the training; a field run changes little from its initial run."""
        preset = find_preset(self.model, "cpu")
        if self.model != "field" or self.init_from is None:
            return preset
        return replace(preset, name="adapt", learning_rate=LEARNING_RATE, drift=DRIFT)

    @property
    def predicts_contact(self) -> bool:
        """Whether the initial run predicts the contact, so that the trained one does too."""
        return self.init_from is not None and bool(load_config(self.init_from).data.has_contact)

    @property
    def trained_dir(self) -> Path:
        """Folder of the trained run, of a field run with an initial run that of their mean."""
        is_mean = self.model == "field" and self.init_from is not None
        return self.out / (AVERAGED if is_mean else TRAINING) / self.model

    def digest(self, presses: Presses) -> str:
        """SHA-256 of the frames and numbers of the optics."""
        digest = hashlib.sha256(presses.background.tobytes() + presses.frames.tobytes())
        numbers = (
            presses.names, self.ball_diameter_mm, self.held_out, self.camera, self.tolerance,
            self.sensor.spec,
        )  # fmt: skip
        digest.update(repr(numbers).encode())
        measured = presses.measurements
        for values in (measured.diameters_mm, measured.depths_mm, measured.forces_n):
            digest.update(values.tobytes())
        return digest.hexdigest()


def adapt(
    background: str | Path,
    presses: str | Path,
    ball_diameter_mm: float,
    out: str | Path,
    held_out: int | None = None,
    minutes: float = 20.0,
    camera: Camera | None = None,
    model: str = "field",
    init_from: str | Path | None = None,
    workers: int | None = None,
    report: Callable[[str], object] = print,
    tolerance: Tolerance = DEFAULT_TOLERANCE,
    sensor: str | Path = SOURCE,
) -> AdaptationResult:
    """Adapts a translator to one gel camera, or resumes an interrupted adaptation.

    Writes optics.npz, optics_coverage.png, optics.json, recipe.toml, data/, training/, averaged/,
    a run named after the model, adapted.json and index.html to the folder out. The run is the
    trained one, a field run with weights averaged with those of init_from, or a copy of init_from
    if that is more accurate on the held-out presses.

    background, presses, ball_diameter_mm, held_out, camera, tolerance, sensor: as for `calibrate`.
    minutes: approximate duration of all steps on two cores, 1 to 6000. model: trained with the
    preset cpu; a field run changes little from its initial run. init_from: run that initializes
    the training; by default the pretrained run of the model for images of the sensor's size, if
    there is one. workers: processes that press; by default one per core. Raises T2TwinError, before
    anything is written, for invalid arguments and for a folder with other content.
    """
    gel_camera, camera = sensor_and_camera(sensor, camera)
    config = AdaptConfig(
        arguments.path(background, "background"),
        arguments.path(presses, "presses"),
        ball_diameter_mm,
        arguments.path(out, "out"), held_out, arguments.real(minutes, "minutes"),
        camera, model, _initial_run(init_from, model, gel_camera), workers,
        arguments.instance(tolerance, "tolerance", Tolerance), str(sensor), gel_camera,
    )  # fmt: skip
    arguments.function(report, "report")
    given, *_ = read_presses(
        config.background, config.presses, ball_diameter_mm, held_out, gel_camera, camera, tolerance
    )
    out, digest = config.out, config.digest(given)
    fitted = _existing_fit(config, digest)
    for warning in contact_warnings(given.background, str(config.background), config.source):
        report(f"warning: {warning}")
    spent: dict[str, float] = {}  # minutes
    with locked(out):
        with _step("light", spent, report):
            fitted = fitted or _existing_fit(config, digest) or _fit(config, digest, report)
            if not (out / RECIPE).is_file():
                _write_recipe(config)
        with _step("data", spent, report):
            make_dataset(out / DATA, recipe=out / RECIPE, workers=workers)
        with _step("training", spent, report):
            _train(config)
    with _step("check", spent, report):  # without the lock, which write_page takes
        result = _check(config, given, fitted, spent)
    write_json(out / ADAPTED, asdict(result))
    return result


def _check(
    config: AdaptConfig, presses: Presses, fitted: OpticsRecord, minutes: dict[str, float]
) -> AdaptationResult:
    """Writes the more accurate run and the page. minutes: by step, of the steps so far."""
    references = _references(config, presses, fitted)
    folders = {TRAINED: config.trained_dir}
    if config.init_from is not None:
        folders[INITIAL] = config.init_from
    candidates = {
        name: Candidate.of(folder, references, presses.background)
        for name, folder in folders.items()
    }
    kept = choose(candidates)
    publish(candidates, kept, config.out / config.model)
    one, scores = candidates[kept], fitted.scores.calibrated
    zero, mean_array = baseline_rmse_percent(references, one.run)
    assert fitted.uncertainty is not None
    result = AdaptationResult(
        model=config.model,
        kept=kept,
        runs={name: candidate.scores for name, candidate in candidates.items()},
        presses=len(references),
        optics_psnr_db=scores.psnr_db,
        optics_ssim=scores.ssim,
        zero_rmse_percent=zero,
        mean_array_rmse_percent=mean_array,
        minutes=minutes,
        uncertainty=fitted.uncertainty,
    )
    write_adapt_page(config.out, one.run, one.comparisons, result)
    return result


def _train(config: AdaptConfig) -> None:
    """Writes the trained run, and of a field run the mean with the initial one."""
    trained, minutes = config.out / TRAINING / config.model, TRAINING_SHARE * config.minutes
    is_kept = config.trained_dir == trained
    train(
        config.model, config.out / DATA, config.preset, trained, minutes=minutes,
        init_from=config.init_from, frame_check=is_kept,
    )  # fmt: skip
    if config.init_from is None or is_kept:
        return
    shutil.rmtree(config.trained_dir, ignore_errors=True)  # of an interrupted adaptation
    average_runs(config.init_from, trained, TRAINED_SHARE, config.trained_dir)
    recalibrate(config.trained_dir, [config.out / DATA])


def _initial_run(init_from: str | Path | None, model: str, sensor: GelCamera) -> Path | None:
    """Folder of the run that initializes the training; refuses one of another model."""
    if init_from is None:
        size = (sensor.camera.rows, sensor.camera.columns)
        for name in pretrained_runs():
            config = load_config(HOME / name)
            if config.model == model and config.data.camera.image_shape[:2] == size:
                return HOME / name
        return None
    return run_of_model(init_from, model)[0]


def _write_recipe(config: AdaptConfig) -> None:
    """Writes the recipe of a dataset in the light around the optics."""
    source, minutes = config.source, config.minutes
    text = RECIPE_TEXT.format(
        model=config.model,
        shapes=max(round(SHAPES_PER_MINUTE * minutes), 25),
        presses=max(round(PRIMITIVE_PRESSES_PER_MINUTE * minutes), 2),
        optics=_quoted((config.out / OPTICS).absolute()),
        source=_quoted(Path(source).absolute() if source.endswith(".toml") else source),
        target=_quoted(TARGET),
        contact_maps=str(config.predicts_contact).lower(),
    )
    with atomic_write(config.out / RECIPE) as temporary:
        temporary.write_text(text, encoding="utf-8")


def _quoted(text: str | Path) -> str:
    """A text in TOML's notation."""
    escaped = str(text).replace("\\", "\\\\").replace('"', '\\"')
    return f'"{escaped}"'


def _existing_fit(config: AdaptConfig, digest: str) -> OpticsRecord | None:
    """The optics of an interrupted adaptation; refuses other inputs and other content."""
    if not config.out.is_dir() or is_empty(config.out):
        return None
    is_fitted = all((config.out / name).is_file() for name in (OPTICS, RECORD))
    fitted = read_json(config.out / RECORD, OpticsRecord, FORMAT) if is_fitted else None
    if fitted is None and not (config.out / BALL).is_file():
        raise T2TwinError(
            f"{config.out} is not empty and contains no adaptation; choose another folder"
        )
    if fitted is not None and fitted.inputs_sha256 != digest:
        raise T2TwinError(
            f"{config.out} contains an adaptation to other frames or numbers; choose another folder"
        )
    return fitted


def _fit(config: AdaptConfig, digest: str, report: Callable[[str], object]) -> OpticsRecord:
    optics = calibrate(
        config.background, config.presses, config.ball_diameter_mm, config.held_out, config.camera,
        report, config.tolerance, config.sensor,
    )  # fmt: skip
    for sentence in coverage_sentences(optics.coverage, optics.optics.camera):
        report(sentence)
    write_ball(config.out / BALL, config.ball_diameter_mm)
    return write_fit(config.out, optics, config.sensor.own_gel, digest)


def _references(
    config: AdaptConfig, presses: Presses, fitted: OpticsRecord
) -> list[SimulatedReference]:
    """Simulated presses of the held-out frames."""
    assert fitted.uncertainty is not None
    diameters_mm = {press.name: press.ball_diameter_mm for press in fitted.uncertainty.presses}
    names = [press.name for press in fitted.held_out]
    balls = [_ball(config, diameters_mm[name]) for name in names]
    poses = np.array([(press.x_mm, press.y_mm, press.depth_mm) for press in fitted.held_out])
    sensors = SensorPair.of(config.sensor, optics=config.out / OPTICS, frames=1)
    frames = presses.frames[[presses.names.index(name) for name in names]]
    return simulate_reference(names, poses, frames, balls, sensors)


def _ball(config: AdaptConfig, diameter_mm: float) -> Shape:
    """Ball of a diameter; diameters other than the configured one have their own file."""
    is_configured = diameter_mm == config.ball_diameter_mm
    path = config.out / (BALL if is_configured else f"ball-{diameter_mm:g}.step")
    return catalogue.load(path) if path.is_file() else write_ball(path, diameter_mm)


@contextmanager
def _step(name: str, minutes: dict[str, float], report: Callable[[str], object]) -> Iterator[None]:
    """Reports a step, and measures its minutes."""
    report(f"{name}: step {STEPS.index(name) + 1} of {len(STEPS)}")
    start = time.monotonic()
    yield
    minutes[name] = (time.monotonic() - start) / 60.0
    report(f"{name}: {minutes[name]:.1f} minutes")
