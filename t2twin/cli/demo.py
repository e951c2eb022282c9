"""t2twin demo: all steps from the shapes to the report."""

import math
import shlex
import shutil
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Annotated, NamedTuple

import tyro

STEPS = 6
"""Number of the commands of a demo."""

TRAININGS = 2
"""Number of these that are trainings."""

PRETRAINED = "field"
"""The pretrained run that is evaluated together with the trained ones."""

MIN_MINUTES = 1.0
"""Smallest limit, minutes (assumed: imports, compiling and the shapes take most of it)."""

USED_SHARE = 0.95
"""Share of the limit that is planned (assumed); the rest is for start and end of the process."""

TRAINING_MINUTES = 1.1
"""Minutes of each training, unless a limit leaves less."""

MIN_TRAINING_MINUTES = 0.01
"""Minutes of a training for which no time is left: it has one epoch."""

SHEET_SHARE = 0.15
"""Share of the limit after which the contact sheet of the shapes is omitted (assumed)."""

SMALL_TRAINING_MINUTES = 0.3
"""Minutes that a dataset of scale small must leave for each training; otherwise the scale is smoke
(assumed)."""

PROBE = ("square-2", "circle-1", "hemisphere-2", "pliers/teeth")
"""Shapes whose presses measure the speed of the machine."""

PAIR_S = 0.05
"""Time of a press into both sensors with a prediction, on the machine of reference, s of one core
(measured on 2026-11-23, one of two busy cores). The following times are of the same machine."""

PAIRS = 1204
"""Pairs of the dataset of scale small."""

POOL_S = 6.0
"""Time in which the processes of a dataset start, s."""

TRAINING_S = 5.0
"""Time of a training outside of its epochs, s: decoding, time estimate, model card."""

REPORT_S = {"small": 25.0, "smoke": 20.0}
"""Time of the evaluation and the report by scale, s. The order is that of preference."""


def demo(
    out: Annotated[Path, tyro.conf.arg(metavar="DIR")] = Path(),
    minutes: Annotated[float | None, tyro.conf.arg(metavar="FLOAT")] = None,
) -> None:
    """Run all steps: shapes, a dataset, two trainings, their evaluation, and the report.

    The same command continues a stopped demo.

    Args:
        out: Folder in which data/ and runs/ are created.
        minutes: Limit of the whole run, at least 1. The steps are made smaller by the measured
            speed of this machine. Default: scale small, and 1.1 minutes for each training.
    """
    from t2twin.core import arguments

    if minutes is not None:
        minutes = arguments.number(minutes, "minutes", low=MIN_MINUTES)
    Demo(out, minutes).run()


class Clock:
    """Time of a demo with a limit in minutes, None for no limit."""

    def __init__(self, minutes: float | None) -> None:
        self._start = time.monotonic()
        self.limit_s = math.inf if minutes is None else 60.0 * minutes

    @property
    def elapsed_s(self) -> float:
        return time.monotonic() - self._start

    @property
    def left_s(self) -> float:
        """Time until the limit, s, without a reserve for the end of the process."""
        return USED_SHARE * self.limit_s - self.elapsed_s


def scale_that_fits(left_s: float, slowness: float, cores: int) -> str:
    """The scale of the dataset for the time that is left.

    left_s: until the limit, s. slowness: as of `slowness`.
    """
    data_s = slowness * (POOL_S + PAIRS * PAIR_S / cores)
    minutes = training_minutes(left_s - data_s, slowness, "small", TRAININGS)
    return "small" if minutes >= SMALL_TRAINING_MINUTES else "smoke"


def training_minutes(left_s: float, slowness: float, scale: str, trainings: int) -> float:
    """Minutes of the next of several trainings, so that all further steps end in left_s, s."""
    epochs_s = left_s - slowness * (REPORT_S[scale] + trainings * TRAINING_S)
    return min(max(epochs_s / trainings / 60.0, MIN_TRAINING_MINUTES), TRAINING_MINUTES)


