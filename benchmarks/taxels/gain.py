"""The gain of an array at which the largest taxels of the training set just reach full scale.

    python -m benchmarks gain [SCALE] [--sensor SENSOR]

Presses the training shapes of a scale (default: paper) into the default array. Returns the gain for
its file, and the share of saturated samples with the present gain.
"""

from argparse import Namespace
from typing import Any

import numpy as np
from tqdm import tqdm

from benchmarks.evidence import Argument, Benchmark, Figure
from t2twin.primitives_cad import catalogue
from t2twin.sim.sampling import protocol
from t2twin.sim.sensors.defaults import TARGET
from t2twin.sim.sensors.files import load_sensor
from t2twin.sim.taxels.pads import pad_pressure_mpa
from t2twin.sim.taxels.taxel_array import TaxelArray

BENCHMARK = Benchmark(
    module="benchmarks.taxels.gain",
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
        Argument(
            "--sensor", "name or file of an array; keeps nothing unless the default one",
            default=TARGET, partial=True,
        ),
    ),
)  # fmt: skip

PERCENTILE = 99.5
"""Percentile of the largest taxel that is to reach full scale (assumed)."""


def largest_pad_pressures_mpa(sensor: TaxelArray, scale: str) -> np.ndarray:
    """The largest pad's mean stress in every training press of a scale, MPa."""
    largest = []
    names = [name for name in catalogue.PRIMITIVES if catalogue.split(name) == "train"]
    for name in tqdm(names, desc="gain", unit="shape"):
        shape = catalogue.load(name)
        for index in protocol.indices(name, protocol.SCALES[scale]):
            contact = sensor.press(shape, protocol.press_of(shape.name, shape.spacing_mm, index))
            largest.append(pad_pressure_mpa(contact, sensor.layout).max())
    return np.array(largest)


def measure(options: Namespace) -> dict[str, Any]:
    sensor = load_sensor(options.sensor)
    assert isinstance(sensor, TaxelArray)
    counts, full_scale = sensor.spec.counts, sensor.full_scale
    pressures = largest_pad_pressures_mpa(sensor, options.scale)
    signals = sensor.spec.transducer.signal(pressures)
    saturated = (sensor.counts_of(pressures) >= full_scale).mean()
    return {
        "scale": options.scale,
        "sensor": sensor.name,
        "presses": pressures.size,
        "gain_counts": full_scale / float(np.percentile(signals, PERCENTILE)),
        "gain_counts_in_use": counts.gain,
        "saturated_share_in_use": float(saturated),
    }
