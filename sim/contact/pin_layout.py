"""Where a press needs pins, and how fine: from a survey of the whole pad to the pins of each stage.

The survey compares the shape with the pad on coarse cells and estimates the contact. Pins are then
laid out under the estimated contact, finer at the shape's edges and where its surface is uneven.
"""

import time
from collections.abc import Sequence

import numpy as np

from t2twin.core.errors import T2TwinError
from t2twin.core.jit import INNER, compiled
from t2twin.primitives_cad.shape import NOTHING_MM, Shape
from t2twin.sim.contact.grid import (
    Window,
    block_means,
    center_values,
    count_parts,
    dilated,
    refined,
    window_around,
)
from t2twin.sim.contact.heights import footprint, heights_at
from t2twin.sim.contact.layer import Layer, cached_layer
from t2twin.sim.contact.mujoco_contact import POOL_SIZES
from t2twin.sim.contact.pins import Pins, joined, place_pins
from t2twin.sim.contact.solver_loops import spring_depth
from t2twin.sim.contact.types import PressCommand, SurfaceShift

SURVEY_MM = 0.5  # largest cell of the survey and of a pin, mm
# Allowed numbers of pins along a survey cell: the smallest where the shape is even, the largest at
# its edges and where it is uneven.
FINER = (1, 2, 4)
MIN_PINS = 200  # pins that the expected contact covers at least, if FINER allows it
# Number of smallest pins that the separate parts of an expected contact cover on average, below
# which the body gets pins of half that size. Needles of 1 mm are such parts, and narrow ridges that
# barely touch; no press of the protocol has them.
PART_PINS = 200
EDGE_FACTOR = 2  # on the number of pins along a survey cell at the shape's edges
# Height of a cell's highest point above its mean, over the expected depth, above which the cell
# gets the smallest pins.
UNEVEN = 0.1
# The rough and the last stage: coarsest grid of the layer, mm, and the relative change of the
# pressure in a step below which the stage has converged.
STAGES = ((0.25, 2e-2), (0.125, 5e-3))
# Share of the largest model's pins above which a layout that had to use larger pins keeps them
# (assumed). In the rounds of a step, a contact with nearly as many pins as the largest model would
# switch between two sizes.
REFINED_SHARE = 0.5
# Tolerated penetration of the shape's highest points outside the pins: in mm, or as a share of the
# depth where that is less.
MISSED_OUTSIDE_MM, MISSED_OUTSIDE_SHARE = 0.01, 0.2
# Parts of a survey cell's side in which a shape is searched that no survey cell sees. Their corners
# and centers are closer together than the points of a height map.
BLADE_CELLS = 8
BETWEEN = 8  # points along a fine cell at which a tilted shape's first touch is searched (assumed)
MARGIN_CELLS = 1  # survey cells around the expected contact that get pins too
GUESSES = 3  # rounds in which springs and their expected contact are adapted to each other


class OffPadError(T2TwinError):
    """No part of the shape lies over the pad. shape: its name."""

    def __init__(self, message: str, shape: str = "") -> None:
        super().__init__(message)
        self.shape = shape


