"""Errors and uncertainty of runs that were trained on one recipe and evaluated on others.

    t2twin simdata --recipe forces
    t2twin simdata --recipe benchmarks/networks/unseen-shapes.toml --out data/unseen-shapes
    for data in paper forces; do
        t2twin evaluate RUN... --data data/$data --split both --out runs/recipes/$data; done
    t2twin evaluate RUN... --data data/unseen-shapes --split val --out
    runs/recipes/unseen-shapes/val python -m benchmarks dataset_runs runs/recipes/*

The results contain the errors of every row, overall with intervals and by force, and the training
data of each run. Runs have the name MODEL-of-RECIPE; each combination may occur once. Several
evaluations may be on one dataset.

Field runs also have the coverage of 90 % intervals, overall and by tenths of the predicted standard
deviation, and the sparsification gain: the decrease of the RMSE without the least certain fifth of
the presses. It is listed with the gain without the fifth that has the largest errors.
"""

from __future__ import annotations

from argparse import Namespace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import msgspec
import numpy as np

from benchmarks.evidence import Argument, Benchmark, Figure
from t2twin.core.errors import T2TwinError

if TYPE_CHECKING:
    from t2twin.translate.evaluation.evaluate import Predictions
    from t2twin.translate.evaluation.records import Evaluation, ModelRow

BENCHMARK = Benchmark(
    module="benchmarks.networks.dataset_runs",
    minutes=1,
    sources=("primitives_cad", "sim", "translate"),
    figures=tuple(
        Figure(f"on.{part}.*.{name}", "%")
        for part in ("*.val", "paper.test", "forces.test")
        for name in ("overall.rmse_percent", "coverage_percent", "sparsification_gain_percent")
    ),
    arguments=(Argument("evaluations", "folders of t2twin evaluate", Path, nargs="+"),),
)

SPLITS = ("val", "test")

NO_UNCERTAINTY = {"coverage_percent": None, "sparsification_gain_percent": None}
"""Figures of a row without predicted uncertainty."""

TENTHS = 10
"""Parts of equal size that the counts are divided into."""


def measure(options: Namespace) -> dict[str, Any]:
    content: dict[str, Any] = {"runs": {}, "on": {}}
    for folder in options.evaluations:
        recipe, splits, runs = _figures(folder)
        for split, rows in splits.items():
            known = content["on"].setdefault(recipe, {}).setdefault(split, {})
            if twice := sorted(runs.keys() & known.keys()):
                raise T2TwinError(
                    f"{folder} has another evaluation of {twice[0]} on {recipe}; give one of them"
                )
            known |= rows
        content["runs"] |= runs
    return content


def _figures(folder: Path) -> tuple[str, dict[str, Any], dict[str, Any]]:
    """Name of the evaluated dataset, the figures of each row by split, and the runs' training."""
    from t2twin.translate.evaluation.evaluate import read_predictions
    from t2twin.translate.evaluation.records import read_evaluation

    splits, runs, recipe = {}, {}, folder.name
    for split in SPLITS:
        if not (folder / split).is_dir():
            continue
        evaluation = read_evaluation(folder / split)
        recipe = evaluation.recipe or recipe
        names = {name: _name_of(name, row) for name, row in evaluation.runs.items()}
        if len(set(names.values())) < len(names):
            raise T2TwinError(
                f"{folder} has two runs of one model and one recipe; evaluate one of them"
            )
        rankings = _rankings(evaluation, read_predictions(folder / split))
        splits[split] = {
            names.get(name, name): _row(row) | rankings.get(name, NO_UNCERTAINTY)
            for name, row in evaluation.models.items()
        }
        runs |= {names[name]: _trained(row) for name, row in evaluation.runs.items()}
    if not splits:
        raise T2TwinError(f"{folder} contains no evaluation; give folders of `t2twin evaluate`")
    return recipe, splits, runs


def _name_of(name: str, row: ModelRow) -> str:
    """Evaluations name runs by model, and by folder if several are of one model."""
    return f"{name.split(' ')[0]}-of-{row.trained_recipe}"


def _row(row: ModelRow) -> dict[str, Any]:
    return {
        "overall": row.overall,
        "interval": msgspec.to_builtins(row.interval),
        "by_force": [msgspec.to_builtins(each) for each in row.by_force],
    }


def _trained(row: ModelRow) -> dict[str, Any]:
    return {"recipe": row.trained_recipe, "pairs": row.trained_pairs, "steps": row.trained_steps}


def _rankings(evaluation: Evaluation, predictions: Predictions) -> dict[str, dict[str, Any]]:
    """Coverage and sparsification gains of each run that predicts its uncertainty."""
    from t2twin.translate.evaluation.metrics import REPORTED_LEVEL
    from t2twin.translate.inference.estimate import half_width

    rankings: dict[str, dict[str, Any]] = {}
    for name, row in evaluation.runs.items():
        if row.uncertainty is None:
            continue
        error = np.abs(predictions.by_model[name] - predictions.truth)
        std = predictions.std_by_model[name]
        covered = (error <= half_width(REPORTED_LEVEL) * std).ravel()
        tenths = np.array_split(np.argsort(std, axis=None), TENTHS)
        rmse = predictions.rmse_counts(name)
        rankings[name] = {
            "coverage_percent": row.uncertainty.figures["coverage_percent"],
            "tenths_coverage_percent": [100.0 * float(covered[part].mean()) for part in tenths],
            "sparsification_gain_percent": row.uncertainty.figures["gain_percent"],
            "largest_gain_percent": _gain_percent(rmse, rmse),
            "uncertainty": msgspec.to_builtins(row.uncertainty),
        }
    return rankings


def _gain_percent(rmse: np.ndarray, ranking: np.ndarray) -> float:
    """Decrease of the RMSE without the fifth of the presses with the largest ranking, percent."""
    from t2twin.translate.evaluation.metrics import REPORTED_SHARE

    kept = np.argsort(ranking, kind="stable")[: round(REPORTED_SHARE * ranking.size)]
    return 100.0 * float(1.0 - _rms(rmse[kept]) / _rms(rmse))


def _rms(values: np.ndarray) -> np.floating:
    return np.sqrt(np.square(values).mean())