class Demo:
    """The steps of a demo in the folder out. minutes: limit, None for no limit."""

    def __init__(self, out: Path, minutes: float | None) -> None:
        from t2twin.core import arguments

        arguments.path(out, "out")
        self.out = out
        self.minutes = minutes
        self.clock = Clock(minutes)
        self._step = 0

    def run(self) -> None:
        """Runs the steps that are not finished. Raises T2TwinError as their commands do."""
        from t2twin.translate.models.presets import PAPER_MODELS

        self._write_primitives()
        scale = self._make_dataset()
        data, runs = self.out / "data" / scale, self.out / "runs" / scale
        trained = [runs / model for model in PAPER_MODELS]
        for number, folder in enumerate(trained):
            self._train(folder, data, scale, len(trained) - number)
        self._evaluate(trained, data, runs / "evaluate")
        self._write_report(trained, data, runs / "report")
        elapsed = self.clock.elapsed_s / 60.0
        print(f"the demo took {elapsed:.1f} minutes")
        if self.minutes is not None and elapsed > self.minutes:
            print(f"this machine is too slow for a demo of {self.minutes:g} minutes")

    def _write_primitives(self) -> None:
        from t2twin.primitives_cad.contact_sheet import draw_sheet
        from t2twin.primitives_cad.export import MANIFEST, export_shapes

        folder = self.out / "data" / "primitives"
        sheet = folder / "contact_sheet.png"
        with self._command("primitives", "--out", folder):
            if not (folder / MANIFEST).is_file():
                export_shapes(folder)
            if self.clock.elapsed_s > SHEET_SHARE * self.clock.limit_s:
                print("the contact sheet is omitted for lack of time; `t2twin primitives` draws it")
            elif not sheet.is_file():
                draw_sheet(sheet)
            print(f"STEP, STL and {MANIFEST} are in {folder}")

    def _make_dataset(self) -> str:
        """Makes the dataset, or continues it. Returns its scale."""
        from t2twin.cli.dataset import SimdataOptions, simdata
        from t2twin.core.machine import cores

        scale = "small"
        if self.minutes is not None:
            made = [each for each in REPORT_S if is_complete(self.out / "data" / each)]
            scale = made[0] if made else scale_that_fits(self.clock.left_s, slowness(), cores())
        folder = self.out / "data" / scale
        # Starting processes takes longer than the few pairs of scale smoke.
        workers = 1 if scale == "smoke" else cores()
        with self._command("simdata", "--scale", scale, "--workers", workers, "--out", folder):
            if scale == "smoke":
                print("the dataset is of scale smoke instead of small for lack of time")
            simdata(SimdataOptions(scale=scale, out=folder, workers=workers))
        return scale

    def _train(self, folder: Path, data: Path, scale: str, trainings: int) -> None:
        """Trains a run, or continues it. trainings: number of those that are not finished."""
        from t2twin.core.files import locked
        from t2twin.translate.training.train import train

        minutes, allowed = TRAINING_MINUTES, math.inf
        if self.minutes is not None:
            allowed = training_minutes(self.clock.left_s, slowness(), scale, trainings)
            minutes = round(allowed, 2)
        earlier = earlier_training(folder)
        if earlier is not None and not earlier.epochs and earlier.remaining > allowed:
            with locked(folder):
                shutil.rmtree(folder)  # without an epoch, nothing is lost
            earlier = None
        limit = minutes if earlier is None else earlier.limit
        option = () if limit is None else ("--minutes", limit)
        with self._command("train", folder.name, "--data", data, "--out", folder, *option):
            if earlier is not None and earlier.remaining > allowed:
                print(
                    f"the training stays as it is after {earlier.epochs} epoch(s) for lack of "
                    "time; this command continues it"
                )
                return
            if earlier is None and minutes < TRAINING_MINUTES:
                print(f"it has less than {TRAINING_MINUTES:g} minutes for lack of time")
            train(folder.name, data, "cpu", folder, minutes=limit)

    def _evaluate(self, runs: list[Path], data: Path, folder: Path) -> None:
        from t2twin.cli.evaluate import evaluate
        from t2twin.translate.runs.pretrained import resolve_run

        words = (PRETRAINED, *runs, "--data", data, "--split", "both", "--out", folder)
        with self._command("evaluate", *words):
            evaluated = (resolve_run(PRETRAINED), *runs)
            if is_evaluated(folder, evaluated, data):
                print(f"{folder} is finished. Nothing to do.")
            else:
                evaluate(evaluated, (data,), "both", folder)

    def _write_report(self, runs: list[Path], data: Path, folder: Path) -> None:
        from t2twin.cli.evaluate import report
        from t2twin.translate.runs.pretrained import resolve_run

        words = ("--data", data, "--runs", PRETRAINED, *runs, "--out", folder)
        with self._command("report", *words):
            report(folder, data, (resolve_run(PRETRAINED), *runs))

    @contextmanager
    def _command(self, *words: object) -> Iterator[None]:
        """Prints the command of the next step before it, and its duration after it."""
        self._step += 1
        name, start = f"step {self._step} of {STEPS}", time.monotonic()
        print(f"\n{name}: t2twin {shlex.join(map(str, words))}", flush=True)
        yield
        print(f"{name}: {time.monotonic() - start:.0f} s", flush=True)


