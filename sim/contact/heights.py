"""Heights of a pressed shape in the sensor frame: at points, and over the cells of a grid."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from t2twin.core.jit import INNER, compiled
from t2twin.primitives_cad.height_map import REACH_MM
from t2twin.primitives_cad.shape import NOTHING_MM, HeightMap
from t2twin.sim.contact.types import PressCommand, SurfaceShift

SAMPLES = 5  # points a side at which a cell with a wall is sampled
# Height difference within a cell, in cells, above which it contains a wall and not a slope.
STEEPEST = 1.5
# Least height difference of a wall, mm (assumed: about that within the usual smallest pin). The
# steep rim of a round needle is no wall on pins that are smaller.
MIN_WALL_MM = 0.18
# Weight of a cell's center in its mean height, the corners sharing the rest: exact for quadratic
# heights.
CENTER_WEIGHT = 2 / 3
MIN_COVER = 0.1  # cells covered by less than this share count as free
MAX_PLACES = 200  # points along a side of a map among which a high place is searched (assumed)
TOP_MM = 0.1  # height range of a high place, mm (assumed: the depth of a light press)
NO_SHIFT = np.zeros((3, 1, 1))  # shift that the compiled loops do not read


def heights_at(
    surface: HeightMap, command: PressCommand, x_mm: np.ndarray, y_mm: np.ndarray,
    shift: SurfaceShift | None = None,
) -> np.ndarray:  # fmt: skip
    """Heights of a pressed shape over the points of two axes, (y, x) float32, mm, bilinear."""
    heights = np.full((y_mm.size, x_mm.size), NOTHING_MM, np.float32)
    everywhere = np.ones((1, 1), bool), np.zeros(y_mm.size, int), np.zeros(x_mm.size, int)
    apex_mm = np.zeros_like(heights)
    raise_to_shape(heights, surface, command, x_mm, y_mm, apex_mm, everywhere, shift)
    return heights


def place_of_top(surface: HeightMap, yaw_rad: float) -> tuple[float, float]:
    """x and y of a press, mm, that puts the shape's highest part over the pad's center."""
    from scipy import ndimage  # slow to import

    step = max(1, max(surface.heights_mm.shape) // MAX_PLACES)
    heights = surface.heights_mm[::step, ::step]
    inside = np.asarray(ndimage.distance_transform_edt(heights >= heights.max() - TOP_MM))
    row, column = divmod(int(inside.argmax()), heights.shape[1])
    x, y = surface.x_mm[::step][column], surface.y_mm[::step][row]
    cos, sin = np.cos(yaw_rad), np.sin(yaw_rad)
    return float(-cos * x - sin * y), float(cos * y - sin * x)


def reaches_beyond(
    surface: HeightMap, command: PressCommand, x_mm: np.ndarray, y_mm: np.ndarray
) -> bool:
    """Whether a corner of a pad with these axes lies beyond a pressed shape's height map."""
    x, y = np.meshgrid(x_mm[[0, -1]] - command.x_mm, y_mm[[0, -1]] - command.y_mm)
    cos, sin = np.cos(command.yaw_rad), np.sin(command.yaw_rad)
    farthest = max(np.abs(cos * x + sin * y).max(), np.abs(sin * x - cos * y).max())
    return bool(farthest > max(surface.x_mm[-1], surface.y_mm[-1]))


def is_cut(surface: HeightMap) -> bool:
    """Whether a height map ends at REACH_MM, where its shape may go on."""
    return max(surface.x_mm[-1], surface.y_mm[-1]) >= REACH_MM


def shifts_on(
    shift: SurfaceShift | None, x_mm: np.ndarray, y_mm: np.ndarray
) -> tuple[bool, np.ndarray]:
    """Arguments of the compiled loops: whether there is a shift, and its values, (3, y, x)."""
    return shift is not None, NO_SHIFT if shift is None else shift.on(x_mm, y_mm)


