"""The CySkin gain at which the largest taxels of the training set just reach full scale.

    python -m benchmarks.taxels.gain [SCALE]

Presses the training shapes of a scale (default: paper). Returns the gain for
t2twin.sim.taxels.pads.GAIN_COUNTS, and the share of saturated samples with the present gain.
"""

from argparse import Namespace
from typing import Any

import numpy as np
from tqdm import tqdm

from benchmarks.evidence.record import Argument, Benchmark, Figure
from benchmarks.evidence.run import main
from t2twin.primitives_cad import catalogue
from t2twin.sim.sampling import protocol
from t2twin.sim.sensors import CySkin
from t2twin.sim.taxels import pads

BENCHMARK = Benchmark(
    module="benchmarks.taxels.gain",
    measures="CySkin gain at which the largest taxels of the training set reach full scale.",
    minutes=9,
    sources=("primitives_cad", "sim"),
    figures=(
        Figure("gain_counts", "counts"),
        Figure("gain_counts_in_use", "counts"),
        Figure("saturated_share_in_use"),
    ),
    arguments=(
        Argument(
            "scale",
            "of the dataset; keeps nothing unless paper",
            default="paper",
            nargs="?",
            choices=("smoke", "small", "paper"),
            partial=True,
        ),
    ),
)

PERCENTILE = 99.5
"""Percentile of the largest taxel that is to reach full scale (assumed)."""


def largest_pad_pressures_mpa(scale: str) -> np.ndarray:
    """The largest pad's mean stress in every training press of a scale, MPa."""
    sensor = CySkin()
    largest = []
    names = [name for name in catalogue.PRIMITIVES if catalogue.split(name) == "train"]
    for name in tqdm(names, desc="gain", unit="shape"):
        shape = catalogue.load(name)
        for index in protocol.indices(name, protocol.scale_of(scale)):
            contact = sensor.press(shape, protocol.press_at(shape, index))
            largest.append(pads.pad_pressure_mpa(contact, sensor.layout).max())
    return np.array(largest)


def measure(options: Namespace) -> dict[str, Any]:
    pressures = largest_pad_pressures_mpa(options.scale)
    per_gain = pads.counts(pressures, gain=1.0)
    saturated = (pads.counts(pressures) >= pads.FULL_SCALE_COUNTS).mean()
    return {
        "scale": options.scale,
        "presses": pressures.size,
        "gain_counts": pads.FULL_SCALE_COUNTS / float(np.percentile(per_gain, PERCENTILE)),
        "gain_counts_in_use": pads.GAIN_COUNTS,
        "saturated_share_in_use": float(saturated),
        "largest_pad_pressure_kpa": {
            name: float(1e3 * np.percentile(pressures, percentile))
            for name, percentile in (
                ("percentile_5", 5), ("median", 50), ("percentile_95", 95),
                ("percentile_99_5", PERCENTILE),
            )
        },
    }  # fmt: skip


if __name__ == "__main__":
    main(BENCHMARK)
