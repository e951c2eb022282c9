"""Samples units of a gel camera: no two units have the same light.

A unit is a complete set of optics: camera, LEDs, the response of each LED in each color, gamma,
background, noise. It is sampled from ranges, alone or near given optics. It depends on the
random generator only, not on threads or processes.

The background's light is computed at nodes NODE_PX apart, encoded as grey levels there and
interpolated by cubics (Catmull and Rom 1974). Blotches, a dark side, specks and the pixels' fixed
pattern are applied to the grey levels.
"""

from dataclasses import dataclass, replace

import numpy as np

from t2twin.core.errors import T2TwinError
from t2twin.sim.contact.elastomer import Elastomer
from t2twin.sim.optical.camera.compiled import jit
from t2twin.sim.optical.camera.noise import standard_normal
from t2twin.sim.optical.camera.pinhole import MAX_MISALIGNMENT, Camera
from t2twin.sim.optical.light.leds import Led
from t2twin.sim.optical.optics import (
    DISTANCES_MM,
    FARTHEST_LED_MM,
    GAMMAS,
    LARGEST_LED_MM,
    MAX_RESPONSE,
    SCALES_PX_PER_MM,
    Optics,
)
from t2twin.sim.optical.randomization.lighting import (
    SampledLight,
    equivalent_leds,
    light_at_rest,
    sample_light,
)
from t2twin.sim.optical.randomization.ranges import UnitRanges, log_uniform
from t2twin.sim.optical.spec import GelCameraSpec

NODE_PX = 10
"""Distance of neighboring nodes, px."""
COARSE_PX = 80
"""Distance of neighboring coarse blotches, px."""
PATTERN = (0.15, 2.0)
"""Bounds of the background's light, in parts of its mean (assumed: the maximum of a real unit is
2.1 times its mean)."""
DARKEST = 1e-4
"""Smallest light of a node, in parts of white, so that it has a grey level."""

Size = tuple[int, int]
"""Rows and columns of an image."""

INSIDE = (slice(1, -2), slice(1, -2))
"""The nodes within the image."""


@dataclass(frozen=True, eq=False)
class Unit:
    """One unit's light.

    optics: complete. noise_grey: standard deviation of one frame, grey levels. leds: for
    pyrender; None for a unit near an optics file. earlier_background: (rows, columns, 3) uint8, the
    background frame, recorded before its light drifted; None without drift.
    """

    optics: Optics
    noise_grey: float
    leds: tuple[Led, ...] | None = None
    earlier_background: np.ndarray | None = None


