"""Translation between every two bundled sensors.

    python -m benchmarks sensor_matrix FOLDER

For every two sensors there is one dataset of the protocol at scale small. ResNet18 is trained on it
to the counts of arrays, touch2touch to the images of gel cameras. FOLDER contains the datasets,
runs and evaluations; the command continues what is there.

Each run is compared with the mean of the training readings and with the target's reading of the
training press whose source's reading is nearest. There is no pair of a sensor with itself.
"""

from __future__ import annotations

from argparse import Namespace
from contextlib import suppress
from itertools import combinations
from pathlib import Path
from typing import TYPE_CHECKING, Any

from benchmarks.evidence import Argument, Benchmark, Figure
from t2twin.core.errors import T2TwinError

if TYPE_CHECKING:
    from t2twin.translate.evaluation.records import Evaluation, ModelRow

BENCHMARK = Benchmark(
    module="benchmarks.networks.sensor_matrix",
    minutes=150,
    sources=("primitives_cad", "sim", "translate"),
    figures=(
        Figure("val.*.*.of_nearest", most=1.0),
        Figure("test.*.*.of_nearest", most=1.0),
    ),
    arguments=(
        Argument("folder", "folder of the datasets, runs and evaluations", Path),
    ),
)  # fmt: skip

SCALE, PRESET = "small", "cpu"

MODELS = {"counts": "resnet18", "image": "touch2touch"}
"""Models by value of the target."""

STEPS = 800
"""Steps of each training (assumed: 33 epochs, about 7 minutes of one core)."""

SEED = 0
SPLITS = ("val", "test")

NEAREST = "nearest-neighbor"
"""Name of its row in an evaluation; the mean is the first row, the run the last."""

FIGURES = ("rmse_percent", "ssim", "psnr_db", "psnr_contact_db", "contact_iou")


def measure(options: Namespace) -> dict[str, Any]:
    from t2twin.sim.sensors.files import bundled_sensors

    names = tuple(bundled_sensors())
    found: dict[str, dict[str, dict[str, Any]]] = {
        split: {name: {} for name in names} for split in SPLITS
    }
    for one, other in combinations(names, 2):
        data = options.folder / "data" / f"{one}-{other}"
        for source, target, direction in (
            (one, other, "source-to-target"),
            (other, one, "target-to-source"),
        ):
            name = f"{source}-to-{target}"
            run, out = (options.folder / part / name for part in ("runs", "evaluations"))
            for split, evaluation in _evaluations(one, other, data, run, direction, out).items():
                found[split][source][target] = _figures(evaluation)
    return found | {"scale": SCALE, "models": MODELS, "preset": PRESET, "steps": STEPS}


def _evaluations(
    one: str, other: str, data: Path, run: Path, direction: str, out: Path
) -> dict[str, Evaluation]:
    """Makes, trains and evaluates what is missing of a pair; its evaluations by split."""
    from t2twin.sim.dataset.generate import make_dataset
    from t2twin.sim.dataset.store import INFO, read_info
    from t2twin.sim.sensors.pair import SensorPair
    from t2twin.translate.evaluation.evaluate import evaluate_splits
    from t2twin.translate.evaluation.records import read_evaluation
    from t2twin.translate.training.train import train

    with suppress(T2TwinError):
        return {split: read_evaluation(out / split) for split in SPLITS}
    if not ((data / INFO).is_file() and read_info(data).complete):
        # Imperfections as those of `t2twin simdata`.
        sensors = SensorPair.of(one, other).with_imperfections(None)
        make_dataset(data, SCALE, SEED, workers=1, sensors=sensors)
    role = direction.rpartition("-")[2]
    value = read_info(data).values[role]
    train(MODELS[value], data, PRESET, run, SEED, steps=STEPS, direction=direction)
    evaluate_splits([run], data, "both", out)
    return {split: read_evaluation(out / split) for split in SPLITS}


def _figures(evaluation: Evaluation) -> dict[str, Any]:
    """The figures of the run and of the trivial predictors, and the ratio of their errors."""
    models = evaluation.models
    mean, *_, network = models.values()
    rows = {"network": network, "nearest": models[NEAREST], "mean": mean}
    errors = {name: row.overall["rmse_percent"] for name, row in rows.items()}
    return {"of_nearest": errors["network"] / errors["nearest"]} | {
        name: _row(row) for name, row in rows.items()
    }


def _row(row: ModelRow) -> dict[str, Any]:
    overall = {name: row.overall[name] for name in FIGURES if name in row.overall}
    return overall | {"interval": row.interval["rmse_percent"]}
