"""t2twin import-pairs"""

from pathlib import Path
from typing import Annotated

import tyro


def import_pairs(
    source: tyro.conf.Positional[Annotated[Path, tyro.conf.arg(metavar="PAIRS")]],
    out: Annotated[Path, tyro.conf.arg(metavar="DIR")],
    layout: str = "cyskin-20",
    full_scale: int = 40_000,
    seed: int = 0,
) -> None:
    """Bring your own pairs into the dataset's format, checked on the way.

    A CSV file beside its pictures has a column image (the picture's file) and taxel_0, taxel_1 ...
    in the layout's order, with commas, semicolons or tabs between; Parquet has image (the same, or
    the picture itself) and taxels (a list). Columns split (train, val, test), shape, family, x_mm,
    y_mm, yaw_rad and force_n are taken where they are there; without split, 80, 10 and 10 % are
    drawn at random.

    Args:
        source: A .csv or .parquet file, or a folder that holds one.
        out: Folder of the dataset to make.
        layout: Your taxels: a name, or a JSON or CSV file with x_mm and y_mm.
        full_scale: Where your taxels saturate, counts.
        seed: Draws the splits where the rows name none.
    """
    import t2twin

    pairs = t2twin.import_pairs(source, out, t2twin.load_layout(layout), full_scale, seed).pairs
    print(
        f"{pairs['train']} training, {pairs['val']} validation and {pairs['test']} test pairs "
        f"in {out}"
    )