def slowness() -> float:
    """Measured time of a press and a prediction on this machine relative to PAIR_S.

    Compiles the loops of a press, unless they are cached.
    """
    from t2twin.core.compile_ahead import compile_optics_ahead

    compile_optics_ahead()
    from t2twin.translate.inference.load import load_run
    from t2twin.translate.models.distributed import use_all_cores
    from t2twin.twin import Twin

    use_all_cores()
    twin, network = Twin(), load_run(PRETRAINED)
    for shape in PROBE:
        network.predict(twin.press(shape).image)
    start = time.monotonic()
    for shape in PROBE:
        network.predict(twin.press(shape, x_mm=1.0).image)
    return (time.monotonic() - start) / len(PROBE) / PAIR_S


def is_complete(folder: Path) -> bool:
    """Whether a folder contains a finished dataset."""
    from t2twin.sim.dataset.store import INFO, read_info

    return (folder / INFO).is_file() and read_info(folder).complete


class EarlierTraining(NamedTuple):
    """A training that an earlier demo began. limit: its minutes, None for no limit. remaining:
    those that are left; 0 if it is finished. epochs: number of its finished epochs."""

    limit: float | None
    remaining: float
    epochs: int


def earlier_training(run: Path) -> EarlierTraining | None:
    """The training in the folder of a run, or None."""
    from t2twin.translate.runs.checkpoint import load_history
    from t2twin.translate.runs.config import CONFIG, LAST, load_config
    from t2twin.translate.training.early_stopping import stop_reason

    if not (run / CONFIG).is_file():
        return None
    config = load_config(run)
    history = load_history(run / LAST) if (run / LAST).is_file() else []
    remaining = 0.0
    if stop_reason(config, history) is None:
        limit = math.inf if config.minutes is None else config.minutes
        remaining = limit - sum(record.seconds for record in history) / 60.0
    return EarlierTraining(config.minutes, remaining, len(history))


def is_evaluated(folder: Path, runs: Sequence[Path], data: Path) -> bool:
    """Whether a folder contains the evaluation of these runs on both splits of a dataset."""
    from t2twin.core.errors import T2TwinError
    from t2twin.sim.dataset.store import INFO, sha256_of
    from t2twin.translate.evaluation.files import read_evaluation
    from t2twin.translate.runs.config import BEST

    weights, dataset = [sha256_of(run / BEST) for run in runs], sha256_of(data / INFO)
    try:
        found = [read_evaluation(folder / split) for split in ("val", "test")]
    except T2TwinError:
        return False
    return all(
        each.info_sha256 == dataset
        and [row.weights_sha256 for row in each.runs.values()] == weights
        for each in found
    )
