"""t2twin translate"""

import sys
from collections import Counter
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import tyro

if TYPE_CHECKING:
    from t2twin.translate.inference.batch import TranslationResult

MAX_PRINTED = 5
"""Images whose counts are printed; the output files contain all."""


def translate(
    images: tyro.conf.Positional[
        Annotated[
            tuple[Path, ...], tyro.conf.arg(metavar="IMAGE", help_behavior_hint="(one or more)")
        ]
    ],
    run: Annotated[str | None, tyro.conf.arg(metavar="RUN")] = None,
    out: Annotated[Path, tyro.conf.arg(metavar="DIR")] = Path("runs/translate"),
    layout: Annotated[str | None, tyro.conf.arg(metavar="FILE")] = None,
    png: Annotated[bool, tyro.conf.arg(help_behavior_hint="(default: they are written)")] = True,
    bf16: bool = False,
    background: Annotated[Path | None, tyro.conf.arg(metavar="IMAGE")] = None,
) -> None:
    """Translate DIGIT images to CySkin counts; writes counts.csv, counts.json and PNG files.

    A field run also writes counts_std.csv, the standard deviation of each count, and the force, if
    it was trained on several. Its PNG files fade to white with increasing uncertainty.

    Args:
        images: PNG or JPEG files of any size, grey or color, upright, or folders of such files.
        run: Folder of a trained run, or name of a pretrained run. Default: the pretrained field. A
            folder called field is ./field.
        out: Output folder.
        layout: Taxel layout (name, or JSON or CSV file) that a touch2touch or field run is read at.
            Default: the run's own.
        png: Write no PNG files of the tactile images, which is faster.
        bf16: Compute in bfloat16 if the processor supports it: faster, counts differ by up to some
            hundreds.
        background: Image of the same DIGIT without contact, for a field run. Default: the mean
            background frame of its training.
    """
    from t2twin.translate.inference.batch import find_images, translate_files
    from t2twin.translate.inference.predictor import NO_BACKGROUND
    from t2twin.translate.models.distributed import use_all_cores
    from t2twin.translate.runs.config import DEFAULT_RUN

    run = DEFAULT_RUN if run is None else run
    _check_no_run(images)
    use_all_cores()
    files = find_images(images)
    result = translate_files(run, files, out, layout, png, bf16, background)
    _print(result, files)
    print(f"written to {out}")
    if result.estimate is not None and background is None:
        print(f"t2twin: {NO_BACKGROUND}", file=sys.stderr)
    _warn(result, files, run)


def _print(result: "TranslationResult", files: list[Path]) -> None:
    """Prints the counts of the first images."""
    import numpy as np

    rows = np.rint(result.counts[:MAX_PRINTED]).astype(int)
    for image, row in zip(files[:MAX_PRINTED], rows, strict=True):
        print(f"{image}: " + " ".join(str(count) for count in row))
    if len(files) > MAX_PRINTED:
        print(f"and {len(files) - MAX_PRINTED:,} more")


def _warn(result: "TranslationResult", files: list[Path], run: str) -> None:
    """Prints a warning to stderr if images are out of distribution."""
    from t2twin.translate.uncertainty.ood import OODClass

    found = [
        (file, ood_class)
        for file, ood_class in zip(files, result.ood_classes, strict=True)
        if ood_class != OODClass.IN_DISTRIBUTION
    ]
    if found:
        classes = Counter(ood_class for _, ood_class in found).most_common()
        print(
            f"t2twin: {len(found)} of {len(files)} images are unlike all training images of {run}, "
            f"such as {found[0][0]} ({', '.join(f'{count} {name}' for name, count in classes)}); "
            "their counts are not reliable: expected upright frames, red before blue, width to "
            "height 3:4, of the same sensor in the same light, and its own background frame",
            file=sys.stderr,
        )


def _check_no_run(images: tuple[Path, ...]) -> None:
    """Raises T2TwinError for a run among the images; in version 0.1 it was the first argument."""
    from t2twin.core.errors import T2TwinError
    from t2twin.translate.runs.config import CONFIG, pretrained_runs

    for path in images:
        if (path / CONFIG).is_file() or (str(path) in pretrained_runs() and not path.exists()):
            raise T2TwinError(f"{path} is a run, not an image; give it as --run {path}")
