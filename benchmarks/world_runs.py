"""Errors of translators trained on one world and evaluated on others.

    t2twin evaluate RUN... --data data/paper data/forces --split both --out runs/worlds
    python -m benchmarks.world_runs runs/worlds/paper runs/worlds/forces

The results have the errors of every row, overall with intervals and by force, and the training data
of each run. Runs have the name MODEL-of-WORLD; each combination may occur once.
"""

from __future__ import annotations

from argparse import Namespace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import msgspec

from benchmarks.evidence.record import Argument, Benchmark, Figure
from benchmarks.evidence.run import main
from t2twin.core.errors import T2TwinError

if TYPE_CHECKING:
    from t2twin.translate.evaluation.records import ModelRow

BENCHMARK = Benchmark(
    name="world_runs",
    measures="Errors of translators trained on one world and evaluated on others.",
    minutes=1,
    sources=("primitives_cad", "sim", "translate"),
    figures=(
        Figure("on.*.val.*.overall.rmse_percent", "%"),
        Figure("on.*.test.*.overall.rmse_percent", "%"),
    ),
    arguments=(Argument("evaluations", "folders of t2twin evaluate", Path, nargs="+"),),
)

SPLITS = ("val", "test")


def measure(options: Namespace) -> dict[str, Any]:
    content: dict[str, Any] = {"runs": {}, "on": {}}
    for folder in options.evaluations:
        world, splits, runs = figures(folder)
        content["on"][world] = splits
        content["runs"] |= runs
    return content


def figures(folder: Path) -> tuple[str, dict[str, Any], dict[str, Any]]:
    """What the evaluated dataset is called, the figures of every row by split, and what each run
    was trained on."""
    from t2twin.translate.evaluation.files import read_evaluation

    splits, runs, world = {}, {}, folder.name
    for split in SPLITS:
        if not (folder / split).is_dir():
            continue
        evaluation = read_evaluation(folder / split)
        world = evaluation.world or world
        names = {name: called(name, row) for name, row in evaluation.runs.items()}
        if len(set(names.values())) < len(names):
            raise T2TwinError(
                f"{folder} has two runs of one model and one world; evaluate one of them"
            )
        splits[split] = {
            names.get(name, name): _row(row) for name, row in evaluation.models.items()
        }
        runs |= {names[name]: _trained(row) for name, row in evaluation.runs.items()}
    if not splits:
        raise T2TwinError(f"{folder} holds no evaluation; give folders of `t2twin evaluate`")
    return world, splits, runs


def called(name: str, row: ModelRow) -> str:
    """Evaluation names runs by model, and by folder where two are of one model."""
    return f"{name.split(' ')[0]}-of-{row.trained_world}"


def _row(row: ModelRow) -> dict[str, Any]:
    return {
        "overall": msgspec.to_builtins(row.overall),
        "interval": msgspec.to_builtins(row.interval),
        "by_force": [msgspec.to_builtins(each) for each in row.by_force],
    } | _sureness(row)


def _sureness(row: ModelRow) -> dict[str, Any]:
    """How sure a run is, of those that say it."""
    from t2twin.translate.evaluation.metrics.reliability import REPORTED_LEVEL, REPORTED_SHARE

    sure = row.uncertainty
    if sure is None:
        return {}
    return {
        "coverage_percent": 100.0 * sure.coverage_at(REPORTED_LEVEL),
        "falls_by_percent": 100.0 * sure.sparsification_gain(REPORTED_SHARE),
        "certainty": msgspec.to_builtins(sure),
    }


def _trained(row: ModelRow) -> dict[str, Any]:
    return {
        "world": row.trained_world,
        "pairs": row.trained_pairs,
        "steps": row.trained_steps,
    }


if __name__ == "__main__":
    main(BENCHMARK)
