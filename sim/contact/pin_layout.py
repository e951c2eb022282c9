"""From a survey of the whole pad to the pins of each stage of a press.

Pins are square blocks of the layer's fine cells, each with the shape above it. A pin's pressure is
uniform over the part of its block that the shape covers, and its deflection is the mean over that
part: a Galerkin method whose pressures end at the shape's edge.
"""

import time
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from math import ceil
from typing import Any

import numpy as np

from t2twin.core.errors import T2TwinError
from t2twin.core.jit import compiled
from t2twin.primitives_cad.shape import NOTHING_MM, Shape
from t2twin.sim.contact.grid import (
    Window,
    block_means,
    center_values,
    dilated,
    refined,
    side_around,
    window_around,
    window_shape,
)
from t2twin.sim.contact.heights import (
    MIN_COVER,
    MIN_WALL_MM,
    STEEPEST,
    Footprint,
    footprint,
    heights_at,
)
from t2twin.sim.contact.layer import Layer, cached_layer
from t2twin.sim.contact.mujoco_contact import POOL_SIZES
from t2twin.sim.contact.solver_loops import spread, spring_depth
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
NO_PLACE = 2**62  # beyond all cells
GUESSES = 3  # rounds in which springs and their expected contact are adapted to each other
# Mean deflection of a uniformly loaded square of side s on a half-space, over (1 - nu^2) p s / E
# (Johnson, Contact Mechanics, 1985, section 3.3).
SQUARE_MEAN = 0.946
# Coefficients of an edge cell's compliance (`_edge_compliance`), fitted to the reference solver's
# depth of all primitives at 1 to 8 N. An error of 0.25 % remains (root mean square), without a bias
# on either sensor. The fit also minimizes the dependence on how an edge falls on the grid.
EDGE_SHARE, EDGE_RISE = 1.02, 1.15


class OffPadError(T2TwinError):
    """No part of the shape lies over the pad. shape: its name."""

    def __init__(self, message: str, shape: str = "") -> None:
        super().__init__(message)
        self.shape = shape


class Survey:
    """The whole pad and the shape above it, on cells of at most SURVEY_MM.

    Raises OffPadError for a shape that does not lie over the pad.
    """

    def __init__(
        self, shape: Shape, command: PressCommand, layer: Layer, shift: SurfaceShift | None = None
    ) -> None:
        shape = command.tilted(shape)
        self.shape, self.command, self.layer, self.shift = shape, command, layer, shift
        # Cells of the contact's grid along one of the survey.
        self.per_side = 2 if 2 * layer.pitch_mm <= SURVEY_MM + 1e-9 else 1
        x, y, rest = layer.coarse(self.per_side)
        self.footprint = footprint(shape.surface, command, x, y, shift=shift)
        # (rows, columns) distance of surface and shape at first touch.
        self.gap_mm, nearest = _gaps(rest, self.footprint.heights_mm)
        if nearest > -NOTHING_MM / 2:  # perhaps a blade between the points that a cell looks at
            within = np.arange(BLADE_CELLS) - (BLADE_CELLS - 1) / 2
            finer = (
                (axis[:, None] + within * (axis[1] - axis[0]) / BLADE_CELLS).ravel()
                for axis in (x, y)
            )
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
        # The same for the shape's highest point over each cell instead of its mean.
        self.peak_gap_mm, _ = _gaps(rest, self.footprint.peaks_mm)
        self.preparing_s = 0.0  # time spent on cached layers

    def surface_mm(self, pressure_mpa: np.ndarray) -> np.ndarray:
        """The surface's deflection under a pressure, both on the contact's grid, (ny, nx), mm."""
        return center_values(self.layer.deflection_mm(pressure_mpa), 1)

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
            depth = spring_depth(force, self.gap_mm.ravel(), np.ones(self.gap_mm.size), np.inf)
            touching = self.gap_mm < depth
        return touching, depth


