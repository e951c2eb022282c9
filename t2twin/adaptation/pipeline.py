"""Adapts a translator to one gel camera, from about ten minutes of presses of a ball.

A finished step is not repeated. light: calibrates the optics, without the held-out presses and on
all. data: simulates a dataset in the light around the optics, with the noise of single frames.
training: trains a translator on it, and averages the weights of a field run with those of the run
that initialized it. check: keeps the more accurate of both on the held-out presses.
"""

import hashlib
import json
import shutil
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import asdict, dataclass, replace
from pathlib import Path

import numpy as np

from t2twin.adaptation import real_frame_evaluation as check
from t2twin.core import arguments
from t2twin.core.errors import T2TwinError
from t2twin.core.files import atomic_write, is_empty, locked, write_json
from t2twin.core.frame_order import UPRIGHT, FrameOrder
from t2twin.core.records import read_json
from t2twin.core.templates import render
from t2twin.optics_fit import background_warning
from t2twin.sim.calibrate.calibrate import (
    DEFAULT_TOLERANCE,
    MARKED,
    OPTICS,
    RECORD,
    OpticsRecord,
    Tolerance,
    calibrate,
    read_presses,
    sensor_and_camera,
    write_fit,
)
from t2twin.sim.calibrate.fit import Presses
from t2twin.sim.calibrate.frames import coverage_sentences
from t2twin.sim.dataset.generate import check_workers, make_dataset, sensor_info
from t2twin.sim.optical.camera import Camera
from t2twin.sim.optical.gel_camera import GelCamera
from t2twin.sim.sensors.defaults import SOURCE, TARGET
from t2twin.sim.sensors.files import load_sensor
from t2twin.sim.sensors.pair import SensorPair
from t2twin.translate.data.pairs import DataInfo
from t2twin.translate.inference.load import load_run
from t2twin.translate.models.presets import find_preset
from t2twin.translate.runs.checkpoint import average_runs
from t2twin.translate.runs.config import HOME, load_config, pretrained_runs
from t2twin.translate.training.train import find_weights, recalibrate, train

STEPS = ("light", "data", "training", "check")
BALL, RECIPE, DATA, TRAINING = "ball.step", "recipe.toml", "data", "training"
AVERAGED, ADAPTED = "averaged", "adapted.json"
MIN_MINUTES, MAX_MINUTES = 1.0, 6000.0

TRAINING_SHARE = 0.5  # share of the minutes that the training takes (assumed)

# Learning rate of the training from a field run, before its reduction after a warm start (assumed:
# a third of the preset's is enough for small changes)
LEARNING_RATE = 1e-4

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

PRIMITIVE_PRESSES_PER_MINUTE = 1.5  # of each primitive, per minute of the adaptation (assumed)


