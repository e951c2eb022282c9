"""Errors and uncertainty of field runs, from folders of `t2twin evaluate` and on the probes.

    for data in paper forces open-8n dense; do
        t2twin evaluate RUN... --data data/$data --split both --out runs/field/$data; done
    python -m benchmarks.field runs/field/* --runs RUN... [--begun-with EARLIER...]

The figures are the errors, the coverage of 90 % intervals, also by tenths of the predicted
uncertainty, and the error of the force. The sparsification gain is the change of the RMSE without
the least certain fifth of the presses. It stands next to the gain without the fifth with the
largest errors, and without the fifth on which two runs differ most.

The dataset open-8n has random shapes. The dataset dense has the protocol's presses with 63 taxels.
Runs have the name of the world that they were trained on. The minutes and steps of a run with a
warm start include those of the earlier run.
"""

from argparse import Namespace
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.evidence.record import Argument, Benchmark, Figure
from benchmarks.evidence.run import main
from benchmarks.probes import Probes, errors, kept_probes
from benchmarks.world_runs import called, figures
from t2twin.core.errors import T2TwinError
from t2twin.sim.dataset.store import sha256_of
from t2twin.sim.world.protocol import FORCE_N

BENCHMARK = Benchmark(
    name="field",
    measures="Errors and uncertainty of field runs on several datasets.",
    minutes=1,
    sources=("primitives_cad", "sim", "translate"),
    figures=(
        *(
            Figure(f"on.{kind}.*.{name}", "%")
            for kind in ("*.val", "paper.test", "dense.test", "forces.test")
            for name in ("overall.rmse_percent", "coverage_percent", "falls_by_percent")
        ),
        Figure("probes.*.rmse_percent", "%"),
        Figure("probes.*.coverage_percent", "%"),
        Figure("runs.*.minutes", "minutes"),
    ),
    arguments=(
        Argument("evaluations", "folders of t2twin evaluate", Path, nargs="+"),
        Argument("--runs", "folders of field runs", Path, nargs="+", required=True),
        Argument(
            "--begun-with",
            "folders of runs with whose weights those began",
            Path,
            nargs="*",
            default=[],
        ),
        Argument(
            "--probes",
            "where the probes' presses are kept",
            Path,
            Path("data/probes.npz"),
            metavar="FILE",
        ),
    ),
)


def measure(options: Namespace) -> dict[str, Any]:
    from t2twin.translate.runs.config import BEST

    content: dict[str, Any] = {"runs": {}, "on": {}, "probes": {}}
    probes = kept_probes(options.probes)
    earlier = {sha256_of(folder / BEST): folder for folder in options.begun_with}
    for folder in options.runs:
        name, run, found = _on_probes(folder, probes)
        content["runs"][name], content["probes"][name] = run, found
    for folder in options.evaluations:
        _, splits, trained = figures(folder)
        for name, run in content["runs"].items():
            if name not in trained:
                raise T2TwinError(f"{folder} says nothing of {name}; evaluate that run too")
            run |= trained[name]
        content["on"][folder.name] = {
            split: {name: rows[name] for name in content["runs"]} for split, rows in splits.items()
        }
        for split, rows in content["on"][folder.name].items():
            _add_ranking(rows, folder / split)
    for folder, run in zip(options.runs, content["runs"].values(), strict=True):
        run |= _with_start(folder, run, earlier)
    return content


def _with_start(folder: Path, run: dict[str, Any], earlier: dict[str, Path]) -> dict[str, Any]:
    """A run's minutes and steps, with those of the run with whose weights it began."""
    from t2twin.translate.evaluation.scoring import training_steps
    from t2twin.translate.inference.load import load_run
    from t2twin.translate.runs.config import load_config

    start = load_config(folder).init_from
    if start is None:
        return {"begun_with": None}
    if start not in earlier:
        raise T2TwinError(f"{folder} began with other weights; give their run with --begun-with")
    before = load_run(earlier[start])
    if before.config.init_from is not None:
        raise T2TwinError(f"{earlier[start]} began with another run itself; two are added up here")
    return {
        "begun_with": before.config.data.world,
        "minutes": run["minutes"] + _minutes(earlier[start]),
        "steps": run["steps"] + training_steps(before, before.config.data.train_pairs),
    }


def _add_ranking(rows: dict[str, Any], folder: Path) -> None:
    """Of each run, what was held of each tenth, and what other rankings of the presses win."""
    from t2twin.translate.evaluation.files import read_evaluation
    from t2twin.translate.evaluation.metrics.reliability import REPORTED_LEVEL
    from t2twin.translate.evaluation.predictions import read_predictions
    from t2twin.translate.uncertainty.estimate import half_width

    predictions, evaluation = read_predictions(folder), read_evaluation(folder)
    names = {called(name, row): name for name, row in evaluation.runs.items()}
    for run, row in rows.items():
        name = names[run]
        off = np.abs(predictions.by_model[name] - predictions.truth)
        std = predictions.std_by_model[name]
        tenths = np.array_split(np.argsort(std, axis=None), 10)
        held = (off <= half_width(REPORTED_LEVEL) * std).ravel()
        rmse = predictions.rmse_counts(name)
        row["tenths_coverage_percent"] = [100.0 * float(held[part].mean()) for part in tenths]
        row["said_over_rmse"] = row["certainty"]["predicted_rmse_counts"] / float(_rms(rmse))
        row["falls_by_at_best_percent"] = _falls_by(rmse, rmse)
        others = [other for other in rows if other != run]
        if len(others) == 1:
            other = predictions.by_model[names[others[0]]]
            apart = np.square(predictions.by_model[name] - other).mean(axis=1)
            row["falls_by_disagreement_percent"] = _falls_by(rmse, apart)


def _falls_by(rmse: np.ndarray, unsure: np.ndarray) -> float:
    """By how much the RMSE falls where the fifth with the largest `unsure` is left out, %."""
    from t2twin.translate.evaluation.metrics.reliability import REPORTED_SHARE

    kept = np.argsort(unsure, kind="stable")[: round(REPORTED_SHARE * unsure.size)]
    return 100.0 * float(1.0 - _rms(rmse[kept]) / _rms(rmse))


def _rms(values: np.ndarray) -> np.floating:
    return np.sqrt(np.square(values).mean())


def _minutes(folder: Path) -> float:
    from t2twin.translate.runs.log import read_log

    return sum(record.seconds for record in read_log(folder)) / 60.0


def _on_probes(folder: Path, probes: Probes) -> tuple[str, dict[str, Any], dict[str, Any]]:
    """What a run is called, how long its training took, and its figures."""
    from t2twin.translate.evaluation.metrics.reliability import REPORTED_LEVEL, uncertainty_metrics
    from t2twin.translate.inference.field_predictor import FieldPredictor
    from t2twin.translate.inference.load import load_run
    from t2twin.translate.inference.predictor import require

    run = load_run(folder)
    data = run.config.data
    told = require(run, FieldPredictor, "the benchmark").estimate(probes.images)
    force_n = np.full(len(probes.names), FORCE_N)
    sure = uncertainty_metrics(told, probes.counts, force_n)
    trained = {"minutes": _minutes(folder)}
    found = {
        "rmse_percent": errors(told.counts, probes, data.full_scale_counts)["all"],
        "coverage_percent": 100.0 * sure.coverage_at(REPORTED_LEVEL),
    }
    return f"{run.config.model}-of-{data.world}", trained, found


if __name__ == "__main__":
    main(BENCHMARK)
