"""t2twin report"""

from pathlib import Path
from typing import Annotated

import tyro


def report(
    out: Annotated[Path, tyro.conf.arg(metavar="DIR")] = Path("runs/report"),
    data: Annotated[Path, tyro.conf.arg(metavar="DIR")] = Path("data/small"),
    runs: Annotated[tuple[Path, ...], tyro.conf.arg(metavar="RUN")] = (),
    evaluation: Annotated[Path | None, tyro.conf.arg(metavar="DIR")] = None,
) -> None:
    """Write a self-contained HTML page about a dataset, or about runs evaluated on it.

    Args:
        out: Folder to write into.
        data: Folder of the dataset.
        runs: Folders of trained runs. The page shows their results, learning curves and errors, on
            a simulated dataset or on imported pairs. Without runs it shows the dataset: shapes,
            images, forces, saturation, near-duplicates.
        evaluation: Folder of `evaluate --split both` with the same runs and dataset; the folder
            evaluate next to --out unless given. If neither matches, the runs are evaluated.
    """
    from t2twin.core.errors import T2TwinError

    if runs:
        from t2twin.report.data import read_report_data
        from t2twin.report.run_report import draw_report
        from t2twin.translate.models.distributed import use_all_cores

        use_all_cores()
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
