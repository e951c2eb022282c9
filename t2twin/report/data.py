"""Data of the report of runs, read and checked before the page is written."""

from dataclasses import dataclass
from pathlib import Path

from t2twin.core.errors import T2TwinError
from t2twin.report.dataset.tables import Dataset, read_dataset
from t2twin.report.evaluations import find_or_evaluate
from t2twin.report.html.page import check_out
from t2twin.translate.evaluation.files import write_findings
from t2twin.translate.evaluation.findings import gap_between
from t2twin.translate.evaluation.predictions import Predictions
from t2twin.translate.evaluation.prepare import run_names, splits_with_pairs
from t2twin.translate.evaluation.records import Evaluation, Finding
from t2twin.translate.inference.load import load_run
from t2twin.translate.inference.predictor import CountsPredictor
from t2twin.translate.runs.config import RunConfig, load_config
from t2twin.translate.runs.log import EpochRecord, read_log
from t2twin.translate.runs.pretrained import resolve_run
from t2twin.translate.training.early_stopping import stop_reason


@dataclass(frozen=True)
class ReportData(Dataset):
    """Data of the report of runs.

    runs: by their names in the evaluation. histories: logs of the runs, one record per epoch.
    evaluations, predictions, folders (of the evaluations): by split, "val" and "test"; imported
    pairs may lack a split. gap: findings about the difference between both splits.
    """

    runs: dict[str, CountsPredictor]
    histories: dict[str, list[EpochRecord]]
    evaluations: dict[str, Evaluation]
    predictions: dict[str, Predictions]
    folders: dict[str, Path]
    gap: dict[str, Finding]

    @property
    def evaluation(self) -> Evaluation:
        """Evaluation of the first split, for content that all splits share."""
        return next(iter(self.evaluations.values()))


def read_report_data(
    out: Path, data: Path, runs: list[Path], evaluation: Path | None = None
) -> ReportData:
    """Reads the dataset, the runs and their evaluation; writes out/findings.json.

    evaluation: a folder of `t2twin evaluate --split both`; see `find_or_evaluate`. Raises
    T2TwinError, before anything is written, for a dataset, a run or a folder that cannot be used.
    """
    check_out(out)
    if not runs:
        raise T2TwinError(
            "there is no run to report on; expected at least one folder of `t2twin train`"
        )
    runs = [resolve_run(run) for run in runs]
    dataset, splits = read_dataset(data), splits_with_pairs(data)
    histories = [read_log(run) for run in runs]
    for run, history in zip(runs, histories, strict=True):
        _check_finished(run, load_config(run), history)
    loaded = [load_run(run) for run in runs]
    names = run_names(loaded)
    sha256 = dataset.layout.sha256
    results = {s: find_or_evaluate(loaded, data, sha256, s, out, evaluation) for s in splits}
    evaluations = {split: each.evaluation for split, each in results.items()}
    gap = gap_between(evaluations, dataset.info)
    write_findings(out, evaluations, gap)
    return ReportData(
        data=data,
        info=dataset.info,
        layout=dataset.layout,
        phi=dataset.phi,
        tables=dataset.tables,
        runs=dict(zip(names, loaded, strict=True)),
        histories=dict(zip(names, histories, strict=True)),
        evaluations=evaluations,
        predictions={split: each.predictions for split, each in results.items()},
        folders={split: each.folder for split, each in results.items()},
        gap=gap,
    )


def _check_finished(run_dir: Path, config: RunConfig, history: list[EpochRecord]) -> None:
    if stop_reason(config, history) is None:
        raise T2TwinError(
            f"{run_dir} is unfinished after {len(history)} of {config.planned_epochs} epochs; the "
            "same `t2twin train` command resumes it"
        )
