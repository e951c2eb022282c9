"""Samples units of a gel camera: no two units have the same light.

A unit is a complete set of optics, sampled from ranges, alone or near given optics. It depends on
the random generator only, not on threads or processes.

Relative to the light in the image's middle at MIDDLE_COSINE of the LEDs that have color c, the
light of LED k in it is

    F_kc(p, m) = own_kc B_k(p) S(m) + leak_kc + irregular_kc(p, m),

with p the place over PLACE_MM, B_k a paraboloid, S a parabola, own_kc 1 where the LED has at least
MIN_OWN of its brightest color in color c, and else 0. All is quadratic in the place and in the
cosine, as a response of t2twin.sim.optical.image_renderer is.

The background's light is computed at nodes NODE_PX apart, encoded as grey levels there and
interpolated by cubics (Catmull and Rom 1974). Blotches, a dark side, specks and the pixels' fixed
pattern are applied to the grey levels.

For pyrender, each LED of the sensor is moved, rotated, resized and colored with its beam, since the
resolution of pyrender's shadow maps depends on the width of the beam. Its color gives the sampled
light in the image's middle. Negative light, as of a negative leak, is omitted.
"""

from dataclasses import dataclass, replace
from typing import Annotated, Any

import numpy as np
from msgspec import Meta, structs

from t2twin.core.arrays import Record
from t2twin.core.errors import T2TwinError
from t2twin.sim.contact.elastomer import Elastomer
from t2twin.sim.optical.camera import LIMITS, Camera, Distance, Scale, Tilt
from t2twin.sim.optical.compiled import jit
from t2twin.sim.optical.illumination import COSINE_TERMS, REACH_MM
from t2twin.sim.optical.optics import (
    FARTHEST_LED_MM,
    GAMMAS,
    MAX_LED_MM,
    MAX_RESPONSE,
    PLACE_TERMS,
    Optics,
    place_terms,
)
from t2twin.sim.optical.response import standard_normal
from t2twin.sim.optical.spec import Elevation, Gamma, GelCameraSpec, Led, LedDistance, Ranges

MIN_OWN = 0.5
"""Share of an LED's brightest color from which on it has another color too (assumed: color filters
of cameras leak less)."""
STATED_LEDS = 3
"""LEDs of the units to whose leaks and irregularity the ranges refer. Each of more LEDs has less of
both, so that their sums stay."""
MIDDLE_COSINE = 0.4  # at which relative light is defined (assumed: flanks of a press)
DEGREE = 2  # degree of the responses in the place (assumed: as determined by a dozen presses)
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
FACING_COSINE = 0.9  # cosine of incidence at the brightest place of a bulge (assumed)
MIN_IN_BEAM = 0.2  # part of a beam's light in the middle, which bounds an LED's brightness
SLOPE_STEP_MM = 0.01  # step of difference quotients of the surface at rest, mm
NODE_PX = 10  # distance of neighboring nodes, px
COARSE_PX = 80  # distance of neighboring coarse blotches, px
PATTERN = (0.15, 2.0)
"""Bounds of the background's light, in parts of its mean (assumed: the maximum of a real unit is
2.1 times its mean)."""
DARKEST = 1e-4  # smallest light of a node, in parts of white, so that it has a grey level

Size = tuple[int, int]  # rows and columns of an image

INSIDE = (slice(1, -2), slice(1, -2))  # the nodes within the image
_ZERO, _ONE, _HALF = np.float32(0.0), np.float32(1.0), np.float32(0.5)
_TWO, _THREE, _FOUR, _FIVE = (np.float32(n) for n in (2.0, 3.0, 4.0, 5.0))
_BRIGHTEST = np.float32(255.0)