@dataclass(frozen=True)
class Pins:
    """n pins over a window of a layer's grid, body by body, block by block, row by row."""

    layer: Layer  # on its fine grid
    window: Window  # the part of the fine grid that contains the pins
    bodies: np.ndarray  # (n,) index of the body above each pin, rising
    rows: np.ndarray  # (n,) first fine cells of each pin in the window
    columns: np.ndarray
    sides: np.ndarray  # (n,) fine cells along each pin
    # Mean distance of surface and shape over the covered part at first touch, mm.
    gap_mm: np.ndarray
    covered: np.ndarray  # (n,) number of fine cells that the shape covers, counting parts of cells
    edge_mm_per_mpa: np.ndarray  # (n,) additional compliance of a pin at an edge
    thickness_mm: np.ndarray  # (n,) mean thickness of the layer under the covered part
    cover: np.ndarray  # (bodies, rows, columns) covered share of each fine cell of the window
    heights_mm: Sequence[np.ndarray]  # (rows, columns) of each body's shape over them
    first_touch_mm: np.ndarray  # (bodies,) depth of the highest point below the apex at first touch

    @property
    def stiffens(self) -> bool:
        """Whether the elastomer's law is not linear."""
        return self.layer.elastomer.law != "linear"

    @property
    def cell_mm2(self) -> float:
        """Area of a fine cell, mm2."""
        return self.layer.pitch_mm**2

    @cached_property
    def arrays(self) -> tuple[np.ndarray, ...]:
        """Arguments of the compiled loops, (n,) each; see `solver_loops.iterate`."""
        of_pins = self.gap_mm, self.covered, self.edge_mm_per_mpa, self.thickness_mm
        return self.bodies, self.rows, self.columns, self.sides, *of_pins

    @cached_property
    def parts(self) -> list[slice]:
        """The part of each body among the pins."""
        if len(self.cover) == 1:
            return [slice(0, self.bodies.size)]
        ends = np.searchsorted(self.bodies, np.arange(len(self.cover) + 1)).tolist()
        return [slice(first, end) for first, end in pairwise(ends)]

    def spread(self, pressure: np.ndarray) -> np.ndarray:
        """Mean pressure on each fine cell, (rows, columns), of pressures on the pins, (n,)."""
        fine = np.zeros(self.cover.shape[1:], np.float32)
        spread(np.asarray(pressure, float), *self.arrays[:4], self.cover, fine)
        return fine.astype(float)

    def spread_each(self, pressure: np.ndarray) -> np.ndarray:
        """The same of each body, (bodies, rows, columns)."""
        if len(self.cover) == 1:
            return self.spread(pressure)[None]
        each = [np.zeros_like(pressure) for _ in self.cover]
        for own, part in zip(each, self.parts, strict=True):
            own[part] = pressure[part]
        return np.stack([self.spread(own) for own in each])

    def gather(self, pressure_mpa: np.ndarray, per_cell: int, first: np.ndarray) -> np.ndarray:
        """(n,) pressures with the forces of each body's mean pressures on larger cells."""
        pressure, of_pins = np.empty(self.rows.size), (*self.arrays[:4], self.covered)
        _gather(pressure_mpa, per_cell, first, *of_pins, pressure)
        return pressure

    def with_neighbors(self, chosen: np.ndarray) -> np.ndarray:
        """(n,) bool: the chosen pins and those within one side length of a chosen one."""
        found, near = np.zeros(chosen.size, bool), np.zeros(self.cover.shape[1:], bool)
        _with_neighbors(*self.arrays[1:4], chosen, near, found)
        return found

    def window_of(self, chosen: np.ndarray) -> Window:
        """The window of fine cells that contains the chosen pins, of one of few sizes."""
        down, across = self.cover.shape[1:]
        top, bottom, left, right = _extent(*self.arrays[1:4], chosen)
        return side_around(top, bottom, down), side_around(left, right, across)

    def springs(self, active: np.ndarray) -> np.ndarray:
        """(bodies,) the compliance D of the springs of the active pins, mm/MPa.

        Of a body with others within the layer's thickness, whose pins are taken to overlap as often
        as they do anywhere.
        """
        layer = self.layer
        if len(self.cover) == 1:
            return np.array([layer.spring_mm_per_mpa(self.window_of(active))])
        reach, found = ceil(layer.elastomer.thickness_mm / layer.pitch_mm), []
        taken = self.spread_each(active.astype(float)) > 0
        for body, own in enumerate(taken):
            near, window = active.copy(), self.window_of(active & (self.bodies == body))
            for first, side in zip((self.rows, self.columns), window, strict=True):
                near &= (first + self.sides > side.start - reach) & (first < side.stop + reach)
            overlapping = int((taken.sum(axis=0) * own).max())
            found.append(layer.spring_mm_per_mpa(self.window_of(near)) * overlapping)
        return np.array(found)


