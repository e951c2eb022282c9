"""Samples DIGIT units: no two DIGITs have the same light.

A unit is a complete calibration: camera, LEDs, the response of each LED in each color, gamma,
background, noise. It is sampled from ranges, alone or near a given calibration. It depends on the
random generator only, not on threads or processes.
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
from t2twin.sim.digit.camera.pinhole import COLUMNS, MAX_MISALIGNMENT, ROWS, Camera
from t2twin.sim.digit.light.leds import Led
from t2twin.sim.digit.optics import NOISE_GREY
from t2twin.sim.digit.randomization.background import sample_background
from t2twin.sim.digit.randomization.lighting import equivalent_leds, sample_light
from t2twin.sim.digit.randomization.ranges import UnitRanges, log_uniform, uniform

__all__ = ["Unit", "UnitRanges", "sample_unit"]


@dataclass(frozen=True, eq=False)
class Unit:
    """One DIGIT's light.

    calibration: complete. noise_grey: standard deviation of one frame, grey levels. leds: for
    pyrender; None for a unit near a calibration. earlier_background: (ROWS, COLUMNS, 3) uint8, the
    background frame, recorded before its light drifted; None without drift.
    """

    calibration: Calibration
    noise_grey: float
    leds: tuple[Led, ...] | None = None
    earlier_background: np.ndarray | None = None


def sample_unit(
    rng: np.random.Generator, ranges: UnitRanges, center: Calibration | None = None
) -> Unit:
    """A unit sampled from the ranges; with a center, one near that calibration."""
    if center is not None:
        return _sample_near(rng, ranges, center)
    scale, distance_mm = uniform(rng, ranges.scale_px_per_mm), uniform(rng, ranges.distance_mm)
    shift, tilt = uniform(rng, ranges.shift_px, 2), uniform(rng, ranges.tilt_deg, 2)
    camera = Camera(float(scale), float(distance_mm), *shift.tolist(), *tilt.tolist())
    is_linear = rng.random() < ranges.linear_amount
    gamma = float(uniform(rng, ranges.linear_gamma if is_linear else ranges.gamma))
    light = sample_light(rng, ranges, gamma)
    background, light = sample_background(rng, ranges, light, camera, gamma)
    noise_grey = float(log_uniform(rng, ranges.noise_grey))
    calibration = Calibration(
        background=background,
        leds_mm=light.places_mm,
        sizes_mm=light.sizes_mm,
        response=light.response,
        gamma=gamma,
        **asdict(camera),
    )
    return Unit(calibration, noise_grey, equivalent_leds(light))


def _sample_near(rng: np.random.Generator, ranges: UnitRanges, center: Calibration) -> Unit:
    def part(shape: int | tuple = ()) -> np.ndarray:
        return uniform(rng, ranges.around_part, shape)

    leds_mm = center.leds_mm + uniform(rng, ranges.around_led_mm, (3, 3))
    # the colors are mixed, and each LED is a little brighter or dimmer
    mixing = np.eye(3) + part((3, 3))
    brightness = 1.0 + part((3, 1, 1, 1))

    def varied_light(table: np.ndarray) -> np.ndarray:
        mixed = np.einsum("kcij,dc->kdij", table, mixing) * brightness
        return np.clip(mixed, -MAX_RESPONSE, MAX_RESPONSE)

    shift, tilt = uniform(rng, ranges.around_shift_px, 2), uniform(rng, ranges.around_tilt_deg, 2)
    calibration = replace(
        center,
        background=_varied(center.background, part((3, 3))),
        leds_mm=np.clip(leds_mm, -FARTHEST_LED_MM, FARTHEST_LED_MM),
        sizes_mm=np.minimum(center.sizes_mm * (1.0 + part(3)), LARGEST_LED_MM),
        response=varied_light(center.response),
        lobe=None if center.lobe is None else varied_light(center.lobe),
        gamma=_clipped(center.gamma * (1.0 + part() / 2.0), GAMMAS),
        scale_px_per_mm=_clipped(center.scale_px_per_mm * (1.0 + part() / 4.0), SCALES_PX_PER_MM),
        distance_mm=_clipped(center.distance_mm * (1.0 + part() / 4.0), DISTANCES_MM),
        **{
            name: _clipped(getattr(center, name) + change, (-limit, limit))
            for (name, limit), change in zip(MAX_MISALIGNMENT.items(), (*shift, *tilt), strict=True)
        },
    )
    return Unit(calibration, float(NOISE_GREY * (1.0 + part())))


def _varied(background: np.ndarray, parts: np.ndarray) -> np.ndarray:
    """(ROWS, COLUMNS, 3) uint8: a background with other brightness.

    parts: (3, 3) relative change of each channel, and its gradients to the right and down.
    """
    level, right, down = parts
    x = ((np.arange(COLUMNS) - COLUMNS / 2) / COLUMNS)[None, :, None]
    y = ((np.arange(ROWS) - ROWS / 2) / ROWS)[:, None, None]
    factor = (1.0 + level + right * x + down * y).astype(np.float32)
    return (np.minimum(background * factor, 255.0) + np.float32(0.5)).astype(np.uint8)


def _clipped(value: np.ndarray | float, bounds: tuple[float, float]) -> float:
    return float(np.clip(value, *bounds))
