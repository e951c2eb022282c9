"""The road from ten minutes with a ball to a translator of one's own DIGIT: five road.

Light: the unit's calibration. World: presses of random shapes and primitives, 0.5 to 12 N, some
untouched, each shape under a light drawn about the calibration, single frames with the unit's own
noise. Data, training, and a check on the presses that the light was not fitted to. Each step is a
command of its own too, and one that is done is not done again.
"""

import hashlib
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from t2twin.adaptation.fitted import CALIBRATION, Fitted, read_fitted, write_fitted
from t2twin.adaptation.page import write_adapt_page
from t2twin.adaptation.real_frame_evaluation import Felt, judge_each, simulate_reference
from t2twin.adaptation.record import Adapted, record_of, write_record
from t2twin.core import arguments
from t2twin.core.errors import T2TwinError
from t2twin.core.files import is_empty, locked, whole_file
from t2twin.primitives_cad import catalogue
from t2twin.primitives_cad.ball import write_ball
from t2twin.primitives_cad.shape import Shape
from t2twin.sim.dataset.generate import generate
from t2twin.sim.dataset.pool import check_workers
from t2twin.sim.digit.calibrate.calibrate import DEFAULT_TOLERANCE, Inputs, calibrate, read_inputs
from t2twin.sim.digit.calibrate.measurements import Tolerance
from t2twin.sim.digit.camera.pinhole import Camera
from t2twin.sim.digit.optics import NOISE_GREY
from t2twin.sim.sensors import Digit, SensorPair
from t2twin.translate.inference.load import load_run
from t2twin.translate.models.presets import find_preset
from t2twin.translate.runs.pretrained import HOME, pretrained_runs
from t2twin.translate.training.train import train
from t2twin.translate.training.warm_start import run_of_model

STEPS = ("light", "data", "training", "check")
BALL, WORLD, DATA = "ball.step", "world.toml", "data"
MINUTES = (1.0, 6000.0)
"""Least and most minutes of a road."""
SHAPES_A_MINUTE = 80
"""Random shapes in the world for each minute of the road: pressing them, four times each, takes
some two fifths of it on two cores (measured)."""
PRIMITIVE_PRESSES_A_MINUTE = 1.5
"""Presses of each primitive for each minute of the road (assumed)."""
TRAINING_PART = 0.5
"""Part of the minutes that training takes (assumed)."""
WORLD_TEXT = """# The world that {model} was adapted in: one unit's light, and what lies about it.
format = 1
name = "adapted"

[[parts]]
shapes = "random"
count = {shapes}
presses = 4
place = {{ normal_mm = 2.5 }}
force_n = {{ low = 0.5, high = 12.0 }}
untouched_share = 0.05
val_share = 0.04

[[parts]]
shapes = "primitives"
presses = {presses}
place = {{ normal_mm = 2.5 }}
force_n = {{ low = 0.5, high = 12.0 }}

[light]
kind = "drawn"
calibration = {calibration}
frames = 1
"""


@dataclass(frozen=True)
class AdaptConfig:
    """Where the road begins, and where it leads."""

    background: Path
    presses: Path
    ball_diameter_mm: float
    out: Path
    held_out: int | None
    minutes: float
    camera: Camera
    model: str
    start: Path | None
    workers: int | None
    tolerance: Tolerance

    def read(self) -> Inputs:
        """The frames and numbers that the calibration is fitted to. Raises T2TwinError for those
        that cannot be used."""
        return read_inputs(
            self.background, self.presses, self.ball_diameter_mm, self.held_out, self.camera,
            self.tolerance,
        )  # fmt: skip

    def digest(self, given: Inputs) -> str:
        """Of those frames and numbers."""
        digest = hashlib.sha256(given.untouched.tobytes() + given.frames.tobytes())
        numbers = (
            given.names, self.ball_diameter_mm, self.held_out, self.camera, self.tolerance,
        )  # fmt: skip
        digest.update(repr(numbers).encode())
        for values in (given.known.diameters_mm, given.known.depths_mm, given.known.forces_n):
            digest.update(values.tobytes())
        return digest.hexdigest()


