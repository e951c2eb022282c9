"""t2twin report"""

from pathlib import Path
from typing import Annotated

import tyro


def report(
    out: Annotated[Path, tyro.conf.arg(metavar="DIR")] = Path("runs/report"),
    data: Annotated[Path, tyro.conf.arg(metavar="DIR")] = Path("data/small"),
    runs: Annotated[tuple[Path, ...], tyro.conf.arg(metavar="RUN")] = (
        Path("runs/touch2touch"),
        Path("runs/resnet18"),
    ),
) -> None:
    """Draw one self-contained HTML page: shapes, pairs, results, learning curves, forces.

    Args:
        out: Folder to write into.
        data: Folder of the dataset.
        runs: Folders of the trained runs.
    """
    from translate.report.page import write_report

    page = write_report(out, data, list(runs))
    print(f"open {page}")
