"""Summary of the report of runs, its dataset and runs, and the limitations."""

from typing import Any

import numpy as np

from t2twin.core.machine import cores, processor
from t2twin.core.tables import Table
from t2twin.report.data import ReportData
from t2twin.report.dataset.pairs import example
from t2twin.report.html.labels import SPLIT_NAMES, name_of
from t2twin.sim.cyskin.taxels import DIELECTRIC_MODULUS_MPA
from t2twin.sim.dataset.store import sha256_of
from t2twin.sim.digit.calibration import DEFAULT_PATH
from t2twin.translate.evaluation.metrics.baselines import MEAN_ARRAY, NEAREST_NEIGHBOR
from t2twin.translate.evaluation.records import Evaluation
from t2twin.translate.evaluation.table import training_data
from t2twin.translate.runs.log import best_epoch

UNSEEN_SHAPES = {
    "val": "new versions of the training shapes",
    "test": "hand tools (new objects)",
}
"""Content of the splits of the paper's protocol, for a run trained on the same dataset."""

HEADS = [
    "Run", "Trained on", "Pairs", "Steps", "Preset", "Image, px", "Parameters", "Epochs",
    "Best epoch", "Minutes",
]  # fmt: skip


def summary(report: ReportData) -> dict[str, Any]:
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


def about(report: ReportData) -> dict[str, Any]:
    """Shapes by split, table of the runs, and runs with other training data."""
    models = report.evaluation.runs
    return {
        "shapes": {s: len(table["shape"].unique()) for s, table in report.tables.items()},
        "cores": cores(),
        "processor": processor(),
        "table": Table(HEADS, {"": [_run(report, name) for name in report.runs]}),
        "other_data": [
            f"{name_of(name)} ({training_data(model)[0]})"
            for name, model in models.items()
            if not model.same_data
        ],
    }


def _run(report: ReportData, name: str) -> list[str]:
    """Row of a run."""
    run, history = report.runs[name], report.histories[name]
    preset = run.config.preset
    parameters = sum(p.numel() for p in run.translator.predictor.parameters())
    seconds = sum(record.seconds for record in history)
    return [
        name_of(name),
        *training_data(report.evaluation.runs[name]),
        preset.name,
        f"{preset.size} × {preset.size}, {'grey' if preset.grey else 'RGB'}",
        f"{parameters / 1e6:.2f} M",
        f"{len(history)}",
        f"{best_epoch(history).epoch}",
        f"{seconds / 60:.1f}" if seconds < 600 else f"{seconds / 60:,.0f}",
    ]


def limits(report: ReportData) -> dict[str, Any]:
    """Assumed parameters of a simulated dataset, and whether its optics are the default ones."""
    parameters = report.info.parameters
    return {
        "parameters": parameters,
        "dielectric_mpa": DIELECTRIC_MODULUS_MPA,
        "is_default_calibration": parameters is not None
        and parameters.digit.calibration_sha256 == sha256_of(DEFAULT_PATH),
    }
