"""Footprint of a shape on a grid: its mean height over each cell, and the share it covers."""

import weakref
from dataclasses import dataclass

import numpy as np

from t2twin.core.jit import compiled
from t2twin.primitives_cad.shape import NOTHING_MM, HeightMap
from t2twin.sim.contact.grid import block_max, block_sums
from t2twin.sim.contact.heights import (
    LOOKUP,
    SHIFT,
    column_and_row,
    heights_along,
    interpolated,
    lookup,
    shifts_on,
)
from t2twin.sim.contact.types import PressCommand, SurfaceShift

SAMPLES = 5
"""Points a side at which a cell is sampled."""

CENTER_AND_CORNERS = np.array([12, 0, 4, 20, 24])
"""Indices of a cell's center and corner samples, which are numbered row by row."""

STEEPEST = 1.5
"""Height difference within a cell, in cells, above which it contains a wall and not a slope."""

MIN_WALL_MM = 0.18
"""Least height difference of a wall, mm (assumed: about that within the usual smallest pin). The
steep rim of a round needle is no wall on pins that are smaller."""

CENTER_WEIGHT = 1 - 1 / (12 * 0.4**2)
"""Weight of a cell's center in its mean height, the corners sharing the rest: exact for quadratic
heights, as the corner samples lie 0.4 cells off the center both ways."""

MIN_COVER = 0.1
"""Cells covered by less than this share count as free."""

BLOCK = 8
"""Points a side of the height map's blocks whose flatness is precomputed."""

NOT_FLAT = np.float32(np.inf)
"""Marks a block that is not flat together with all blocks around it."""


@dataclass(frozen=True)
class Footprint:
    """A shape over the cells of a grid, all (ny, nx).

    heights_mm: mean height of the part over each cell, mm, NOTHING_MM where there is none.
    shares: covered share of the cell, 0 to 1.
    peaks_mm: highest point over the cell, mm.
    """

    heights_mm: np.ndarray
    shares: np.ndarray
    peaks_mm: np.ndarray

    def coarsened(self, per_side: int) -> "Footprint":
        """The footprint on cells of per_side x per_side of these."""
        if per_side == 1:
            return self
        peaks = block_max(self.peaks_mm, per_side)
        covered = block_sums(self.shares, per_side)
        heights = np.where(self.shares > 0, self.heights_mm, 0.0)
        mean = block_sums(self.shares * heights, per_side) / np.maximum(covered, MIN_COVER)
        return Footprint(np.where(covered > 0, mean, NOTHING_MM), covered / per_side**2, peaks)


def footprint(
    surface: HeightMap,
    command: PressCommand,
    x_mm: np.ndarray,
    y_mm: np.ndarray,
    active: np.ndarray | None = None,
    shift: SurfaceShift | None = None,
) -> Footprint:
    """The footprint on cells with centers x_mm (nx,), y_mm (ny,), mm, equally spaced.

    active: bool on coarser cells that each contain a whole number of these; the others are
        treated as free. None includes all.
    shift: of the layer's surface. Cells meet the shape where they are displaced to, and the heights
        are above the lowered surface.
    """
    heights, shares, peaks = np.empty((3, y_mm.size, x_mm.size))
    included = np.ones((1, 1), bool) if active is None else np.ascontiguousarray(active)
    place = *lookup(surface, command), _flat_blocks(surface), x_mm, y_mm
    _footprint(*place, *shifts_on(shift, x_mm, y_mm), included, heights, shares, peaks)
    return Footprint(heights, shares, peaks)


_flat: dict[int, tuple[weakref.ref, np.ndarray]] = {}
"""Results of `_flat_blocks` for living surfaces, by identity."""