def raise_to_shape(
    surface_mm: np.ndarray, shape_surface: HeightMap, command: PressCommand, x_mm: np.ndarray, y_mm:
    np.ndarray, apex_mm: np.ndarray, near: tuple[np.ndarray, np.ndarray, np.ndarray], shift:
    SurfaceShift | None = None,
) -> None:  # fmt: skip
    """Raise a surface, (y, x) float32, mm, in place to a pressed shape wherever that is higher.

    apex_mm: (y, x) float32, level of the shape's height 0. near: mask of the coarser cells in which
    the shape is sampled, and the mask's row (y,) and column (x,) of each point.
    """
    x_mm, y_mm = np.array(x_mm), np.array(y_mm)  # read-only ones would compile the loops once more
    shifts = shifts_on(shift, x_mm, y_mm)
    work = np.empty((2, x_mm.size)), np.empty(x_mm.size, int), np.empty(x_mm.size, np.float32)
    of_shape = lookup(shape_surface, command)
    _raise(*of_shape, x_mm, y_mm, *shifts, apex_mm, *near, *work, surface_mm)


def lookup(surface: HeightMap, command: PressCommand) -> tuple[Any, ...]:
    """Arguments of the compiled loops: the heights and the map's place."""
    per_mm = 1.0 / surface.pitch_mm
    place = (
        -float(surface.x_mm[0]) * per_mm,
        -float(surface.y_mm[0]) * per_mm,
        float(command.x_mm),
        float(command.y_mm),
        float(np.cos(command.yaw_rad)) * per_mm,
        float(np.sin(command.yaw_rad)) * per_mm,
    )
    return np.ascontiguousarray(surface.heights_mm, dtype=np.float32), place


@compiled(inline="always")
def column_and_row(place, x, y):
    """Column and row of a point of the sensor frame on the height map."""
    column, row, press_x, press_y, cos, sin = place
    dx, dy = x - press_x, y - press_y
    return column + (cos * dx + sin * dy), row + (sin * dx - cos * dy)


@compiled(nogil=True, **INNER)
def heights_along(heights, columns, rows, count, found):
    """Write the heights at `count` places of a map, bilinear; twice as fast as with the places."""
    # Unsigned indices save the check for negative ones.
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


@compiled(nogil=True)
def _raise(
    heights, place, x_mm, y_mm, shifted, shift, apex, near, near_rows, near_columns, places, chosen,
    found, out,
):  # fmt: skip
    columns, rows = places[0], places[1]
    for i in range(y_mm.size):
        wanted, count = near[near_rows[i]], np.int64(0)  # 0 would compile heights_along once more
        for j in range(x_mm.size):
            chosen[count] = j
            count += wanted[near_columns[j]]
        for n in range(count):
            x, y = x_mm[chosen[n]], y_mm[i]
            if shifted:
                x, y = x + shift[0, i, chosen[n]], y + shift[1, i, chosen[n]]
            columns[n], rows[n] = column_and_row(place, x, y)
        heights_along(heights, columns, rows, count, found)
        for n in range(count):
            j = chosen[n]
            if shifted:
                found[n] -= shift[2, i, j]
            out[i, j] = max(out[i, j], apex[i, j] + found[n])