class PinLayout:
    """The pins of both stages, under the expected contacts of bodies and MARGIN_CELLS around them.

    surveys: of the bodies, on the same layer. expected: of each, (rows, columns) bool on the
    survey's cells and the expected depth, mm. before: the layout of a contact near to this one,
    whose sizes of pins are kept where possible. at_least: (rows, columns) bool of each, cells that
    have pins in any case.
    """

    def __init__(
        self, surveys: Sequence[Survey], expected: Sequence[tuple[np.ndarray, float]],
        before: "PinLayout | None" = None, at_least: Sequence[np.ndarray] | None = None,
    ) -> None:  # fmt: skip
        self.surveys = surveys
        # The survey's cells that have pins of each body, and the window that contains them.
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
        # Of each body, the allowed numbers of pins along a survey cell, and how many of them it
        # uses.
        self.finer, self.sizes = finer, sizes.copy()
        self._finest = self._per_side(max(each[-1] for each in finer), STAGES[-1][0])
        survey = surveys[0]
        fine = survey.fine_layer(self._finest)
        rows, columns = refined(self.window, survey.per_side * self._finest)
        axes, rest_mm = (fine.x_mm[columns], fine.y_mm[rows]), fine.rest_mm[rows, columns]
        self._bodies = []
        for body, (survey, (touching, depth_mm)) in enumerate(zip(surveys, expected, strict=True)):
            shape = footprint(
                survey.shape.surface, survey.command, *axes, self.active[body][self.window],
                survey.shift,
            )  # fmt: skip
            gap_mm, first_touch_mm = _gaps(rest_mm, shape.peaks_mm)
            if survey.command.tilt_rad != (0.0, 0.0):
                first_touch_mm = _first_touch_mm(survey, *axes, gap_mm, first_touch_mm)
            along = self._pins_along(body, touching, depth_mm, shape, sizes[body])
            self._bodies.append((along, shape, first_touch_mm))

    def stage(self, last: bool) -> Pins:
        """The pins of the rough or the last stage. Raises OffPadError for a body without pins."""
        layer_mm, survey = STAGES[last][0], self.surveys[0]
        along = [both[last] for both, _, _ in self._bodies]
        per_side = max(self._per_side(int(each.max()), layer_mm) for each in along)
        per_cell, coarser = survey.per_side * per_side, self._finest // per_side
        bodies = [
            (own, int(np.vdot(own, own)), shape.coarsened(coarser), first_touch_mm)
            for own, (_, shape, first_touch_mm) in zip(along, self._bodies, strict=True)
        ]
        layer, window = survey.fine_layer(per_side), refined(self.window, per_cell)
        pins = place_pins(layer, window, per_cell, bodies)
        for survey, part in zip(self.surveys, pins.parts, strict=True):
            if part.start == part.stop:
                name = survey.shape.name
                raise OffPadError(
                    f"no part of {name} lies over the surface, which shear has displaced; take a "
                    "smaller force or a smaller friction",
                    name,
                )
        return pins

    def _per_side(self, pins: int, layer_mm: float) -> int:
        """Fine cells along one of the contact's: no fewer than pins along a survey cell."""
        survey = self.surveys[0]
        return max(1, round(pins / survey.per_side), round(survey.layer.pitch_mm / layer_mm))

    def _pins_along(
        self, body: int, touching: np.ndarray, depth_mm: float, shape: Footprint, sizes_before: int
    ) -> tuple[np.ndarray, np.ndarray]:
        """(rows, columns) pins along each cell in both stages."""
        survey, finer = self.surveys[body], self.finer[body]
        active, even = self.active[body][self.window], finer[-1]
        if finer == FINER:  # the coarsest pins of which the contact covers at least MIN_PINS
            covered = float(survey.footprint.shares[touching].sum())
            even = next((each for each in FINER if covered * each**2 >= MIN_PINS), even)
        cells = shape.coarsened(survey.per_side * self._finest)
        # Edges are the partly covered cells, the neighbors of cells that are covered by less than
        # half, and the pad's rims.
        edge = (cells.shares < 1.0) | dilated(active & (cells.shares < 0.5), 1)
        rows, columns = self.window
        length, width = survey.gap_mm.shape
        edge[:1] |= rows.start == 0
        edge[-1:] |= rows.stop == length
        edge[:, :1] |= columns.start == 0
        edge[:, -1:] |= columns.stop == width
        wanted = np.where(edge, EDGE_FACTOR * even, even)
        wanted[cells.peaks_mm - cells.heights_mm > UNEVEN * depth_mm] = finer[-1]
        pinned = active & (cells.shares > 0.0)
        while True:  # too many pins: a rim was expected, and a face behind it touches too
            fine = np.where(pinned, np.minimum(wanted, finer[self.sizes[body] - 1]), 0)
            share = REFINED_SHARE if self.sizes[body] > sizes_before else 1.0
            if np.vdot(fine, fine) <= POOL_SIZES[-1] * share or self.sizes[body] == 1:
                return (fine + 1) // 2, fine
            self.sizes[body] -= 1


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