def _flat_blocks(surface: HeightMap) -> np.ndarray:
    """Height of each block of BLOCK x BLOCK points, mm; NOT_FLAT where a neighbor differs.

    Computed once a surface: a base plate and a punch's face are most of a map.
    """
    known = _flat.get(id(surface))
    if known is not None and known[0]() is surface:
        return known[1]
    heights = np.asarray(surface.heights_mm, np.float32)
    blocks = np.empty([-(-side // BLOCK) for side in heights.shape], np.float32)
    _find_flat_blocks(np.ascontiguousarray(heights), blocks)
    place = id(surface)
    _flat[place] = weakref.ref(surface, lambda _: _flat.pop(place, None)), blocks
    return blocks


@compiled("void(f4[:, ::1], f4[:, ::1])", nogil=True)
def _find_flat_blocks(heights, blocks):
    """Write the blocks of `_flat_blocks`."""
    rows, columns = blocks.shape
    low, high = np.empty((rows, columns), np.float32), np.empty((rows, columns), np.float32)
    for a in range(rows):
        for b in range(columns):
            least = most = heights[a * BLOCK, b * BLOCK]
            for i in range(a * BLOCK, min((a + 1) * BLOCK, heights.shape[0])):
                for j in range(b * BLOCK, min((b + 1) * BLOCK, heights.shape[1])):
                    least, most = min(least, heights[i, j]), max(most, heights[i, j])
            low[a, b], high[a, b] = least, most
    for a in range(rows):
        for b in range(columns):
            least, most = low[a, b], high[a, b]
            for i in range(max(a - 1, 0), min(a + 2, rows)):
                for j in range(max(b - 1, 0), min(b + 2, columns)):
                    least, most = min(least, low[i, j]), max(most, high[i, j])
            blocks[a, b] = least if least == most else NOT_FLAT


@compiled(inline="always")
def _sample_offsets(cos, sin, cell):
    """Columns and rows of a cell's samples relative to its center, on the height map."""
    apart, first = cell / SAMPLES, -(SAMPLES - 1) / 2
    columns, rows = np.empty(SAMPLES * SAMPLES), np.empty(SAMPLES * SAMPLES)
    for a in range(SAMPLES):
        for b in range(SAMPLES):
            x, y = (first + b) * apart, (first + a) * apart
            columns[SAMPLES * a + b] = cos * x + sin * y
            rows[SAMPLES * a + b] = sin * x - cos * y
    return columns, rows


@compiled(inline="always")
def _walled_cell(heights, column, row, aside, ahead, samples, high, wall):
    """Mean height, share and peak of the part of a cell above its walls, from all samples.

    Some samples are on the wall, which the map interpolates as a slope. They are left out of the
    mean: those farther below the mean of all samples than the highest one is above it.
    """
    for k in range(samples.size):
        samples[k] = interpolated(heights, column + aside[k], row + ahead[k])
        high = max(high, samples[k])
    mean, share = _mean_above(samples, max(high - wall, NOTHING_MM / 2))
    if share < MIN_COVER:
        return NOTHING_MM, 0.0, NOTHING_MM
    mean, _ = _mean_above(samples, 2 * mean - high)
    return mean, share, high


@compiled(inline="always")
def _mean_above(samples, lowest):
    """Mean of the samples that are not below the lowest one, and their share."""
    count, total = 0, 0.0
    for k in range(samples.size):
        if samples[k] >= lowest:
            count += 1
            total += samples[k]
    return total / max(count, 1), count / samples.size


@compiled(inline="always")
def _smooth_cell(few, n, wall):
    """Whether a cell contains no wall, its mean height, lowest and highest sample."""
    center = few[0, n]
    low, high, total = center, center, np.float32(0.0)
    for k in range(1, CENTER_AND_CORNERS.size):
        height = few[k, n]
        low, high, total = min(low, height), max(high, height), total + height
    mean = CENTER_WEIGHT * center + (1 - CENTER_WEIGHT) * total / 4
    return high - low <= wall, mean, low, high


@compiled(
    f"void({LOOKUP}, f4[:, ::1], f8[::1], f8[::1], {SHIFT}, b1[:, ::1], f8[:, ::1], f8[:, ::1],"
    " f8[:, ::1])",
    nogil=True,
)
def _footprint(
    heights, at_column, at_row, press_x, press_y, cos, sin, flat, x_mm, y_mm, shifted, shift,
    included, mean, share, peak,
):  # fmt: skip
    """Writes mean, share and peak, all (ny, nx), of a Footprint."""
    cell = x_mm[1] - x_mm[0]
    wall = max(STEEPEST * cell, MIN_WALL_MM)
    aside, ahead = _sample_offsets(cos, sin, cell)
    samples = np.empty(SAMPLES * SAMPLES)
    # The sampled cells of a row, and their heights at the center and the corners.
    chosen = np.empty(x_mm.size, np.int64)
    columns, rows = np.empty(x_mm.size), np.empty(x_mm.size)
    along, below = np.empty(x_mm.size), np.empty(x_mm.size)
    few = np.empty((CENTER_AND_CORNERS.size, x_mm.size), np.float32)
    mean[:], share[:], peak[:] = NOTHING_MM, 0.0, NOTHING_MM
    # A cell's side in cells of the map: farther outside the map no sample of a cell is on it.
    reach = cell * np.hypot(cos, sin)
    max_column, max_row = heights.shape[1] - 1 + reach, heights.shape[0] - 1 + reach
    # A cell's samples lie within its middle four fifths, whichever way it is turned.
    within_block = 0.4 * np.sqrt(2.0) * reach + 1.0 < BLOCK
    inner_column, inner_row = heights.shape[1] - 1 - reach, heights.shape[0] - 1 - reach
    down, across = y_mm.size // included.shape[0], x_mm.size // included.shape[1]
    for i in range(y_mm.size):
        count = 0
        for j in range(x_mm.size):
            if not included[i // down, j // across]:
                continue
            x, y = x_mm[j], y_mm[i]
            if shifted:
                x, y = x + shift[0, i, j], y + shift[1, i, j]
            column, row = column_and_row(at_column, at_row, press_x, press_y, cos, sin, x, y)
            if not (-reach < column < max_column and -reach < row < max_row):
                continue
            if within_block and reach < column < inner_column and reach < row < inner_row:
                height = flat[int(row) // BLOCK, int(column) // BLOCK]
                if height != NOT_FLAT:
                    mean[i, j] = peak[i, j] = height
                    share[i, j] = 1.0 if height > NOTHING_MM / 2 else 0.0
                    continue
            chosen[count], columns[count], rows[count] = j, column, row
            count += 1
        for k in range(CENTER_AND_CORNERS.size):
            for n in range(count):
                along[n] = columns[n] + aside[CENTER_AND_CORNERS[k]]
                below[n] = rows[n] + ahead[CENTER_AND_CORNERS[k]]
            heights_along(heights, along, below, count, few[k])
        for n in range(count):
            j = chosen[n]
            smooth, height, low, high = _smooth_cell(few, n, wall)
            if not smooth:
                mean[i, j], share[i, j], peak[i, j] = _walled_cell(
                    heights, columns[n], rows[n], aside, ahead, samples, np.float64(high), wall
                )
                continue
            peak[i, j] = high
            if low > NOTHING_MM / 2:
                mean[i, j], share[i, j] = height, 1.0
    if shifted:
        mean -= shift[2]
        peak -= shift[2]
