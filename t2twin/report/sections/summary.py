"""Summary of the report of runs: errors, comparison with the baselines, an example."""

from typing import Any

import numpy as np

from t2twin.report.data import ReportData
from t2twin.report.dataset.pairs import example
from t2twin.report.html.labels import SPLIT_NAMES, name_of
from t2twin.translate.evaluation.metrics.baselines import MEAN_ARRAY, NEAREST_NEIGHBOR
from t2twin.translate.evaluation.records import Evaluation

UNSEEN_SHAPES = {
    "val": "new versions of the training shapes",
    "test": "hand tools (new objects)",
}
"""Content of the splits of the paper's protocol, for a run trained on the same dataset."""


def section(report: ReportData) -> dict[str, Any]:
    """Errors by split, and the press with the median error of the best run."""
    split, evaluation = next(iter(report.evaluations.items()))
    name, predictions = best_run(evaluation), report.predictions[split]
    errors = predictions.rmse_counts(name)
    row = int(np.argsort(errors, kind="stable")[(errors.size - 1) // 2])
    ratios = {s: _ratio(one) for s, one in report.evaluations.items()}
    return {
        "runs": [name_of(run) for run in report.runs],
        "pairs": {split: _pairs(report, split) for split in report.evaluations},
        "baselines": (MEAN_ARRAY, NEAREST_NEIGHBOR),
        "ratios": ratios,
        "better": [split for split, ratio in ratios.items() if ratio < 1.0],
        "split": split,
        "best": name,
        "errors": errors,
        "row": row,
        "example": example(report, split, row, predictions.by_model[name][row]),
    }


def best_run(evaluation: Evaluation) -> str:
    """Name of the run with the lowest RMSE on a split."""
    return min(evaluation.runs, key=lambda name: evaluation.runs[name].overall.rmse_counts)


def _pairs(report: ReportData, split: str) -> str:
    """Content of a split, and whether its shapes are in the training split, if recorded."""
    evaluation = report.evaluations[split]
    pairs = f"the {evaluation.pairs:,} {SPLIT_NAMES[split]} pairs"
    if not all(row.same_data for row in evaluation.runs.values()):
        return pairs
    own, trained = (set(report.tables[s]["shape"].to_pylist()) for s in (split, "train"))
    if own <= trained:
        return f"{pairs} (of training shapes)"
    if own & trained:
        return f"{pairs} (some of training shapes)"
    return UNSEEN_SHAPES[split] if report.info.is_protocol else f"{pairs} (of unseen shapes)"


def _ratio(evaluation: Evaluation) -> float:
    """RMSE of the best run relative to that of the better baseline."""
    baselines = (evaluation.models[name] for name in (MEAN_ARRAY, NEAREST_NEIGHBOR))
    lowest = min(row.overall.rmse_counts for row in baselines)
    best = evaluation.runs[best_run(evaluation)].overall.rmse_counts
    return best / lowest if lowest else float("inf")
