"""A light guessed from the untouched gel alone: the mean of the drawn units that explain it best.

One frame without a press says next to nothing of how LEDs shade and shadow a press. So many DIGITs
are drawn, those are kept whose LEDs come nearest to the frame, each LED's colour brightened or
dimmed and an even light added, and their places and responses are averaged. Camera and background
are the user's own. docs/calibration.md says how near that comes, and how much the choice adds.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from scipy.optimize import nnls

from t2twin.sim.digit.calibrate.fit import GAMMA
from t2twin.sim.digit.calibrate.frames import read_frame, upright_frame
from t2twin.sim.digit.calibration import Calibration
from t2twin.sim.digit.camera import COLUMNS, ROWS, Camera
from t2twin.sim.digit.picture import linear
from t2twin.sim.digit.unit_draw import UnitDraw
from t2twin.sim.digit.unit_light import DrawnLight, untouched_light
from t2twin.sim.digit.units import draw_unit

DRAWN, NEAREST = 1000, 30
"""Units drawn, and how many of them are averaged (of 5, 10, 30, 100 and 300 the best for the first
14 presses of one real unit, by little)."""
DRAW = UnitDraw(linear_amount=1.0, linear_gamma=(GAMMA, GAMMA))
"""Units whose grey levels go with the light, as a fit takes a real unit's to do: only responses of
one gamma can be averaged."""
BLOCK_PX = 10
"""Side of the blocks of pixels that are compared, px: under it a background has specks and noise
(assumed)."""


@dataclass(frozen=True)
class Candidate:
    """A drawn unit with the user's own camera and background. off_grey: root mean square by which
    its LEDs, at their best, miss the untouched frame, grey levels."""

    calibration: Calibration
    off_grey: float


def guess_light(
    background: str | Path,
    camera: Camera | None = None,
    say: Callable[[str], object] = lambda line: None,
) -> Calibration:
    """A calibration of a unit of which there is one untouched frame and nothing else.

    background: that frame, 240 wide, 320 high, PNG or JPEG. camera: scale and distance, which the
    frame does not tell. Its noise is not known, and what noise the frame has stays in it. The same
    frame gives the same light. Raises T2TwinError for a frame that cannot be used.
    """
    untouched = upright_frame(read_frame(Path(background)))
    say(f"drawing {DRAWN} DIGITs")
    return mean_light(nearest(candidates(untouched, camera or Camera()), NEAREST))


def candidates(untouched: np.ndarray, camera: Camera, count: int = DRAWN) -> list[Candidate]:
    """Drawn units, each beside the untouched frame (ROWS, COLUMNS, 3) uint8."""
    blocks = untouched.reshape(ROWS // BLOCK_PX, BLOCK_PX, COLUMNS // BLOCK_PX, BLOCK_PX, 3)
    seen = linear(blocks.mean(axis=(1, 3)), GAMMA)
    made = []
    for number in range(count):
        unit = draw_unit(np.random.default_rng((0, number)), DRAW).calibration
        calibration = replace(
            unit,
            background=untouched,
            scale_px_per_mm=camera.scale_px_per_mm,
            distance_mm=camera.distance_mm,
            shift_x_px=camera.shift_x_px,
            shift_y_px=camera.shift_y_px,
            tilt_x_deg=camera.tilt_x_deg,
            tilt_y_deg=camera.tilt_y_deg,
        )
        made.append(Candidate(calibration, _off_grey(calibration, seen)))
    return made


def nearest(units: Sequence[Candidate], count: int) -> list[Candidate]:
    """As many of those that miss the frame least, the nearest first."""
    return sorted(units, key=lambda unit: unit.off_grey)[:count]


def mean_light(units: Sequence[Candidate]) -> Calibration:
    """LEDs at the mean places, of the mean sizes, geometrically, with the mean response."""
    each = [unit.calibration for unit in units]
    return replace(
        each[0],
        leds_mm=np.mean([of.leds_mm for of in each], axis=0),
        sizes_mm=np.exp(np.mean([np.log(of.sizes_mm) for of in each], axis=0)),
        response=np.mean([of.response for of in each], axis=0),
    )


def _off_grey(calibration: Calibration, seen: np.ndarray) -> float:
    """See Candidate. seen: (blocks down, blocks across, RGB) light of the untouched frame."""
    light = DrawnLight(calibration.leds_mm, calibration.sizes_mm, calibration.response)
    middle = (BLOCK_PX - 1) / 2
    rows, columns = (BLOCK_PX * np.arange(count) + middle for count in seen.shape[:2])
    lit = untouched_light(light, calibration.camera, columns, rows)
    errors = [
        nnls(np.stack([own.ravel(), np.ones(own.size)], axis=1), wanted.ravel())[1]
        for own, wanted in zip(np.moveaxis(lit, -1, 0), np.moveaxis(seen, -1, 0), strict=True)
    ]
    return float(255.0 * np.sqrt(np.sum(np.square(errors)) / seen.size))
