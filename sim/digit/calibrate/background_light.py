"""A calibration from one background frame: the mean light of sampled units.

The background frame does not determine how LEDs shade and shadow a press. The sampled units whose
LEDs explain it best predict a real unit's presses no better than the others. The mean over many
units predicts them better than any one unit.
"""

from collections.abc import Callable, Sequence
from dataclasses import asdict, replace
from pathlib import Path

import numpy as np

from t2twin.core import arguments
from t2twin.sim.digit.calibrate.fit import GAMMA
from t2twin.sim.digit.calibrate.frames import read_frame, upright_frame
from t2twin.sim.digit.calibration import Calibration
from t2twin.sim.digit.camera.pinhole import Camera
from t2twin.sim.digit.randomization.ranges import UnitRanges
from t2twin.sim.digit.randomization.unit import sample_unit

UNIT_COUNT = 300
"""Number of units that are averaged (assumed: twice as many change the mean by little)."""
RANGES = UnitRanges(linear_amount=1.0, linear_gamma=(GAMMA, GAMMA))
"""Ranges of the units: their gamma is the one of a fit. Only responses of one gamma can be
averaged."""


def guess_light(
    background: str | Path,
    camera: Camera | None = None,
    report: Callable[[str], object] = lambda line: None,
) -> Calibration:
    """A calibration with the user's background and the mean light of sampled units.

    background: a background frame, 240 wide, 320 high, PNG or JPEG, whose noise is kept. camera:
    scale and distance, which a frame does not determine. report: called with progress messages.
    Raises T2TwinError for an invalid frame.
    """
    camera = Camera() if camera is None else arguments.instance(camera, "camera", Camera)
    arguments.function(report, "report")
    frame = upright_frame(read_frame(arguments.path(background, "background")))
    report(f"sampling {UNIT_COUNT} DIGIT units, some seconds")
    return mean_light(sample_lights(frame, camera))


def sample_lights(
    background: np.ndarray, camera: Camera, count: int = UNIT_COUNT
) -> list[Calibration]:
    """Sampled units, all with one camera and one background (ROWS, COLUMNS, 3) uint8."""
    units = (sample_unit(np.random.default_rng((0, n)), RANGES).calibration for n in range(count))
    return [replace(unit, background=background, **asdict(camera)) for unit in units]


def mean_light(units: Sequence[Calibration]) -> Calibration:
    """The mean LED positions and response, and the geometric mean of the LED sizes."""
    return replace(
        units[0],
        leds_mm=np.mean([unit.leds_mm for unit in units], axis=0),
        sizes_mm=np.exp(np.mean([np.log(unit.sizes_mm) for unit in units], axis=0)),
        response=np.mean([unit.response for unit in units], axis=0),
    )
