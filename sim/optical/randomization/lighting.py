"""Samples the LEDs of a unit and their light in each color.

Relative to the light in the image's middle at MIDDLE_COSINE of the LEDs that have color c, the
light of LED k in it is

    F_kc(p, m) = own_kc B_k(p) S(m) + leak_kc + irregular_kc(p, m),

with p the place over PLACE_MM, B_k a paraboloid, S a parabola, own_kc 1 where the LED has at least
MIN_OWN of its brightest color in color c, and else 0. All
is quadratic in the place and in the cosine, as a response of t2twin.sim.optical.image_renderer is.

For pyrender, equivalent_leds gives lamps of the same places, sizes and colors. Each has the lobe of
the sensor's LED in its place, rotated and moved with it, since the resolution of pyrender's shadow
maps depends on the width of the lobe. Its color gives the sampled light in the image's middle.
Negative light, as of a negative leak, is omitted.
"""

from dataclasses import dataclass

import numpy as np
from msgspec import structs

from t2twin.sim.contact.elastomer import Elastomer
from t2twin.sim.optical.camera.pinhole import Camera
from t2twin.sim.optical.light.illumination import COSINE_TERMS
from t2twin.sim.optical.light.leds import REACH_MM, Led
from t2twin.sim.optical.optics import PLACE_TERMS, place_terms
from t2twin.sim.optical.randomization.ranges import UnitRanges, log_uniform

MIN_OWN = 0.5
"""Share of an LED's brightest color from which on it has another color too (assumed: color filters
of cameras leak less)."""
STATED_LEDS = 3
"""LEDs of the units to whose leaks and irregularity the ranges refer. Each of more LEDs has less of
both, so that their sums stay."""
MIDDLE_COSINE = 0.4
"""Cosine of incidence at which relative light is defined (assumed: flanks of a press)."""
DEGREE = 2
"""Degree of the responses in the place (assumed: as determined by a dozen presses)."""
TERMS = (DEGREE + 1) * (DEGREE + 2) // 2
IRREGULAR = np.array([[0.0, 0.5, 0.5, 1.0, 1.0, 1.0], [0.2, 1.2, 1.2, 2.0, 2.0, 2.0]])
"""Standard deviations of an irregular light's coefficients in the place, and of their slopes with
the cosine, for an amount of 1 (assumed: about those of one real unit's fit)."""
GAMMA_EXPONENT = -1.5
"""Exponent of gamma in leaks and irregularity (assumed): they are largest in the one real unit's
fit, of gamma 1, and 0 in the rendered light, of gamma 2.2."""
LARGEST_SIZE = 0.95
"""Largest radius of an LED's disc, in parts of its height over the apex. A larger disc would be
partly below the gel's horizon and cut off near a press only."""
FACING_COSINE = 0.9
"""Cosine of incidence at the brightest place of a bulge (assumed)."""
MIN_IN_BEAM = 0.2
"""Lower bound of the fraction of a lobe's light in the middle, which bounds an LED's brightness."""
SLOPE_STEP_MM = 0.01
"""Step of difference quotients of the surface at rest, mm."""


@dataclass(frozen=True)
class SampledLight:
    """LEDs and their linear light. places_mm: (LEDs, 3). sizes_mm: (LEDs,) radii. response: (LEDs,
    RGB, PLACE_TERMS, COSINE_TERMS). leds: those of the sensor, of which these are varied."""

    places_mm: np.ndarray
    sizes_mm: np.ndarray
    response: np.ndarray
    leds: tuple[Led, ...]


def own_colors(leds: tuple[Led, ...]) -> np.ndarray:
    """(LEDs, RGB) bool: the colors that each LED has."""
    colors = np.array([led.color for led in leds])
    return colors >= MIN_OWN * colors.max(axis=1, keepdims=True)


