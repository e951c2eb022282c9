"""Everything that the report of runs shows, read and checked before any of it is written.

The folder that a report is written into, tried before the work begins.
"""

import tempfile
from dataclasses import dataclass
from pathlib import Path

from t2twin.core.errors import T2TwinError
from t2twin.report.dataset.tables import Dataset, read_dataset
from t2twin.report.evaluations import results_of
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
    """What the report of runs is made of.

    runs: by the names that `evaluate` gives them. histories: their logs, one record an epoch.
    evaluations, predictions, folders (those that they were read from): by split, "val" and "test",
    of which imported pairs may lack one. gap: between the two, by name.
    """

    runs: dict[str, CountsPredictor]
    histories: dict[str, list[EpochRecord]]
    evaluations: dict[str, Evaluation]
    predictions: dict[str, Predictions]
    folders: dict[str, Path]
    gap: dict[str, Finding]

    @property
    def evaluation(self) -> Evaluation:
        """That of the first split, for what is said of all alike."""
        return next(iter(self.evaluations.values()))


def read_report_data(
    out: Path, data: Path, runs: list[Path], evaluation: Path | None = None
) -> ReportData:
    """Reads the dataset, the runs, and what `t2twin evaluate` says of them.

    evaluation: a folder of `t2twin evaluate --split both`. Where neither that nor the folder
    `evaluate` beside `out` is of these runs on this dataset, they are evaluated into
    out/evaluate-val and out/evaluate-test (module evaluations). Writes out/findings.json.
    Raises T2TwinError, before anything is written, for a dataset, a run or a folder that cannot be
    used.
    """
    check_out(out)
    if not runs:
        raise T2TwinError("there is no run to report on; give at least one folder of `train`")
    runs = [resolve_run(run) for run in runs]
    dataset, splits = read_dataset(data), splits_with_pairs(data)
    histories = [read_log(run) for run in runs]
    for run, history in zip(runs, histories, strict=True):
        _check_finished(run, load_config(run), history)
    loaded = [load_run(run) for run in runs]
    names = run_names(loaded)
    sha256 = dataset.layout.sha256
    results = {s: results_of(loaded, data, sha256, s, out, evaluation) for s in splits}
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
            "same `t2twin train` command ends it"
        )


PAGE = "index.html"


def check_out(out: Path) -> None:
    """Whether out/index.html can be written; leaves nothing behind.

    A file is made for a moment in `out`, or in the nearest folder above it that is there.
    Raises T2TwinError where there is a file in the folder's place, a folder in the page's, or no
    right to write.
    """
    try:
        if out.exists() and not out.is_dir():
            raise T2TwinError(f"{out} is a file; give a folder to write the report into")
        if (out / PAGE).is_dir():
            raise T2TwinError(f"{out / PAGE} is a folder; give another folder for the report")
        there = next(folder for folder in (out, *out.parents) if folder.exists())
        with tempfile.TemporaryFile(dir=there):
            pass
    except OSError as error:
        reason = (error.strerror or str(error)).lower()
        raise T2TwinError(
            f"{out} cannot be written to ({reason}); give a writable folder for the report"
        ) from error