def place_pins(
    layer: Layer,
    window: Window,
    per_cell: int,
    bodies: Sequence[tuple[np.ndarray, int, Footprint, float]],
) -> Pins:
    """The pins under bodies: (rows, columns) number along each coarse cell, the sum of their
    squares, the footprint, and the depth at first touch, mm, of each."""
    cover, placed = np.zeros((len(bodies), *window_shape(window))), []
    edge, surface, thickness = _edge_compliance(layer), layer.rest_mm[window], layer.thickness_mm
    for (along, count, shape, first_touch_mm), own in zip(bodies, cover, strict=True):
        blocks, of_pins = np.empty((3, count), int), np.empty((4, count))
        kept = _place(
            along, per_cell, shape.heights_mm, shape.shares, STEEPEST * layer.pitch_mm, edge,
            surface, thickness[window], first_touch_mm, *blocks, of_pins, own,
        )  # fmt: skip
        placed.append((np.full(kept, len(placed)), *blocks[:, :kept], *of_pins[:, :kept]))
    of_all: Any = placed[0] if len(placed) == 1 else map(np.concatenate, zip(*placed, strict=True))
    heights = [shape.heights_mm for _, _, shape, _ in bodies]
    first_touch_mm = np.array([each[-1] for each in bodies])
    of_bodies: Any = cover, heights, first_touch_mm
    return Pins(layer, window, *of_all, *of_bodies)


