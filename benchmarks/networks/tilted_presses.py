"""Errors of a field run on presses that are tilted by 0, 5 and 10 degrees.

    python -m benchmarks.networks.tilted_presses [--run RUN]

The solids are those of benchmark `probes`, which are neither primitives nor tools. Each press is
done three times: with the same force and place, and tilted by each angle in a direction of its own.
The background frame is given.
"""

from argparse import Namespace
from typing import Any

import numpy as np
from tqdm import tqdm

import t2twin
from benchmarks.evidence.record import Argument, Benchmark, Figure
from benchmarks.evidence.run import main
from benchmarks.networks import probes
from t2twin.core.errors import T2TwinError

TILTS_DEG = (0.0, 5.0, 10.0)

PRESSES = 28
"""Presses of each of the nine solids at each tilt."""

FORCES_N = (0.5, 12.0)
"""Range of the forces, log-uniform, N."""

PLACE_MM = 1.5
"""Standard deviation of the place along x and y, mm (assumed: solids with an end stay on the
sensor)."""

LEVEL = 0.9
"""Of the intervals."""

SEED = 0

Errors = tuple[np.ndarray, np.ndarray, float]
"""Of a press: errors of the counts, (N,), whether intervals cover these, (N,), and the relative
error of the force."""

BENCHMARK = Benchmark(
    module="benchmarks.networks.tilted_presses",
    measures="Errors of the pretrained run on straight and on tilted presses of new solids.",
    minutes=2,
    sources=("primitives_cad", "sim", "translate"),
    figures=(
        *(
            Figure(f"at.{tilt:g} deg.{name}", "%")
            for tilt in TILTS_DEG
            for name in ("rmse_percent", "force_median_error_percent", "coverage_percent")
        ),
        *(
            Figure(f"ratio.{tilt:g} deg.{name}", most=1.2)
            for tilt in TILTS_DEG[1:]
            for name in ("rmse", "force")
        ),
    ),
    arguments=(Argument("--run", "folder or name of a field run", str, "field", metavar="RUN"),),
)


def measure(options: Namespace) -> dict[str, Any]:
    run = t2twin.load(options.run)
    if not hasattr(run, "estimate"):
        raise T2TwinError(f"{options.run} is not a field run")
    twin = t2twin.Twin(imperfections="none")
    background = twin.background
    errors: dict[float, list[tuple[np.ndarray, np.ndarray, float]]] = {
        tilt: [] for tilt in TILTS_DEG
    }
    for number, (name, solid) in enumerate(probes.solids().items()):
        shape = probes.shape_of(name, solid)
        for press in tqdm(range(PRESSES), name, unit="press"):
            rng = np.random.default_rng((SEED, number, press))
            x_mm, y_mm = PLACE_MM * rng.standard_normal(2)
            force_n = float(np.exp(rng.uniform(*np.log(FORCES_N))))
            yaw_deg, toward = rng.uniform(0.0, 360.0), rng.uniform(0.0, 2 * np.pi)
            for tilt, found in errors.items():
                touch = twin.press(
                    shape, force_n=force_n, x_mm=x_mm, y_mm=y_mm, yaw_deg=yaw_deg,
                    tilt_x_deg=tilt * np.cos(toward), tilt_y_deg=tilt * np.sin(toward), seed=press,
                )  # fmt: skip
                estimate = run.estimate(touch.image, background)
                low, high = estimate.interval(LEVEL)
                found.append((
                    estimate.counts - touch.counts,
                    (low <= touch.counts) & (touch.counts <= high),
                    abs(float(estimate.force_n) / force_n - 1.0),
                ))  # fmt: skip
    at = {
        tilt: _figures(found, run.config.data.array.full_scale_counts)
        for tilt, found in errors.items()
    }
    straight = at[TILTS_DEG[0]]
    return {
        "presses": len(errors[TILTS_DEG[0]]),
        "at": {f"{tilt:g} deg": figures for tilt, figures in at.items()},
        "ratio": {
            f"{tilt:g} deg": {
                "rmse": at[tilt]["rmse_percent"] / straight["rmse_percent"],
                "force": at[tilt]["force_median_error_percent"]
                / straight["force_median_error_percent"],
            }
            for tilt in TILTS_DEG[1:]
        },
    }


def _figures(found: list[Errors], full_scale: float) -> dict[str, float]:
    errors, inside, force = (np.array(each) for each in zip(*found, strict=True))
    return {
        "rmse_percent": 100.0 * float(np.sqrt(np.square(errors).mean())) / full_scale,
        "force_median_error_percent": 100.0 * float(np.median(force)),
        "coverage_percent": 100.0 * float(inside.mean()),
    }


if __name__ == "__main__":
    main(BENCHMARK)
