"""t2twin train, calibrate-uncertainty, evaluate, report, translate, live, export and demo"""

import math
import shlex
import sys
import time
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

import tyro

from t2twin.core.errors import T2TwinError, counted
from t2twin.core.frame_order import UPRIGHT, FrameOrder

Split = Literal["val", "test", "both"]

PRETRAINED = "field"  # the pretrained run
MAX_PRINTED = 5  # images whose counts are printed; the output files contain all

MIN_MINUTES = 1.0  # of a demo (assumed: imports, compiling and the shapes take most of it)
# Least duration with the dataset of scale small; below it, the scale is smoke (assumed: on two
# cores the dataset, the evaluation and the report take about half of it).
SMALL_MINUTES = 4.0
TRAINING_SHARE = 0.2  # each of the two trainings' share of the demo (assumed)
TRAINING_MINUTES = 1.1  # longest duration of a training


def train(
    model: tyro.conf.Positional[str],
    data: Path,
    preset: str = "cpu",
    out: Path | None = None,
    seed: int = 0,
    epochs: int | None = None,
    minutes: float | None = None,
    steps: int | None = None,
    init_from: str | None = None,
    direction: Literal[
        "source-to-target", "target-to-source", "image-to-counts", "counts-to-image"
    ] = "source-to-target",
    iou_weight: float | None = None,
    contact_alone: bool = False,
) -> None:
    """Train a translator, or resume a stopped training.

    Args:
        model: touch2touch (any pair of sensors), resnet18 (to counts), or field (from images to
            counts; needs a dataset with dense counts).
        data: Folder of the dataset.
        preset: cpu (two cores), paper (as published; for a GPU) or smoke (seconds).
        out: Folder of the run. Default: runs/MODEL, or runs/MODEL-DIRECTION.
        seed: Seed of weights, order, dropout and augmentation.
        epochs: Maximum epochs. Default: the preset's.
        minutes: Maximum minutes. The epochs are planned to fit; with a fixed learning rate, the
            epoch in which they are over is the last.
        steps: Maximum steps, rounded to whole epochs. Default: the preset's.
        init_from: Run of the same model, or name of a pretrained run, for the initial weights.
        direction: Of the dataset's sensors; image-to-counts and counts-to-image are for a gel
            camera and a taxel array, whichever is the source.
        iou_weight: Weight of the soft IoU loss of the tactile image; that of L1 is 100. touch2touch
            only. Default: the preset's, 0.
        contact_alone: Train only the layers that predict the contact, on those of the field run of
            --init-from, whose other predictions stay as they are.
    """
    from t2twin.translate.training.train import train as run

    suffix = "" if direction in ("source-to-target", "image-to-counts") else f"-{direction}"
    folder = out or Path("runs") / f"{model}{suffix}"
    run(
        model, data, preset, folder, seed=seed, epochs=epochs, minutes=minutes, steps=steps,
        init_from=init_from, direction=direction, iou_weight=iou_weight,
        contact_alone=contact_alone,
    )  # fmt: skip


def calibrate_uncertainty(run: tyro.conf.Positional[Path], data: tuple[Path, ...]) -> None:
    """Recalibrate the predicted uncertainty of a field run on validation presses of several
    datasets.

    Args:
        run: Folder of a trained field run; the calibration is written into its best weights.
        data: Folders of datasets with dense counts, including the run's own. Each contributes the
            same number of validation presses.
    """
    from t2twin.translate.training.train import recalibrate

    if not data:
        raise T2TwinError("there is no dataset to calibrate on; give folders with --data")
    presses = recalibrate(run, data)
    print(f"standard deviations calibrated on {presses:,} presses; written to {run}")


def evaluate(
    runs: tyro.conf.Positional[
        Annotated[tuple[Path, ...], tyro.conf.arg(help_behavior_hint="(one or more)")]
    ],
    data: Path,
    split: Split = "val",
    out: Path | None = None,
    background: Path | None = None,
) -> None:
    """Evaluate trained translators, with baselines and error floors; writes metrics.json.

    Args:
        runs: Folders of trained runs, or names of pretrained runs.
        data: Folder of the dataset, of training or any other. touch2touch also accepts another
            taxel layout inside its own, field any on the cover.
        split: val (in the paper's protocol: new versions of primitives), test (hand tools) or both.
            With both, writes DIR/val, DIR/test and DIR/results.md.
        out: Output folder. Default: runs/evaluate/SPLIT; runs/evaluate with both.
        background: Image of the dataset's gel camera without contact, stored as the imported
            images, for field runs. Default: each pair's own, or that of the sensor's own light, if
            the dataset was made with either.
    """
    from t2twin.core.tables import text
    from t2twin.translate.evaluation.evaluate import evaluate_splits
    from t2twin.translate.evaluation.table import results_tables

    folder = out or Path("runs/evaluate") / ("" if split == "both" else split)
    evaluations = evaluate_splits(runs, data, split, folder, background)
    print("\n\n".join(map(text, results_tables(evaluations))), end="\n\n")
    print(f"written to {folder}")