Amount = Annotated[float, Meta(ge=0.0, le=1.0)]
Part = Annotated[float, Meta(ge=-4.0, le=4.0)]
Around = Annotated[float, Meta(ge=-0.5, le=0.5)]
Grey = Annotated[float, Meta(ge=0.0, le=255.0)]
Degrees = Annotated[float, Meta(ge=-45.0, le=45.0)]
Shift = Annotated[float, Meta(ge=-50.0, le=50.0)]
OfLed = Annotated[float, Meta(ge=-20.0, le=20.0)]
LedSize = Annotated[float, Meta(ge=0.1, le=30.0)]
Pixels = Annotated[float, Meta(ge=-100.0, le=320.0)]
Radius = Annotated[float, Meta(ge=0.5, le=50.0)]
Count = Annotated[int, Meta(ge=0, le=100)]
Noise = Annotated[float, Meta(ge=0.01, le=50.0)]

Range = tuple[float, float]


class UnitRanges(Ranges, frozen=True):
    """Ranges of a unit's parameters, low and high; None is that of the sensor's table [units].

    Samples are uniform; those of the LEDs' distance and sizes and of the noise are log-uniform.
    Parts are relative to the own LED's light in the image's middle; places are in units of
    PLACE_MM, 8 mm. All but the noise is assumed, so as to contain the default optics and one real
    DIGIT; docs/explanation/optics.md compares them.
    """

    # of the camera: image scale, distance from the pinhole, both axes of the shift and of the tilt
    scale_px_per_mm: tuple[Scale, Scale] | None = None
    distance_mm: tuple[Distance, Distance] | None = None
    shift_px: tuple[Shift, Shift] = (-10.0, 10.0)
    tilt_deg: tuple[Tilt, Tilt] = (-1.5, 1.5)
    # of each LED; distance and elevation over the apex have one value per unit
    led_turn_deg: tuple[Degrees, Degrees] = (-9.0, 9.0)  # deviation from its angle around the gel
    led_distance_mm: tuple[LedDistance, LedDistance] | None = None
    led_elevation_deg: tuple[Elevation, Elevation] | None = None
    led_elevation_off_deg: tuple[Degrees, Degrees] = (-4.0, 4.0)  # from the lengths of shadows
    led_size_mm: tuple[LedSize, LedSize] = (1.0, 9.0)  # radius, at most LARGEST_SIZE of its height
    # of the light that each LED leaves in each color
    facing_grey: tuple[Grey, Grey] = (110.0, 250.0)  # of gel that faces its own LED
    beam_along_part: tuple[Part, Part] = (-1.8, 0.4)  # gradient of an LED's light towards it
    beam_across_part: tuple[Part, Part] = (-0.2, 2.0)  # and away from the image's lower end
    beam_curve_part: tuple[Part, Part] = (-2.0, 0.4)  # half its second derivatives
    beam_twist_part: tuple[Part, Part] = (-1.0, 1.0)  # the same, mixed
    cosine_slope_part: tuple[Part, Part] = (-0.5, 0.8)  # from Lambert's law, linear in the cosine
    cosine_bend_part: tuple[Part, Part] = (-2.0, 0.8)  # the same, quadratic
    leak_amount: tuple[Amount, Amount] = (0.0, 1.0)  # of an LED's light in the other two colors
    leak_part: tuple[Part, Part] = (-0.8, 0.8)  # its factor; cameras' color correction subtracts
    irregular_amount: tuple[Amount, Amount] = (0.0, 1.0)  # of a separate pattern in each color
    # of the image
    linear_amount: Amount = 0.4  # share of units of a gamma in linear_gamma, such as a real one, 1
    linear_gamma: tuple[Gamma, Gamma] = (0.9, 1.1)
    gamma: tuple[Gamma, Gamma] = (1.1, 2.4)  # of the others, such as TACTO's renderer, 2.2
    scattered_part: tuple[Part, Part] = (0.0, 1.2)  # undirected light, added to the LEDs'
    follow_amount: tuple[Amount, Amount] = (0.1, 1.0)  # weight of the LEDs' light in the background
    gradient_part: tuple[Part, Part] = (-0.5, 0.5)  # of the separate pattern in the rest of it
    brightness_grey: tuple[Grey, Grey] = (70.0, 135.0)  # of a channel's mean in the background
    pattern_grey: tuple[Grey, Grey] = (10.0, 48.0)  # maximum of its deviation before the following
    uneven_coarse_grey: tuple[Grey, Grey] = (0.0, 10.0)  # of blotches about 80 pixels wide
    uneven_fine_grey: tuple[Grey, Grey] = (0.0, 3.0)  # of blotches about 10 pixels wide
    texture_grey: tuple[Grey, Grey] = (0.0, 1.3)  # of the pixels' fixed pattern
    edge_dark_amount: tuple[Amount, Amount] = (0.0, 0.6)  # darkening of one side of the image
    edge_px: tuple[Pixels, Pixels] = (-30.0, 45.0)  # its end
    edge_soft_px: tuple[Radius, Radius] = (6.0, 40.0)  # and blur
    specks: tuple[Count, Count] = (0, 6)  # their number
    speck_px: tuple[Radius, Radius] = (1.0, 6.0)  # radius
    speck_grey: tuple[Grey, Grey] = (10.0, 60.0)  # contrast
    noise_grey: tuple[Noise, Noise] = (1.5, 7.0)  # of one frame (2.8 measured; TACTO 7)
    # of units near an optics file, relative to it
    around_led_mm: tuple[OfLed, OfLed] = (-1.0, 1.0)
    around_part: tuple[Around, Around] = (-0.1, 0.1)  # half for gamma, a quarter for scale
    around_shift_px: tuple[Shift, Shift] = (-4.0, 4.0)
    around_tilt_deg: tuple[Tilt, Tilt] = (-0.5, 0.5)


