"""Data of the report of runs, read and checked before the page is written.

An existing evaluation is used if it evaluates the same weights, in the same order, on the same
dataset. Digests are compared, so folders may be moved and copied.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from t2twin.core.errors import T2TwinError
from t2twin.report.dataset import Dataset, read_dataset
from t2twin.report.page import check_out
from t2twin.sim.dataset.info import SPLITS
from t2twin.sim.dataset.store import sha256_of
from t2twin.translate.data.pairs import DataInfo, load_info
from t2twin.translate.evaluation.evaluate import evaluate
from t2twin.translate.evaluation.findings import gap_between
from t2twin.translate.evaluation.predictions import (
    Predictions,
    read_predictions,
    run_names,
    splits_with_pairs,
)
from t2twin.translate.evaluation.records import Evaluation, Finding, read_evaluation, write_findings
from t2twin.translate.evaluation.table import counts_form
from t2twin.translate.inference.load import load_run
from t2twin.translate.inference.predictor import CountsPredictor
from t2twin.translate.runs.config import BEST, load_config, resolve_run
from t2twin.translate.runs.log import EpochRecord, read_log
from t2twin.translate.training.trainer import stop_reason

SIBLING_FOLDER = "evaluate"
"""Folder next to the report's folder, into which `make evaluate` writes val and test."""


@dataclass(frozen=True)
class ReportData(Dataset):
    """Data of the report of runs.

    layout: taxels, full scale and SHA-256 of the dataset. runs: by their names in the evaluation.
    histories: logs of the runs, one record per epoch.
    evaluations, predictions, folders (of the evaluations): by split, "val" and "test"; imported
    pairs may lack a split. gap: findings about the difference between both splits.
    """

    layout: DataInfo
    runs: dict[str, CountsPredictor]
    histories: dict[str, list[EpochRecord]]
    evaluations: dict[str, Evaluation]
    predictions: dict[str, Predictions]
    folders: dict[str, Path]
    gap: dict[str, Finding]

    def counts(self, value: float) -> str:
        """A number of counts as text, with a decimal for a small full scale."""
        return counts_form(self.layout.full_scale_counts).format(value)

    @property
    def evaluation(self) -> Evaluation:
        """Evaluation of the first split, for content that all splits share."""
        return next(iter(self.evaluations.values()))


def read_report_data(
    out: Path, data: Path, runs: list[Path], evaluation: Path | None = None
) -> ReportData:
    """Reads the dataset, the runs and their evaluation; writes out/findings.json.

    evaluation: a folder of `t2twin evaluate --split both`; see `_find_or_evaluate`. Raises
    T2TwinError, before anything is written, for a dataset, a run or a folder that cannot be used.
    """
    check_out(out)
    if not runs:
        raise T2TwinError(
            "there is no run to report on; expected at least one folder of `t2twin train`"
        )
    if evaluation is not None and not any((evaluation / name).is_dir() for name in SPLITS):
        raise T2TwinError(
            f"{evaluation} contains no evaluation; expected a folder of "
            "`t2twin evaluate --split both`"
        )
    runs = [resolve_run(run) for run in runs]
    dataset, layout, splits = read_dataset(data), load_info(data), splits_with_pairs(data)
    histories = [read_log(run) for run in runs]
    for run, history in zip(runs, histories, strict=True):
        config = load_config(run)
        if stop_reason(config, history) is None:
            raise T2TwinError(
                f"{run} is unfinished after {len(history)} of {config.planned_epochs} epochs; the "
                "same `t2twin train` command resumes it"
            )
    loaded = [load_run(run) for run in runs]
    names = run_names(loaded)
    found = {
        s: _find_or_evaluate(loaded, names, data, layout.sha256, s, out, evaluation) for s in splits
    }
    evaluations = {split: each for split, (_, each, _) in found.items()}
    gap = gap_between(evaluations)
    write_findings(out, evaluations, gap)
    return ReportData(
        **vars(dataset),
        layout=layout,
        runs=dict(zip(names, loaded, strict=True)),
        histories=dict(zip(names, histories, strict=True)),
        evaluations=evaluations,
        predictions={split: each for split, (_, _, each) in found.items()},
        folders={split: folder for split, (folder, _, _) in found.items()},
        gap=gap,
    )


def _find_or_evaluate(
    runs: Sequence[CountsPredictor],
    names: Sequence[str],
    data: Path,
    info_sha256: str,
    split: str,
    out: Path,
    given: Path | None,
) -> tuple[Path, Evaluation, Predictions]:
    """Evaluation of runs on one split, and its folder.

    names: of the runs. data, info_sha256: of the dataset. out: folder of the report. given: a
    folder of `t2twin evaluate --split both`. Searches given, the sibling folder of `out`, and
    out/evaluate-SPLIT for an evaluation of these weights, in this order, on this split of this
    dataset; if none matches, evaluates the runs into the last. Raises T2TwinError as `evaluate`
    does.
    """
    weights = [sha256_of(run.run_dir / BEST) for run in runs]
    own = out / f"evaluate-{split}"
    folders = [out.parent / SIBLING_FOLDER / split, own]
    if given is not None:
        folders.insert(0, given / split)
    for folder in folders:
        try:
            evaluation, predictions = read_evaluation(folder), read_predictions(folder)
        except T2TwinError:
            continue  # there is no evaluation that this version can read
        if (
            evaluation.split == split
            and evaluation.info_sha256 == info_sha256
            and list(evaluation.runs) == names
            and [row.weights_sha256 for row in evaluation.runs.values()] == weights
            and list(predictions.by_model) == list(evaluation.models)
            and len(predictions.truth) == evaluation.pairs
        ):
            return folder, evaluation, predictions
    evaluation = evaluate([run.run_dir for run in runs], data, split, own)
    return own, evaluation, read_predictions(own)