@dataclass(frozen=True)
class AdaptConfig:
    """Arguments of an adaptation, see `adapt`."""

    background: Path
    presses: Path
    ball_diameter_mm: float
    out: Path
    held_out: int | None
    minutes: float
    camera: Camera
    model: str
    init_from: Path | None  # None without an initial run
    workers: int | None
    tolerance: Tolerance
    source: str  # the sensor as given
    sensor: GelCamera
    order: FrameOrder

    def __post_init__(self) -> None:
        find_preset(self.model, "cpu")
        check_workers(self.workers)
        arguments.number(self.minutes, "minutes", MIN_MINUTES, MAX_MINUTES)
        if self.held_out is not None:
            arguments.whole_number(self.held_out, "held_out", low=1)

    @property
    def averages(self) -> bool:
        """Whether the weights are averaged with the initial ones: those of a field run, which
        changes little from its initial run."""
        return self.model == "field" and self.init_from is not None

    @property
    def trained_dir(self) -> Path:
        """Folder of the trained run, or of its mean with the initial one."""
        return self.out / (AVERAGED if self.averages else TRAINING) / self.model

    def digest(self, presses: Presses) -> str:
        """SHA-256 of the frames and numbers of the optics."""
        inputs = (
            presses.background.tobytes(), presses.frames.tobytes(), presses.names, self.held_out,
            self.ball_diameter_mm, self.camera, self.tolerance, self.sensor.spec,
            presses.diameters_mm.tolist(), presses.depths_mm.tolist(), presses.forces_n.tolist(),
        )  # fmt: skip
        return hashlib.sha256(repr(inputs).encode()).hexdigest()


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
    order: FrameOrder = UPRIGHT,
) -> check.AdaptationResult:
    """Adapts a translator to one gel camera, or resumes an interrupted adaptation.

    Writes optics.npz, optics_coverage.png, optics.json, recipe.toml, data/, training/, averaged/,
    a run named after the model, adapted.json and index.html to the folder out. The run is the
    trained one, a field run with weights averaged with those of init_from, or a copy of init_from
    if that is more accurate on the held-out presses.

    background, presses, ball_diameter_mm, held_out, camera, report, tolerance, sensor, order: as
    for `calibrate`. minutes: approximate duration of all steps on two cores, 1 to 6000. model:
    trained with the preset cpu; a field run changes little from its initial run. init_from: run
    that initializes the training; by default the pretrained run of the model for images of the
    sensor's size, if there is one. workers: processes that press; by default one per core. Raises
    T2TwinError, before anything is written, for invalid arguments and a folder with other content.
    """
    gel_camera, camera = sensor_and_camera(sensor, camera)
    arguments.function(report, "report")
    arguments.instance(order, "order", FrameOrder)
    config = AdaptConfig(
        arguments.path(background, "background"), arguments.path(presses, "presses"),
        ball_diameter_mm, arguments.path(out, "out"), held_out, minutes, camera, model,
        _initial_run(init_from, model, gel_camera), workers,
        arguments.instance(tolerance, "tolerance", Tolerance), str(sensor), gel_camera, order,
    )  # fmt: skip
    if warning := background_warning(config.background, order, camera, gel_camera.name):
        report(f"warning: {warning}")
    given, *_ = read_presses(
        config.background, config.presses, ball_diameter_mm, held_out, gel_camera, camera,
        tolerance, order)  # fmt: skip
    out, digest = config.out, config.digest(given)
    fitted = _existing_fit(out, digest, given)
    spent: dict[str, float] = {}  # minutes
    with locked(out):
        with _step("light", spent, report):
            fitted = fitted or _fit(config, digest, report)
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
) -> check.AdaptationResult:
    """Writes the more accurate run and the page. minutes: by step, of the steps so far."""
    assert fitted.uncertainty is not None
    diameters_mm = {press.name: press.ball_diameter_mm for press in fitted.uncertainty.presses}
    names = [press.name for press in fitted.held_out]
    references = check.simulate_references(
        names,
        np.array([(press.x_mm, press.y_mm, press.depth_mm) for press in fitted.held_out]),
        presses.frames[[presses.names.index(name) for name in names]],
        [diameters_mm[name] for name in names],
        SensorPair.of(config.sensor, optics=config.out / OPTICS, frames=1),
    )
    folders, still = {check.TRAINED: config.trained_dir}, presses.background
    if config.init_from is not None:
        folders[check.INITIAL] = config.init_from
    runs = {name: load_run(folder) for name, folder in folders.items()}
    real, simulated = (
        {name: check.evaluate_frames(run, each, references, still) for name, run in runs.items()}
        for each in (references.frames, references.simulated)
    )
    on_real, on_simulated = (
        {name: check.AdaptationScores.of(errors) for name, (_, errors) in each.items()}
        for each in (real, simulated)
    )
    kept = check.choose(on_real, on_simulated)
    check.publish(folders[kept], kept, on_real, on_simulated, config.out / config.model)
    zero, mean_array = check.baseline_rmse_percent(references, runs[kept])
    result = check.AdaptationResult(
        model=config.model,
        kept=kept,
        real=on_real,
        simulated=on_simulated,
        background_counts={n: check.background_counts(run, still) for n, run in runs.items()},
        presses=len(names),
        optics_psnr_db=fitted.scores["calibrated"].psnr_db,
        optics_ssim=fitted.scores["calibrated"].ssim,
        zero_rmse_percent=zero,
        mean_array_rmse_percent=mean_array,
        minutes=minutes,
        uncertainty=fitted.uncertainty,
    )
    check.write_adapt_page(config.out, runs[kept], real[kept], simulated[kept], references, result)
    return result


