"""Light without end: DIGITs that might be, drawn one by one.

No two DIGITs have the same light. A unit's calibration is drawn whole: camera, LEDs, the response
of each in each color, gamma, background, noise; or a known calibration is changed a little. What
is drawn depends on the generator alone, not on threads or processes.
"""

from dataclasses import asdict, dataclass, replace

import numpy as np

from t2twin.sim.digit.calibration import (
    DISTANCES_MM,
    FARTHEST_LED_MM,
    GAMMAS,
    LARGEST_LED_MM,
    MAX_RESPONSE,
    SCALES_PX_PER_MM,
    Calibration,
)
from t2twin.sim.digit.camera.pinhole import MAX_OFF, Camera
from t2twin.sim.digit.light.leds import Led
from t2twin.sim.digit.optics import NOISE_GREY
from t2twin.sim.digit.randomization.background import redrawn, sample_background
from t2twin.sim.digit.randomization.lighting import leds_like, sample_light
from t2twin.sim.digit.randomization.ranges import UnitRanges, evenly, log_uniform

__all__ = ["Unit", "UnitRanges", "sample_unit"]


@dataclass(frozen=True, eq=False)
class Unit:
    """One DIGIT's light.

    calibration: complete, as of a fitted unit. noise_grey: standard deviation of one frame, grey
    levels. leds: what stands for its LEDs in pyrender, None where nothing does.
    """

    calibration: Calibration
    noise_grey: float
    leds: tuple[Led, ...] | None = None


def sample_unit(
    rng: np.random.Generator, draw: UnitRanges, center: Calibration | None = None
) -> Unit:
    """A unit drawn from the ranges of draw; with a center, one near that calibration."""
    return _drawn(rng, draw) if center is None else _around(rng, draw, center)


def _drawn(rng: np.random.Generator, draw: UnitRanges) -> Unit:
    scale, distance_mm = evenly(rng, draw.scale_px_per_mm), evenly(rng, draw.distance_mm)
    shift, tilt = evenly(rng, draw.shift_px, 2), evenly(rng, draw.tilt_deg, 2)
    camera = Camera(float(scale), float(distance_mm), *shift.tolist(), *tilt.tolist())
    is_linear = rng.random() < draw.linear_amount
    gamma = float(evenly(rng, draw.linear_gamma if is_linear else draw.gamma))
    light = sample_light(rng, draw, gamma)
    background, light = sample_background(rng, draw, light, camera, gamma)
    noise_grey = float(log_uniform(rng, draw.noise_grey))
    calibration = Calibration(
        background=background,
        leds_mm=light.places_mm,
        sizes_mm=light.sizes_mm,
        response=light.response,
        gamma=gamma,
        **asdict(camera),
    )
    return Unit(calibration, noise_grey, leds_like(light))


def _around(rng: np.random.Generator, draw: UnitRanges, center: Calibration) -> Unit:
    def part(shape: int | tuple = ()) -> np.ndarray:
        return evenly(rng, draw.around_part, shape)

    leds_mm = center.leds_mm + evenly(rng, draw.around_led_mm, (3, 3))
    # each color takes a part of the others', and each LED is a little brighter or dimmer
    mixing = np.eye(3) + part((3, 3))
    response = np.einsum("kcij,dc->kdij", center.response, mixing) * (1.0 + part((3, 1, 1, 1)))
    shift, tilt = evenly(rng, draw.around_shift_px, 2), evenly(rng, draw.around_tilt_deg, 2)
    calibration = replace(
        center,
        background=redrawn(rng, draw, center),
        leds_mm=np.clip(leds_mm, -FARTHEST_LED_MM, FARTHEST_LED_MM),
        sizes_mm=np.minimum(center.sizes_mm * (1.0 + part(3)), LARGEST_LED_MM),
        response=np.clip(response, -MAX_RESPONSE, MAX_RESPONSE),
        gamma=_within(center.gamma * (1.0 + part() / 2.0), GAMMAS),
        scale_px_per_mm=_within(center.scale_px_per_mm * (1.0 + part() / 4.0), SCALES_PX_PER_MM),
        distance_mm=_within(center.distance_mm * (1.0 + part() / 4.0), DISTANCES_MM),
        **{
            name: _within(getattr(center, name) + off, (-most, most))
            for (name, most), off in zip(MAX_OFF.items(), (*shift, *tilt), strict=True)
        },
    )
    return Unit(calibration, float(NOISE_GREY * (1.0 + part())))


def _within(value: np.ndarray | float, bounds: tuple[float, float]) -> float:
    """The value that a calibration may have nearest to this one."""
    return float(np.clip(value, *bounds))
