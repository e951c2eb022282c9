"""A real DIGIT compared with randomly sampled units.

    python -m benchmarks units FRAMES

FRAMES is a folder with background.png and press_*.png of a 4.70 mm ball. It is not part of the
project. An optics file is fitted to the frames and compared with sampled units. A percentile is the
share of the sampled units below a value. Writes docs/pictures/units.png.
"""

from argparse import Namespace
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image

from benchmarks import ROOT
from benchmarks.evidence import Argument, Benchmark, Figure
from benchmarks.optics.fitted_optics import BALL_DIAMETER_MM, HELD_OUT
from maintenance.bake_optics import block
from t2twin.core.files import atomic_write
from t2twin.sim.calibrate.calibrate import calibrate
from t2twin.sim.optical.image_renderer import ImageRenderer
from t2twin.sim.optical.surface import ball_surface
from t2twin.sim.optical.units import MIDDLE_COSINE, TERMS, Unit, UnitRanges, at_middle, sample_unit
from t2twin.sim.sensors.pair import SensorPair

BENCHMARK = Benchmark(
    module="benchmarks.optics.units",
    minutes=2,
    sources=("sim/calibrate", "sim/optical"),
    figures=(Figure("parameters.*.real.percentile", "%"),),
    arguments=(Argument("frames", "folder of background.png and press_*.png", Path),),
)

PICTURE = ROOT / "docs" / "pictures" / "units.png"
DRAWN = 300
SEED = 1
SHEET = (3, 8)
"""Rows and columns of units in the picture."""
TILE_PX = (150, 200)

SENSOR = SensorPair().camera
GEL, NOISE_GREY = SENSOR.own_gel, SENSOR.spec.camera.noise_grey


def measure(options: Namespace) -> dict[str, Any]:
    background = options.frames / "background.png"
    report = calibrate(background, options.frames, BALL_DIAMETER_MM, HELD_OUT, tolerance=None)
    real = Unit(report.optics, NOISE_GREY)
    units = [drawn(number) for number in range(DRAWN)]
    if not options.keep_nothing:
        with atomic_write(PICTURE) as temporary:
            sheet().save(temporary, optimize=True)
    return {
        "drawn": DRAWN,
        "parameters": {
            name: _placed(parameter, units, real) for name, parameter in PARAMETERS.items()
        },
    }


def drawn(number: int) -> Unit:
    """One unit of the shipped distribution."""
    return sample_unit(np.random.default_rng([SEED, number]), SENSOR.spec, UnitRanges())


def _own(unit: Unit) -> np.ndarray:
    """(3,) each LED's light in its own color, in the picture's middle."""
    return np.diag(at_middle(unit.optics.response))


def _leaks(unit: Unit) -> np.ndarray:
    """(6,) light in other colors there, in parts of the color's own LED's."""
    return (at_middle(unit.optics.response) / _own(unit))[~np.eye(3, dtype=bool)]


def _irregularity(unit: Unit) -> float:
    """Root mean square, over LEDs and other colors, of the coefficients in the place."""
    powers = MIDDLE_COSINE ** np.arange(unit.optics.response.shape[-1])
    places = np.einsum("kcij,j->kci", unit.optics.response, powers)[:, :, 1:TERMS]
    parts = (places / _own(unit)[None, :, None])[~np.eye(3, dtype=bool)]
    return float(np.sqrt(np.mean(parts**2)))


def _far_mm(unit: Unit) -> np.ndarray:
    return np.hypot(unit.optics.leds_mm[:, 0], unit.optics.leds_mm[:, 1])


def _elevation_deg(unit: Unit) -> np.ndarray:
    return np.degrees(np.arctan2(-unit.optics.leds_mm[:, 2], _far_mm(unit)))


def _grey(unit: Unit) -> np.ndarray:
    return unit.optics.background.astype(float)


PARAMETERS: dict[str, Callable[[Unit], float]] = {
    "gamma": lambda unit: unit.optics.gamma,
    "led_distance_mm": lambda unit: float(_far_mm(unit).mean()),
    "led_elevation_deg": lambda unit: float(_elevation_deg(unit).mean()),
    "led_size_least_mm": lambda unit: float(unit.optics.sizes_mm.min()),
    "led_size_most_mm": lambda unit: float(unit.optics.sizes_mm.max()),
    "own_light_grey": lambda unit: float(
        255.0 * np.mean(np.maximum(_own(unit), 0.0)) ** (1.0 / unit.optics.gamma)
    ),
    "leak_mean_size": lambda unit: float(np.abs(_leaks(unit)).mean()),
    "irregularity": _irregularity,
    "background_mean_grey": lambda unit: float(_grey(unit).mean()),
    "background_deviation_grey": lambda unit: float(_grey(unit).std(axis=(0, 1)).mean()),
    "noise_grey": lambda unit: unit.noise_grey,
}


def _placed(
    parameter: Callable[[Unit], float], units: list[Unit], real: Unit
) -> dict[str, dict[str, float]]:
    """A parameter's spread over the units, and where the real one lies in it."""
    values, value = np.array([parameter(unit) for unit in units]), parameter(real)
    low, high = np.percentile(values, (5, 95))
    return {
        "drawn": {"p5": float(low), "p95": float(high)},
        "real": {"value": value, "percentile": 100.0 * float(np.mean(values < value))},
    }


def sheet() -> Image.Image:
    """Drawn units, each pressed by a ball and a block."""
    surface = np.maximum(
        ball_surface(GEL, -1.5, -2.5, 1.1), block(GEL, 1.8, 3.0, 0.7, 5.0, 2.0, 0.5)
    )
    page = Image.new("RGB", (SHEET[1] * TILE_PX[0], SHEET[0] * TILE_PX[1]))
    for number in range(SHEET[0] * SHEET[1]):
        picture = ImageRenderer(drawn(number).optics, GEL, NOISE_GREY).render(surface)
        row, column = divmod(number, SHEET[1])
        tile = Image.fromarray(picture).resize(TILE_PX)
        page.paste(tile, (column * TILE_PX[0], row * TILE_PX[1]))
    return page
