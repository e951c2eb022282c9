"""Assumed values of the default array beside public measurements of sensors of its family.

    python -m benchmarks.taxels.public_sensors

- The strain of the dielectric under pressure: 270 capacitive taxels of an insole in an air chamber
  (repository ami-iit/paper_belli_2023) follow m (1 - exp(-p / (M m))).
- The blur of cover and pad: a capacitive fingertip that slides over boards with grooves of two
  periods (repository wngfra/FabricSlide; Wang et al., Frontiers in Neurorobotics 2022). Its counts
  vary less over the narrow grooves; the ratio depends on the thickness of the cover and the pad.
"""

from argparse import Namespace
from typing import Any

import numpy as np

from benchmarks.evidence import Benchmark, Figure, main
from t2twin.sim.contact.closed_forms import spectra
from t2twin.sim.sensors.pair import SensorPair
from t2twin.sim.taxels.pads import disc_transform
from t2twin.sim.taxels.spec import TransducerTable

BENCHMARK = Benchmark(
    module="benchmarks.taxels.public_sensors",
    measures="Assumed strain law, cover and pad of the default array against public measurements.",
    minutes=1,
    sources=("sim/taxels", "sim/sensors/specs"),
    figures=(
        Figure("strain.*.*"),
        Figure("blur.assumed", least=0.033, most=0.048),
        Figure("blur.covers_and_pads.*"),
    ),
)

INSOLE = {"modulus_mpa": 0.18, "largest_strain": 0.76}
"""Medians of the insole's taxels."""

PRESSURES_KPA = (10.0, 25.0, 50.0, 100.0, 200.0)

PERIODS_MM = (4.0, 20.0)
"""Of the grooves."""

MEASURED = {"low": 0.033, "median": 0.036, "high": 0.048}
"""Variation over grooves of 4 mm over that over grooves of 20 mm; of the taxels."""

COVERS_AND_PADS_MM = ((2.0, 4.0), (2.5, 4.0), (3.0, 4.0), (2.5, 3.0))
"""Thickness of the cover and diameter of the pad, mm: the assumed ones and their neighbors."""


def measure(options: Namespace) -> dict[str, Any]:
    array = SensorPair().array
    thickness_mm = array.elastomer.thickness_mm
    pad_mm = float(array.layout.pad_diameter_mm[0])
    return {
        "strain": {f"{p:g} kPa": strains(array.spec.transducer, p) for p in PRESSURES_KPA},
        "blur": {
            "measured": MEASURED,
            "assumed": blur(thickness_mm, pad_mm, array.elastomer.poisson),
            "covers_and_pads": {
                f"{cover:g} and {pad:g} mm": blur(cover, pad, array.elastomer.poisson)
                for cover, pad in COVERS_AND_PADS_MM
            },
        },
    }


def strains(assumed: TransducerTable, pressure_kpa: float) -> dict[str, float]:
    """Strain of the dielectric of the array and of the insole."""
    insole = TransducerTable("capacitive", **INSOLE)
    return {"assumed": strain(assumed, pressure_kpa), "insole": strain(insole, pressure_kpa)}


def strain(law: TransducerTable, pressure_kpa: float) -> float:
    signal = float(law.signal(np.array(1e-3 * pressure_kpa)))
    return signal / (1.0 + signal)


def blur(thickness_mm: float, pad_mm: float, poisson: float) -> float:
    """Transfer of the bonded cover and of the pad for one period of grooves over the other."""
    narrow, wide = (
        spectra(k, thickness_mm, 1.0, poisson).base_pressure * abs(disc_transform(k, pad_mm))
        for k in 2.0 * np.pi / np.array(PERIODS_MM)
    )
    return float(narrow / wide)


if __name__ == "__main__":
    main(BENCHMARK)