def sample_light(
    rng: np.random.Generator, ranges: UnitRanges, leds: tuple[Led, ...], gamma: float
) -> SampledLight:
    """The light of a unit of this gamma. ranges: without None. leds: of the sensor."""
    assert ranges.led_distance_mm is not None and ranges.led_elevation_deg is not None
    count = len(leds)
    azimuths_deg = np.array([led.angle_deg for led in leds])
    azimuth = np.radians(azimuths_deg + rng.uniform(*ranges.led_turn_deg, count))
    distance_mm = float(log_uniform(rng, ranges.led_distance_mm))
    elevation_deg = rng.uniform(*ranges.led_elevation_deg)
    elevation = np.radians(elevation_deg + rng.uniform(*ranges.led_elevation_off_deg, count))
    towards = np.stack([np.cos(azimuth), -np.sin(azimuth)], axis=1)
    heights = -distance_mm * np.tan(elevation)
    places_mm = np.concatenate([distance_mm * towards, heights[:, None]], axis=1)
    response = _relative(rng, ranges, leds, towards, gamma**GAMMA_EXPONENT)
    facing = (rng.uniform(*ranges.facing_grey, 3) / 255.0) ** gamma
    # in the middle, an LED's light falls with the square of its distance to the apex
    reach = REACH_MM**2 / (places_mm**2).sum(axis=1) * FACING_COSINE
    own = own_colors(leds)
    of_color = np.where(own.any(axis=0), own, True)  # all LEDs, if none has a color
    mean_reach = (of_color * reach[:, None]).sum(axis=0) / of_color.sum(axis=0)
    response *= (facing / mean_reach)[None, :, None, None]
    sizes_mm = np.minimum(log_uniform(rng, ranges.led_size_mm, count), LARGEST_SIZE * -heights)
    return SampledLight(places_mm, sizes_mm, response, leds)


def _relative(
    rng: np.random.Generator,
    ranges: UnitRanges,
    leds: tuple[Led, ...],
    towards: np.ndarray,
    mixed: float,
) -> np.ndarray:
    """(LEDs, RGB, PLACE_TERMS, COSINE_TERMS) light relative to that of the color's own LEDs.

    towards: (LEDs, 2) directions. mixed: factor of leaks and irregularity.
    """
    count = len(leds)
    by_power = np.zeros((count, 3, 3, TERMS))  # LED, color, power of the cosine, place
    few = min(1.0, STATED_LEDS / count)
    leaks = few * mixed * rng.uniform(*ranges.leak_amount)
    leaks = leaks * rng.uniform(*ranges.leak_part, (count, 3))
    amount = np.sqrt(few) * mixed * rng.uniform(*ranges.irregular_amount)
    patterns = amount * rng.standard_normal((count, 3, *IRREGULAR.shape)) * IRREGULAR
    by_power[:, :, 0, 0] = leaks
    by_power[:, :, : len(IRREGULAR)] += patterns
    slopes = rng.uniform(*ranges.cosine_slope_part, count)
    bends = rng.uniform(*ranges.cosine_bend_part, count)
    colors = own_colors(leds)
    shares = 1.0 / np.maximum(colors.sum(axis=0), 1)  # of each color's own LEDs
    for k in range(count):
        # the light of LEDs that are to the right or left crosses the middle towards the upper end
        across_sign = -np.sign(round(float(np.cos(np.radians(leds[k].angle_deg))), 6))
        beam = _beam(rng, ranges, towards[k], across_sign)
        for c in np.flatnonzero(colors[k]):
            # an LED's own light is irregular too, except for its level
            own, lit = by_power[k, c], shares[c] * beam
            own[0] += lit - leaks[k, c] * np.eye(TERMS)[0]
            own[1] += slopes[k] * lit
            own[2] += bends[k] * lit
    response = np.zeros((count, 3, PLACE_TERMS, COSINE_TERMS))
    value, rise, bend = by_power[:, :, 0], by_power[:, :, 1], by_power[:, :, 2]
    response[:, :, :TERMS, 0] = value - MIDDLE_COSINE * rise + MIDDLE_COSINE**2 * bend
    response[:, :, :TERMS, 1] = rise - 2.0 * MIDDLE_COSINE * bend
    response[:, :, :TERMS, 2] = bend
    return response