def log_uniform(rng: np.random.Generator, bounds: Range, shape: int | tuple = ()) -> np.ndarray:
    """Samples of a shape whose logarithm is uniform."""
    return np.exp(rng.uniform(np.log(bounds[0]), np.log(bounds[1]), shape))


@dataclass(frozen=True, eq=False)
class Unit(Record):
    """One unit's light."""

    optics: Optics
    noise_grey: float  # standard deviation of one frame, grey levels
    leds: tuple[Led, ...] | None = None  # for pyrender; None for a unit near an optics file
    # (rows, columns, 3) uint8, the background frame before its light drifted; None without drift
    earlier_background: np.ndarray | None = None


def own_colors(leds: tuple[Led, ...]) -> np.ndarray:
    """(LEDs, RGB) bool: the colors that each LED has."""
    colors = np.array([led.color for led in leds])
    return colors >= MIN_OWN * colors.max(axis=1, keepdims=True)


def sample_light(
    rng: np.random.Generator, ranges: UnitRanges, leds: tuple[Led, ...], camera: Camera,
    gamma: float,
) -> Optics:  # fmt: skip
    """The LEDs and the response of a unit, with a black background. ranges: without None. leds: of
    the sensor."""
    assert ranges.led_distance_mm is not None and ranges.led_elevation_deg is not None
    count = len(leds)
    azimuths_deg = np.array([led.angle_deg for led in leds])
    azimuth = np.radians(azimuths_deg + rng.uniform(*ranges.led_turn_deg, count))
    distance_mm = float(log_uniform(rng, ranges.led_distance_mm))
    elevation_deg = rng.uniform(*ranges.led_elevation_deg)
    elevation = np.radians(elevation_deg + rng.uniform(*ranges.led_elevation_off_deg, count))
    towards = np.stack([np.cos(azimuth), -np.sin(azimuth)], axis=1)
    heights = -distance_mm * np.tan(elevation)
    leds_mm = np.concatenate([distance_mm * towards, heights[:, None]], axis=1)
    response = _relative(rng, ranges, leds, towards, gamma**GAMMA_EXPONENT)
    facing = (rng.uniform(*ranges.facing_grey, 3) / 255.0) ** gamma
    # in the middle, an LED's light falls with the square of its distance to the apex
    reach = REACH_MM**2 / (leds_mm**2).sum(axis=1) * FACING_COSINE
    own = own_colors(leds)
    of_color = np.where(own.any(axis=0), own, True)  # all LEDs, if none has a color
    mean_reach = (of_color * reach[:, None]).sum(axis=0) / of_color.sum(axis=0)
    response *= (facing / mean_reach)[None, :, None, None]
    sizes_mm = np.minimum(log_uniform(rng, ranges.led_size_mm, count), LARGEST_SIZE * -heights)
    black = np.zeros((camera.rows, camera.columns, 3), np.uint8)
    return Optics(black, leds_mm, sizes_mm, response, gamma, camera)


