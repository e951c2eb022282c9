"""Artifacts of used units: streaks of light, glare of LEDs, worn gels, drift of the light.

A unit's background frame is recorded before its presses. Between the two, the light drifts and the
streaks move. So a unit with artifacts has two frames without contact: the one of its presses, and
the earlier one, which is its background frame.

Streaks and glare add to the grey levels. A worn gel has a coating of uneven albedo a(p), which
multiplies all light, so grey levels by a(p)^(1 / gamma). Drift adds, in each color c,

    D_c(p) = d_c (sqrt(e) s_c + sqrt(1 - e) W_c(p)) / rms(..)

to the earlier frame, with d_c of drift_grey, e of drift_even_part, a random sign s_c, and W_c
cubic between normal samples DRIFT_PX apart. The division makes d_c the root mean
square over the image.
"""

from dataclasses import replace
from functools import cache
from typing import Annotated

import numpy as np
from msgspec import Meta

from t2twin.sim.optical.compiled import jit
from t2twin.sim.optical.spec import Led, Ranges
from t2twin.sim.optical.units import Range, Unit, at_middle, cubic_weights, log_uniform
from t2twin.sim.optical.units import Size as Pixels

DRIFT_PX = 80  # distance of samples of the drift, px (assumed: as smooth as in one real unit)
WEAR_PX = 40  # distance of neighboring samples of smooth wear, px (assumed)
MIN_ALBEDO = 0.3  # smallest albedo of a worn coating, relative to a new one (assumed)
GLARE_OFF_DEG = (-15.0, 15.0)  # direction relative to its LED's, from the image's middle (assumed)
GLARE_INSET_PX = (-20.0, 40.0)  # of its middle from the image's edge, px (one real unit: 33)
SPECKLE_PX, FINE_DRIFT_PX = 4, 8  # distance of nodes of an albedo and of a drift, px (assumed)
GLARE_REACH = 5.0  # distance at which a glare ends, in its radii: 0.15 % of its brightness

_ZERO, _ONE, _HALF = np.float32(0.0), np.float32(1.0), np.float32(0.5)
_BRIGHTEST, _REACH = np.float32(255.0), np.float32(GLARE_REACH)

Count = Annotated[int, Meta(ge=0, le=20)]
Part = Annotated[float, Meta(ge=0.0, le=1.0)]
Change = Annotated[float, Meta(ge=-1.0, le=1.0)]
Grey = Annotated[float, Meta(ge=0.1, le=255.0)]
Drift = Annotated[float, Meta(ge=0.0, le=50.0)]
Size = Annotated[float, Meta(ge=1.0, le=400.0)]
Degrees = Annotated[float, Meta(ge=-90.0, le=90.0)]
Length = Annotated[float, Meta(ge=0.0, le=100.0)]


class Artifacts(Ranges, frozen=True):
    """Distribution of the artifacts of sampled units: ranges, low and high.

    Drift, and the move and the brightness of streaks are as in frames of one real unit; the others
    are assumed. Brightnesses, widths, lengths and radii are log-uniform.
    """

    streaks: tuple[Count, Count] = (0, 4)  # number of bright bands that point at an LED
    streak_grey: tuple[Grey, Grey] = (5.0, 50.0)  # brightness
    streak_px: tuple[Size, Size] = (6.0, 40.0)  # half width
    streak_length_px: tuple[Size, Size] = (30.0, 160.0)  # half length
    streak_off_deg: tuple[Degrees, Degrees] = (-25.0, 25.0)  # deviation from the LED's direction
    streak_bend_part: tuple[Change, Change] = (-0.1, 0.1)  # offset of the ends over the half length
    streak_moved_px: tuple[Length, Length] = (0.0, 10.0)  # between background frame and press
    glares: tuple[Count, Count] = (0, 2)  # number of glares at the image's edge, near an LED
    glare_grey: tuple[Grey, Grey] = (20.0, 200.0)  # brightness
    glare_px: tuple[Size, Size] = (3.0, 40.0)  # radius at a quarter of the brightness
    changed_part: tuple[Change, Change] = (-0.3, 0.3)  # of brightness since the background frame
    other_color_part: tuple[Part, Part] = (0.0, 0.7)  # brightness in colors other than the LED's
    worn: Part = 0.5  # share of units with worn gel
    wear_part: tuple[Part, Part] = (0.02, 0.12)  # deviation of the albedo's smooth part
    speckle_part: tuple[Part, Part] = (0.01, 0.06)  # and of its fine part
    drift_grey: tuple[Drift, Drift] = (1.0, 6.0)  # root mean square of the drift of each color
    drift_even_part: tuple[Part, Part] = (0.0, 0.6)  # share of its mean square that is even