def report(
    out: Path = Path("runs/report"),
    data: Path = Path("data/small"),
    runs: tuple[Path, ...] = (),
    evaluation: Path | None = None,
) -> None:
    """Write a self-contained HTML page about a dataset, or about runs evaluated on it.

    Args:
        out: Folder to write into.
        data: Folder of the dataset.
        runs: Folders of trained runs, or names of pretrained runs. The page shows their results,
            learning curves and errors, on a simulated dataset or on imported pairs. Without runs it
            shows the dataset: shapes, images, forces, saturation.
        evaluation: Folder of `evaluate --split both` with the same runs and dataset; the folder
            evaluate next to --out unless given. If neither matches, the runs are evaluated.
    """
    if runs:
        from t2twin.report.run_report import draw_report, read_report_data

        report_data = read_report_data(out, data, list(runs), evaluation)
        folders = " and ".join(str(folder) for folder in report_data.folders.values())
        print(f"using the evaluation in {folders}")
        page = draw_report(out, report_data)
    elif evaluation is not None:
        raise T2TwinError("--evaluation requires trained runs; give them with --runs")
    else:
        from t2twin.report.dataset_report import write_data_report

        page = write_data_report(out, data)
    print(f"open {page}")


@dataclass(frozen=True)
class PredictionOptions:
    """The run of a command that predicts, and its input.

    Args:
        run: Folder of a trained run, or name of a pretrained run. A folder called field is ./field.
        layout: Taxel layout (name, or JSON or CSV file) that a touch2touch or field run is read at.
            Default: the run's own.
        bf16: Compute in bfloat16 if the run's preset and the processor support it: faster, counts
            differ by up to some hundreds.
        background: Background frame of the same sensor, stored as the frames, for a field run.
            Default: the mean background frame of its training.
    """

    run: str = PRETRAINED
    layout: str | None = None
    bf16: bool = False
    background: Path | None = None
    order: Annotated[FrameOrder, tyro.conf.arg(name="")] = UPRIGHT


def translate(
    images: tyro.conf.Positional[
        Annotated[tuple[Path, ...], tyro.conf.arg(help_behavior_hint="(one or more)")]
    ],
    options: Annotated[PredictionOptions, tyro.conf.arg(name="")],
    out: Path = Path("runs/translate"),
    png: Annotated[bool, tyro.conf.arg(help_behavior_hint="(default: they are written)")] = True,
    target: Literal["counts", "contact"] = "counts",
) -> None:
    """Translate images to counts; writes counts.csv, counts.json and PNG files.

    A field run also writes counts_std.csv, the standard deviation of each count, and the force, if
    it was trained on several. Its PNG files fade to white with increasing uncertainty. A run
    from counts or to images writes counts.csv or predicted images.

    Args:
        images: PNG or JPEG files of any size, upright and in color, or folders of such files. For
            a run from counts, CSV files with columns taxel_0, taxel_1 and so on, or NPY files.
        out: Output folder.
        png: Write no PNG files of the tactile images, nor of the contacts, which is faster.
        target: What a field run predicts. contact writes contacts.csv, and for each image NAME.npz,
            NAME.json, NAME_depth.png (16 bits, micrometers) and NAME_relief.png.
    """
    import numpy as np

    from t2twin.translate.inference import files
    from t2twin.translate.models.presets import IMAGE_TO_COUNTS
    from t2twin.translate.runs.config import load_config, resolve_run

    direction = load_config(resolve_run(options.run)).direction
    is_to_counts = target == "counts" and direction == IMAGE_TO_COUNTS
    if not is_to_counts and (options.layout is not None or options.bf16):
        raise T2TwinError("--layout and --bf16 are for predictions of counts from images")
    if target == "contact":
        found = files.find_images(images)  # before more are written there
        contacts = files.translate_contacts(
            options.run, found, out, options.background, png, options.order
        )
        lines = [f"{file}: {each.words}" for file, each in zip(found, contacts, strict=True)]
    elif is_to_counts:
        found = files.find_images(images)
        counts = files.translate_images(
            found, out, options.run, options.layout, png, options.bf16, options.background,
            options.order,
        )  # fmt: skip
        each = zip(found, np.rint(counts).astype(int), strict=True)
        lines = [f"{file}: {' '.join(map(str, row))}" for file, row in each]
    else:
        if options.background is not None:
            raise T2TwinError(f"--background is for field runs; {options.run} is {direction}")
        readings = files.translate_readings(options.run, images, out, png, options.order)
        lines = [f"{counted(len(readings), 'reading')} translated"]
    print(*lines[:MAX_PRINTED], sep="\n")
    if len(lines) > MAX_PRINTED:
        print(f"and {len(lines) - MAX_PRINTED:,} more")
    print(f"written to {out}")