def _beam(
    rng: np.random.Generator, ranges: UnitRanges, towards: np.ndarray, across_sign: float
) -> np.ndarray:
    """(TERMS,) coefficients of an LED's light in the place.

    towards: (2,) direction. across_sign: of the gradient of its light across this direction.
    """
    along, across = rng.uniform(*ranges.beam_along_part), rng.uniform(*ranges.beam_across_part)
    curves, twist = rng.uniform(*ranges.beam_curve_part, 2), rng.uniform(*ranges.beam_twist_part)
    sideways = np.array([-towards[1], towards[0]])
    rise = along * towards + across_sign * across * sideways
    return np.array([1.0, rise[0], rise[1], curves[0], twist, curves[1]])


def light_at_rest(
    light: SampledLight, camera: Camera, gel: Elastomer, columns: np.ndarray, rows: np.ndarray
) -> np.ndarray:
    """(rows, columns, RGB) light of the LEDs on a gel at rest.

    columns, rows: pixel coordinates, which may be fractional and outside the image.
    """
    x, y, z = camera.gel_points(gel, columns, rows)
    slope_x = (_surface_mm(camera, gel, x + SLOPE_STEP_MM, y) - z) / SLOPE_STEP_MM
    slope_y = (_surface_mm(camera, gel, x, y + SLOPE_STEP_MM) - z) / SLOPE_STEP_MM
    terms = place_terms(x, y, DEGREE)
    steep2 = 1.0 + slope_x**2 + slope_y**2
    seen = np.zeros((*x.shape, 3))
    for place, response in zip(light.places_mm, light.response, strict=True):
        dx, dy, dz = place[0] - x, place[1] - y, place[2] - z
        far2 = dx**2 + dy**2 + dz**2
        m = np.maximum(slope_x * dx + slope_y * dy - dz, 0.0) / np.sqrt(steep2 * far2)
        weight = m * REACH_MM**2 / far2
        powers = m[..., None] ** np.arange(COSINE_TERMS)
        by_power = np.einsum("rsi,cij->rscj", terms, response[:, :TERMS])
        seen += weight[..., None] * np.einsum("rscj,rsj->rsc", by_power, powers)
    return seen


def _surface_mm(camera: Camera, gel: Elastomer, x_mm: np.ndarray, y_mm: np.ndarray) -> np.ndarray:
    return gel.rest_surface_mm(x_mm, y_mm) + camera.tilt_mm(x_mm, y_mm)


def at_middle(response: np.ndarray) -> np.ndarray:
    """(LEDs, RGB) light of a response in the image's middle at MIDDLE_COSINE."""
    return np.einsum("kcj,j->kc", response[:, :, 0], MIDDLE_COSINE ** np.arange(COSINE_TERMS))


def equivalent_leds(light: SampledLight) -> tuple[Led, ...]:
    """LEDs for t2twin.sim.optical.pyrender_renderer, in the order of the light's LEDs."""
    colors = np.maximum(at_middle(light.response), 0.0)
    leds = zip(light.leds, light.places_mm.tolist(), light.sizes_mm.tolist(), colors, strict=True)
    return tuple(_equivalent_led(*each) for each in leds)


def _equivalent_led(default: Led, place_mm: list[float], size_mm: float, color: np.ndarray) -> Led:
    """A sensor's LED moved to another place, with another size and color."""
    x, y, z = place_mm
    angle, radius_mm = np.arctan2(-y, x), float(np.hypot(x, y))
    turn, stretch = angle - np.radians(default.angle_deg), radius_mm / default.radius_mm
    cos, sin = stretch * np.cos(turn), stretch * np.sin(turn)
    aim_x, aim_y, aim_z = default.aim_mm
    # angles increase against y, which points down in the image
    aim_mm = (float(cos * aim_x + sin * aim_y), float(cos * aim_y - sin * aim_x), aim_z)
    led = structs.replace(
        default, angle_deg=float(np.degrees(angle)), radius_mm=radius_mm, z_mm=z, size_mm=size_mm,
        aim_mm=aim_mm,
    )  # fmt: skip
    color = color / max(float(led.in_beam(np.zeros(3))), MIN_IN_BEAM)
    return structs.replace(led, color=tuple(color.tolist()))