def _train(config: AdaptConfig) -> None:
    """Writes the trained run, and of a field run the mean with the initial one."""
    preset = find_preset(config.model, "cpu")
    if config.averages:
        preset = replace(preset, name="adapt", learning_rate=LEARNING_RATE, drift=DRIFT)
    trained = config.out / TRAINING / config.model
    train(
        config.model, config.out / DATA, preset, trained, minutes=TRAINING_SHARE * config.minutes,
        init_from=config.init_from, frame_check=not config.averages,
    )  # fmt: skip
    if config.averages:
        assert config.init_from is not None
        shutil.rmtree(config.trained_dir, ignore_errors=True)  # of an interrupted adaptation
        average_runs(config.init_from, trained, TRAINED_SHARE, config.trained_dir)
        recalibrate(config.trained_dir, [config.out / DATA])


def _initial_run(init_from: str | Path | None, model: str, sensor: GelCamera) -> Path | None:
    """Folder of the run that initializes the training; refuses one that does not fit."""
    size = (sensor.camera.rows, sensor.camera.columns)
    for name in pretrained_runs() if init_from is None else ():
        config = load_config(HOME / name)
        if config.model == model and config.data.camera.image_shape[:2] == size:
            init_from = name
            break
    if init_from is None:
        return None
    data = DataInfo("0" * 64, sensor_info(sensor), sensor_info(load_sensor(TARGET)))
    return find_weights(init_from, model, find_preset(model, "cpu"), data).parent


def _write_recipe(config: AdaptConfig) -> None:
    """Writes the ball, and the recipe of a dataset in the light around the optics, with the contact
    if the initial run predicts it."""
    from t2twin.primitives_cad.solids import write_ball  # slow to import

    write_ball(config.out / BALL, config.ball_diameter_mm)
    source, minutes, initial = config.source, config.minutes, config.init_from
    has_contact = initial is not None and load_config(initial).predicts_contact
    # TOML's notation of texts is that of JSON.
    source, target, optics = (
        json.dumps(str(each), ensure_ascii=False)
        for each in (
            Path(source).absolute() if source.endswith(".toml") else source,
            TARGET,
            (config.out / OPTICS).absolute(),
        )
    )
    text = render(
        "adaptation/templates/recipe.toml",
        model=config.model,
        shapes=max(round(SHAPES_PER_MINUTE * minutes), 25),
        presses=max(round(PRIMITIVE_PRESSES_PER_MINUTE * minutes), 2),
        optics=optics,
        source=source,
        target=target,
        contact_maps=str(has_contact).lower(),
    )
    with atomic_write(config.out / RECIPE) as temporary:
        temporary.write_text(text, encoding="utf-8")


def _existing_fit(out: Path, digest: str, presses: Presses) -> OpticsRecord | None:
    """The optics of an interrupted adaptation; refuses other inputs, other content, and markers."""
    if MARKED in presses.notes:  # simulated presses have none
        raise T2TwinError("the frames show printed markers; expected a gel without markers")
    if not out.is_dir() or is_empty(out):
        return None
    if not (out / RECORD).is_file():
        raise T2TwinError(f"{out} is not empty and contains no adaptation; choose another folder")
    fitted = read_json(out / RECORD, OpticsRecord, "`t2twin adapt`")
    if fitted.inputs_sha256 != digest:
        raise T2TwinError(
            f"{out} contains an adaptation to other frames or numbers; choose another folder"
        )
    return fitted


def _fit(config: AdaptConfig, digest: str, report: Callable[[str], object]) -> OpticsRecord:
    optics = calibrate(
        config.background, config.presses, config.ball_diameter_mm, config.held_out, config.camera,
        report, config.tolerance, config.sensor, config.order,
    )  # fmt: skip
    for sentence in coverage_sentences(optics.covered, optics.next_mm):
        report(sentence)
    return write_fit(config.out, optics, config.sensor.own_gel, digest)


@contextmanager
def _step(name: str, minutes: dict[str, float], report: Callable[[str], object]) -> Iterator[None]:
    """Reports a step, and measures its minutes."""
    report(f"{name}: step {STEPS.index(name) + 1} of {len(STEPS)}")
    start = time.monotonic()
    yield
    minutes[name] = (time.monotonic() - start) / 60.0
    report(f"{name}: {minutes[name]:.1f} minutes")
