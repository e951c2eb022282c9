"""The CySkin's gain that lets the training set's largest taxels just reach full scale.

    python -m benchmarks.gain [SCALE]

Presses the training shapes of a scale (small unless given), prints the gain to write into
t2twin.sim.cyskin.taxels.GAIN_COUNTS, and the share of samples that saturate with the one there.
"""

import json
import sys
from pathlib import Path

import numpy as np
from tqdm import tqdm

from t2twin.primitives_cad import catalogue
from t2twin.sim.cyskin import taxels
from t2twin.sim.dataset import protocol
from t2twin.sim.sensors import CySkin

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
            contact = sensor.touch(shape, protocol.press_at(shape, index))
            largest.append(taxels.pad_pressure_mpa(contact, sensor.layout, sensor.cover).max())
    return np.array(largest)


def main() -> None:
    scale = sys.argv[1] if len(sys.argv) > 1 else "small"
    pressures = largest_pad_pressures_mpa(scale)
    per_gain = taxels.counts(pressures, gain=1.0)
    saturated = (taxels.counts(pressures) >= taxels.FULL_SCALE_COUNTS).mean()
    found = {
        "command": f"python -m benchmarks.gain {scale}",
        "presses": pressures.size,
        "gain_counts": taxels.FULL_SCALE_COUNTS / float(np.percentile(per_gain, PERCENTILE)),
        "gain_counts_in_use": taxels.GAIN_COUNTS,
        "saturated_share_in_use": float(saturated),
        "largest_pad_pressure_kpa": {
            str(p): float(1e3 * np.percentile(pressures, p)) for p in (5, 50, 95, 99.5)
        },
    }
    Path("benchmarks/results/gain.json").write_text(json.dumps(found, indent=1) + "\n")
    print(json.dumps(found, indent=1))


if __name__ == "__main__":
    main()
