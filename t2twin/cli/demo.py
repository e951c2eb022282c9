"""t2twin demo: all steps from the shapes to the report, as six commands."""

import shlex
import time
from pathlib import Path

PRETRAINED = "field"
"""The pretrained run that is evaluated together with the trained ones."""

MIN_MINUTES = 1.0
"""Smallest duration, minutes (assumed: imports, compiling and the shapes take most of it)."""

SMALL_MINUTES = 4.0
"""Least duration with the dataset of scale small; below it, the scale is smoke (assumed: on two
cores the dataset, the evaluation and the report take about half of it)."""

TRAINING_SHARE = 0.2
"""Duration of each of the two trainings as a share of the whole (assumed)."""

TRAINING_MINUTES = 1.1
"""Longest duration of a training, minutes, and that of a demo without a given duration."""


def demo(
    out: Path = Path(),
    minutes: float | None = None,
) -> None:
    """Run all steps: shapes, a dataset, two trainings, their evaluation, and the report.

    The same command continues a stopped demo.

    Args:
        out: Folder in which data/ and runs/ are created.
        minutes: Approximate duration on two cores, at least 1: a smaller dataset, and shorter
            trainings. Default: scale small, and 1.1 minutes for each training.
    """
    from t2twin.cli.dataset import SimdataOptions, simdata
    from t2twin.cli.evaluate import evaluate, report
    from t2twin.cli.press import primitives
    from t2twin.cli.train import train
    from t2twin.core import arguments
    from t2twin.core.machine import cores
    from t2twin.translate.models.presets import PAPER_MODELS
    from t2twin.translate.runs.config import resolve_run

    arguments.path(out, "out")
    if minutes is not None:
        minutes = arguments.number(minutes, "minutes", low=MIN_MINUTES)
    started = time.monotonic()
    scale, training_minutes = plan(minutes)
    # Starting processes takes longer than the few pairs of scale smoke.
    workers = 1 if scale == "smoke" else cores()
    shapes, data, runs = out / "data/primitives", out / "data" / scale, out / "runs" / scale
    trained = [runs / model for model in PAPER_MODELS]
    evaluated = (resolve_run(PRETRAINED), *trained)

    _announce(1, "primitives", "--out", shapes)
    primitives(shapes)
    _announce(2, "simdata", "--scale", scale, "--workers", workers, "--out", data)
    simdata(SimdataOptions(scale=scale, out=data, workers=workers))
    for number, run in enumerate(trained):
        limit = ("--minutes", training_minutes)
        _announce(3 + number, "train", run.name, "--data", data, "--out", run, *limit)
        train(run.name, data, out=run, minutes=training_minutes)
    folder = runs / "evaluate"
    _announce(
        5, "evaluate", PRETRAINED, *trained, "--data", data, "--split", "both", "--out", folder
    )
    evaluate(evaluated, (data,), "both", folder)
    folder = runs / "report"
    _announce(6, "report", "--data", data, "--runs", PRETRAINED, *trained, "--out", folder)
    report(folder, data, evaluated)
    print(f"the demo took {(time.monotonic() - started) / 60.0:.1f} minutes")


def plan(minutes: float | None) -> tuple[str, float]:
    """Scale of the dataset and minutes of each training. minutes: of the demo, None if not given.

    They depend on nothing else, so that the same command continues a stopped demo.
    """
    if minutes is None:
        return "small", TRAINING_MINUTES
    scale = "small" if minutes >= SMALL_MINUTES else "smoke"
    return scale, round(min(TRAINING_SHARE * minutes, TRAINING_MINUTES), 2)


def _announce(step: int, *words: object) -> None:
    """Prints the command of the next step."""
    print(f"\nstep {step} of 6: t2twin {shlex.join(map(str, words))}", flush=True)
