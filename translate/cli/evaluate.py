"""t2twin evaluate"""

from pathlib import Path
from typing import Annotated, Literal

import tyro


def evaluate(
    runs: tyro.conf.Positional[Annotated[tuple[Path, ...], tyro.conf.arg(metavar="RUN")]],
    data: Annotated[Path, tyro.conf.arg(metavar="DIR")],
    split: Literal["val", "test"] = "val",
    out: Annotated[Path | None, tyro.conf.arg(metavar="DIR")] = None,
) -> None:
    """Measure trained translators and the trivial ones beside them; writes metrics.json.

    Args:
        runs: Folders of trained runs.
        data: Folder of the dataset.
        split: val (versions of the primitives never trained on) or test (the hand tools).
        out: Folder to write into; runs/evaluate/SPLIT unless given.
    """
    from primitives_cad.errors import T2TwinError
    from translate.evaluate import evaluate as measure
    from translate.evaluate import table

    if not runs:
        raise T2TwinError("there is no run to evaluate; give at least one run's folder")
    folder = out or Path("runs/evaluate") / split
    print(table(measure(list(runs), data, split, folder)))
    print(f"written to {folder}")