Lights = tuple[np.ndarray, np.ndarray]  # streaks and glares, as for compose


def with_artifacts(
    rng: np.random.Generator, unit: Unit, artifacts: Artifacts, leds: tuple[Led, ...] = ()
) -> Unit:
    """The unit with sampled artifacts and an earlier background. leds: of the sensor; where the
    unit has other LEDs, the lights' colors are those of its response."""
    light, background = unit.optics, np.ascontiguousarray(unit.optics.background)
    toward_px = light.leds_mm[:, 1::-1] * light.camera.scale_px_per_mm + light.camera.middle
    size: Pixels = (light.camera.rows, light.camera.columns)
    is_own = len(leds) == len(toward_px)
    colors = np.array([led.color for led in leds]) if is_own else at_middle(light.response)
    now, before = _sample_lights(rng, artifacts, toward_px, colors.argmax(axis=1), size)
    shade, albedo = np.zeros((0, 0), dtype=np.float32), None
    if rng.random() < artifacts.worn:
        down, across = _cubics(WEAR_PX, SPECKLE_PX, size)
        smooth = rng.standard_normal((down.shape[1], across.shape[1]))
        fine = rng.standard_normal((len(down), len(across)))
        parts = rng.uniform(*artifacts.wear_part), rng.uniform(*artifacts.speckle_part)
        nodes = 1.0 + parts[0] * (down @ smooth @ across.T) + parts[1] * fine
        nodes = np.maximum(nodes, MIN_ALBEDO)  # SPECKLE_PX apart
        shade, albedo = (nodes ** (1.0 / light.gamma)).astype(np.float32), np.empty(size, "f4")
        coarse = nodes.astype(np.float32)
        for row, filled in enumerate(albedo):
            _enlarge_row(coarse, SPECKLE_PX, row, filled)
    drift = _sample_drift(rng, artifacts, size)
    still = np.zeros((3, 0, 0), dtype=np.float32)
    shown, earlier = np.empty_like(background), np.empty_like(background)
    compose(background, shade, still, *now, shown)
    compose(background, shade, drift, *before, earlier)
    optics = replace(light, background=shown, albedo=albedo)
    return replace(unit, optics=optics, earlier_background=earlier)


def _sample_drift(rng: np.random.Generator, artifacts: Artifacts, size: Pixels) -> np.ndarray:
    """(RGB, nodes) float32 drift, grey levels, FINE_DRIFT_PX apart."""
    rms = rng.uniform(*artifacts.drift_grey, 3)[:, None, None]
    even = rng.uniform(*artifacts.drift_even_part, 3)[:, None, None]
    signs = rng.choice([-1.0, 1.0], (3, 1, 1))
    down, across = _cubics(DRIFT_PX, FINE_DRIFT_PX, size)
    samples = rng.standard_normal((3, down.shape[1], across.shape[1]))
    nodes = np.sqrt(even) * signs + np.sqrt(1.0 - even) * (down @ samples @ across.T)
    of_rows, of_columns = _squares(FINE_DRIFT_PX, size)
    mean_square = (nodes * (of_rows @ nodes @ of_columns)).sum(axis=(1, 2), keepdims=True)
    return (nodes * rms / np.sqrt(mean_square)).astype(np.float32)


