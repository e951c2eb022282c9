"""t2twin translate"""

import sys
from collections import Counter
from pathlib import Path
from typing import Annotated

import tyro

SHOWN = 5
"""Images whose counts are printed; all of them are in the files."""


def translate(
    images: tyro.conf.Positional[
        Annotated[
            tuple[Path, ...], tyro.conf.arg(metavar="IMAGE", help_behavior_hint="(one or more)")
        ]
    ],
    run: Annotated[str | None, tyro.conf.arg(metavar="RUN")] = None,
    out: Annotated[Path, tyro.conf.arg(metavar="DIR")] = Path("runs/translate"),
    layout: Annotated[str | None, tyro.conf.arg(metavar="FILE")] = None,
    pictures: Annotated[
        bool, tyro.conf.arg(help_behavior_hint="(default: they are written)")
    ] = True,
    bf16: bool = False,
    background: Annotated[Path | None, tyro.conf.arg(metavar="IMAGE")] = None,
) -> None:
    """Translate DIGIT images into CySkin counts; writes counts.csv, counts.json and pictures.

    A field run also writes counts_std.csv, the standard deviation of each count, and says the force
    where it was trained on several; its pictures fade to white where it is not sure.

    Args:
        images: PNG or JPEG files of any size, grey or color, upright as the DIGIT gives them, or
            folders of such files.
        run: Folder of a trained run, or the name of a pretrained run; the pretrained field unless
            given. A name stands for the pretrained run; a folder called field is ./field.
        out: Folder to write into.
        layout: Taxel layout (name, or JSON or CSV file) to read a touch2touch or field run
            at; the run's own unless given.
        pictures: Leave the pictures of the tactile images out and write the counts only, which is
            faster.
        bf16: Compute in bfloat16 where the processor has it: faster, and up to some hundred counts
            off what float32 gives.
        background: Image of the same DIGIT with nothing touching it, which a field run compares
            with the images; the mean background frame of its training unless given.
    """
    import numpy as np

    from t2twin.translate.inference.batch import find_images, translate_files
    from t2twin.translate.models.distributed import use_all_cores
    from t2twin.translate.runs.pretrained import DEFAULT_RUN

    run = DEFAULT_RUN if run is None else run
    _check_no_run(images)
    use_all_cores()
    files = find_images(images)
    translated = translate_files(run, files, out, layout, pictures, bf16, background)
    counts = translated.counts
    for image, row in zip(files[:SHOWN], np.rint(counts[:SHOWN]).astype(int), strict=True):
        print(f"{image}: " + " ".join(str(count) for count in row))
    if len(counts) > SHOWN:
        print(f"and {len(counts) - SHOWN:,} more")
    print(f"written to {out}")
    strange = [(file, looks) for file, looks in zip(files, translated.looks, strict=True) if looks]
    if strange:
        how = Counter(looks for _, looks in strange).most_common()
        print(
            f"t2twin: {len(strange)} of {len(files)} pictures are unlike all that {run} was "
            f"trained on, such as {strange[0][0]} "
            f"({', '.join(f'{count} {looks}' for looks, count in how)}); do not believe their "
            "counts, which are right of upright frames of the same sensor in the same light only",
            file=sys.stderr,
        )


def _check_no_run(images: tuple[Path, ...]) -> None:
    """Raises T2TwinError where a run stands among the images, as its first argument once did."""
    from t2twin.core.errors import T2TwinError
    from t2twin.translate.runs.config import CONFIG
    from t2twin.translate.runs.pretrained import pretrained_runs

    for path in images:
        if (path / CONFIG).is_file() or (str(path) in pretrained_runs() and not path.exists()):
            raise T2TwinError(f"{path} is a run, not an image; give it as --run {path}")
