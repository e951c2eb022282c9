"""Light without end: DIGITs that might be, drawn one by one.

No two DIGITs have the same light. A unit's calibration is drawn whole: camera, LEDs, the response
of each in each colour, gamma, background, noise; or a known calibration is changed a little. What
is drawn depends on the generator alone, not on threads or processes.
"""

from dataclasses import asdict, dataclass, replace

import numpy as np

from t2twin.sim.digit.calibration import (
    DISTANCES_MM,
    FARTHEST_LED_MM,
    GAMMAS,
    LARGEST_LED_MM,
    MOST_RESPONSE,
    SCALES_PX_PER_MM,
    Calibration,
)
from t2twin.sim.digit.camera.pinhole import MOST_OFF, Camera
from t2twin.sim.digit.light.leds import Led
from t2twin.sim.digit.optics import NOISE_GREY
from t2twin.sim.digit.randomization.background import draw_background, redrawn
from t2twin.sim.digit.randomization.lighting import draw_light, leds_like
from t2twin.sim.digit.randomization.ranges import UnitDraw, evenly, evenly_in_log

__all__ = ["Unit", "UnitDraw", "draw_unit"]


@dataclass(frozen=True, eq=False)
class Unit:
    """One DIGIT's light.

    calibration: complete, as of a fitted unit. noise_grey: standard deviation of one frame, grey
    levels. leds: what stands for its LEDs in pyrender, None where nothing does.
    """

    calibration: Calibration
    noise_grey: float
    leds: tuple[Led, ...] | None = None


def draw_unit(rng: np.random.Generator, draw: UnitDraw, centre: Calibration | None = None) -> Unit:
    """A unit drawn from the ranges of draw; with a centre, one near that calibration."""
    return _drawn(rng, draw) if centre is None else _around(rng, draw, centre)


def _drawn(rng: np.random.Generator, draw: UnitDraw) -> Unit:
    scale, distance_mm = evenly(rng, draw.scale_px_per_mm), evenly(rng, draw.distance_mm)
    shift, tilt = evenly(rng, draw.shift_px, 2), evenly(rng, draw.tilt_deg, 2)
    camera = Camera(float(scale), float(distance_mm), *shift.tolist(), *tilt.tolist())
    is_linear = rng.random() < draw.linear_amount
    gamma = float(evenly(rng, draw.linear_gamma if is_linear else draw.gamma))
    light = draw_light(rng, draw, gamma)
    background, light = draw_background(rng, draw, light, camera, gamma)
    noise_grey = float(evenly_in_log(rng, draw.noise_grey))
    calibration = Calibration(
        background=background,
        leds_mm=light.places_mm,
        sizes_mm=light.sizes_mm,
        response=light.response,
        gamma=gamma,
        **asdict(camera),
    )
    return Unit(calibration, noise_grey, leds_like(light))


def _around(rng: np.random.Generator, draw: UnitDraw, centre: Calibration) -> Unit:
    def part(shape: int | tuple = ()) -> np.ndarray:
        return evenly(rng, draw.around_part, shape)

    leds_mm = centre.leds_mm + evenly(rng, draw.around_led_mm, (3, 3))
    # each colour takes a part of the others', and each LED is a little brighter or dimmer
    mixing = np.eye(3) + part((3, 3))
    response = np.einsum("kcij,dc->kdij", centre.response, mixing) * (1.0 + part((3, 1, 1, 1)))
    shift, tilt = evenly(rng, draw.around_shift_px, 2), evenly(rng, draw.around_tilt_deg, 2)
    calibration = replace(
        centre,
        background=redrawn(rng, draw, centre),
        leds_mm=np.clip(leds_mm, -FARTHEST_LED_MM, FARTHEST_LED_MM),
        sizes_mm=np.minimum(centre.sizes_mm * (1.0 + part(3)), LARGEST_LED_MM),
        response=np.clip(response, -MOST_RESPONSE, MOST_RESPONSE),
        gamma=_within(centre.gamma * (1.0 + part() / 2.0), GAMMAS),
        scale_px_per_mm=_within(centre.scale_px_per_mm * (1.0 + part() / 4.0), SCALES_PX_PER_MM),
        distance_mm=_within(centre.distance_mm * (1.0 + part() / 4.0), DISTANCES_MM),
        **{
            name: _within(getattr(centre, name) + off, (-most, most))
            for (name, most), off in zip(MOST_OFF.items(), (*shift, *tilt), strict=True)
        },
    )
    return Unit(calibration, float(NOISE_GREY * (1.0 + part())))


def _within(value: np.ndarray | float, bounds: tuple[float, float]) -> float:
    """The value that a calibration may have nearest to this one."""
    return float(np.clip(value, *bounds))
