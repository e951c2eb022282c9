"""Heights of a pressed shape at points of the sensor frame."""

from typing import Any

import numpy as np

from t2twin.core.jit import compiled
from t2twin.primitives_cad.height_map import REACH_MM
from t2twin.primitives_cad.shape import NOTHING_MM, HeightMap
from t2twin.sim.contact.types import PressCommand, SurfaceShift


def heights_at(
    surface: HeightMap,
    command: PressCommand,
    x_mm: np.ndarray,
    y_mm: np.ndarray,
    shift: SurfaceShift | None = None,
) -> np.ndarray:
    """Heights of a pressed shape over the points of two axes, (y, x) float32, mm, bilinear.

    shift: of the points; see `footprint`.
    """
    heights = np.empty((y_mm.size, x_mm.size), np.float32)
    _heights(*lookup(surface, command), x_mm, y_mm, *shifts_on(shift, x_mm, y_mm), heights)
    return heights


def place_of_top(surface: HeightMap, yaw_rad: float) -> tuple[float, float]:
    """x and y of a press, mm, that puts the middle of a shape's highest part over the pad's
    center."""
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
    if shift is None:
        return False, NO_SHIFT
    return True, shift.on(x_mm, y_mm)


def raise_to_shape(
    surface_mm: np.ndarray,
    shape_surface: HeightMap,
    command: PressCommand,
    x_mm: np.ndarray,
    y_mm: np.ndarray,
    apex_mm: np.ndarray,
    near: tuple[np.ndarray, np.ndarray, np.ndarray],
    shift: SurfaceShift | None = None,
) -> None:
    """Raise a surface, (y, x) float32, mm, in place to a pressed shape wherever that is higher.

    apex_mm: (y, x) float32, level of the shape's height 0. near: mask of the coarser cells in which
    the shape is sampled, and the mask's row (y,) and column (x,) of each point. shift: of the
    points; see `footprint`.
    """
    shifts = shifts_on(shift, x_mm, y_mm)
    _raise(*lookup(shape_surface, command), x_mm, y_mm, *shifts, apex_mm, *near, surface_mm)


def lookup(surface: HeightMap, command: PressCommand) -> tuple[Any, ...]:
    """Arguments of the compiled loops, of the types LOOKUP.

    The heights, column and row of the shape's origin, the press position, and cos and sin of the
    yaw in cells per mm.
    """
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


MAX_PLACES = 200
"""Points along a side of a map among which a high place is searched (assumed)."""

TOP_MM = 0.1
"""Height range of a high place, mm (assumed: the depth of a light press)."""

LOOKUP = "f4[:, ::1], f8, f8, f8, f8, f8, f8"
"""Types of what `lookup` returns."""

NO_SHIFT = np.zeros((3, 1, 1))
"""Shift that the compiled loops do not read."""

SHIFT = "b1, f8[:, :, ::1]"
"""Types of what `shifts_on` returns."""


@compiled(inline="always")
def column_and_row(column, row, press_x, press_y, cos, sin, x, y):
    """Column and row of a point of the sensor frame on the height map."""
    dx, dy = x - press_x, y - press_y
    return column + (cos * dx + sin * dy), row + (sin * dx - cos * dy)


@compiled("void(f4[:, ::1], f8[::1], f8[::1], i8, f4[::1])", nogil=True)
def heights_along(heights, columns, rows, count, found):
    """Write the heights at `count` places between a map's points, bilinear; NOTHING_MM outside.

    Twice as fast as a loop that also computes the places.
    """
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


@compiled(f"void({LOOKUP}, f8[::1], f8[::1], {SHIFT}, f4[:, ::1])", nogil=True)
def _heights(
    heights, at_column, at_row, press_x, press_y, cos, sin, x_mm, y_mm, shifted, shift, out
):
    columns, rows = np.empty(x_mm.size), np.empty(x_mm.size)
    for i in range(y_mm.size):
        for j in range(x_mm.size):
            x, y = x_mm[j], y_mm[i]
            if shifted:
                x, y = x + shift[0, i, j], y + shift[1, i, j]
            columns[j], rows[j] = column_and_row(
                at_column, at_row, press_x, press_y, cos, sin, x, y
            )
        heights_along(heights, columns, rows, x_mm.size, out[i])
        if shifted:
            for j in range(x_mm.size):
                out[i, j] -= shift[2, i, j]


@compiled(
    f"void({LOOKUP}, f8[::1], f8[::1], {SHIFT}, f4[:, ::1], b1[:, ::1], i8[::1], i8[::1],"
    " f4[:, ::1])",
    nogil=True,
)
def _raise(
    heights, at_column, at_row, press_x, press_y, cos, sin, x_mm, y_mm, shifted, shift, apex, near,
    near_rows, near_columns, out,
):  # fmt: skip
    columns, rows = np.empty(x_mm.size), np.empty(x_mm.size)
    chosen, found = np.empty(x_mm.size, np.int64), np.empty(x_mm.size, np.float32)
    for i in range(y_mm.size):
        wanted, count = near[near_rows[i]], 0
        for j in range(x_mm.size):
            chosen[count] = j
            count += wanted[near_columns[j]]
        for n in range(count):
            x, y = x_mm[chosen[n]], y_mm[i]
            if shifted:
                x, y = x + shift[0, i, chosen[n]], y + shift[1, i, chosen[n]]
            columns[n], rows[n] = column_and_row(
                at_column, at_row, press_x, press_y, cos, sin, x, y
            )
        heights_along(heights, columns, rows, count, found)
        for n in range(count):
            j = chosen[n]
            if shifted:
                found[n] -= shift[2, i, j]
            out[i, j] = max(out[i, j], apex[i, j] + found[n])