def adapt(
    background: str | Path,
    presses: str | Path,
    ball_diameter_mm: float,
    out: str | Path,
    held_out: int | None = None,
    minutes: float = 60.0,
    camera: Camera | None = None,
    model: str = "field",
    start: str | Path | None = None,
    workers: int | None = None,
    say: Callable[[str], object] = print,
    tolerance: Tolerance = DEFAULT_TOLERANCE,
) -> Adapted:
    """Walks the road into the folder out, or what is left of it.

    background, presses, ball_diameter_mm, held_out, camera, tolerance: as for `calibrate`. minutes:
    that all steps take together, about, on two cores. model: what is trained, preset cpu. start: a
    run whose weights the training begins with; unless given the one that ships, of a model of which
    one does. workers: processes that press, as many as there are cores unless given. say: told
    which step begins. out then holds calibration.npz, world.toml, data/, a run named like the
    model, adapted.json and index.html. Raises T2TwinError for what `calibrate` refuses, minutes out
    of range, a start of another model, and a folder that holds something else, before anything is
    written.
    """
    find_preset(model, "cpu")
    minutes = arguments.real(minutes, "minutes")
    road = AdaptConfig(
        arguments.path(background, "background"),
        arguments.path(presses, "presses"),
        ball_diameter_mm,
        arguments.path(out, "out"), held_out, minutes,
        Camera() if camera is None else arguments.instance(camera, "camera", Camera),
        model, _start(start, model), workers, arguments.instance(tolerance, "tolerance", Tolerance),
    )  # fmt: skip
    for name, value in (("held_out", held_out), ("workers", workers)):
        if value is not None:
            arguments.whole_number(value, name, low=1)
    arguments.function(say, "say")
    if not MINUTES[0] <= minutes <= MINUTES[1]:
        raise T2TwinError(
            f"minutes is {minutes:g}; it must be from {MINUTES[0]:g} to {MINUTES[1]:g}"
        )
    check_workers(workers)
    given = road.read()
    asked = road.digest(given)
    fitted = _kept(road, asked)
    clock = _Clock(say)
    with locked(road.out):
        with clock.step("light"):
            fitted = fitted or _kept(road, asked) or _fit(road, asked, say)
            _write_world(road)
        with clock.step("data"):
            generate(road.out / DATA, world=road.out / WORLD, workers=workers)
        with clock.step("training"):
            run_dir = road.out / model
            part = TRAINING_PART * minutes
            train(model, road.out / DATA, "cpu", run_dir, minutes=part, init_from=road.start)
    with clock.step("check"):  # without the lock, which the page takes itself
        run = load_run(run_dir)
        judged = judge_each(run, _felt(road, given, fitted), given.untouched)
        adapted = record_of(run, judged, given.untouched, fitted, clock.minutes)
        write_adapt_page(road.out, run, judged, adapted)
    write_record(road.out, adapted)
    return adapted


def _start(start: str | Path | None, model: str) -> Path | None:
    """The folder of the run to begin with. Raises T2TwinError for one that is not there, or is of
    another model."""
    if start is None:
        return HOME / model if model in pretrained_runs() else None
    return run_of_model(start, model)[0]


def _kept(road: AdaptConfig, asked: str) -> Fitted | None:
    """The calibration that an earlier start made. Raises T2TwinError where it was asked something
    else, or the folder holds other things."""
    if not road.out.is_dir() or is_empty(road.out):
        return None
    fitted = read_fitted(road.out)
    if fitted is None and not (road.out / BALL).is_file():
        raise T2TwinError(f"{road.out} is not empty and holds no adaptation; choose another folder")
    if fitted is not None and fitted.asked != asked:
        raise T2TwinError(
            f"{road.out} holds an adaptation to other frames or numbers; choose another folder"
        )
    return fitted


def _fit(road: AdaptConfig, asked: str, say: Callable[[str], object]) -> Fitted:
    report = calibrate(
        road.background, road.presses, road.ball_diameter_mm, road.held_out, road.camera, say,
        road.tolerance,
    )  # fmt: skip
    write_ball(road.out / BALL, road.ball_diameter_mm)
    return write_fitted(road.out, report, asked, road.ball_diameter_mm)


def _write_world(road: AdaptConfig) -> None:
    """The recipe, unless an earlier start wrote it: what was begun is ended as it was."""
    if (road.out / WORLD).is_file():
        return
    path = str((road.out / CALIBRATION).absolute())
    text = WORLD_TEXT.format(
        model=road.model,
        shapes=max(round(SHAPES_A_MINUTE * road.minutes), 25),
        presses=max(round(PRIMITIVE_PRESSES_A_MINUTE * road.minutes), 2),
        calibration='"' + path.replace("\\", "\\\\").replace('"', '\\"') + '"',
    )
    with whole_file(road.out / WORLD) as temporary:
        temporary.write_text(text, encoding="utf-8")


def _felt(road: AdaptConfig, given: Inputs, fitted: Fitted) -> list[Felt]:
    """The held-out presses, as the twin makes them."""
    balls = [_ball(road, diameter_mm) for diameter_mm in fitted.diameters_mm]
    sensors = SensorPair(Digit(calibration=str(road.out / CALIBRATION), noise_grey=NOISE_GREY))
    chosen = [given.names.index(one.name) for one in fitted.held_out]
    return simulate_reference(
        [given.names[index] for index in chosen], fitted.poses, given.frames[chosen], balls, sensors
    )


def _ball(road: AdaptConfig, diameter_mm: float) -> Shape:
    """As a shape; others than the one that was asked for have a file of their own."""
    own = diameter_mm == road.ball_diameter_mm
    path = road.out / (BALL if own else f"ball-{diameter_mm:g}.step")
    return catalogue.load(path) if path.is_file() else write_ball(path, diameter_mm)


class _Clock:
    """Minutes that each step took."""

    def __init__(self, say: Callable[[str], object]) -> None:
        self.minutes: dict[str, float] = {}
        self._say = say

    @contextmanager
    def step(self, name: str) -> Iterator[None]:
        self._say(f"{name}: step {STEPS.index(name) + 1} of {len(STEPS)}")
        start = time.monotonic()
        yield
        self.minutes[name] = (time.monotonic() - start) / 60.0
        self._say(f"{name}: {self.minutes[name]:.1f} minutes")
