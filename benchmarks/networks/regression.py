"""Both translators trained briefly on a small fixed dataset, compared with a baseline.

    python -m benchmarks.networks.regression            measure and compare with the baseline
    python -m benchmarks.networks.regression --write    measure and write a new baseline

The baseline, benchmarks/results/regression.json, has the RMSE in percent of full scale and the
contact IoU of the translators. `tests/test_regression.py` compares every test run with it. If the
physics or a network changes on purpose, write a new baseline and give the reason in the commit.
"""

import tempfile
from argparse import Namespace
from dataclasses import replace
from pathlib import Path
from typing import Any

from benchmarks.evidence.record import Benchmark, Figure
from benchmarks.evidence.results import read_results
from benchmarks.evidence.run import main
from t2twin.sim.dataset.generate import make_dataset

BENCHMARK = Benchmark(
    module="benchmarks.networks.regression",
    measures="Both translators trained briefly on a small fixed dataset, against a baseline.",
    minutes=4,
    sources=("primitives_cad", "sim", "translate"),
    figures=(
        # Runs on other processors and other numbers of threads differ by some percent; a broken
        # phi, loss or pairing by a factor.
        Figure("against.rmse_of_baseline.*.*", most=1.2),
        Figure("against.rmse_of_mean_array.val.*", most=0.5),
        Figure("against.rmse_of_mean_array.test.*", most=1.0),
        Figure("against.iou_below_baseline.*.*", most=0.05),
    ),
    is_baseline=True,
)

SCALE = "small"
EPOCHS = {"touch2touch": 40, "resnet18": 12}
"""Epochs of each translator: brief, yet enough to be well below the mean array."""

SIZES_PX = {"touch2touch": 32, "resnet18": 96}
"""Side of each translator's images: half of the preset's for touch2touch, a quarter of the time."""

DECIMALS = 6
"""Of what is compared with a limit, so that what meets it exactly does meet it."""

Figures = dict[str, dict[str, dict[str, float]]]
"""Figures by name ("rmse_percent", "contact_iou"), split and model."""


def measure(options: Namespace) -> dict[str, Any]:
    with tempfile.TemporaryDirectory() as folder:
        measured = train_and_evaluate(Path(folder))
    baseline = measured if options.write else read_results(BENCHMARK.results).content
    return {"scale": SCALE, "epochs": EPOCHS, **measured, "against": against(measured, baseline)}


def train_and_evaluate(folder: Path, cache: Path | None = None) -> Figures:
    """The figures on data and runs made in folder; contact IoU of the translators alone."""
    from t2twin.translate.evaluation.evaluate import evaluate
    from t2twin.translate.models.presets import find_preset
    from t2twin.translate.training.train import train

    make_dataset(folder / "data", SCALE, seed=0, cache=cache)
    runs = []
    for model, epochs in EPOCHS.items():
        preset = replace(find_preset(model, "cpu"), size=SIZES_PX[model])
        train(model, folder / "data", preset, folder / model, seed=0, epochs=epochs)
        runs.append(folder / model)
    measured: Figures = {"rmse_percent": {}, "contact_iou": {}}
    for split in ("val", "test"):
        models = evaluate(runs, folder / "data", split, folder / split).models
        for figure, which in (("rmse_percent", tuple(models)), ("contact_iou", tuple(EPOCHS))):
            measured[figure][split] = {
                name: round(float(getattr(models[name].overall, figure)), 3) for name in which
            }
    return measured


def against(measured: Figures, baseline: dict[str, Any]) -> dict[str, Any]:
    """What the limits are for: errors in parts of the baseline's, the translators' in parts of the
    mean array's, and how far their contact IoU is below the baseline's."""
    from t2twin.translate.evaluation.baselines import MEAN_ARRAY

    errors, ious = measured["rmse_percent"], measured["contact_iou"]
    return {
        "rmse_of_baseline": {
            split: {
                name: round(errors[split][name] / before, DECIMALS)
                for name, before in models.items()
            }
            for split, models in baseline["rmse_percent"].items()
        },
        "rmse_of_mean_array": {
            split: {name: round(models[name] / models[MEAN_ARRAY], DECIMALS) for name in EPOCHS}
            for split, models in errors.items()
        },
        "iou_below_baseline": {
            split: {
                name: round(before - ious[split][name], DECIMALS) for name, before in models.items()
            }
            for split, models in baseline["contact_iou"].items()
        },
    }


if __name__ == "__main__":
    main(BENCHMARK)
