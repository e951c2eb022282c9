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


def demo(out: Path = Path(), minutes: float | None = None) -> None:
    """Run all steps: shapes, a dataset, two trainings, their evaluation, and the report.

    The same command continues a stopped demo.

    Args:
        out: Folder in which data/ and runs/ are created.
        minutes: Approximate duration on two cores, at least 1: a smaller dataset, and shorter
            trainings. Default: scale small, and 1.1 minutes for each training.
    """
    from t2twin import cli
    from t2twin.core import arguments

    if minutes is not None:
        minutes = arguments.number(minutes, "minutes", low=MIN_MINUTES)
    started = time.monotonic()
    steps = commands(out, minutes)
    for number, words in enumerate(steps, start=1):
        print(f"\nstep {number} of {len(steps)}: t2twin {shlex.join(words)}", flush=True)
        cli.main(words)
    print(f"the demo took {(time.monotonic() - started) / 60.0:.1f} minutes")


def commands(out: Path, minutes: float | None) -> list[list[str]]:
    """The commands. They depend on nothing else, so that the same demo continues a stopped one."""
    from t2twin.core.machine import cores
    from t2twin.translate.models.presets import PAPER_MODELS

    scale, training_minutes = "small", TRAINING_MINUTES
    if minutes is not None:
        scale = "small" if minutes >= SMALL_MINUTES else "smoke"
        training_minutes = round(min(TRAINING_SHARE * minutes, TRAINING_MINUTES), 2)
    # Starting processes takes longer than the few pairs of scale smoke.
    workers = 1 if scale == "smoke" else cores()
    data, runs = out / "data" / scale, out / "runs" / scale
    trained = [runs / model for model in PAPER_MODELS]
    of_data = ("--data", data, "--out")
    steps = [
        ("primitives", "--out", out / "data/primitives"),
        ("simdata", "--scale", scale, "--workers", workers, "--out", data),
        *(("train", run.name, *of_data, run, "--minutes", training_minutes) for run in trained),
        ("evaluate", PRETRAINED, *trained, "--split", "both", *of_data, runs / "evaluate"),
        ("report", *of_data, runs / "report", "--runs", PRETRAINED, *trained),
    ]
    return [[str(word) for word in step] for step in steps]
