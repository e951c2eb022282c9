"""t2twin translate, t2twin live, t2twin export"""

import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

import tyro

from t2twin.core.errors import counted

MAX_PRINTED = 5
"""Images whose counts are printed; the output files contain all."""


@dataclass(frozen=True)
class RunOptions:
    """The run of a command.

    Args:
        run: Folder of a trained run, or name of a pretrained run. Default: the pretrained field. A
            folder called field is ./field.
        layout: Taxel layout (name, or JSON or CSV file) that a touch2touch or field run is read at.
            Default: the run's own.
    """

    run: str | None = None
    layout: str | None = None

    @property
    def name(self) -> str:
        """Folder or name of the run."""
        from t2twin.translate.runs.config import DEFAULT_RUN

        return DEFAULT_RUN if self.run is None else self.run


@dataclass(frozen=True)
class PredictionOptions(RunOptions):
    """The run of a command that predicts, and its input.

    Args:
        bf16: Compute in bfloat16 if the processor supports it: faster, counts differ by up to some
            hundreds.
        background: Background frame of the same sensor, in the orientation of the training images,
            for a field run. Default: the mean background frame of its training.
    """

    bf16: bool = False
    background: Path | None = None


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
    it was trained on several. Its PNG files fade to white with increasing uncertainty. A run of
    other sensors writes counts.csv or predicted images.

    Args:
        images: PNG or JPEG files of any size, upright and in color, or folders of such files. For
            a run from counts, CSV files with columns taxel_0, taxel_1 and so on, or NPY files.
        out: Output folder.
        png: Write no PNG files of the tactile images, which is faster.
        target: What a field run predicts. contact writes contacts.csv, and for each image NAME.npz,
            NAME.json, NAME_depth.png (16 bits, micrometers) and NAME_relief.png.
    """
    import numpy as np

    from t2twin.translate.inference.files import find_images, translate_files, translate_readings
    from t2twin.translate.inference.predictor import NO_BACKGROUND
    from t2twin.translate.models.distributed import use_all_cores
    from t2twin.translate.uncertainty.ood import unlike

    _check_no_run(images)
    use_all_cores()
    if target == "contact":
        lines, warnings = _translate_contacts(images, options, out, png)
    elif not _is_image_to_counts(options):
        readings = translate_readings(options.name, images, out, png)
        print(f"{counted(len(readings), 'reading')} translated, written to {out}")
        return
    else:
        files = find_images(images)
        result = translate_files(
            options.name, files, out, options.layout, png, options.bf16, options.background
        )
        rows = np.rint(result.counts).astype(int)
        lines = [
            f"{file}: {' '.join(map(str, row))}" for file, row in zip(files, rows, strict=True)
        ]
        is_without = result.counts_std is not None and options.background is None
        warnings = [NO_BACKGROUND] * is_without
        warnings += filter(None, [unlike(list(result.ood_class), options.name, files)])
    print(*lines[:MAX_PRINTED], sep="\n")
    if len(lines) > MAX_PRINTED:
        print(f"and {len(lines) - MAX_PRINTED:,} more")
    print(f"written to {out}")
    for warning in warnings:
        _report(warning)


def _translate_contacts(
    images: tuple[Path, ...], options: PredictionOptions, out: Path, png: bool
) -> tuple[list[str], list[str]]:
    """A line about each image, and warnings."""
    from t2twin.core.errors import T2TwinError
    from t2twin.translate.inference.files import find_images, translate_contacts
    from t2twin.translate.inference.predictor import NO_BACKGROUND

    if options.layout is not None or options.bf16:
        raise T2TwinError("--layout and --bf16 are for counts; give them without --target contact")
    files = find_images(images)
    contacts = translate_contacts(options.name, files, out, options.background, png)
    warnings = [NO_BACKGROUND] * (options.background is None)
    for note in dict.fromkeys(note for each in contacts for note in each.notes):
        noted = [file for file, each in zip(files, contacts, strict=True) if note in each.notes]
        part = f"{len(noted)} of {counted(len(files), 'image')}, such as {noted[0]}"
        warnings.append(f"{part}: {note}")
    return [f"{file}: {each.words}" for file, each in zip(files, contacts, strict=True)], warnings


def _is_image_to_counts(options: PredictionOptions) -> bool:
    """Whether a run is from images to counts. Raises T2TwinError for options that another run does
    not have."""
    from t2twin.core.errors import T2TwinError
    from t2twin.translate.models.presets import IMAGE_TO_COUNTS
    from t2twin.translate.runs.config import load_config, resolve_run

    direction = load_config(resolve_run(options.name)).direction
    if direction == IMAGE_TO_COUNTS:
        return True
    if options.layout is not None or options.background is not None or options.bf16:
        raise T2TwinError(
            f"--layout, --background and --bf16 are for runs from images to counts; {options.name} "
            f"has the direction {direction}"
        )
    return False


def _check_no_run(images: tuple[Path, ...]) -> None:
    """Raises T2TwinError for a run among the images, as its folder may contain images."""
    from t2twin.core.errors import T2TwinError
    from t2twin.translate.runs.config import CONFIG, pretrained_runs

    for path in images:
        if (path / CONFIG).is_file() or (str(path) in pretrained_runs() and not path.exists()):
            raise T2TwinError(f"{path} is a run, not an image; give it as --run {path}")


def live(
    source: tyro.conf.Positional[str],
    options: Annotated[PredictionOptions, tyro.conf.arg(name="")],
    turn_deg: Literal[0, 90, 180, 270] = 0,
    frames: int | None = None,
    zmq: str | None = None,
    rerun: Path | None = None,
) -> None:
    """Translate frames as they arrive; print a line of JSON with the counts for each.

    Frames that arrive during a translation are dropped, except the latest. Rate and latency are
    printed on standard error.

    Args:
        source: Camera number, video file, or folder in which PNG or JPEG files appear.
        turn_deg: Clockwise rotation of the frames, not of the background frame, into the
            orientation of the training images.
        frames: Number of frames after which the command ends; unlimited unless given.
        zmq: Address at which a ZeroMQ PUB socket publishes each line, such as tcp://127.0.0.1:5555.
        rerun: Recording of the frames and predictions for the viewer of Rerun.
    """
    from contextlib import ExitStack

    import numpy as np

    from t2twin.core import arguments
    from t2twin.live.follow import follow, published, recorded
    from t2twin.live.sources import open_source
    from t2twin.translate.data.images import open_image
    from t2twin.translate.inference.load import load
    from t2twin.translate.models.distributed import use_all_cores

    if frames is not None:
        arguments.whole_number(frames, "--frames", 1)
    use_all_cores()
    loaded = load(options.name, options.layout, options.bf16)
    with ExitStack() as stack:
        outputs = []
        if zmq is not None:
            outputs.append(stack.enter_context(published(zmq)))
        if rerun is not None:
            outputs.append(stack.enter_context(recorded(rerun)))
        follow(
            loaded.need_counts("live"),
            open_source(source, turn_deg, _report),
            lambda line: print(line, flush=True),
            _report,
            frames,
            None if options.background is None else np.asarray(open_image(options.background)),
            outputs,
        )


def _report(message: str) -> None:
    print(f"t2twin: {message}", file=sys.stderr, flush=True)


def export(
    options: Annotated[RunOptions, tyro.conf.arg(name="")],
    out: Path | None = None,
    force: bool = False,
) -> None:
    """Export a trained run as an ONNX file, from pixels to counts and tactile images.

    Args:
        out: Output file. Default: MODEL.onnx in RUN; for a pretrained run NAME.onnx in the working
            directory.
        force: Replace an existing file.
    """
    from t2twin.core.files import check_new_file
    from t2twin.translate.inference.load import load_run
    from t2twin.translate.inference.onnx_export import export_onnx
    from t2twin.translate.models.distributed import use_all_cores
    from t2twin.translate.runs.config import HOME

    if out is not None:
        check_new_file(out, force)
    use_all_cores()
    loaded = load_run(options.name, options.layout)
    if out is None:
        folder, model = loaded.run_dir, loaded.config.model
        is_pretrained = folder.parent == HOME
        out = Path(f"{folder.name}.onnx") if is_pretrained else folder / f"{model}.onnx"
        check_new_file(out, force)
    difference = export_onnx(loaded, out)
    print(f"counts differ by at most {difference:.3f} from PyTorch's on random images")
    print(f"written to {out}")