def _relative(
    rng: np.random.Generator, ranges: UnitRanges, leds: tuple[Led, ...], towards: np.ndarray,
    mixed: float,
) -> np.ndarray:  # fmt: skip
    """(LEDs, RGB, PLACE_TERMS, COSINE_TERMS) light relative to that of the color's own LEDs.

    towards: (LEDs, 2) directions of the LEDs. mixed: factor of leaks and irregularity.
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
    for k, (x, y) in enumerate(towards):
        along, across = rng.uniform(*ranges.beam_along_part), rng.uniform(*ranges.beam_across_part)
        curves = rng.uniform(*ranges.beam_curve_part, 2)
        twist = rng.uniform(*ranges.beam_twist_part)
        # the light of LEDs that are to the right or left crosses the middle towards the upper end
        sign = -np.sign(round(float(np.cos(np.radians(leds[k].angle_deg))), 6))
        rise_x, rise_y = along * x + sign * across * -y, along * y + sign * across * x
        beam = np.array([1.0, rise_x, rise_y, curves[0], twist, curves[1]])
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


def light_at_rest(
    optics: Optics, gel: Elastomer, columns: np.ndarray, rows: np.ndarray
) -> np.ndarray:
    """(rows, columns, RGB) light of a sampled unit's LEDs on a gel at rest at pixel coordinates."""
    camera = optics.camera
    x, y, z = camera.gel_points(gel, columns, rows)
    slope_x = (camera.rest_mm(gel, x + SLOPE_STEP_MM, y) - z) / SLOPE_STEP_MM
    slope_y = (camera.rest_mm(gel, x, y + SLOPE_STEP_MM) - z) / SLOPE_STEP_MM
    terms = place_terms(x, y, DEGREE)
    steep2 = 1.0 + slope_x**2 + slope_y**2
    seen = np.zeros((*x.shape, 3))
    for place, response in zip(optics.leds_mm, optics.response, strict=True):
        dx, dy, dz = place[0] - x, place[1] - y, place[2] - z
        far2 = dx**2 + dy**2 + dz**2
        m = np.maximum(slope_x * dx + slope_y * dy - dz, 0.0) / np.sqrt(steep2 * far2)
        weight = m * REACH_MM**2 / far2
        powers = m[..., None] ** np.arange(COSINE_TERMS)
        by_power = np.einsum("rsi,cij->rscj", terms, response[:, :TERMS])
        seen += weight[..., None] * np.einsum("rscj,rsj->rsc", by_power, powers)
    return seen


def at_middle(response: np.ndarray) -> np.ndarray:
    """(LEDs, RGB) light of a response in the image's middle at MIDDLE_COSINE."""
    return np.einsum("kcj,j->kc", response[:, :, 0], MIDDLE_COSINE ** np.arange(COSINE_TERMS))


