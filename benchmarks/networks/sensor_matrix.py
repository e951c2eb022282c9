"""Translation between every two bundled sensors.

    python -m benchmarks.networks.sensor_matrix FOLDER
    python -m benchmarks.networks.sensor_matrix FOLDER --pairs finished

For every two sensors there is one dataset of the protocol at scale small. ResNet18 is trained on it
to the counts of arrays, touch2touch to the images of gel cameras. FOLDER contains the datasets,
runs and evaluations; the command continues what is there. The second form writes the results of the
pairs that are finished.

Each run is compared with the mean of the training readings and with the target's reading of the
training press whose source's reading is nearest. There is no pair of a sensor with itself.
"""

from __future__ import annotations

from argparse import Namespace
from collections.abc import Iterator
from itertools import combinations
from pathlib import Path
from typing import TYPE_CHECKING, Any

from benchmarks.evidence import Argument, Benchmark, Figure, main
from t2twin.core.errors import T2TwinError

if TYPE_CHECKING:
    from t2twin.translate.evaluation.records import Evaluation, ModelRow

BENCHMARK = Benchmark(
    module="benchmarks.networks.sensor_matrix",
    measures="Errors of translation between every two bundled sensors.",
    minutes=150,
    sources=("primitives_cad", "sim", "translate"),
    figures=(
        Figure("largest_of_nearest.val", most=1.0),
        Figure("largest_of_nearest.test", most=1.0),
        Figure("finished", "pairs"),
        Figure("val.*.*.of_nearest"),
        Figure("test.*.*.of_nearest"),
    ),
    arguments=(
        Argument("folder", "folder of the datasets, runs and evaluations", Path),
        Argument("--pairs", "all, or those that are finished", default="all",
                 choices=("all", "finished")),
    ),
)  # fmt: skip

SCALE, PRESET = "small", "cpu"

MODELS = {"counts": "resnet18", "image": "touch2touch"}
"""Models by value of the target."""

STEPS = 800
"""Steps of each training (assumed: 33 epochs, about 7 minutes of one core)."""

SEED = 0
SPLITS = ("val", "test")

NEAREST = "nearest-neighbour"
"""Name of its row in an evaluation; the mean is the first row, the run the last."""

FIGURES = ("rmse_percent", "ssim", "psnr_db", "psnr_contact_db", "contact_iou")


def measure(options: Namespace) -> dict[str, Any]:
    from t2twin.sim.sensors.files import bundled_sensors

    names = tuple(bundled_sensors())
    found: dict[str, dict[str, dict[str, Any]]] = {
        split: {name: {} for name in names} for split in SPLITS
    }
    finished = 0
    for source, target, evaluations in _evaluations(names, options):
        finished += 1
        for split, evaluation in evaluations.items():
            found[split][source][target] = _figures(evaluation)
    ratios = {
        split: [pair["of_nearest"] for row in rows.values() for pair in row.values()]
        for split, rows in found.items()
    }
    return found | {
        "finished": finished,
        "largest_of_nearest": {split: max(each, default=None) for split, each in ratios.items()},
        "scale": SCALE,
        "models": MODELS,
        "preset": PRESET,
        "steps": STEPS,
    }


def _evaluations(
    names: tuple[str, ...], options: Namespace
) -> Iterator[tuple[str, str, dict[str, Evaluation]]]:
    """Source, target, and the evaluations of each pair by split."""
    for one, other in combinations(names, 2):
        data = options.folder / "data" / f"{one}-{other}"
        for source, target, direction in (
            (one, other, "source-to-target"),
            (other, one, "target-to-source"),
        ):
            name = f"{source}-to-{target}"
            run, out = (options.folder / part / name for part in ("runs", "evaluations"))
            if options.pairs == "all":
                _make(one, other, data, run, direction, out)
            if (found := _read(out)) is not None:
                yield source, target, found


def _make(one: str, other: str, data: Path, run: Path, direction: str, out: Path) -> None:
    """Makes, trains and evaluates what is missing of a pair."""
    from t2twin.sim.dataset.generate import make_dataset
    from t2twin.sim.dataset.store import INFO, read_info
    from t2twin.sim.sensors.pair import SensorPair
    from t2twin.translate.evaluation.evaluate import evaluate_splits
    from t2twin.translate.training.train import train

    if _read(out) is not None:
        return
    if not ((data / INFO).is_file() and read_info(data).complete):
        # Imperfections as those of `t2twin simdata`.
        sensors = SensorPair.of(one, other).with_imperfections(None)
        make_dataset(data, SCALE, SEED, workers=1, sensors=sensors)
    role = direction.rpartition("-")[2]
    value = read_info(data).values[role]
    train(MODELS[value], data, PRESET, run, SEED, steps=STEPS, direction=direction)
    evaluate_splits([run], data, "both", out)


def _read(out: Path) -> dict[str, Evaluation] | None:
    """The evaluations of both splits in a folder, None if one is missing."""
    from t2twin.translate.evaluation.records import read_evaluation

    try:
        return {split: read_evaluation(out / split) for split in SPLITS}
    except T2TwinError:
        return None


def _figures(evaluation: Evaluation) -> dict[str, Any]:
    """The figures of the run and of the trivial predictors, and the ratio of their errors."""
    models = evaluation.models
    mean, *_, network = models.values()
    rows = {"network": network, "nearest": models[NEAREST], "mean": mean}
    errors = {name: row.overall.rmse_percent for name, row in rows.items()}
    return {"of_nearest": errors["network"] / errors["nearest"]} | {
        name: _row(row) for name, row in rows.items()
    }


def _row(row: ModelRow) -> dict[str, Any]:
    overall = {name: getattr(row.overall, name) for name in FIGURES}
    return {name: value for name, value in overall.items() if value is not None} | {
        "interval": row.interval["rmse_percent"]
    }


if __name__ == "__main__":
    main(BENCHMARK)
