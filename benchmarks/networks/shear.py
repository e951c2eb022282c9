"""Shear force and counts of moving touches of unseen tools.

    t2twin simdata --recipe moving --out data/moving
    t2twin train field --data data/moving --init-from field --steps 4000 --out runs/moving
    python -m benchmarks.networks.shear --run runs/moving --start field --data data/moving-tools

The tools are touched as the shapes of the recipe `moving`. The dataset is made first if it is
missing. The figures of the shear force are given for DIGITs with markers and without.
"""

from __future__ import annotations

from argparse import Namespace
from dataclasses import asdict, fields, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from msgspec import structs

from benchmarks.evidence.record import Argument, Benchmark, Figure
from benchmarks.evidence.run import main

if TYPE_CHECKING:
    from t2twin.sim.sampling.recipe import Recipe
    from t2twin.translate.data.pairs import Pairs
    from t2twin.translate.inference.field_predictor import FieldPredictor
    from t2twin.translate.uncertainty.estimate import Estimate

COVERAGE = {"least": 87.0, "most": 93.0}
"""Limits of the coverage of 90 % intervals, %."""

BENCHMARK = Benchmark(
    module="benchmarks.networks.shear",
    measures="Shear force and counts of moving touches of unseen tools.",
    minutes=6,
    sources=("primitives_cad", "sim", "translate"),
    figures=(
        Figure("markers.direction_error_deg", "deg", most=10.0),
        Figure("markers.magnitude_error_percent", "%", most=15.0),
        Figure("markers.coverage_percent", "%", **COVERAGE),
        Figure("plain.coverage_percent", "%", **COVERAGE),
        Figure("plain.direction_error_deg", "deg"),
        Figure("moving_over_still", "", most=1.15),
        Figure("counts.run.*.rmse_percent", "%"),
        Figure("counts.run.*.coverage_percent", "%", **COVERAGE),
        Figure("counts.start.*.rmse_percent", "%"),
    ),
    arguments=(
        Argument("--run", "run trained on moving touches", Path, required=True, metavar="RUN"),
        Argument("--start", "run that it was initialized from", required=True, metavar="RUN"),
        Argument("--data", "dataset of the tools", Path, required=True, metavar="DIR"),
    ),
)

PRESSES, SEED = 60, 77
"""Touches of each tool at each of its keypoints, and the seed of the recipe."""


def measure(options: Namespace) -> dict[str, Any]:
    from t2twin.sim.dataset.columns import MARKERS
    from t2twin.sim.dataset.generate import make_dataset
    from t2twin.sim.dataset.store import read_info, read_split
    from t2twin.translate.data.pairs import load_pairs
    from t2twin.translate.evaluation.evaluate import training_steps
    from t2twin.translate.evaluation.predictions import as_readings
    from t2twin.translate.inference.field_predictor import FieldPredictor
    from t2twin.translate.inference.load import load_run
    from t2twin.translate.inference.predictor import require

    make_dataset(options.data, recipe=tools())
    run, start = (
        require(load_run(each), FieldPredictor, "the benchmark")
        for each in (options.run, options.start)
    )
    preset = run.config.preset
    pairs = load_pairs(options.data, "test", preset.size, preset.grey, with_dense_counts=True)
    has_markers = read_split(options.data, "test", [MARKERS])[MARKERS].to_numpy(False)
    info = read_info(options.data)
    estimate = as_readings(run.estimate_pixels(pairs.inputs), info)
    of_start = as_readings(start.estimate_pixels(pairs.inputs), info)
    content: dict[str, Any] = {
        "markers": _shear(estimate, pairs, has_markers),
        "plain": _shear(estimate, pairs, ~has_markers),
        "counts": {
            "run": _counts(estimate, pairs, run),
            "start": _counts(of_start, pairs, start),
        },
    }
    found = content["counts"]["run"]
    ratio = found["moving"]["rmse_counts"] / found["still"]["rmse_counts"]
    steps = training_steps(run, run.config.data.train_pairs)
    return content | {"moving_over_still": ratio, "steps": steps}


def tools() -> Recipe:
    """The recipe `moving`, with the tools in place of its shapes."""
    from t2twin.sim.sampling.recipe import load_recipe

    recipe = load_recipe("moving")
    part = structs.replace(
        recipe.parts[0], shapes="tools", split="test", count=None, presses=PRESSES
    )
    return structs.replace(recipe, name="moving tools", seed=SEED, parts=(part,))


def _shear(estimate: Estimate, pairs: Pairs, which: np.ndarray) -> dict[str, Any]:
    """Figures of the shear force over the moving pairs `which`, (P,) bool."""
    from t2twin.translate.evaluation.array_errors import shear_metrics

    arrays = {f.name: getattr(estimate, f.name) for f in fields(estimate)}
    part = {n: a[which] for n, a in arrays.items() if isinstance(a, np.ndarray)}
    found = shear_metrics(replace(estimate, **part), pairs.subset(np.flatnonzero(which)))
    assert found is not None
    return asdict(found)


def _counts(estimate: Estimate, pairs: Pairs, run: FieldPredictor) -> dict[str, Any]:
    """Errors of the counts of still and of moving pairs."""
    from t2twin.sim.taxels.phi import Phi
    from t2twin.translate.evaluation.array_errors import by_motion, compare

    data = run.config.data.array
    full_scale = data.full_scale_counts
    figures = compare(estimate.counts, pairs.counts, Phi(data.x_mm, data.y_mm), full_scale)
    found = by_motion(figures, pairs, full_scale, estimate)
    assert found is not None
    return {name: asdict(each) for name, each in found.items()}


if __name__ == "__main__":
    main(BENCHMARK)
