"""The pins of a press: square blocks of the layer's fine cells, and the shape above each.

Each of several bodies has pins of its own, which overlap where the bodies do. A pin's pressure is
uniform over the part of its block that the shape covers, and its deflection is the mean over that
part: a Galerkin method whose pressures end at the shape's edge.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from math import ceil

import numpy as np

from t2twin.core.jit import compiled
from t2twin.primitives_cad.shape import NOTHING_MM
from t2twin.sim.contact.grid import Window, side_around
from t2twin.sim.contact.heights import MIN_COVER, MIN_WALL_MM, STEEPEST, Footprint
from t2twin.sim.contact.layer import Layer

# Mean deflection of a uniformly loaded square of side s on a half-space, over (1 - nu^2) p s / E
# (Johnson, Contact Mechanics, 1985, section 3.3).
SQUARE_MEAN = 0.946
# Coefficients of an edge cell's compliance (`_edge_compliance`), fitted to the reference solver's
# depth of all primitives at 1 to 8 N. An error of 0.25 % remains (root mean square), without a bias
# on either sensor. The fit also minimizes the dependence on how an edge falls on the grid.
EDGE_SHARE, EDGE_RISE = 1.02, 1.15


@dataclass(frozen=True)
class Pins:
    """n pins over a window of a layer's grid, body by body, block by block, row by row.

    layer: on its fine grid. window: the part of the fine grid that contains the pins.
    bodies: (n,) index of the body above each pin, rising.
    rows, columns, sides: (n,) first fine cell of each pin in the window, and its cells a side.
    gap_mm: (n,) mean distance of surface and shape over the covered part at first touch, mm.
    covered: (n,) number of fine cells that the shape covers, counting parts of cells.
    edge_mm_per_mpa: (n,) additional compliance of a pin at an edge.
    thickness_mm: (n,) mean thickness of the layer under the covered part.
    cover: (bodies, rows, columns) covered share of each fine cell of the window, 0 to 1.
    heights_mm: (bodies, rows, columns) heights of the shapes over them.
    first_touch_mm: (bodies,) depth of each highest point below the apex at first touch.
    """

    layer: Layer
    window: Window
    bodies: np.ndarray
    rows: np.ndarray
    columns: np.ndarray
    sides: np.ndarray
    gap_mm: np.ndarray
    covered: np.ndarray
    edge_mm_per_mpa: np.ndarray
    thickness_mm: np.ndarray
    cover: np.ndarray
    heights_mm: np.ndarray
    first_touch_mm: np.ndarray

    @property
    def stiffens(self) -> bool:
        """Whether the elastomer's law is not linear."""
        return self.layer.elastomer.law != "linear"

    @property
    def cell_mm2(self) -> float:
        """Area of a fine cell, mm2."""
        return self.layer.pitch_mm**2

    @property
    def blocks(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """rows, columns, sides."""
        return self.rows, self.columns, self.sides

    @cached_property
    def arrays(self) -> tuple[np.ndarray, ...]:
        """Arguments of the compiled loops, (n,) each; see `solver_loops.iterate`."""
        of_pins = self.gap_mm, self.covered, self.edge_mm_per_mpa, self.thickness_mm
        return self.bodies, *self.blocks, *of_pins

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
        spread(np.asarray(pressure, float), self.bodies, *self.blocks, self.cover, fine)
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
        found = np.empty(self.rows.size)
        _gather(pressure_mpa, per_cell, first, self.bodies, *self.blocks, self.covered, found)
        return found

    def mean_over_cover(self, fine: np.ndarray) -> np.ndarray:
        """(n,) mean of values on fine cells, (rows, columns), over the covered part of each pin."""
        first = np.zeros((len(self.cover), 2), int)
        return self.gather(fine * self.cover, 1, first)

    def with_neighbors(self, chosen: np.ndarray) -> np.ndarray:
        """(n,) bool: the chosen pins and those within one side length of a chosen one."""
        found = np.empty(chosen.size, bool)
        _with_neighbors(*self.blocks, chosen, np.zeros(self.cover.shape[1:], bool), found)
        return found

    def window_of(self, chosen: np.ndarray) -> Window:
        """The window of fine cells that contains the chosen pins, of one of few sizes."""
        down, across = self.cover.shape[1:]
        top, bottom, left, right = _extent(*self.blocks, chosen)
        return side_around(top, bottom, down), side_around(left, right, across)

    def around(self, body: int, chosen: np.ndarray) -> np.ndarray:
        """(n,) bool: a body's chosen pins, and those of others within the layer's thickness."""
        if len(self.cover) == 1:
            return chosen
        reach = ceil(self.layer.elastomer.thickness_mm / self.layer.pitch_mm)
        near = chosen.copy()
        for first, side in zip(
            (self.rows, self.columns), self.window_of(chosen & (self.bodies == body)), strict=True
        ):
            near &= (first + self.sides > side.start - reach) & (first < side.stop + reach)
        return near

    def most_overlapping(self, body: int, chosen: np.ndarray) -> int:
        """Largest number of bodies with a chosen pin over a cell of the body's own chosen pins."""
        if len(self.cover) == 1:
            return 1
        taken = self.spread_each(chosen.astype(float)) > 0
        return int((taken.sum(axis=0) * taken[body]).max())

    def centers_mm(self) -> tuple[np.ndarray, np.ndarray]:
        """x and y of the pins' centers, each (n,), mm."""
        layer, (down, along) = self.layer, self.window
        half = (self.sides - 1) / 2 * layer.pitch_mm
        return (layer.x_mm[along][self.columns] + half, layer.y_mm[down][self.rows] + half)


def place_pins(
    layer: Layer,
    window: Window,
    per_cell: int,
    along: np.ndarray,
    count: int,
    shape: Footprint,
    first_touch_mm: float,
) -> Pins:
    """The pins under a footprint; along: (rows, columns) number along each coarse cell."""
    (rows, columns, sides), of_pins = np.empty((3, count), int), np.empty((4, count))
    cover = np.zeros(shape.shares.shape)
    kept = _place(
        along, per_cell, shape.heights_mm, shape.shares, STEEPEST * layer.pitch_mm,
        _edge_compliance(layer), layer.rest_mm[window], layer.thickness_mm[window], first_touch_mm,
        rows, columns, sides, of_pins, cover,
    )  # fmt: skip
    gap_mm, covered, edge_mm_per_mpa, thickness_mm = of_pins[:, :kept]
    return Pins(
        layer, window, np.zeros(kept, int), rows[:kept], columns[:kept], sides[:kept], gap_mm,
        covered, edge_mm_per_mpa, thickness_mm, cover[None], shape.heights_mm[None],
        np.array([first_touch_mm]),
    )  # fmt: skip


def joined(pins: Sequence[Pins]) -> Pins:
    """The pins of several bodies, each the only one of its own pins, on the same window."""
    first = pins[0]
    if len(pins) == 1:
        return first
    bodies = np.repeat(np.arange(len(pins)), [each.rows.size for each in pins])
    of_pins = (
        "rows", "columns", "sides", "gap_mm", "covered", "edge_mm_per_mpa", "thickness_mm",
    )  # fmt: skip
    of_bodies = ("cover", "heights_mm", "first_touch_mm")
    together = (
        np.concatenate([getattr(each, name) for each in pins]) for name in of_pins + of_bodies
    )
    return Pins(first.layer, first.window, bodies, *together)


@compiled(inline="always")
def _blocks(along, per_cell, rows, columns, sides):
    """Write the first rows, first columns and sides of all blocks, in fine cells."""
    n = 0
    for i in range(along.shape[0]):
        for j in range(along.shape[1]):
            for a in range(along[i, j]):
                for b in range(along[i, j]):
                    side = per_cell // along[i, j]
                    rows[n], columns[n] = i * per_cell + a * side, j * per_cell + b * side
                    sides[n] = side
                    n += 1


@compiled(nogil=True)
def spread(pressure, bodies, rows, columns, sides, cover, fine):
    """Write the sum of the pins' pressures, times their cover, to fine, (rows, >= columns)."""
    for i in range(fine.shape[0]):
        for j in range(fine.shape[1]):
            fine[i, j] = 0.0
    for n in range(pressure.size):
        if pressure[n] == 0.0:
            continue
        for i in range(rows[n], rows[n] + sides[n]):
            for j in range(columns[n], columns[n] + sides[n]):
                fine[i, j] += pressure[n] * cover[bodies[n], i, j]


@compiled(nogil=True)
def _gather(coarse, per_cell, first, bodies, rows, columns, sides, covered, pressure):
    down, across = coarse.shape[1] * per_cell, coarse.shape[2] * per_cell
    for n in range(rows.size):
        body, total = bodies[n], 0.0
        top, left = rows[n] - first[body, 0], columns[n] - first[body, 1]
        for i in range(max(top, 0), min(top + sides[n], down)):
            for j in range(max(left, 0), min(left + sides[n], across)):
                total += coarse[body, i // per_cell, j // per_cell]
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
        found[n] = False
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


@compiled(inline="always")
def _additional(cover, i, j, compliance):
    """Additional compliance of a fine cell at the shape's edge; see `_edge_compliance`."""
    share, rows, columns = cover[i, j], cover.shape[0], cover.shape[1]
    inner = share >= 1.0
    if inner and i > 0:
        inner = cover[i - 1, j] > 0.0
    if inner and i + 1 < rows:
        inner = cover[i + 1, j] > 0.0
    if inner and j > 0:
        inner = cover[i, j - 1] > 0.0
    if inner and j + 1 < columns:
        inner = cover[i, j + 1] > 0.0
    return 0.0 if inner else compliance * (EDGE_SHARE / max(share, MIN_COVER) - EDGE_RISE)


@compiled(nogil=True)
def _place(
    along, per_cell, heights, shares, wall, compliance, surface, thickness, first_touch, rows,
    columns, sides, of_pins, cover,
):  # fmt: skip
    """Write the covered pins; of_pins: gaps, covered cells, edge compliances, thicknesses."""
    _blocks(along, per_cell, rows, columns, sides)
    # In a block that a wall crosses only the part above the wall is pressed.
    _cover(heights, shares, wall, rows, columns, sides, cover)
    kept = 0
    for n in range(rows.size):
        total, distance, giving, deep = 0.0, 0.0, 0.0, 0.0
        for i in range(rows[n], rows[n] + sides[n]):
            for j in range(columns[n], columns[n] + sides[n]):
                part = cover[i, j]
                if part > 0.0:
                    total += part
                    distance += part * (-surface[i, j] - heights[i, j] - first_touch)
                    giving += part * part * _additional(cover, i, j, compliance)
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
    top = left = np.iinfo(np.int64).max
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
