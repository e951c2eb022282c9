"""Everything that the report of runs shows, read and checked before any of it is written."""

from dataclasses import dataclass
from pathlib import Path

from t2twin.primitives_cad.errors import T2TwinError
from t2twin.report.dataset import Dataset, read_dataset
from t2twin.report.evaluations import results_of
from t2twin.sim.dataset.info import Parameters
from t2twin.translate.evaluation.evaluate import run_names
from t2twin.translate.evaluation.findings import gap
from t2twin.translate.evaluation.predictions import Predictions
from t2twin.translate.evaluation.records import Evaluation, write_findings
from t2twin.translate.outcome import reason_to_stop
from t2twin.translate.predict import TrainedTranslator, load_run
from t2twin.translate.runs.config import RunConfig, load_config
from t2twin.translate.runs.log import EpochRecord, read_log

SHOWN = ("val", "test")
"""The splits that results are given for."""


@dataclass(frozen=True)
class ReportData(Dataset):
    """What the report of runs is made of.

    parameters: what the dataset was simulated with. runs: by the names that `evaluate` gives them.
    histories: their logs, one record an epoch. evaluations, predictions, folders (those that they
    were read from): by split, "val" and "test".
    """

    parameters: Parameters
    runs: dict[str, TrainedTranslator]
    histories: dict[str, list[EpochRecord]]
    evaluations: dict[str, Evaluation]
    predictions: dict[str, Predictions]
    folders: dict[str, Path]


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
    if out.exists() and not out.is_dir():
        raise T2TwinError(f"{out} is a file; give a folder to write the report into")
    if not runs:
        raise T2TwinError("there is no run to report on; give at least one folder of `train`")
    dataset = read_dataset(data)
    parameters = _parameters(dataset)
    histories = [read_log(run) for run in runs]
    for run, history in zip(runs, histories, strict=True):
        _check_finished(run, load_config(run), history)
    loaded = [load_run(run) for run in runs]
    names = run_names(loaded)
    sha256 = dataset.layout.sha256
    results = {s: results_of(loaded, data, sha256, s, out, evaluation) for s in SHOWN}
    evaluations = {split: each.evaluation for split, each in results.items()}
    val, test = (evaluations[split] for split in SHOWN)
    write_findings(out, val, test, gap(val.models, test.models))
    return ReportData(
        data=data,
        info=dataset.info,
        layout=dataset.layout,
        phi=dataset.phi,
        tables=dataset.tables,
        parameters=parameters,
        runs=dict(zip(names, loaded, strict=True)),
        histories=dict(zip(names, histories, strict=True)),
        evaluations=evaluations,
        predictions={split: each.predictions for split, each in results.items()},
        folders={split: each.folder for split, each in results.items()},
    )


def _parameters(dataset: Dataset) -> Parameters:
    """The page of runs says what their dataset was made with."""
    if not dataset.info.is_simulated or dataset.info.parameters is None:
        lacks = "parameters" if dataset.info.is_simulated else "scale"
        raise T2TwinError(
            f"{dataset.data} does not name its {lacks}; a report of runs is of datasets of "
            "`t2twin simdata`, and of other pairs there is one without --runs"
        )
    return dataset.info.parameters


def _check_finished(run_dir: Path, config: RunConfig, history: list[EpochRecord]) -> None:
    if reason_to_stop(config, history) is None:
        raise T2TwinError(
            f"{run_dir} is unfinished after {len(history)} of {config.planned_epochs} epochs; the "
            "same `t2twin train` command ends it"
        )