class Survey:
    """The whole pad and the shape above it, on cells of at most SURVEY_MM.

    shape: with the tilt of the press. per_side: cells of the contact's grid along one survey cell.
    footprint: the shape over the cells. gap_mm: (rows, columns) distance of surface and shape at
    first touch, mm, >= 0. peak_gap_mm: the same for the shape's highest point over each cell
    instead of its mean.
    preparing_s: time spent on cached layers.
    Raises OffPadError for a shape that does not lie over the pad.
    """

    def __init__(
        self, shape: Shape, command: PressCommand, layer: Layer, shift: SurfaceShift | None = None
    ) -> None:
        shape = command.tilted(shape)
        self.shape, self.command, self.layer, self.shift = shape, command, layer, shift
        self.per_side = 2 if 2 * layer.pitch_mm <= SURVEY_MM + 1e-9 else 1
        x, y, rest = layer.coarse(self.per_side)
        self.footprint = footprint(shape.surface, command, x, y, shift=shift)
        self.gap_mm, self.peak_gap_mm = np.empty_like(rest), np.empty_like(rest)
        nearest = _gaps(rest, self.footprint.heights_mm, self.gap_mm)
        if nearest > -NOTHING_MM / 2:  # perhaps a blade between the points that a cell looks at
            finer = (_divided(axis, BLADE_CELLS) for axis in (x, y))
            found = footprint(shape.surface, command, *finer, shift=shift)
            self.footprint = found.coarsened(BLADE_CELLS)
            nearest = _gaps(rest, self.footprint.heights_mm, self.gap_mm)
        if nearest > -NOTHING_MM / 2:
            half_x, half_y = layer.elastomer.width_mm / 2, layer.elastomer.length_mm / 2
            raise OffPadError(
                f"{shape.name} at x {command.x_mm:g} mm, y {command.y_mm:g} mm does not lie over "
                f"the {layer.elastomer.name} pad, which reaches {half_x:g} mm in x and {half_y:g} "
                "mm in y from its center",
                shape.name,
            )
        _gaps(rest, self.footprint.peaks_mm, self.peak_gap_mm)
        self.preparing_s = 0.0

    def surface_mm(self, pressure_mpa: np.ndarray) -> np.ndarray:
        """The surface's deflection under a pressure, both on the contact's grid, (ny, nx), mm."""
        layer = self.layer
        return center_values(layer.by_law_mm(layer.deflection_mm(pressure_mpa)), 1)

    def missed(self, active: np.ndarray, depth_mm: float, pressure_mpa: np.ndarray) -> np.ndarray:
        """(rows, columns) bool: the cells without pins where the shape penetrates the surface.

        active: (rows, columns) bool, the cells that have pins. pressure_mpa: (ny, nx).
        """
        depth_mm -= min(MISSED_OUTSIDE_MM, MISSED_OUTSIDE_SHARE * depth_mm)
        missed = (self.peak_gap_mm < depth_mm) & ~active
        if missed.any():
            surface_mm = block_means(self.surface_mm(pressure_mpa), self.per_side)
            missed &= self.peak_gap_mm < depth_mm - surface_mm
        return missed

    def fine_layer(self, per_side: int) -> Layer:
        """The layer on the contact's cells divided into per_side x per_side."""
        started = time.perf_counter()
        layer = cached_layer(self.layer.elastomer, self.layer.pitch_mm, per_side)
        self.preparing_s += time.perf_counter() - started
        return layer

    def expected_contact(self, force_n: float) -> tuple[np.ndarray, float]:
        """Contact area, (rows, columns) bool, and depth, mm, of independent springs that are as
        compliant as the layer."""
        depth, touching, before = 0.0, np.ones(self.gap_mm.shape, bool), 0.0
        for _ in range(GUESSES):
            loaded = refined(window_around(touching), self.per_side)
            compliance = self.layer.spring_mm_per_mpa(loaded)
            if compliance == before:
                break  # with the same springs, the contact would be the same
            before = compliance
            force = force_n * compliance / (self.per_side * self.layer.pitch_mm) ** 2
            depth = spring_depth(force, self.gap_mm.ravel(), np.ones(self.gap_mm.size))
            touching = self.gap_mm < depth
        return touching, depth


def _divided(axis_mm: np.ndarray, parts: int) -> np.ndarray:
    """Centers of the parts of cells, from those of the cells."""
    cell_mm = float(axis_mm[1] - axis_mm[0])
    within = (np.arange(parts) - (parts - 1) / 2) * cell_mm / parts
    return (axis_mm[:, None] + within).ravel()


