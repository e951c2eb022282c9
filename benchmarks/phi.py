"""What a tactile image costs: phi as one product, against scipy's LinearNDInterpolator.

    python -m benchmarks.phi

Both make the same batch of images of the default layout, turn by turn. The interpolator's
triangles are found once. It is taken both ways: one image at a time, which the ratio is of, and
the whole batch as many-valued data, which finds each pixel's triangle but once. Writes
benchmarks/results/phi.json.
"""

import json
import os
import platform
import statistics
import sys
import time
from pathlib import Path

import numpy as np
from scipy.interpolate import LinearNDInterpolator
from scipy.spatial import Delaunay

from t2twin.sim.cyskin.layout import load_layout
from t2twin.translate.phi import Phi

BATCH = 64
ONE_BY_ONE = 8
"""Images of the batch that the interpolator makes one at a time."""
REPEATS = 7
LIMIT_MS = 0.2
LEAST_RATIO = 10.0
RESULTS = Path(__file__).parent / "results" / "phi.json"


def main() -> int:
    layout = load_layout()
    phi = Phi(layout.x_mm, layout.y_mm)
    counts = np.random.default_rng(0).integers(0, 40_001, (BATCH, layout.size)).astype(np.float32)
    triangles = Delaunay(np.column_stack([layout.x_mm, layout.y_mm]))
    centres = np.stack(np.meshgrid(*phi.centres_mm), axis=-1).reshape(-1, 2)

    def interpolated() -> np.ndarray:
        return LinearNDInterpolator(triangles, counts.T, fill_value=0.0)(centres)

    def one_by_one() -> list[np.ndarray]:
        return [
            LinearNDInterpolator(triangles, image, fill_value=0.0)(centres)
            for image in counts[:ONE_BY_ONE]
        ]

    images = phi(counts).reshape(BATCH, -1)
    apart = float(np.abs(images.T - interpolated())[phi.hull.ravel()].max())
    phi_ms, scipy_ms, batch_ms = [], [], []
    for _ in range(REPEATS):
        for make, count, times in (
            (lambda: phi(counts), BATCH, phi_ms),
            (one_by_one, ONE_BY_ONE, scipy_ms),
            (interpolated, BATCH, batch_ms),
        ):
            started = time.perf_counter()
            make()
            times.append(1e3 * (time.perf_counter() - started) / count)
    ours, theirs, batched = (statistics.median(times) for times in (phi_ms, scipy_ms, batch_ms))
    found = {
        "command": "python -m benchmarks.phi",
        "python": platform.python_version(),
        "cores": os.cpu_count(),
        "load_average": os.getloadavg()[0],
        "batch": BATCH,
        "image": list(phi.shape),
        "phi_ms_an_image": ours,
        "scipy_ms_an_image": theirs,
        "scipy_batch_ms_an_image": batched,
        "ratio": theirs / ours,
        "batch_ratio": batched / ours,
        "largest_difference_counts": apart,
        "limit_ms": LIMIT_MS,
        "least_ratio": LEAST_RATIO,
    }
    for name, value in found.items():
        print(f"phi.{name:28s} {value}")
    RESULTS.parent.mkdir(exist_ok=True)
    part = RESULTS.with_suffix(".json.part")
    part.write_text(json.dumps(found, indent=2) + "\n")
    part.replace(RESULTS)
    return 0 if ours <= LIMIT_MS and theirs >= LEAST_RATIO * ours else 1


if __name__ == "__main__":
    sys.exit(main())