def nodes(size: Size) -> tuple[np.ndarray, np.ndarray]:
    """Rows and columns of the nodes, px; cubics need one beyond each edge of the image."""
    down, across = (NODE_PX * (np.arange(-(-count // NODE_PX) + 3) - 1.0) for count in size)
    return down, across


def sample_unit(
    rng: np.random.Generator, spec: GelCameraSpec, ranges: UnitRanges, center: Optics | None = None
) -> Unit:
    """A unit of a sensor, sampled from the ranges; with a center, one near those optics."""
    if center is not None:
        return _sample_near(rng, ranges, center, spec.camera.noise_grey)
    leds = spec.light.leds
    if not leds or spec.units is None:
        raise T2TwinError(
            f"the file of {spec.name} has no {'table [units]' if leds else 'LEDs'}, from which "
            "units are sampled; add them, or give an optics file"
        )
    within: Any = spec.ranges(ranges)
    scale, distance_mm = rng.uniform(*within.scale_px_per_mm), rng.uniform(*within.distance_mm)
    shift, tilt = (rng.uniform(*each, size=2) for each in (within.shift_px, within.tilt_deg))
    size = spec.camera.rows, spec.camera.columns
    camera = Camera(*size, scale, distance_mm, *shift.tolist(), *tilt.tolist())
    is_linear = rng.random() < within.linear_amount
    gamma = rng.uniform(*(within.linear_gamma if is_linear else within.gamma))
    light = sample_light(rng, within, leds, camera, gamma)
    optics = with_background(rng, within, light, spec.gel.elastomer(spec.name))
    noise_grey = float(log_uniform(rng, within.noise_grey))
    colors = np.maximum(at_middle(optics.response), 0.0)
    moved = zip(leds, optics.leds_mm.tolist(), optics.sizes_mm.tolist(), colors, strict=True)
    return Unit(optics, noise_grey, tuple(_moved_led(*each) for each in moved))


def _sample_near(
    rng: np.random.Generator, ranges: UnitRanges, center: Optics, noise_grey: float
) -> Unit:
    leds = len(center.leds_mm)

    def part(shape: int | tuple = ()) -> np.ndarray:
        return rng.uniform(*ranges.around_part, shape)

    leds_mm = center.leds_mm + rng.uniform(*ranges.around_led_mm, (leds, 3))
    # the colors are mixed, and each LED is a little brighter or dimmer
    mixing = np.eye(3) + part((3, 3))
    brightness = 1.0 + part((leds, 1, 1, 1))

    def varied_light(table: np.ndarray) -> np.ndarray:
        mixed = np.einsum("kcij,dc->kdij", table, mixing) * brightness
        return np.clip(mixed, -MAX_RESPONSE, MAX_RESPONSE)

    shift, tilt = rng.uniform(*ranges.around_shift_px, 2), rng.uniform(*ranges.around_tilt_deg, 2)
    # relative change of the background's channels, and its gradients to the right and down
    level, right, down = part((3, 3))
    rows, columns = center.background.shape[:2]
    x = ((np.arange(columns) - columns / 2) / columns)[None, :, None]
    y = ((np.arange(rows) - rows / 2) / rows)[:, None, None]
    factor = (1.0 + level + right * x + down * y).astype(np.float32)
    background = np.minimum(center.background * factor, 255.0) + np.float32(0.5)
    sizes_mm = np.minimum(center.sizes_mm * (1.0 + part(leds)), MAX_LED_MM)
    gamma = float(np.clip(center.gamma * (1.0 + part() / 2.0), *GAMMAS))
    own = structs.asdict(center.camera)
    moved = {name: own[name] * (1.0 + part() / 4.0) for name in ("scale_px_per_mm", "distance_mm")}
    off = zip(
        ("shift_x_px", "shift_y_px", "tilt_x_deg", "tilt_y_deg"), (*shift, *tilt), strict=True
    )
    moved |= {name: own[name] + change for name, change in off}
    limited = {name: float(np.clip(value, *LIMITS[name])) for name, value in moved.items()}
    optics = replace(
        center,
        background=background.astype(np.uint8),
        leds_mm=np.clip(leds_mm, -FARTHEST_LED_MM, FARTHEST_LED_MM),
        sizes_mm=sizes_mm,
        response=varied_light(center.response),
        lobe=None if center.lobe is None else varied_light(center.lobe),
        gamma=gamma,
        camera=structs.replace(center.camera, **limited),
    )
    return Unit(optics, float(noise_grey * (1.0 + part())))


def with_background(
    rng: np.random.Generator, ranges: UnitRanges, optics: Optics, gel: Elastomer
) -> Optics:
    """The optics with a sampled background; channels that would be overexposed are dimmed."""
    size, gamma = (optics.camera.rows, optics.camera.columns), optics.gamma
    rows, columns = nodes(size)
    direct = np.maximum(light_at_rest(optics, gel, columns, rows), DARKEST)
    mean = direct[INSIDE].mean(axis=(0, 1)) * (1.0 + rng.uniform(*ranges.scattered_part, 3))
    low, high = (np.array(ranges.brightness_grey) / 255.0) ** gamma
    exposure = np.minimum(high / mean, 1.0)
    direct = direct * exposure
    follow = rng.uniform(*ranges.follow_amount)
    mixed = follow * direct / direct[INSIDE].mean(axis=(0, 1))
    # a separate pattern: constant gradients and a mean of about 1
    (half_rows, half_columns), along = (
        np.array(size) / 2,
        rng.uniform(*ranges.gradient_part, (2, 3)),
    )
    x = (columns - half_columns)[None, :, None] / half_columns
    y = (rows - half_rows)[:, None, None] / half_rows
    mixed += (1.0 - follow) * (1.0 + along[0] * x + along[1] * y)
    mixed = np.clip(mixed, *PATTERN) * np.maximum(mean * exposure, low)
    # the background contains most of the light that a shadow removes; else it would be clipped
    mixed = np.maximum(mixed, np.minimum(direct, PATTERN[1] * mean * exposure))
    grey = 255.0 * mixed ** (1.0 / gamma)
    middle, limit = grey[INSIDE].mean(axis=(0, 1)), rng.uniform(*ranges.pattern_grey, 3)
    grey = middle + (grey - middle) * np.minimum(limit / (grey[INSIDE].std(axis=(0, 1))), 1.0)
    # a dark side of the image
    amount, end = rng.uniform(*ranges.edge_dark_amount), rng.uniform(*ranges.edge_px)
    soft, side = rng.uniform(*ranges.edge_soft_px), int(rng.integers(4))
    down, across = np.meshgrid(rows, columns, indexing="ij")
    distance = (down, size[0] - down, across, size[1] - across)[side]
    grey *= (1.0 - amount * (1.0 - (0.5 + 0.5 * np.tanh((distance - end) / soft))))[..., None]
    grey += blotches(rng, ranges, size)
    background = paint(rng, ranges, grey, size)
    return replace(
        optics, background=background, response=optics.response * exposure[:, None, None]
    )


def blotches(rng: np.random.Generator, ranges: UnitRanges, size: Size) -> np.ndarray:
    """(nodes, RGB) grey levels of smooth blotches, coarse and fine."""
    coarse_grey = rng.uniform(*ranges.uneven_coarse_grey)
    fine_grey = rng.uniform(*ranges.uneven_fine_grey)
    places = nodes(size)
    coarse = rng.standard_normal((*(int(at[-1]) // COARSE_PX + 2 for at in places), 3))
    fine = rng.standard_normal((*(at.size for at in places), 3))
    for axis, along in enumerate(places):
        at = np.maximum(along, 0.0) / COARSE_PX
        first = at.astype(int)
        part = at - first
        part = (part * part * (3.0 - 2.0 * part)).reshape((-1, 1, 1) if axis == 0 else (1, -1, 1))
        coarse = (1.0 - part) * coarse.take(first, axis) + part * coarse.take(first + 1, axis)
    return coarse_grey * coarse + fine_grey * fine


def paint(rng: np.random.Generator, ranges: UnitRanges, grey: np.ndarray, size: Size) -> np.ndarray:
    """(rows, columns, 3) uint8: interpolated grey levels, with specks and a fixed pattern."""
    count = int(rng.integers(ranges.specks[0], ranges.specks[1] + 1))
    middles = rng.uniform((0.0, 0.0), size, (count, 2))
    radii = rng.uniform(*ranges.speck_px, (count, 1))
    colors = rng.uniform(*ranges.speck_grey, (count, 3)) * rng.choice([-1.0, 1.0], (count, 3))
    specks = np.concatenate([middles, radii, colors], axis=1).astype(np.float32)
    texture = np.float32(rng.uniform(*ranges.texture_grey))
    out = np.empty((*size, 3), dtype=np.uint8)
    _paint(
        np.ascontiguousarray(grey, dtype=np.float32), NODE_PX, specks,
        texture * standard_normal(rng, (size[0], size[1] * 3)), out,
    )  # fmt: skip
    return out


def _moved_led(default: Led, place_mm: list[float], size_mm: float, color: np.ndarray) -> Led:
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


@jit
def cubic_weights(count, step):
    """(count, 4) weights of the nodes about each pixel."""
    weights = np.empty((count, 4), dtype=np.float32)
    for n in range(count):
        t = np.float32(n % step) / np.float32(step)
        weights[n, 0] = _HALF * t * (-_ONE + t * (_TWO - t))
        weights[n, 1] = _ONE + _HALF * t * t * (-_FIVE + _THREE * t)
        weights[n, 2] = _HALF * t * (_ONE + t * (_FOUR - _THREE * t))
        weights[n, 3] = _HALF * t * t * (-_ONE + t)
    return weights


@jit
def _paint(nodes, step, specks, texture, out):
    """Fill out (P, RGB) uint8. nodes: (.., .., RGB) grey levels, step px apart, the first one step
    before the image. specks: (n, 6) row, column, radius, RGB. texture: (rows, columns RGB)."""
    rows, columns, channels = out.shape
    down, across = cubic_weights(rows, step), cubic_weights(columns, step)
    grey = np.empty((rows, columns * channels), dtype=np.float32)
    line = np.empty((nodes.shape[1], channels), dtype=np.float32)
    for row in range(rows):
        i = row // step
        for a in range(nodes.shape[1]):
            for c in range(channels):
                line[a, c] = (
                    down[row, 0] * nodes[i, a, c] + down[row, 1] * nodes[i + 1, a, c]
                    + down[row, 2] * nodes[i + 2, a, c] + down[row, 3] * nodes[i + 3, a, c]
                )  # fmt: skip
        for column in range(columns):
            j, w = column // step, across[column]
            for c in range(channels):
                grey[row, channels * column + c] = (
                    w[0] * line[j, c] + w[1] * line[j + 1, c]
                    + w[2] * line[j + 2, c] + w[3] * line[j + 3, c]
                )  # fmt: skip
    for n in range(specks.shape[0]):
        middle_row, middle_column, radius = specks[n, 0], specks[n, 1], specks[n, 2]
        reach = int(_THREE * radius) + 1
        for row in range(max(int(middle_row) - reach, 0), min(int(middle_row) + reach, rows)):
            for column in range(
                max(int(middle_column) - reach, 0), min(int(middle_column) + reach, columns)
            ):
                far = ((np.float32(row) - middle_row) / radius) ** 2
                far += ((np.float32(column) - middle_column) / radius) ** 2
                for c in range(channels):
                    grey[row, channels * column + c] += specks[n, 3 + c] * np.exp(-_HALF * far)
    for row in range(rows):
        filled = out[row].ravel()
        for n in range(filled.size):
            value = grey[row, n] + texture[row, n]
            filled[n] = np.uint8(min(max(value, _ZERO), _BRIGHTEST) + _HALF)