class PinLayout:
    """The pins of both stages, under the expected contacts of bodies and MARGIN_CELLS around them.

    surveys: of the bodies, on the same layer. expected: (rows, columns) bool on the survey's cells
    and the expected depth, mm, of each. before: the layout of a contact of the same bodies near to
    this one, whose sizes of pins are kept where possible. at_least: (rows, columns) bool of each,
    cells that have pins in any case.
    Attributes: surveys; active, the survey's cells that have pins of each body; window, the window
    that contains them.
    """

    def __init__(
        self,
        surveys: Sequence[Survey],
        expected: Sequence[tuple[np.ndarray, float]],
        before: "PinLayout | None" = None,
        at_least: Sequence[np.ndarray] | None = None,
    ) -> None:
        self.surveys = surveys
        self.active = [dilated(touching, MARGIN_CELLS) for touching, _ in expected]
        if at_least is not None:
            self.active = [own | more for own, more in zip(self.active, at_least, strict=True)]
        self.window = window_around(np.logical_or.reduce(self.active))
        if before is not None:
            finer, sizes = before.finer, before.sizes
        else:
            finer = [
                _allowed_pins(survey, touching)
                for survey, (touching, _) in zip(surveys, expected, strict=True)
            ]
            sizes = list(map(len, finer))
        finest = max(each[-1] for each in finer)
        self._bodies = [
            _BodyPins(survey, touching, depth_mm, active, self.window, allowed, finest, size)
            for survey, (touching, depth_mm), active, allowed, size in zip(
                surveys, expected, self.active, finer, sizes, strict=True
            )
        ]

    @property
    def finer(self) -> list[tuple[int, ...]]:
        """Of each body, the allowed numbers of pins along a survey cell."""
        return [body.finer for body in self._bodies]

    @property
    def sizes(self) -> list[int]:
        """Of each body, how many of the allowed numbers it uses."""
        return [body.sizes for body in self._bodies]

    def stage(self, last: bool) -> Pins:
        """The pins of the rough or the last stage. Raises OffPadError for a body without pins."""
        per_side = max(body.per_side(last) for body in self._bodies)
        pins = [body.pins(last, per_side) for body in self._bodies]
        for survey, each in zip(self.surveys, pins, strict=True):
            if not each.gap_mm.size:
                name = survey.shape.name
                raise OffPadError(
                    f"no part of {name} lies over the surface, which shear has displaced; take a "
                    "smaller force or a smaller friction",
                    name,
                )
        return joined(pins)