def live(
    source: tyro.conf.Positional[str],
    options: Annotated[PredictionOptions, tyro.conf.arg(name="")],
    frames: int | None = None,
    zmq: str | None = None,
    rerun: Path | None = None,
) -> None:
    """Translate frames as they arrive; print a line of JSON with the counts for each.

    Frames that arrive during a translation are dropped, except the latest. Rate, latency and the
    address of --zmq are printed on standard error.

    Args:
        source: Camera number, video file, or folder in which PNG or JPEG files appear.
        frames: Number of frames after which the command ends; unlimited unless given.
        zmq: Address at which a ZeroMQ PUB socket publishes each line, such as tcp://127.0.0.1:5555.
        rerun: Recording of the frames and predictions for the viewer of Rerun.
    """
    from t2twin.core import arguments
    from t2twin.live.follow import follow, published, recorded
    from t2twin.live.sources import open_source
    from t2twin.translate.data.images import read_image
    from t2twin.translate.inference.load import load

    if frames is not None:
        arguments.whole_number(frames, "--frames", 1)
    loaded = load(options.run, options.layout, options.bf16)
    with ExitStack() as stack:
        outputs = []
        if zmq is not None:
            outputs.append(stack.enter_context(published(zmq, _report)))
        if rerun is not None:
            outputs.append(stack.enter_context(recorded(rerun)))
        follow(
            loaded._need_counts("live"),
            open_source(source, options.order, _report),
            lambda line: print(line, flush=True),
            _report,
            frames,
            options.background and read_image(options.background, options.order),
            outputs,
            options.order,
        )


def _report(message: str) -> None:
    print(f"t2twin: {message}", file=sys.stderr, flush=True)


def export(
    run: str = PRETRAINED, layout: str | None = None, out: Path | None = None, force: bool = False
) -> None:
    """Export a trained run as an ONNX file, from pixels to counts and tactile images.

    Args:
        run: Folder of a trained run, or name of a pretrained run. A folder called field is ./field.
        layout: Taxel layout (name, or JSON or CSV file) that a touch2touch or field run is read at.
            Default: the run's own.
        out: Output file. Default: MODEL.onnx in RUN; for a pretrained run NAME.onnx in the working
            directory.
        force: Replace an existing file.
    """
    from t2twin.translate.inference.load import export_onnx, load_run
    from t2twin.translate.runs.config import HOME

    loaded = load_run(run, layout)
    if out is None:
        folder, name = loaded.run_dir, f"{loaded.config.model}.onnx"
        out = Path(f"{folder.name}.onnx") if folder.parent == HOME else folder / name
    difference = export_onnx(loaded, out, force)
    print(f"counts differ by at most {difference:.3f} from PyTorch's on random images")
    print(f"written to {out}")


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

    given = () if minutes is None else (arguments.number(minutes, "minutes", low=MIN_MINUTES),)
    started = time.monotonic()
    steps = demo_commands(out, *given)
    for number, words in enumerate(steps, start=1):
        print(f"\nstep {number} of {len(steps)}: t2twin {shlex.join(words)}", flush=True)
        cli.main(words)
    print(f"the demo took {(time.monotonic() - started) / 60.0:.1f} minutes")


def demo_commands(out: Path, minutes: float = math.inf) -> list[list[str]]:
    """The commands. They depend on nothing else, so that the same demo continues a stopped one."""
    from t2twin.core.machine import cores
    from t2twin.translate.models.presets import PAPER_MODELS

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
