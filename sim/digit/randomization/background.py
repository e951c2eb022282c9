"""The background of a drawn unit: what its camera sees of the untouched gel.

Light is worked out at nodes NODE_PX apart, turned into grey levels there, and interpolated by
cubics (Catmull and Rom 1974); blotches, a dark side, specks and the pixels' fixed pattern are added
as grey levels.
"""

from dataclasses import replace

import numpy as np

from t2twin.sim.digit.calibration import Calibration
from t2twin.sim.digit.camera.compiled import jit
from t2twin.sim.digit.camera.gaussian_noise import white
from t2twin.sim.digit.camera.pinhole import COLUMNS, ROWS, Camera
from t2twin.sim.digit.randomization.lighting import DrawnLight, untouched_light
from t2twin.sim.digit.randomization.ranges import UnitRanges, evenly

NODE_PX = 10
"""Pixels from a node to the next."""
COARSE_PX = 80
"""Pixels from one coarse blotch to the next."""
PATTERN = (0.15, 2.0)
"""Least and most of a background's light, in parts of its mean (assumed: a real unit's brightest
place has 2.1 times its mean)."""
DARKEST = 1e-4
"""Least light of a node, white being 1, so that it has a grey level."""

NODE_ROWS = NODE_PX * (np.arange(ROWS // NODE_PX + 3) - 1.0)
NODE_COLUMNS = NODE_PX * (np.arange(COLUMNS // NODE_PX + 3) - 1.0)
"""Pixels of the nodes, one beyond each edge of the picture, as cubics need."""

INSIDE = (slice(1, -2), slice(1, -2))
"""The nodes within the picture."""


def sample_background(
    rng: np.random.Generator, draw: UnitRanges, light: DrawnLight, camera: Camera, gamma: float
) -> tuple[np.ndarray, DrawnLight]:
    """(ROWS, COLUMNS, 3) uint8, and the light as exposed: dimmer where it were too bright."""
    direct = np.maximum(untouched_light(light, camera, NODE_COLUMNS, NODE_ROWS), DARKEST)
    wanted = direct[INSIDE].mean(axis=(0, 1)) * (1.0 + evenly(rng, draw.scattered_part, 3))
    low, high = (np.array(draw.brightness_grey) / 255.0) ** gamma
    exposure = np.minimum(high / wanted, 1.0)
    direct = direct * exposure
    follow = float(evenly(rng, draw.follow_amount))
    mixed = follow * direct / direct[INSIDE].mean(axis=(0, 1))
    mixed += (1.0 - follow) * _own_pattern(rng, draw)
    mixed = np.clip(mixed, *PATTERN) * np.maximum(wanted * exposure, low)
    # what a shadow takes away must have been there, mostly, or it were black with a hard rim
    mixed = np.maximum(mixed, np.minimum(direct, PATTERN[1] * wanted * exposure))
    grey = _calmed(255.0 * mixed ** (1.0 / gamma), evenly(rng, draw.pattern_grey, 3))
    grey *= _dark_side(rng, draw)[..., None]
    grey += blotches(rng, draw)
    exposed = replace(light, response=light.response * exposure[:, None, None])
    return paint(rng, draw, grey), exposed


def _own_pattern(rng: np.random.Generator, draw: UnitRanges) -> np.ndarray:
    """(nodes, RGB) smooth light with a mean of about 1."""
    x = (NODE_COLUMNS - COLUMNS / 2)[None, :, None] / (COLUMNS / 2)
    y = (NODE_ROWS - ROWS / 2)[:, None, None] / (ROWS / 2)
    along = evenly(rng, draw.gradient_part, (2, 3))
    return 1.0 + along[0] * x + along[1] * y


def _calmed(grey: np.ndarray, most: np.ndarray) -> np.ndarray:
    """(nodes, RGB) grey levels whose standard deviation in the picture is at most so much."""
    middle = grey[INSIDE].mean(axis=(0, 1))
    return middle + (grey - middle) * np.minimum(most / (grey[INSIDE].std(axis=(0, 1))), 1.0)


def _dark_side(rng: np.random.Generator, draw: UnitRanges) -> np.ndarray:
    """(nodes) what is left of the light beside one side of the picture."""
    amount, end = float(evenly(rng, draw.edge_dark_amount)), float(evenly(rng, draw.edge_px))
    soft, side = float(evenly(rng, draw.edge_soft_px)), int(rng.integers(4))
    off = (
        NODE_ROWS[:, None],
        ROWS - NODE_ROWS[:, None],
        NODE_COLUMNS[None, :],
        COLUMNS - NODE_COLUMNS[None, :],
    )[side]
    inside = 0.5 + 0.5 * np.tanh((off - end) / soft)
    return np.broadcast_to(1.0 - amount * (1.0 - inside), (NODE_ROWS.size, NODE_COLUMNS.size))


def blotches(rng: np.random.Generator, draw: UnitRanges) -> np.ndarray:
    """(nodes, RGB) grey levels of smooth unevenness, coarse and fine."""
    coarse_grey, fine_grey = (
        float(evenly(rng, draw.uneven_coarse_grey)),
        float(evenly(rng, draw.uneven_fine_grey)),
    )
    coarse = rng.standard_normal((ROWS // COARSE_PX + 2, COLUMNS // COARSE_PX + 2, 3))
    fine = rng.standard_normal((NODE_ROWS.size, NODE_COLUMNS.size, 3))
    for axis, nodes in ((0, NODE_ROWS), (1, NODE_COLUMNS)):
        at = np.maximum(nodes, 0.0) / COARSE_PX
        first = at.astype(int)
        part = at - first
        part = (part * part * (3.0 - 2.0 * part)).reshape((-1, 1, 1) if axis == 0 else (1, -1, 1))
        coarse = (1.0 - part) * coarse.take(first, axis) + part * coarse.take(first + 1, axis)
    return coarse_grey * coarse + fine_grey * fine


def paint(rng: np.random.Generator, draw: UnitRanges, grey: np.ndarray) -> np.ndarray:
    """(ROWS, COLUMNS, 3) uint8 of grey levels at the nodes, with specks and a fixed pattern."""
    count = int(rng.integers(draw.specks[0], draw.specks[1] + 1))
    middles = rng.uniform((0.0, 0.0), (ROWS, COLUMNS), (count, 2))
    radii = evenly(rng, draw.speck_px, (count, 1))
    colors = evenly(rng, draw.speck_grey, (count, 3)) * rng.choice([-1.0, 1.0], (count, 3))
    specks = np.concatenate([middles, radii, colors], axis=1).astype(np.float32)
    texture = np.float32(evenly(rng, draw.texture_grey))
    out = np.empty((ROWS, COLUMNS, 3), dtype=np.uint8)
    _paint(
        np.ascontiguousarray(grey, dtype=np.float32), NODE_PX, specks,
        texture * white(rng, (ROWS, COLUMNS * 3)), out,
    )  # fmt: skip
    return out


def redrawn(rng: np.random.Generator, draw: UnitRanges, center: Calibration) -> np.ndarray:
    """(ROWS, COLUMNS, 3) uint8: a calibration's background, its brightness changed a little.

    Each channel by a part and by rises along both axes, of around_part each.
    """
    level, right, down = evenly(rng, draw.around_part, (3, 3))
    x = ((np.arange(COLUMNS) - COLUMNS / 2) / COLUMNS)[None, :, None]
    y = ((np.arange(ROWS) - ROWS / 2) / ROWS)[:, None, None]
    factor = (1.0 + level + right * x + down * y).astype(np.float32)
    return (np.minimum(center.background * factor, 255.0) + np.float32(0.5)).astype(np.uint8)


_ZERO, _ONE, _HALF = np.float32(0.0), np.float32(1.0), np.float32(0.5)
_TWO, _THREE, _FOUR, _FIVE = (np.float32(n) for n in (2.0, 3.0, 4.0, 5.0))
_BRIGHTEST = np.float32(255.0)


@jit
def _cubic(count, step):
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

    nodes: (.., .., RGB) grey levels, step pixels apart, the first one step before the picture.
    specks: (n, 6) row, column, radius, RGB. texture: (rows, columns RGB) grey levels.
    """
    rows, columns, channels = out.shape
    down, across = _cubic(rows, step), _cubic(columns, step)
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
