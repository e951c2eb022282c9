"""The evaluations that the report draws: those that are there already, else made now.

`t2twin evaluate` leaves one a split. It is drawn where it is of these very weights, in this order
of runs, on this very dataset; digests tell, so that folders may be moved and copied.
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

BESIDE = "evaluate"
"""Folder beside the report's, in which `make evaluate` leaves val and test."""


@dataclass(frozen=True)
class SplitResults:
    """One split as `evaluate` left it in a folder."""

    folder: Path
    evaluation: Evaluation
    predictions: Predictions


def results_of(
    runs: Sequence[CountsPredictor],
    data: Path,
    info_sha256: str,
    split: str,
    out: Path,
    given: Path | None = None,
) -> SplitResults:
    """What `evaluate` says of some runs on one split.

    data: the dataset's folder, info_sha256: of its info.json. out: the report's folder. given: a
    folder of `t2twin evaluate --split both`, which is looked into first; then the one beside `out`,
    then out/evaluate-SPLIT. Where none fits, the runs are evaluated into the last.

    Raises T2TwinError as `evaluate` does.
    """
    own = out / f"evaluate-{split}"
    places = [out.parent / BESIDE / split, own]
    if given is not None:
        places.insert(0, given / split)
    for folder in places:
        results = _read(folder)
        if results is not None and _is_of(results, runs, info_sha256, split):
            return results
    evaluation = evaluate([run.run_dir for run in runs], data, split, own)
    return SplitResults(own, evaluation, read_predictions(own))


def _read(folder: Path) -> SplitResults | None:
    """None where there is no evaluation, or none that this version can read."""
    try:
        return SplitResults(folder, read_evaluation(folder), read_predictions(folder))
    except T2TwinError:
        return None


def _is_of(
    results: SplitResults, runs: Sequence[CountsPredictor], info_sha256: str, split: str
) -> bool:
    """Whether these are results of these weights, in this order, on this dataset's split."""
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
