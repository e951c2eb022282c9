"""Finds the evaluation that a report shows, or runs it.

An existing evaluation is used if it evaluates the same weights, in the same order, on the same
dataset. Digests are compared, so folders may be moved and copied.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from t2twin.core.errors import T2TwinError
from t2twin.sim.dataset.store import sha256_of
from t2twin.translate.evaluation.evaluate import evaluate
from t2twin.translate.evaluation.files import read_evaluation
from t2twin.translate.evaluation.predictions import Predictions, read_predictions
from t2twin.translate.evaluation.prepare import run_names
from t2twin.translate.evaluation.records import Evaluation
from t2twin.translate.inference.predictor import CountsPredictor
from t2twin.translate.runs.config import BEST

SIBLING_FOLDER = "evaluate"
"""Folder next to the report's folder, into which `make evaluate` writes val and test."""


@dataclass(frozen=True)
class SplitResults:
    """Evaluation of one split, and the folder that contains it."""

    folder: Path
    evaluation: Evaluation
    predictions: Predictions


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
        results = _read(folder)
        if results is not None and _matches(results, runs, info_sha256, split):
            return results
    evaluation = evaluate([run.run_dir for run in runs], data, split, own)
    return SplitResults(own, evaluation, read_predictions(own))


def _read(folder: Path) -> SplitResults | None:
    """None if there is no evaluation that this version can read."""
    try:
        return SplitResults(folder, read_evaluation(folder), read_predictions(folder))
    except T2TwinError:
        return None


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
