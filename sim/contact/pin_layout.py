"""Where a press needs pins, and how fine: from a survey of the whole pad to the pins of each stage.

The survey compares the shape with the pad on coarse cells and estimates the contact. Pins are then
laid out under the estimated contact, finer at the shape's edges and where its surface is uneven.
"""

import time
from collections.abc import Sequence
from typing import Any

import numpy as np

from t2twin.core.errors import T2TwinError
from t2twin.primitives_cad.shape import NOTHING_MM, Shape
from t2twin.sim.contact.grid import (
    Window,
    block_means,
    center_values,
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
FINER = (1, 2, 4)  # powers of 2
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
        self.gap_mm, nearest = _gaps(rest, self.footprint.heights_mm)
        if nearest > -NOTHING_MM / 2:  # perhaps a blade between the points that a cell looks at
            finer = (_divided(axis, BLADE_CELLS) for axis in (x, y))
            found = footprint(shape.surface, command, *finer, shift=shift)
            self.footprint = found.coarsened(BLADE_CELLS)
            self.gap_mm, nearest = _gaps(rest, self.footprint.heights_mm)
        if nearest > -NOTHING_MM / 2:
            half_x, half_y = layer.elastomer.width_mm / 2, layer.elastomer.length_mm / 2
            raise OffPadError(
                f"{shape.name} at x {command.x_mm:g} mm, y {command.y_mm:g} mm does not lie over "
                f"the {layer.elastomer.name} pad, which reaches {half_x:g} mm in x and {half_y:g} "
                "mm in y from its center",
                shape.name,
            )
        self.peak_gap_mm, _ = _gaps(rest, self.footprint.peaks_mm)
        self.preparing_s = 0.0

    def surface_mm(self, pressure_mpa: np.ndarray) -> np.ndarray:
        """The surface's deflection under a pressure, both on the contact's grid, (ny, nx), mm."""
        layer = self.layer
        return center_values(layer.by_law_mm(layer.deflection_mm(pressure_mpa)), 1)

    def missed(self, active: np.ndarray, depth_mm: float, pressure_mpa: np.ndarray) -> np.ndarray:
        """(rows, columns) bool: the cells without pins where the shape penetrates the surface."""
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
        """Contact area, bool, and depth, mm, of independent springs as compliant as the layer."""
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
        taken = self.active[0] if len(surveys) == 1 else np.logical_or.reduce(self.active)
        self.window = window_around(taken)
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
        gap_mm, self._first_touch_mm = _gaps(fine.rest_mm[rows, columns], self._footprint.peaks_mm)
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
        """Per stage: (2, rows, columns) pins along each cell, the largest, and the number."""
        survey, active = self.survey, self.active[self.window]
        cells = self._footprint.coarsened(survey.per_side * self._finest)
        # Edges are the partly covered cells, the neighbors of cells that are covered by less than
        # half, and the pad's rims.
        edge = (cells.shares < 1.0) | dilated(active & (cells.shares < 0.5), 1)
        rows, columns = self.window
        length, width = survey.gap_mm.shape
        edge[:1] |= rows.start == 0
        edge[-1:] |= rows.stop == length
        edge[:, :1] |= columns.start == 0
        edge[:, -1:] |= columns.stop == width
        wanted = np.where(edge, EDGE_FACTOR * self._even, self._even)
        wanted[cells.peaks_mm - cells.heights_mm > UNEVEN * depth_mm] = self.finer[-1]
        pinned = active & (cells.shares > 0.0)
        while True:  # too many pins: a rim was expected, and a face behind it touches too
            fine = np.where(pinned, np.minimum(wanted, self.finer[self.sizes - 1]), 0)
            count = int(np.vdot(fine, fine))
            share = REFINED_SHARE if self.sizes > sizes_before else 1.0
            if count <= POOL_SIZES[-1] * share or self.sizes == 1:
                break
            self.sizes -= 1
        rough, largest = (fine + 1) // 2, int(fine.max())
        counts = int(np.vdot(rough, rough)), count
        return np.stack([rough, fine]), (min(largest, max(largest // 2, 1)), largest), counts


def _gaps(rest: np.ndarray, heights: np.ndarray) -> tuple[np.ndarray, float]:
    """Distances of a shape from a surface at first touch, mm, and the depth of that."""
    gap = -rest - heights
    nearest = float(gap.min())
    return gap - nearest, nearest


def _first_touch_mm(
    survey: Survey, x_mm: np.ndarray, y_mm: np.ndarray, gap_mm: np.ndarray, nearest_mm: float
) -> float:
    """Depth at which a tilted shape touches, with points between the cells' samples, mm."""
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
    """FINER, with pins of half the size where separate parts of the expected contact are small."""
    window = window_around(expected)
    shares = survey.footprint.shares[window] * expected[window]
    touched, pins = shares > 0.0, shares.sum() * FINER[-1] ** 2
    corners = touched.copy()  # each part has a cell without neighbors above and on the left
    corners[1:] &= ~touched[:-1]
    corners[:, 1:] &= ~touched[:, :-1]
    if pins >= PART_PINS * np.count_nonzero(corners):
        return FINER
    from scipy import ndimage  # slow to import

    labels: Any = ndimage.label(touched)
    return (*FINER, 2 * FINER[-1]) if pins < PART_PINS * labels[1] else FINER


def _pins_per_cell(cells_in_contact: float) -> int:
    """Pins along a survey cell with which the contact covers at least MIN_PINS."""
    enough = (finer for finer in FINER if cells_in_contact * finer**2 >= MIN_PINS)
    return next(enough, FINER[-1])