class _BodyPins:
    """The pins of one body on the survey's active cells, within a window that contains them.

    expected: (rows, columns) bool, the survey's cells in contact. depth_mm: the expected depth.
    finer: allowed numbers of pins along a survey cell. finest: the largest of all bodies.
    sizes_before: of finer, how many an earlier layout used. Attributes: finer; sizes, how many this
    uses.
    """

    def __init__(
        self,
        survey: Survey,
        expected: np.ndarray,
        depth_mm: float,
        active: np.ndarray,
        window: Window,
        finer: tuple[int, ...],
        finest: int,
        sizes_before: int,
    ) -> None:
        self.survey, self.active, self.window = survey, active, window
        self.finer, self.sizes = finer, len(finer)
        self._even = finer[-1]
        if finer == FINER:
            self._even = _pins_per_cell(float(survey.footprint.shares[expected].sum()))
        self._finest = self._per_side(finest, STAGES[-1][0])
        fine = survey.fine_layer(self._finest)
        rows, columns = refined(window, survey.per_side * self._finest)
        self._footprint = footprint(
            survey.shape.surface,
            survey.command,
            fine.x_mm[columns],
            fine.y_mm[rows],
            active[window],
            survey.shift,
        )
        gap_mm, rest_mm = np.empty(self._footprint.peaks_mm.shape), fine.rest_mm[rows, columns]
        self._first_touch_mm = _gaps(rest_mm, self._footprint.peaks_mm, gap_mm)
        if survey.command.tilt_rad != (0.0, 0.0):
            self._first_touch_mm = _first_touch_mm(
                survey, fine.x_mm[columns], fine.y_mm[rows], gap_mm, self._first_touch_mm
            )
        self._along, self._largest, self._counts = self._pins_along(depth_mm, sizes_before)

    def per_side(self, last: bool) -> int:
        """Fine cells along one of the contact's in the rough or the last stage."""
        return self._per_side(self._largest[last], STAGES[last][0])

    def pins(self, last: bool, per_side: int) -> Pins:
        """The pins of the rough or the last stage on fine cells; see `per_side`."""
        per_cell = self.survey.per_side * per_side
        return place_pins(
            self.survey.fine_layer(per_side),
            refined(self.window, per_cell),
            per_cell,
            self._along[int(last)],
            self._counts[last],
            self._footprint.coarsened(self._finest // per_side),
            self._first_touch_mm,
        )

    def _per_side(self, pins: int, layer_mm: float) -> int:
        """Fine cells along one of the contact's: no fewer than pins along a survey cell."""
        survey = self.survey
        return max(1, round(pins / survey.per_side), round(survey.layer.pitch_mm / layer_mm))

    def _pins_along(
        self, depth_mm: float, sizes_before: int
    ) -> tuple[np.ndarray, tuple[int, int], tuple[int, int]]:
        """(2, rows, columns) number of pins along each of the window's survey cells, 0 for none, in
        the rough and the last stage; the largest of each stage; and the pins of each stage."""
        survey, window = self.survey, self.window
        cells = self._footprint.coarsened(survey.per_side * self._finest)
        rims = [
            rim
            for side, length in zip(window, survey.gap_mm.shape, strict=True)
            for rim in (side.start == 0, side.stop == length)
        ]
        along = np.empty((2, *cells.shares.shape), int)
        self.sizes, largest, count = _choose_pins(
            self.active[window], cells.shares, cells.peaks_mm, cells.heights_mm, UNEVEN * depth_mm,
            self._even, np.array(self.finer), self.sizes, sizes_before, POOL_SIZES[-1],
            np.array(rims), along[1],
        )  # fmt: skip
        return along, (min(largest, max(largest // 2, 1)), largest), (_halve(*along), count)


@compiled(nogil=True, **INNER)
def _at_edge(active, shares, rims, i, j):
    """Whether a cell of a window is at an edge of the shape.

    Those are the partly covered ones and the neighbors of cells that are covered by less than half;
    the pad's rims count as edges.
    """
    rows, columns = shares.shape
    top, bottom, left, right = rims[0], rims[1], rims[2], rims[3]
    if (
        shares[i, j] < 1.0 or (top and i == 0) or (bottom and i == rows - 1)
        or (left and j == 0) or (right and j == columns - 1)
    ):  # fmt: skip
        return True
    for k in range(max(i - 1, 0), min(i + 2, rows)):
        for m in range(max(j - 1, 0), min(j + 2, columns)):
            if active[k, m] and shares[k, m] < 0.5:
                return True
    return False


@compiled(
    "UniTuple(i8, 3)(b1[:, :], f8[:, ::1], f8[:, ::1], f8[:, ::1], f8, i8, i8[::1], i8, i8, i8,"
    " b1[::1], i8[:, ::1])",
    nogil=True,
)
def _choose_pins(
    active, shares, peaks, heights, uneven, even, finer, sizes, sizes_before, pool, rims, along
):
    """Write the number of pins along each of a window's survey cells, 0 for none.

    uneven: see UNEVEN, mm. even: pins along an even cell. finer: allowed numbers. sizes: how many
    of these may be used. pool: pins of the largest model. rims: whether the window's top, bottom,
    left and right are the pad's.
    Returns how many of the allowed numbers are used, the largest, and the number of all pins.
    """
    for i in range(along.shape[0]):
        for j in range(along.shape[1]):
            along[i, j] = 0
            if active[i, j] and shares[i, j] > 0.0:
                along[i, j] = even
                if peaks[i, j] - heights[i, j] > uneven:
                    along[i, j] = finer[-1]
                elif _at_edge(active, shares, rims, i, j):
                    along[i, j] = EDGE_FACTOR * even
    while True:
        pins, largest = 0, 0
        for i in range(along.shape[0]):
            for j in range(along.shape[1]):
                size = 0
                while size < sizes - 1 and finer[size] < along[i, j]:
                    size += 1
                along[i, j] = finer[size] if along[i, j] > 0 else 0
                pins, largest = pins + along[i, j] ** 2, max(largest, along[i, j])
        most = pool * (REFINED_SHARE if sizes > sizes_before else 1.0)
        if pins <= most or sizes == 1:
            return sizes, largest, pins
        sizes -= 1  # too many pins: a rim was expected, and a face behind it touches too


@compiled("i8(i8[:, ::1], i8[:, ::1])", nogil=True)
def _halve(rough, along):
    """Write half the numbers of pins along each cell, at least 1; returns the number of pins."""
    pins = 0
    for i in range(along.shape[0]):
        for j in range(along.shape[1]):
            rough[i, j] = max(along[i, j] // 2, 1) if along[i, j] > 0 else 0
            pins += rough[i, j] ** 2
    return pins


@compiled("f8(f8[:, :], f8[:, ::1], f8[:, ::1])", nogil=True)
def _gaps(rest, heights, gap):
    """Write the distances of a shape from a surface at first touch; returns the depth of that.

    rest, heights: of the surface and the shape. All arrays are (rows, columns), mm.
    """
    nearest = np.inf
    for i in range(gap.shape[0]):
        for j in range(gap.shape[1]):
            gap[i, j] = -rest[i, j] - heights[i, j]
            nearest = min(nearest, gap[i, j])
    for i in range(gap.shape[0]):
        for j in range(gap.shape[1]):
            gap[i, j] -= nearest
    return nearest


def _first_touch_mm(
    survey: Survey, x_mm: np.ndarray, y_mm: np.ndarray, gap_mm: np.ndarray, nearest_mm: float
) -> float:
    """Depth of a tilted shape's highest point below the apex at first touch, mm.

    gap_mm: (rows, columns) of the highest samples of fine cells, from their own first touch.
    nearest_mm: depth of that. A tilted shape touches first with a corner or an edge between the
    samples, which is searched around the nearest ones.
    """
    command = survey.command
    cell_mm = float(x_mm[1] - x_mm[0])
    steep = np.tan(abs(command.tilt_x_rad)) + np.tan(abs(command.tilt_y_rad))
    rows, columns = window_around(dilated(gap_mm <= cell_mm * steep, 1))
    step_mm, half_mm = cell_mm / BETWEEN, cell_mm / 2
    x, y = (
        np.arange(float(axis[side.start]) - half_mm, float(axis[side.stop - 1]) + half_mm, step_mm)
        for axis, side in ((x_mm, columns), (y_mm, rows))
    )
    heights = heights_at(survey.shape.surface, command, x, y, survey.shift)
    surface = survey.layer.elastomer.rest_surface_mm(*np.meshgrid(x, y))
    return min(nearest_mm, float((-surface - heights).min()))


def _allowed_pins(survey: Survey, expected: np.ndarray) -> tuple[int, ...]:
    """FINER, and twice its largest number where the separate parts of the expected contact,
    (rows, columns) bool, are small."""
    window = window_around(expected)
    shares = survey.footprint.shares[window] * expected[window]
    if shares.sum() * FINER[-1] ** 2 < PART_PINS * count_parts(shares > 0.0):
        return *FINER, 2 * FINER[-1]
    return FINER


def _pins_per_cell(cells_in_contact: float) -> int:
    """Pins along a survey cell with which the contact covers at least MIN_PINS."""
    enough = (finer for finer in FINER if cells_in_contact * finer**2 >= MIN_PINS)
    return next(enough, FINER[-1])
