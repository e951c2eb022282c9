"""t2twin translate"""

from pathlib import Path
from typing import Annotated

import tyro


def translate(
    run: tyro.conf.Positional[Annotated[Path, tyro.conf.arg(metavar="RUN")]],
    images: tyro.conf.Positional[Annotated[tuple[Path, ...], tyro.conf.arg(metavar="IMAGE")]],
    out: Annotated[Path, tyro.conf.arg(metavar="DIR")] = Path("runs/translate"),
) -> None:
    """Translate DIGIT images into CySkin counts; writes counts.csv, counts.json and pictures.

    Args:
        run: Folder of a trained run.
        images: PNG or JPEG files of any size, grey or colour, upright as the DIGIT gives them.
        out: Folder to write into.
    """
    import numpy as np

    from translate.predict import translate_images

    counts = translate_images(run, images, out)
    for image, row in zip(images, np.rint(counts).astype(int), strict=True):
        print(f"{image}: " + " ".join(str(count) for count in row))
    print(f"written to {out}")
