"""Cost of a tactile image: phi as one matrix product, compared with LinearNDInterpolator of SciPy.

    python -m benchmarks.taxels.phi

Both compute the same batch of images of the default layout, in turn. The interpolator's triangles
are computed once. It is timed with one image at a time, which gives the ratio. It is also timed
with the batch as vector-valued data, where each pixel's triangle is searched once.
"""

import statistics
import time
from argparse import Namespace
from typing import Any

import numpy as np
from scipy.interpolate import LinearNDInterpolator
from scipy.spatial import Delaunay

from benchmarks.evidence.record import Benchmark, Figure
from benchmarks.evidence.run import main
from t2twin.sim.cyskin.layout import load_layout
from t2twin.sim.cyskin.phi import Phi

BENCHMARK = Benchmark(
    module="benchmarks.taxels.phi",
    measures="Cost of a tactile image, against scipy's LinearNDInterpolator.",
    minutes=0.2,
    sources=("sim/cyskin",),
    figures=(
        Figure("phi_ms_an_image", "ms", most=0.2),
        Figure("ratio", least=10.0),
        Figure("batch_ratio"),
        Figure("largest_difference_counts", "counts"),
    ),
)

BATCH = 64
ONE_BY_ONE = 8
"""Images of the batch that the interpolator makes one at a time."""
REPEATS = 7


def measure(options: Namespace) -> dict[str, Any]:
    layout = load_layout()
    phi = Phi(layout.x_mm, layout.y_mm)
    counts = np.random.default_rng(0).integers(0, 40_001, (BATCH, layout.size)).astype(np.float32)
    triangles = Delaunay(np.column_stack([layout.x_mm, layout.y_mm]))
    centers = np.stack(np.meshgrid(*phi.centers_mm), axis=-1).reshape(-1, 2)

    def interpolated() -> np.ndarray:
        return LinearNDInterpolator(triangles, counts.T, fill_value=0.0)(centers)

    def one_by_one() -> list[np.ndarray]:
        return [
            LinearNDInterpolator(triangles, image, fill_value=0.0)(centers)
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
    return {
        "batch": BATCH,
        "image": list(phi.shape),
        "phi_ms_an_image": ours,
        "scipy_ms_an_image": theirs,
        "scipy_batch_ms_an_image": batched,
        "ratio": theirs / ours,
        "batch_ratio": batched / ours,
        "largest_difference_counts": apart,
    }


if __name__ == "__main__":
    main(BENCHMARK)