@dataclass(frozen=True)
class Footprint:
    """A shape over the cells of a grid, all (ny, nx)."""

    heights_mm: np.ndarray  # mean height of the part over each cell; NOTHING_MM without any
    shares: np.ndarray  # covered share of the cell, 0 to 1
    peaks_mm: np.ndarray  # highest point over the cell

    def coarsened(self, per_side: int) -> "Footprint":
        """The footprint on cells of per_side x per_side of these."""
        if per_side == 1:
            return self
        found: Any = np.empty((3, *(size // per_side for size in self.shares.shape)))
        _coarsen(self.heights_mm, self.shares, self.peaks_mm, per_side, *found)
        return Footprint(*found)


def footprint(
    surface: HeightMap, command: PressCommand, x_mm: np.ndarray, y_mm: np.ndarray, active:
    np.ndarray | None = None, shift: SurfaceShift | None = None,
) -> Footprint:  # fmt: skip
    """The footprint on cells with centers x_mm (nx,), y_mm (ny,), mm, equally spaced.

    active: bool on coarser cells that each contain a whole number of these; the others are free.
    shift: of the layer's surface. Cells meet the shape where they are displaced to, and the heights
    are above the lowered surface.
    """
    heights, shares, peaks = np.empty((3, y_mm.size, x_mm.size))
    included = np.ones((1, 1), bool) if active is None else np.ascontiguousarray(active)
    shifts = shifts_on(shift, x_mm, y_mm)
    found, (of_map, place), size = (heights, shares, peaks), lookup(surface, command), x_mm.size + 1
    places, at = np.empty((2, heights.size), int), np.empty((2, heights.size))
    lines = np.empty(size, int), np.empty((4, size)), np.empty((3, size), np.float32)
    count = _footprint(of_map, place, x_mm, y_mm, *shifts, included, *lines, places, at, *found)
    if count:
        work = np.empty((SAMPLES**2 + 2, count), np.float32), np.empty((5, count))
        _sample_cells(of_map, place, x_mm[1] - x_mm[0], count, places, at, *work, *found)
    if shift is not None:
        heights -= shifts[1][2]
        peaks -= shifts[1][2]
    return Footprint(*found)


@compiled(inline="always")
def _mean_above(samples, count, lowest, mean, number):
    """Write the mean and the number of each cell's samples that are not below the lowest."""
    rows = SAMPLES * SAMPLES
    for n in range(count):
        mean[n], number[n] = 0.0, 0.0
    for k in range(rows):
        for n in range(count):
            above = samples[k, n] >= lowest[n]
            mean[n] += samples[k, n] if above else 0.0
            number[n] += 1.0 if above else 0.0
    for n in range(count):
        mean[n] /= max(number[n], 1.0)


@compiled(nogil=True)
def _sample_cells(heights, place, cell, count, places, at, samples, lines, mean, share, peak):
    """Write mean, share and peak of the part of cells above their walls, from all samples."""
    # Some samples are on the wall, which the map interpolates as a slope. They are left out of the
    # mean: those farther below the mean of all samples than the highest one is above it.
    wall = max(STEEPEST * cell, MIN_WALL_MM)
    apart, first, cos, sin = cell / SAMPLES, -(SAMPLES - 1) / 2, place[4], place[5]
    columns, rows, bound, total, number = lines[0], lines[1], lines[2], lines[3], lines[4]
    low, high = samples[SAMPLES * SAMPLES], samples[SAMPLES * SAMPLES + 1]
    for a in range(SAMPLES):
        for b in range(SAMPLES):
            x, y = (first + b) * apart, (first + a) * apart
            aside, ahead = cos * x + sin * y, sin * x - cos * y
            for n in range(count):
                columns[n], rows[n] = at[0, n] + aside, at[1, n] + ahead
            heights_along(heights, columns, rows, count, samples[SAMPLES * a + b])
    for n in range(count):
        low[n] = high[n] = samples[0, n]
        bound[n] = NOTHING_MM
    for k in range(1, SAMPLES * SAMPLES):
        for n in range(count):
            low[n], high[n] = min(low[n], samples[k, n]), max(high[n], samples[k, n])
    for n in range(count):
        if high[n] - low[n] > wall:
            bound[n] = max(high[n] - wall, NOTHING_MM / 2)
    _mean_above(samples, count, bound, total, number)
    for n in range(count):
        i, j = places[0, n], places[1, n]
        mean[i, j], peak[i, j], share[i, j] = total[n], high[n], number[n] / (SAMPLES * SAMPLES)
        if not high[n] - low[n] > wall:
            share[i, j] = 1.0 if low[n] > NOTHING_MM / 2 else 0.0
        else:
            bound[n] = 2 * total[n] - high[n]
    _mean_above(samples, count, bound, total, number)
    for n in range(count):
        i, j = places[0, n], places[1, n]
        if high[n] - low[n] > wall:
            mean[i, j] = total[n]
            if share[i, j] < MIN_COVER:
                mean[i, j], share[i, j], peak[i, j] = NOTHING_MM, 0.0, NOTHING_MM


@compiled(inline="always")
def _corner_heights(
    heights, place, x_mm, y_mm, shifted, shift, i, first, last, columns, rows, corners
):
    """Write the heights at the corners between the rows i - 1 and i of cells, (nx + 1,)."""
    half = 0.5 * (x_mm[1] - x_mm[0])
    y = y_mm[i] - half if i < y_mm.size else y_mm[i - 1] + half
    for j in range(first, last):
        x = x_mm[j] - half if j < x_mm.size else x_mm[j - 1] + half
        at_x, at_y = x, y
        if shifted:
            above, below = max(i - 1, 0), min(i, y_mm.size - 1)
            left, right = max(j - 1, 0), min(j, x_mm.size - 1)
            for k in (above, below):
                for m in (left, right):
                    at_x += 0.25 * shift[0, k, m]
                    at_y += 0.25 * shift[1, k, m]
        columns[j - first], rows[j - first] = column_and_row(place, at_x, at_y)
    heights_along(heights, columns, rows, last - first, corners[first:])


@compiled(inline="always")
def _chosen_cells(heights, place, x_mm, y_mm, shifted, shift, included, i, chosen, columns, rows):
    """Write the cells of row i that may lie on the map, and their centers; return their number."""
    # A cell's side in cells of the map: farther outside the map no sample of a cell is on it.
    reach = (x_mm[1] - x_mm[0]) * np.hypot(place[4], place[5])
    max_column, max_row = heights.shape[1] - 1 + reach, heights.shape[0] - 1 + reach
    down, across = y_mm.size // included.shape[0], x_mm.size // included.shape[1]
    count, within = np.int64(0), included[i // down]
    for block in range(within.size):
        if not within[block]:
            continue
        for j in range(block * across, (block + 1) * across):
            x, y = x_mm[j], y_mm[i]
            if shifted:
                x, y = x + shift[0, i, j], y + shift[1, i, j]
            column, row = column_and_row(place, x, y)
            if -reach < column < max_column and -reach < row < max_row:
                chosen[count], columns[count], rows[count] = j, column, row
                count += 1
    return count


@compiled(nogil=True)
def _footprint(
    heights, place, x_mm, y_mm, shifted, shift, included, chosen, lines, points, places, at, mean,
    share, peak,
):  # fmt: skip
    """Write mean, share and peak, all (ny, nx), of a Footprint, and the places of the cells with a
    wall, and their centers on the map; returns their number."""
    wall, walls = max(STEEPEST * (x_mm[1] - x_mm[0]), MIN_WALL_MM), 0
    # The sampled cells of a row, their heights, and those at the corners above and below the row.
    columns, rows, along, below = lines[0], lines[1], lines[2], lines[3]
    found, upper, lower = points[0], points[1], points[2]
    known_from = known_to = 0  # of the corners above the row
    for i in range(y_mm.size):
        for j in range(x_mm.size):
            mean[i, j], share[i, j], peak[i, j] = NOTHING_MM, 0.0, NOTHING_MM
    for i in range(y_mm.size):
        count = _chosen_cells(
            heights, place, x_mm, y_mm, shifted, shift, included, i, chosen, columns, rows
        )
        if count == 0:
            known_from = known_to = 0
            continue
        first, last = chosen[0], chosen[count - 1] + 2
        known = known_from <= first < last <= known_to
        for side in range(1 if known else 0, 2):
            _corner_heights(
                heights, place, x_mm, y_mm, shifted, shift, i + side, first, last, along, below,
                lower if side else upper,
            )  # fmt: skip
        heights_along(heights, columns, rows, count, found)
        for n in range(count):
            j, center = chosen[n], found[n]
            low = min(center, min(min(upper[j], upper[j + 1]), min(lower[j], lower[j + 1])))
            high = max(center, max(max(upper[j], upper[j + 1]), max(lower[j], lower[j + 1])))
            if high - low > wall:
                places[0, walls], places[1, walls] = i, j
                at[0, walls], at[1, walls] = columns[n], rows[n]
                walls += 1
                continue
            peak[i, j] = high
            if low > NOTHING_MM / 2:
                corners = upper[j] + upper[j + 1] + lower[j] + lower[j + 1]
                mean[i, j] = CENTER_WEIGHT * center + (1.0 - CENTER_WEIGHT) / 4.0 * corners
                share[i, j] = 1.0
        upper, lower = lower, upper
        known_from, known_to = first, last
    return walls


@compiled(nogil=True)
def _coarsen(heights, shares, peaks, per_side, mean, share, peak):
    """Write mean, share and peak of cells of per_side x per_side cells."""
    for i in range(mean.shape[0]):
        for j in range(mean.shape[1]):
            covered, total, most = 0.0, 0.0, peaks[i * per_side, j * per_side]
            for k in range(i * per_side, (i + 1) * per_side):
                for m in range(j * per_side, (j + 1) * per_side):
                    most = max(most, peaks[k, m])
                    if shares[k, m] > 0.0:
                        covered += shares[k, m]
                        total += shares[k, m] * heights[k, m]
            peak[i, j], share[i, j] = most, covered / per_side**2
            mean[i, j] = total / max(covered, MIN_COVER) if covered > 0.0 else NOTHING_MM