def nodes(size: Size) -> tuple[np.ndarray, np.ndarray]:
    """Rows and columns of the nodes, px; cubics need one beyond each edge of the image."""
    down, across = (NODE_PX * (np.arange(-(-count // NODE_PX) + 3) - 1.0) for count in size)
    return down, across


def sample_unit(
    rng: np.random.Generator,
    spec: GelCameraSpec,
    ranges: UnitRanges,
    center: Optics | None = None,
) -> Unit:
    """A unit of a sensor, sampled from the ranges; with a center, one near those optics.

    Raises T2TwinError for a sensor without LEDs or without ranges of its units, if there is no
    center.
    """
    if center is not None:
        return _sample_near(rng, ranges, center, spec.camera.noise_grey)
    ranges, leds = _complete(ranges, spec), spec.light.leds
    assert ranges.scale_px_per_mm is not None and ranges.distance_mm is not None
    size, gel = (spec.camera.rows, spec.camera.columns), spec.gel.elastomer(spec.name)
    scale, distance_mm = rng.uniform(*ranges.scale_px_per_mm), rng.uniform(*ranges.distance_mm)
    shift, tilt = rng.uniform(*ranges.shift_px, 2), rng.uniform(*ranges.tilt_deg, 2)
    camera = Camera(*size, scale, distance_mm, *shift.tolist(), *tilt.tolist())
    is_linear = rng.random() < ranges.linear_amount
    gamma = rng.uniform(*(ranges.linear_gamma if is_linear else ranges.gamma))
    light = sample_light(rng, ranges, leds, gamma)
    background, light = sample_background(rng, ranges, light, camera, gel, gamma)
    noise_grey = float(log_uniform(rng, ranges.noise_grey))
    optics = Optics(
        background=background,
        leds_mm=light.places_mm,
        sizes_mm=light.sizes_mm,
        response=light.response,
        gamma=gamma,
        **camera.placement,
    )
    return Unit(optics, noise_grey, equivalent_leds(light))


def _complete(ranges: UnitRanges, spec: GelCameraSpec) -> UnitRanges:
    """The ranges, with those of the sensor where they are None."""
    if not spec.light.leds or spec.units is None:
        lacking = "LEDs" if not spec.light.leds else "table [units]"
        raise T2TwinError(
            f"the file of {spec.name} has no {lacking}, from which units are sampled; give an "
            "optics file around which to sample them"
        )
    own = {name: getattr(spec.units, name) for name in spec.units.__struct_fields__}
    missing = {name: value for name, value in own.items() if getattr(ranges, name) is None}
    return replace(ranges, **missing)


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
    optics = replace(
        center,
        background=_varied(center.background, part((3, 3))),
        leds_mm=np.clip(leds_mm, -FARTHEST_LED_MM, FARTHEST_LED_MM),
        sizes_mm=np.minimum(center.sizes_mm * (1.0 + part(leds)), LARGEST_LED_MM),
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
    return Unit(optics, float(noise_grey * (1.0 + part())))


def _varied(background: np.ndarray, parts: np.ndarray) -> np.ndarray:
    """(rows, columns, 3) uint8: a background with other brightness.

    parts: (3, 3) relative change of each channel, and its gradients to the right and down.
    """
    level, right, down = parts
    rows, columns = background.shape[:2]
    x = ((np.arange(columns) - columns / 2) / columns)[None, :, None]
    y = ((np.arange(rows) - rows / 2) / rows)[:, None, None]
    factor = (1.0 + level + right * x + down * y).astype(np.float32)
    return (np.minimum(background * factor, 255.0) + np.float32(0.5)).astype(np.uint8)


def _clipped(value: np.ndarray | float, bounds: tuple[float, float]) -> float:
    return float(np.clip(value, *bounds))


def sample_background(
    rng: np.random.Generator,
    ranges: UnitRanges,
    light: SampledLight,
    camera: Camera,
    gel: Elastomer,
    gamma: float,
) -> tuple[np.ndarray, SampledLight]:
    """(rows, columns, 3) uint8, and the light, dimmed in channels that would be overexposed."""
    size = camera.rows, camera.columns
    rows, columns = nodes(size)
    direct = np.maximum(light_at_rest(light, camera, gel, columns, rows), DARKEST)
    mean = direct[INSIDE].mean(axis=(0, 1)) * (1.0 + rng.uniform(*ranges.scattered_part, 3))
    low, high = (np.array(ranges.brightness_grey) / 255.0) ** gamma
    exposure = np.minimum(high / mean, 1.0)
    direct = direct * exposure
    follow = rng.uniform(*ranges.follow_amount)
    mixed = follow * direct / direct[INSIDE].mean(axis=(0, 1))
    mixed += (1.0 - follow) * _separate_pattern(rng, ranges, size)
    mixed = np.clip(mixed, *PATTERN) * np.maximum(mean * exposure, low)
    # the background contains most of the light that a shadow removes; else it would be clipped
    mixed = np.maximum(mixed, np.minimum(direct, PATTERN[1] * mean * exposure))
    grey = _limit_std(255.0 * mixed ** (1.0 / gamma), rng.uniform(*ranges.pattern_grey, 3))
    grey *= _dark_side(rng, ranges, size)[..., None]
    grey += blotches(rng, ranges, size)
    exposed = replace(light, response=light.response * exposure[:, None, None])
    return paint(rng, ranges, grey, size), exposed


def _separate_pattern(rng: np.random.Generator, ranges: UnitRanges, size: Size) -> np.ndarray:
    """(nodes, RGB) light with constant gradients and a mean of about 1."""
    half_rows, half_columns = (count / 2 for count in size)
    rows, columns = nodes(size)
    x = (columns - half_columns)[None, :, None] / half_columns
    y = (rows - half_rows)[:, None, None] / half_rows
    along = rng.uniform(*ranges.gradient_part, (2, 3))
    return 1.0 + along[0] * x + along[1] * y


def _limit_std(grey: np.ndarray, limit: np.ndarray) -> np.ndarray:
    """(nodes, RGB) grey levels, scaled about their mean; limit: (RGB) standard deviation."""
    middle = grey[INSIDE].mean(axis=(0, 1))
    return middle + (grey - middle) * np.minimum(limit / (grey[INSIDE].std(axis=(0, 1))), 1.0)


def _dark_side(rng: np.random.Generator, ranges: UnitRanges, size: Size) -> np.ndarray:
    """(nodes) factor that darkens one side of the image."""
    amount, end = rng.uniform(*ranges.edge_dark_amount), rng.uniform(*ranges.edge_px)
    soft, side = rng.uniform(*ranges.edge_soft_px), int(rng.integers(4))
    rows, columns = nodes(size)
    distance = (
        rows[:, None],
        size[0] - rows[:, None],
        columns[None, :],
        size[1] - columns[None, :],
    )[side]
    inside = 0.5 + 0.5 * np.tanh((distance - end) / soft)
    return np.broadcast_to(1.0 - amount * (1.0 - inside), (rows.size, columns.size))


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


_ZERO, _ONE, _HALF = np.float32(0.0), np.float32(1.0), np.float32(0.5)
_TWO, _THREE, _FOUR, _FIVE = (np.float32(n) for n in (2.0, 3.0, 4.0, 5.0))
_BRIGHTEST = np.float32(255.0)


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
    """Fill out (P, RGB) uint8.

    nodes: (.., .., RGB) grey levels, step pixels apart, the first one step before the image.
    specks: (n, 6) row, column, radius, RGB. texture: (rows, columns RGB) grey levels.
    """
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
