"""Contact that a run predicts for untouched DIGIT units, with and without artifacts.

    python -m benchmarks.networks.untouched_units [--run RUN]

Every unit is sampled twice: without and with streaks, glare, wear and drift. The input is a single
camera frame of its gel without contact. The run predicts without and with the unit's background
frame, which is recorded before the drift. All counts and forces should be zero.
"""

from argparse import Namespace
from typing import TYPE_CHECKING, Any

import numpy as np

from benchmarks.evidence.record import Argument, Benchmark, Figure
from benchmarks.evidence.run import main
from t2twin.sim.digit.optics import NOISE_GREY
from t2twin.sim.digit.randomization.artifacts import Artifacts, with_artifacts
from t2twin.sim.digit.randomization.unit import UnitRanges, sample_unit
from t2twin.sim.sensors import Digit

if TYPE_CHECKING:
    from t2twin.translate.uncertainty.estimate import Estimate

BENCHMARK = Benchmark(
    module="benchmarks.networks.untouched_units",
    measures="Contact that a run predicts for untouched DIGIT units with streaks, glare and drift.",
    minutes=2,
    sources=("sim/digit", "translate"),
    figures=(
        Figure("units.*.*.counts.p95", "counts"),
        Figure("units.*.*.force_n.p95", "N"),
    ),
    arguments=(
        Argument("--run", "folder or name of a field run", default="field", partial=True),
        Argument("--units", "number of units", int, default=200, partial=True),
    ),
)

SEED = 77
"""Of the units, which no bundled world has."""
KINDS = {"plain": None, "artifacts": Artifacts()}
PERCENTILES = (50, 95)


def measure(options: Namespace) -> dict[str, Any]:
    from t2twin.translate.inference.load import load_run
    from t2twin.translate.inference.predictor import FieldPredictor, require

    run = require(load_run(options.run), FieldPredictor, "the benchmark")
    found: dict[str, Any] = {}
    for kind, artifacts in KINDS.items():
        estimates: dict[str, list[Estimate]] = {"without_background": [], "with_background": []}
        for number in range(options.units):
            image, background = untouched_frames(number, artifacts)
            estimates["without_background"].append(run.estimate(image))
            estimates["with_background"].append(run.estimate(image, background))
        found[kind] = {name: _percentiles(each) for name, each in estimates.items()}
    return {"run": run.config.data.world_shown, "sampled_units": options.units, "units": found}


def untouched_frames(number: int, artifacts: Artifacts | None) -> tuple[np.ndarray, np.ndarray]:
    """A frame without contact, and the background frame before it, of a sampled unit."""
    unit = sample_unit(np.random.default_rng([SEED, number]), UnitRanges())
    if artifacts is not None:
        unit = with_artifacts(np.random.default_rng([SEED, number, 1]), unit, artifacts)
    digit, rng = Digit(noise_grey=NOISE_GREY).with_unit(unit), np.random.default_rng([number])
    background = digit.background_frame(rng)
    return digit.image(None, rng), background


def _percentiles(estimates: "list[Estimate]") -> dict[str, Any]:
    """Of the total counts and the forces."""
    values = {
        "counts": [float(each.counts.sum()) for each in estimates],
        "force_n": [float(each.force_n) for each in estimates if each.force_n is not None],
    }
    return {
        name: {f"p{at}": float(np.percentile(each, at)) for at in PERCENTILES}
        for name, each in values.items()
        if each
    }


if __name__ == "__main__":
    main(BENCHMARK)
