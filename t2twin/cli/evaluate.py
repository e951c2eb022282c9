"""t2twin evaluate and t2twin report"""

from pathlib import Path
from typing import Annotated, Literal

import tyro

Split = Literal["val", "test", "both"]


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
        runs: Folders of trained runs.
        data: Folder of the dataset, of training or any other. touch2touch also accepts another
            taxel layout inside its own, field any on the cover.
        split: val (in the paper's protocol: new versions of primitives), test (hand tools) or both.
            With both, writes DIR/val, DIR/test and DIR/results.md.
        out: Output folder. Default: runs/evaluate/SPLIT; runs/evaluate with both.
        background: Image of the dataset's gel camera without contact, for field runs. Default: each
            pair's own, or that of the sensor's own light, if the dataset was made with either.
    """
    from t2twin.core.errors import T2TwinError
    from t2twin.core.tables import text
    from t2twin.translate.evaluation.evaluate import evaluate_splits
    from t2twin.translate.evaluation.table import results_tables
    from t2twin.translate.models.distributed import use_all_cores

    if not runs:
        raise T2TwinError(
            "there is no run to evaluate; give one run's folder or more before --data"
        )
    folder = out or Path("runs/evaluate") / ("" if split == "both" else split)
    use_all_cores()
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
        runs: Folders of trained runs. The page shows their results, learning curves and errors, on
            a simulated dataset or on imported pairs. Without runs it shows the dataset: shapes,
            images, forces, saturation.
        evaluation: Folder of `evaluate --split both` with the same runs and dataset; the folder
            evaluate next to --out unless given. If neither matches, the runs are evaluated.
    """
    from t2twin.core.errors import T2TwinError

    if runs:
        from t2twin.report.run_report import draw_report, read_report_data
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
