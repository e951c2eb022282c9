"""Data of the report of runs, read and checked before the page is written.

An existing evaluation is used if it evaluates the same weights, in the same order, on the same
dataset. Digests are compared, so folders may be moved and copied.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from t2twin.core.errors import T2TwinError
from t2twin.report.dataset.tables import Dataset, read_dataset
from t2twin.report.html.page import check_out
from t2twin.sim.dataset.store import sha256_of
from t2twin.translate.evaluation.evaluate import evaluate
from t2twin.translate.evaluation.files import read_evaluation, write_findings
from t2twin.translate.evaluation.findings import gap_between
from t2twin.translate.evaluation.predictions import Predictions, read_predictions
from t2twin.translate.evaluation.prepare import run_names, splits_with_pairs
from t2twin.translate.evaluation.records import Evaluation, Finding
from t2twin.translate.inference.load import load_run
from t2twin.translate.inference.predictor import CountsPredictor
from t2twin.translate.runs.config import BEST, RunConfig, load_config
from t2twin.translate.runs.log import EpochRecord, read_log
from t2twin.translate.runs.pretrained import resolve_run
from t2twin.translate.training.early_stopping import stop_reason

SIBLING_FOLDER = "evaluate"
"""Folder next to the report's folder, into which `make evaluate` writes val and test."""


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


@dataclass(frozen=True)
class SplitResults:
    """Evaluation of one split, and the folder that contains it."""

    folder: Path
    evaluation: Evaluation
    predictions: Predictions


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
        **vars(dataset),
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


def find_or_evaluate(
    runs: Sequence[CountsPredictor],
    data: Path,
    info_sha256: str,
    split: str,
    out: Path,
    given: Path | None = None,
) -> SplitResults:
    """Evaluation of runs on one split.

    data: folder of the dataset. info_sha256: of its info.json. out: folder of the report. given: a
    folder of `t2twin evaluate --split both`. Searches given, the sibling folder of `out`, and
    out/evaluate-SPLIT; if none matches, evaluates the runs into the last.

    Raises T2TwinError as `evaluate` does.
    """
    own = out / f"evaluate-{split}"
    folders = [out.parent / SIBLING_FOLDER / split, own]
    if given is not None:
        folders.insert(0, given / split)
    for folder in folders:
        try:
            results = SplitResults(folder, read_evaluation(folder), read_predictions(folder))
        except T2TwinError:
            continue  # there is no evaluation that this version can read
        if _matches(results, runs, info_sha256, split):
            return results
    evaluation = evaluate([run.run_dir for run in runs], data, split, own)
    return SplitResults(own, evaluation, read_predictions(own))


def _matches(
    results: SplitResults, runs: Sequence[CountsPredictor], info_sha256: str, split: str
) -> bool:
    """Whether results are of these weights, in this order, on this split of this dataset."""
    evaluation, predictions = results.evaluation, results.predictions
    return (
        evaluation.split == split
        and evaluation.info_sha256 == info_sha256
        and list(evaluation.runs) == run_names(runs)
        and list(predictions.by_model) == list(evaluation.models)
        and len(predictions.truth) == evaluation.pairs
        and [row.weights_sha256 for row in evaluation.runs.values()]
        == [sha256_of(run.run_dir / BEST) for run in runs]
    )