@compiled(nogil=True)
def _gather(coarse, per_cell, first, bodies, rows, columns, sides, covered, pressure):
    down, across = coarse.shape[1] * per_cell, coarse.shape[2] * per_cell
    size = np.uint32(per_cell)  # divisions without a sign are fast
    for n in range(rows.size):
        body, total = bodies[n], 0.0
        top, left = rows[n] - first[body, 0], columns[n] - first[body, 1]
        for i in range(max(top, 0), min(top + sides[n], down)):
            row = coarse[body, np.uint32(i) // size]
            for j in range(max(left, 0), min(left + sides[n], across)):
                total += row[np.uint32(j) // size]
        pressure[n] = total / covered[n]


@compiled(nogil=True)
def _with_neighbors(rows, columns, sides, chosen, near, found):
    down, across = near.shape
    for n in range(chosen.size):
        if chosen[n]:
            side = sides[n]
            for i in range(max(rows[n] - side, 0), min(rows[n] + 2 * side, down)):
                for j in range(max(columns[n] - side, 0), min(columns[n] + 2 * side, across)):
                    near[i, j] = True
    for n in range(chosen.size):
        for i in range(rows[n], rows[n] + sides[n]):
            for j in range(columns[n], columns[n] + sides[n]):
                found[n] |= near[i, j]


@compiled(inline="always")
def _cover(heights, shares, wall, rows, columns, sides, cover):
    """Write the covered share of each fine cell of pins that are covered enough; zero elsewhere."""
    # A cell lower than a pin's highest one by `wall` mm per cell of its side is not part of it.
    for n in range(rows.size):
        side, highest, covered = sides[n], NOTHING_MM, 0.0
        for i in range(rows[n], rows[n] + side):
            for j in range(columns[n], columns[n] + side):
                highest = max(highest, heights[i, j])
        lowest = max(highest - max(wall * side, MIN_WALL_MM), NOTHING_MM / 2)
        for i in range(rows[n], rows[n] + side):
            for j in range(columns[n], columns[n] + side):
                if heights[i, j] >= lowest:
                    covered += shares[i, j]
        if covered < MIN_COVER * side**2:
            continue
        for i in range(rows[n], rows[n] + side):
            for j in range(columns[n], columns[n] + side):
                if heights[i, j] >= lowest:
                    cover[i, j] = shares[i, j]


@compiled(nogil=True)
def _place(
    along, per_cell, heights, shares, wall, compliance, surface, thickness, first_touch, rows,
    columns, sides, of_pins, cover,
):  # fmt: skip
    """Write the covered pins; of_pins: gaps, covered cells, edge compliances, thicknesses."""
    kept = n = 0
    for i in range(along.shape[0]):
        for j in range(along.shape[1]):
            side = per_cell // max(along[i, j], 1)
            for a in range(along[i, j]):
                for b in range(along[i, j]):
                    rows[n], columns[n] = i * per_cell + a * side, j * per_cell + b * side
                    sides[n] = side
                    n += 1
    # In a block that a wall crosses only the part above the wall is pressed.
    _cover(heights, shares, wall, rows, columns, sides, cover)
    for n in range(rows.size):
        total, distance, giving, deep = 0.0, 0.0, 0.0, 0.0
        for i in range(rows[n], rows[n] + sides[n]):
            for j in range(columns[n], columns[n] + sides[n]):
                part = cover[i, j]
                if part > 0.0:
                    total += part
                    distance += part * (-surface[i, j] - heights[i, j] - first_touch)
                    inner = part >= 1.0
                    for k, m in ((i - 1, j), (i + 1, j), (i, j - 1), (i, j + 1)):
                        if inner and 0 <= k < cover.shape[0] and 0 <= m < cover.shape[1]:
                            inner = cover[k, m] > 0.0
                    if not inner:  # at the shape's edge; see `_edge_compliance`
                        edge = compliance * (EDGE_SHARE / max(part, MIN_COVER) - EDGE_RISE)
                        giving += part * part * edge
                    deep += part * thickness[i, j]
        if total > 0.0:
            rows[kept], columns[kept], sides[kept] = rows[n], columns[n], sides[n]
            of_pins[0, kept], of_pins[1, kept] = distance / total, total
            of_pins[2, kept], of_pins[3, kept] = giving / max(total, MIN_COVER), deep / total
            kept += 1
    return kept


@compiled(nogil=True)
def _extent(rows, columns, sides, chosen):
    """First and last row, first and last column of the chosen pins' cells."""
    top = left = NO_PLACE
    bottom = right = -1
    for n in range(rows.size):
        if chosen[n]:
            top, bottom = min(top, rows[n]), max(bottom, rows[n] + sides[n] - 1)
            left, right = min(left, columns[n]), max(right, columns[n] + sides[n] - 1)
    return top, bottom, left, right


def _edge_compliance(layer: Layer) -> float:
    """Compliance of a fine cell, mm/MPa, in the correction of cells at the shape's edge.

    A cell covered by a share c carries its force on that share. A punch's pressure rises towards
    its edge, which a pressure constant on cells cannot represent. Both effects are limited to edge
    cells and corrected by EDGE_SHARE / c - EDGE_RISE times the cell's own compliance.
    """
    elastomer = layer.elastomer
    half_space = SQUARE_MEAN * (1 - elastomer.poisson**2) / elastomer.young_mpa * layer.pitch_mm
    # A layer thinner than a cell is stiffer than a half-space.
    return min(half_space, layer.max_compliance_mm_per_mpa)
