"""A light for a unit of which there is one untouched frame and nothing else: the drawn units' mean.

The frame gives the background. Of how the LEDs shade and shadow a press it says nothing that could
be used: drawn units whose LEDs explain it best come no nearer to a real unit's presses than others
do (benchmarks/untouched.py). The mean over many drawn units comes nearer than any of them, as it
errs the least.
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

DRAWN = 300
"""Units that are averaged (assumed: twice as many change the mean by little)."""
DRAW = UnitRanges(linear_amount=1.0, linear_gamma=(GAMMA, GAMMA))
"""Units whose grey levels go with the light, as a fit takes a real unit's to do: only responses of
one gamma can be averaged."""


def guess_light(
    background: str | Path,
    camera: Camera | None = None,
    say: Callable[[str], object] = lambda line: None,
) -> Calibration:
    """A calibration with the user's background, under the mean light of drawn units.

    background: a frame of the untouched sensor, 240 wide, 320 high, PNG or JPEG; what noise it has
    stays in it. camera: scale and distance, which the frame does not tell. Raises T2TwinError for a
    frame that cannot be used.
    """
    camera = Camera() if camera is None else arguments.instance(camera, "camera", Camera)
    arguments.function(say, "say")
    untouched = upright_frame(read_frame(arguments.path(background, "background")))
    say(f"drawing {DRAWN} DIGITs, some seconds")
    return mean_light(drawn_lights(untouched, camera))


def drawn_lights(untouched: np.ndarray, camera: Camera, count: int = DRAWN) -> list[Calibration]:
    """Drawn units, all with one camera and background (ROWS, COLUMNS, 3) uint8."""
    units = (sample_unit(np.random.default_rng((0, n)), DRAW).calibration for n in range(count))
    return [
        replace(
            unit,
            background=untouched,
            **asdict(camera),
        )
        for unit in units
    ]


def mean_light(units: Sequence[Calibration]) -> Calibration:
    """LEDs at the mean places, of the mean sizes, geometrically, with the mean response."""
    return replace(
        units[0],
        leds_mm=np.mean([unit.leds_mm for unit in units], axis=0),
        sizes_mm=np.exp(np.mean([np.log(unit.sizes_mm) for unit in units], axis=0)),
        response=np.mean([unit.response for unit in units], axis=0),
    )
