"""What a shape's surface is over each cell of a grid: how high, and over how much of the cell."""

import weakref
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy import ndimage

from t2twin.core.jit import compiled
from t2twin.primitives_cad.shape import NOTHING_MM, HeightMap
from t2twin.sim.contact.grid import highest, sums
from t2twin.sim.contact.types import PressCommand

SAMPLES = 5
"""Points a side at which a cell's part of the surface is looked up."""

FEW = np.array([12, 0, 4, 20, 24])
"""Of those, row by row, the middle and the corners."""

STEEPEST = 1.5
"""Height differences within a cell beyond this many cells count as a wall, not a slope."""

MIDDLE_WEIGHT = 1 - 1 / (12 * 0.4**2)
"""Weight of a cell's middle in its mean height, the corners' being the rest: exact where the
height is quadratic, the corner samples lying 0.4 cells off the middle both ways."""

MIN_COVER = 0.1
"""Cells of which the shape covers less than this share count as free."""


BLOCK = 8
"""Points a side of the blocks in which a shape is known to be flat, and needs no samples."""

UNEVEN = np.float32(np.inf)
"""Stands for a block that is not flat, with all blocks around it."""


def to_shape_frame(
    command: PressCommand, x_mm: np.ndarray, y_mm: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Where points of the sensor frame lie in the shape frame (see t2twin.primitives_cad.shape)."""
    cos, sin = np.cos(command.yaw_rad), np.sin(command.yaw_rad)
    dx, dy = x_mm - command.x_mm, y_mm - command.y_mm
    return cos * dx + sin * dy, sin * dx - cos * dy


def heights_at(
    surface: HeightMap, command: PressCommand, x_mm: np.ndarray, y_mm: np.ndarray
) -> np.ndarray:
    """Heights of the turned-over shape over the axes' points, (y, x) float32, mm, bilinear."""
    heights = np.empty((y_mm.size, x_mm.size), np.float32)
    _heights(*_lookup(surface, command), x_mm, y_mm, heights)
    return heights


def raise_to_shape(
    surface_mm: np.ndarray,
    shape_surface: HeightMap,
    command: PressCommand,
    x_mm: np.ndarray,
    y_mm: np.ndarray,
    apex_mm: np.ndarray,
    near: tuple[np.ndarray, np.ndarray, np.ndarray],
) -> None:
    """Lift a surface, (y, x) float32, mm, in place to where the turned-over shape stands in it.

    apex_mm: (y, x) float32, where the shape's height 0 is. near: mask of coarser cells in which it
    is looked up, and their rows (y,) and columns (x,).
    """
    _raise(*_lookup(shape_surface, command), x_mm, y_mm, apex_mm, *near, surface_mm)


@dataclass(frozen=True)
class Footprint:
    """What of a shape stands over each cell of a grid, all (ny, nx).

    heights_mm: mean height of that part, mm, NOTHING_MM where there is none.
    shares: its share of the cell, 0 to 1.
    peaks_mm: its highest point, mm.
    """

    heights_mm: np.ndarray
    shares: np.ndarray
    peaks_mm: np.ndarray

    def coarsened(self, per_side: int) -> "Footprint":
        """The same on cells of per_side x per_side of these."""
        if per_side == 1:
            return self
        peaks = highest(self.peaks_mm, per_side)
        covered = sums(self.shares, per_side)
        heights = np.where(self.shares > 0, self.heights_mm, 0.0)
        mean = sums(self.shares * heights, per_side) / np.maximum(covered, MIN_COVER)
        return Footprint(np.where(covered > 0, mean, NOTHING_MM), covered / per_side**2, peaks)


def footprint(
    surface: HeightMap,
    command: PressCommand,
    x_mm: np.ndarray,
    y_mm: np.ndarray,
    looked_at: np.ndarray | None = None,
) -> Footprint:
    """The footprint on cells with centers x_mm (nx,), y_mm (ny,), mm, equally spaced.

    looked_at: bool on coarser cells, of a whole number of these each; over the others nothing is
        said to stand. None looks at all.
    """
    heights, shares, peaks = np.empty((3, y_mm.size, x_mm.size))
    wanted = np.ones((1, 1), bool) if looked_at is None else np.ascontiguousarray(looked_at)
    lookup = _lookup(surface, command)
    _footprint(*lookup, _even_blocks(surface), x_mm, y_mm, wanted, heights, shares, peaks)
    return Footprint(heights, shares, peaks)


_even: dict[int, tuple[weakref.ref, np.ndarray]] = {}
"""What `_even_blocks` has found of surfaces that are still there, by their identity."""


def _even_blocks(surface: HeightMap) -> np.ndarray:
    """Blocks of BLOCK x BLOCK points: the height of those that are flat as all about them are, mm;
    else UNEVEN. Worked out once a surface: a base plate and a punch's face are most of a map."""
    known = _even.get(id(surface))
    if known is not None and known[0]() is surface:
        return known[1]
    heights = np.asarray(surface.heights_mm, np.float32)
    rows, columns = (np.arange(0, side, BLOCK) for side in heights.shape)
    low, high = (
        extreme.reduceat(extreme.reduceat(heights, rows, axis=0), columns, axis=1)
        for extreme in (np.minimum, np.maximum)
    )
    low, high = ndimage.minimum_filter(low, 3), ndimage.maximum_filter(high, 3)
    blocks = np.where(low == high, low, UNEVEN).astype(np.float32)
    place = id(surface)
    _even[place] = weakref.ref(surface, lambda _: _even.pop(place, None)), blocks
    return blocks


def _lookup(surface: HeightMap, command: PressCommand) -> tuple[Any, ...]:
    """The map, where the press' place lies on it (column and row), and the columns and rows that
    cos and sin of the turn make a mm."""
    per_mm = 1.0 / surface.pitch_mm
    return (
        np.ascontiguousarray(surface.heights_mm, dtype=np.float32),
        -float(surface.x_mm[0]) * per_mm,
        -float(surface.y_mm[0]) * per_mm,
        float(command.x_mm),
        float(command.y_mm),
        float(np.cos(command.yaw_rad)) * per_mm,
        float(np.sin(command.yaw_rad)) * per_mm,
    )


_LOOKUP = "f4[:, ::1], f8, f8, f8, f8, f8, f8"
"""Types of what `_lookup` gives, so that compiling happens at import and not within a press."""


@compiled(inline="always")
def _column_and_row(column, row, press_x, press_y, cos, sin, x, y):
    """Where a place lies on the shape's map, in its cells."""
    dx, dy = x - press_x, y - press_y
    return column + (cos * dx + sin * dy), row + (sin * dx - cos * dy)


@compiled("f4(f4[:, ::1], f8, f8)", nogil=True)
def _height(heights, column, row):
    if not (0.0 <= column < heights.shape[1] - 1 and 0.0 <= row < heights.shape[0] - 1):
        return np.float32(NOTHING_MM)
    # Unsigned, as what could count from an axis' end would be looked at each time.
    j, i, one = np.uintp(column), np.uintp(row), np.uintp(1)
    across, down = np.float32(column - j), np.float32(row - i)
    upper, lower = heights[i], heights[i + one]
    left = upper[j] + down * (lower[j] - upper[j])
    right = upper[j + one] + down * (lower[j + one] - upper[j + one])
    return left + across * (right - left)


@compiled("void(f4[:, ::1], f8[::1], f8[::1], i8, f4[::1])", nogil=True)
def _heights_along(heights, columns, rows, count, found):
    """`_height` at so many places. Apart from where they come from, it is twice as fast."""
    points, width, one = heights.ravel(), np.uint32(heights.shape[1]), np.uint32(1)
    last_column, last_row = heights.shape[1] - 1, heights.shape[0] - 1
    for n in range(count):
        column, row = columns[n], rows[n]
        if not (0.0 <= column < last_column and 0.0 <= row < last_row):
            found[n] = NOTHING_MM
            continue
        j, i = np.int32(column), np.int32(row)
        across, down = np.float32(column - j), np.float32(row - i)
        upper = np.uint32(np.uint32(i) * width + np.uint32(j))
        lower = np.uint32(upper + width)
        left = points[upper] + down * (points[lower] - points[upper])
        upper, lower = np.uint32(upper + one), np.uint32(lower + one)
        right = points[upper] + down * (points[lower] - points[upper])
        found[n] = left + across * (right - left)


@compiled(f"void({_LOOKUP}, f8[::1], f8[::1], f4[:, ::1])", nogil=True)
def _heights(heights, at_column, at_row, press_x, press_y, cos, sin, x_mm, y_mm, out):
    columns, rows = np.empty(x_mm.size), np.empty(x_mm.size)
    for i in range(y_mm.size):
        for j in range(x_mm.size):
            columns[j], rows[j] = _column_and_row(
                at_column, at_row, press_x, press_y, cos, sin, x_mm[j], y_mm[i]
            )
        _heights_along(heights, columns, rows, x_mm.size, out[i])


@compiled(
    f"void({_LOOKUP}, f8[::1], f8[::1], f4[:, ::1], b1[:, ::1], i8[::1], i8[::1], f4[:, ::1])",
    nogil=True,
)
def _raise(
    heights, at_column, at_row, press_x, press_y, cos, sin, x_mm, y_mm, apex, near, near_rows,
    near_columns, out,
):  # fmt: skip
    columns, rows = np.empty(x_mm.size), np.empty(x_mm.size)
    chosen, found = np.empty(x_mm.size, np.int64), np.empty(x_mm.size, np.float32)
    for i in range(y_mm.size):
        wanted, count = near[near_rows[i]], 0
        for j in range(x_mm.size):
            chosen[count] = j
            count += wanted[near_columns[j]]
        for n in range(count):
            columns[n], rows[n] = _column_and_row(
                at_column, at_row, press_x, press_y, cos, sin, x_mm[chosen[n]], y_mm[i]
            )
        _heights_along(heights, columns, rows, count, found)
        for n in range(count):
            j = chosen[n]
            out[i, j] = max(out[i, j], apex[i, j] + found[n])


@compiled(
    f"void({_LOOKUP}, f4[:, ::1], f8[::1], f8[::1], b1[:, ::1], f8[:, ::1], f8[:, ::1],"
    " f8[:, ::1])",
    nogil=True,
)
def _footprint(
    heights, at_column, at_row, press_x, press_y, cos, sin, even, x_mm, y_mm, wanted,
    mean, share, peak,
):  # fmt: skip
    cell = x_mm[1] - x_mm[0]
    # A cell's samples, as steps on the shape's map; row by row of the cell.
    apart, first = cell / SAMPLES, -(SAMPLES - 1) / 2
    aside, ahead = np.empty(SAMPLES * SAMPLES), np.empty(SAMPLES * SAMPLES)
    for a in range(SAMPLES):
        for b in range(SAMPLES):
            x, y = (first + b) * apart, (first + a) * apart
            aside[SAMPLES * a + b] = cos * x + sin * y
            ahead[SAMPLES * a + b] = sin * x - cos * y
    samples = np.empty(SAMPLES * SAMPLES)
    # A row's cells that are looked up, and their heights at FEW.
    chosen = np.empty(x_mm.size, np.int64)
    columns, rows = np.empty(x_mm.size), np.empty(x_mm.size)
    along, below = np.empty(x_mm.size), np.empty(x_mm.size)
    few = np.empty((FEW.size, x_mm.size), np.float32)
    mean[:] = NOTHING_MM
    share[:] = 0.0
    peak[:] = NOTHING_MM
    # In cells of the map. Beyond the map by more than this no sample of a cell is on it.
    reach = cell * np.hypot(cos, sin)
    most_column, most_row = heights.shape[1] - 1 + reach, heights.shape[0] - 1 + reach
    # A cell's samples lie within its middle four fifths, whichever way it is turned.
    nearby = 0.4 * np.sqrt(2.0) * reach + 1.0 < BLOCK
    inner_column, inner_row = heights.shape[1] - 1 - reach, heights.shape[0] - 1 - reach
    down, across = y_mm.size // wanted.shape[0], x_mm.size // wanted.shape[1]
    for i in range(y_mm.size):
        count = 0
        for j in range(x_mm.size):
            if not wanted[i // down, j // across]:
                continue
            column, row = _column_and_row(
                at_column, at_row, press_x, press_y, cos, sin, x_mm[j], y_mm[i]
            )
            if not (-reach < column < most_column and -reach < row < most_row):
                continue
            if nearby and reach < column < inner_column and reach < row < inner_row:
                height = even[int(row) // BLOCK, int(column) // BLOCK]
                if height != UNEVEN:
                    mean[i, j] = peak[i, j] = height
                    share[i, j] = 1.0 if height > NOTHING_MM / 2 else 0.0
                    continue
            chosen[count], columns[count], rows[count] = j, column, row
            count += 1
        for k in range(FEW.size):
            for n in range(count):
                along[n], below[n] = columns[n] + aside[FEW[k]], rows[n] + ahead[FEW[k]]
            _heights_along(heights, along, below, count, few[k])
        for n in range(count):
            j, center = chosen[n], few[0, n]
            low, high, total = center, center, np.float32(0.0)
            for k in range(1, FEW.size):
                height = few[k, n]
                low, high, total = min(low, height), max(high, height), total + height
            # Where middle and corners lie near each other, they say it all.
            if high - low <= STEEPEST * cell:
                if low > NOTHING_MM / 2:
                    mean[i, j] = MIDDLE_WEIGHT * center + (1 - MIDDLE_WEIGHT) * total / 4
                    share[i, j] = 1.0
                peak[i, j] = high
                continue
            for k in range(samples.size):
                samples[k] = _height(heights, columns[n] + aside[k], rows[n] + ahead[k])
                high = max(high, samples[k])
            lowest = high - STEEPEST * cell
            covered, total = 0, 0.0
            for k in range(samples.size):
                if samples[k] >= lowest and samples[k] > NOTHING_MM / 2:
                    covered += 1
                    total += samples[k]
            if covered >= MIN_COVER * samples.size:
                share[i, j] = covered / samples.size
                mean[i, j] = total / covered
                peak[i, j] = high