@cache
def _cubics(step: int, fine: int, size: Pixels) -> tuple[np.ndarray, np.ndarray]:
    """Weights of samples, step px apart, at nodes, fine px apart: of rows and of columns."""
    found = []
    for count in (-(-size[0] // fine) + 1, -(-size[1] // fine) + 1):
        at = np.arange(count)
        weights = np.zeros((count, (count - 1) // (step // fine) + 4))
        for shift, column in enumerate(cubic_weights(count, step // fine).T):
            weights[at, at // (step // fine) + shift] = column
        found.append(weights)
    return found[0], found[1]


@cache
def _squares(fine: int, size: Pixels) -> tuple[np.ndarray, np.ndarray]:
    """Matrices of the mean square over the image of what is linear between nodes, fine px apart."""
    found = []
    for count in size:
        at, part = np.divmod(np.arange(count), fine)
        weights = np.zeros((count, -(-count // fine) + 1))
        weights[np.arange(count), at] = 1.0 - part / fine
        weights[np.arange(count), at + 1] = part / fine
        found.append(weights.T @ weights / count)
    return found[0], found[1]


def _sample_lights(
    rng: np.random.Generator, artifacts: Artifacts, toward_px: np.ndarray, colors_of: np.ndarray,
    size: Pixels,
) -> tuple[Lights, Lights]:  # fmt: skip
    """Streaks and glares of the presses, and of the background frame before. toward_px: (LEDs, 2)
    rows and columns of the LEDs. colors_of: (LEDs,) their brightest colors."""
    count = int(rng.integers(artifacts.streaks[0], artifacts.streaks[1] + 1))
    leds = rng.integers(len(toward_px), size=count)
    places = rng.uniform((0.0, 0.0), size, (count, 2))
    deviation = np.radians(rng.uniform(*artifacts.streak_off_deg, count))
    lengths = log_uniform(rng, artifacts.streak_length_px, count)
    widths = log_uniform(rng, artifacts.streak_px, count)
    bends = rng.uniform(*artifacts.streak_bend_part, count) * lengths
    colors = _colors(rng, artifacts, colors_of[leds], artifacts.streak_grey)
    aim = toward_px[leds] - places
    angles = np.arctan2(aim[:, 0], aim[:, 1]) + deviation
    sizes = np.stack([np.sin(angles), np.cos(angles), lengths, widths, bends], axis=1)
    moved = rng.uniform(*artifacts.streak_moved_px, (count, 1))
    turn = rng.uniform(0.0, 2.0 * np.pi, count)
    places_before = places + moved * np.stack([np.sin(turn), np.cos(turn)], axis=1)
    colors_before = colors * (1.0 + rng.uniform(*artifacts.changed_part, (count, 1)))

    glares = int(rng.integers(artifacts.glares[0], artifacts.glares[1] + 1))
    leds = rng.integers(len(toward_px), size=glares)
    middle = np.array(size) / 2
    aim = toward_px[leds] - middle
    angles = np.arctan2(aim[:, 0], aim[:, 1]) + np.radians(rng.uniform(*GLARE_OFF_DEG, glares))
    direction = np.stack([np.sin(angles), np.cos(angles)], axis=1)
    to_edge = np.min(middle / np.maximum(np.abs(direction), 1e-9), axis=1)
    reach = to_edge - rng.uniform(*GLARE_INSET_PX, glares)
    radii = log_uniform(rng, artifacts.glare_px, (glares, 1))
    blobs = np.concatenate([middle + reach[:, None] * direction, radii], axis=1)
    glare = _colors(rng, artifacts, colors_of[leds], artifacts.glare_grey)
    glare_before = glare * (1.0 + rng.uniform(*artifacts.changed_part, (glares, 1)))
    return (
        (_joined(places, sizes, colors), _joined(blobs, glare)),
        (_joined(places_before, sizes, colors_before), _joined(blobs, glare_before)),
    )


def _joined(*columns: np.ndarray) -> np.ndarray:
    return np.concatenate(columns, axis=1).astype(np.float32)


def _colors(
    rng: np.random.Generator, artifacts: Artifacts, colors: np.ndarray, grey: Range
) -> np.ndarray:
    """(n, RGB) grey levels of lights that are brightest in colors (n,)."""
    parts = rng.uniform(*artifacts.other_color_part, (colors.size, 3))
    parts[np.arange(colors.size), colors] = 1.0
    return log_uniform(rng, grey, (colors.size, 1)) * parts


@jit
def _enlarge_row(nodes, step, row, out):
    """Fill out (columns) with a row, linear between nodes, step apart."""
    i, down = row // step, np.float32(row % step) / np.float32(step)
    for j in range(nodes.shape[1] - 1):
        left = nodes[i, j] + down * (nodes[i + 1, j] - nodes[i, j])
        right = nodes[i, j + 1] + down * (nodes[i + 1, j + 1] - nodes[i, j + 1])
        for n in range(min(step, out.size - j * step)):
            out[j * step + n] = left + np.float32(n) / np.float32(step) * (right - left)


@jit
def compose(background, shade, drift, streaks, glares, out):
    """Fill out (P, RGB) uint8 with the background (P, RGB), shaded, plus drift and lights.

    shade: (nodes) factors SPECKLE_PX apart, or empty. drift: (RGB, nodes) grey levels FINE_DRIFT_PX
    apart, or empty. streaks: (n, 10) row, column, direction (down, right), half length, half width,
    bend, RGB. glares: (n, 6) row, column, radius, RGB.
    """
    rows, columns = out.shape[0], out.shape[1]
    grey, values = np.empty((columns, 3), dtype=np.float32), np.empty(columns, dtype=np.float32)
    for row in range(rows):
        flat, still, filled = grey.ravel(), background[row].ravel(), out[row].ravel()
        for n in range(flat.size):
            flat[n] = still[n]
        if shade.size > 0:
            _enlarge_row(shade, SPECKLE_PX, row, values)
            for column in range(columns):
                for c in range(3):
                    grey[column, c] *= values[column]
        for c in range(3 if drift.size > 0 else 0):
            _enlarge_row(drift[c], FINE_DRIFT_PX, row, values)
            for column in range(columns):
                grey[column, c] += values[column]
        for n in range(streaks.shape[0]):
            _add_streak(streaks[n], row, grey)
        for n in range(glares.shape[0]):
            _add_glare(glares[n], row, grey)
        for n in range(flat.size):
            filled[n] = np.uint8(min(max(flat[n], _ZERO), _BRIGHTEST) + _HALF)


@jit
def _add_streak(streak, row, grey):
    """Add a row of a streak to grey (columns, RGB): 1 - u^2 along and (1 - v^2)^2 across, with u, v
    the place relative to its half length and half width; its middle line is a parabola."""
    down, right, length, width, bend = streak[2], streak[3], streak[4], streak[5], streak[6]
    high = np.float32(row) - streak[0]
    side = width + abs(bend)
    if abs(high) > abs(down) * length + abs(right) * side:
        return
    half = abs(right) * length + abs(down) * side
    first = max(int(streak[1] - half), 0)
    end = min(int(streak[1] + half) + 2, grey.shape[0])
    red, green, blue = streak[7], streak[8], streak[9]
    per_length, per_width = _ONE / length, _ONE / width
    for column in range(first, end):
        far = np.float32(column) - streak[1]
        u = (far * right + high * down) * per_length
        v = (far * down - high * right - bend * u * u) * per_width
        across = max(_ONE - v * v, _ZERO)
        profile = max(_ONE - u * u, _ZERO) * across * across
        grey[column, 0] += profile * red
        grey[column, 1] += profile * green
        grey[column, 2] += profile * blue


@jit
def _add_glare(glare, row, grey):
    """Add a row of a glare to grey (columns, RGB): 1 / (1 + d^2)^2 of its distance in radii d."""
    radius = glare[2]
    high = (np.float32(row) - glare[0]) / radius
    if abs(high) > _REACH:
        return
    first = max(int(glare[1] - _REACH * radius), 0)
    end = min(int(glare[1] + _REACH * radius) + 1, grey.shape[0])
    for column in range(first, end):
        far = (np.float32(column) - glare[1]) / radius
        part = _ONE / (_ONE + far * far + high * high)
        for c in range(3):
            grey[column, c] += part * part * glare[3 + c]
