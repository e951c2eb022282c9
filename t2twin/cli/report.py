"""t2twin report"""

from pathlib import Path
from typing import Annotated

import tyro


def report(
    out: Annotated[Path, tyro.conf.arg(metavar="DIR")] = Path("runs/report"),
    data: Annotated[Path, tyro.conf.arg(metavar="DIR")] = Path("data/small"),
    runs: Annotated[tuple[Path, ...], tyro.conf.arg(metavar="RUN")] = (),
) -> None:
    """Draw one self-contained HTML page: of a dataset alone, or of runs trained on it.

    Args:
        out: Folder to write into.
        data: Folder of the dataset.
        runs: Folders of trained runs: results, learning curves, errors. Without any, the dataset
            itself is drawn: shapes, pictures, forces, saturation, near-duplicates, outliers.
    """
    if runs:
        from t2twin.report.page import write_report

        page = write_report(out, data, list(runs))
    else:
        from t2twin.report.data_page import write_data_report

        page = write_data_report(out, data)
    print(f"open {page}")
