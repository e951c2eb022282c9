"""The pins of a press: what of the shape stands over each, in a window of the elastomer's grid.

Pins stand on square blocks of the layer's fine cells: small ones at the shape's edges and where it
is uneven, larger ones between. A pin's force is shared evenly over the part of its block that the
shape covers, and it feels the mean deflection there: a Galerkin method whose pressures know where
the shape ends.
"""

from dataclasses import dataclass

import numpy as np

from t2twin.core.jit import compiled
from t2twin.primitives_cad.shape import NOTHING_MM
from t2twin.sim.contact.footprint import MIN_COVER, STEEPEST, Footprint
from t2twin.sim.contact.grid import Window, side_around
from t2twin.sim.contact.layer import Layer

SQUARE_MEAN = 0.946
"""Mean deflection of a uniformly loaded square of side s on a half-space, over (1 - nu^2) p s / E
(Johnson, Contact Mechanics, 1985, section 3.3)."""

EDGE_SHARE, EDGE_RISE = 0.95, 1.15
"""Fitted to the oracle's depth of all primitives at 1 to 8 N (0.4 % of it remain, without a bias on
either sensor), under the condition that it depends little on how an edge falls on the grid."""


@dataclass(frozen=True)
class Pins:
    """n pins over a window of a layer's grid, block by block, row by row.

    layer: on its fine grid. window: the fine cells that are looked at.
    rows, columns, sides: (n,) each pin's first fine cell in the window, and its cells a side.
    gap_mm: (n,) how far the surface is from the shape at first touch, its mean over the covered
        part, mm.
    covered: (n,) fine cells of the pin that the shape covers, parts of cells counted as such.
    edge_mm_per_mpa: (n,) what a pin at an edge gives way more than one within the shape.
    cover: (rows, columns) the covered part of each fine cell of the window, 0 to 1.
    heights_mm: (rows, columns) the shape's over them.
    first_touch_mm: how far the shape's highest point lies below the apex at first touch.
    """

    layer: Layer
    window: Window
    rows: np.ndarray
    columns: np.ndarray
    sides: np.ndarray
    gap_mm: np.ndarray
    covered: np.ndarray
    edge_mm_per_mpa: np.ndarray
    cover: np.ndarray
    heights_mm: np.ndarray
    first_touch_mm: float

    @property
    def weights(self) -> np.ndarray:
        """Of the layer's answers in the window, (n, rows, columns)."""
        return self.layer.weights[:, *self.window]

    @property
    def thickness_mm(self) -> np.ndarray:
        """The layer's in the window, (rows, columns), mm."""
        return self.layer.thickness_mm[self.window]

    @property
    def stiffens(self) -> bool:
        """Whether the elastomer's law is not linear."""
        return self.layer.elastomer.law != "linear"

    @property
    def cell_mm2(self) -> float:
        """Area of a fine cell, mm2."""
        return self.layer.pitch_mm**2

    @property
    def places(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """rows, columns, sides."""
        return self.rows, self.columns, self.sides

    def spread(self, pressure: np.ndarray) -> np.ndarray:
        """(rows, columns) mean over each fine cell of what (n,) is on the covered part of each
        pin's block."""
        fine = np.zeros(self.cover.shape, np.float32)
        spread(np.asarray(pressure, float), *self.places, self.cover, fine)
        return fine.astype(float)

    def gathered(self, fine: np.ndarray) -> np.ndarray:
        """(n,) what of a sum over (rows, columns) comes to each pin, per covered fine cell."""
        return self._sums(np.ascontiguousarray(fine, float)) / self.covered

    def mean_over_cover(self, fine: np.ndarray) -> np.ndarray:
        """(n,) mean of (rows, columns) over the covered part of each pin's block."""
        return self._sums(fine * self.cover) / self.covered

    def _sums(self, fine: np.ndarray) -> np.ndarray:
        sums = np.empty(self.rows.size)
        _sum_up(fine, *self.places, sums)
        return sums

    def beside(self, chosen: np.ndarray) -> np.ndarray:
        """(n,) bool: the pins that are chosen or lie within one's own side of one that is."""
        found = np.empty(chosen.size, bool)
        _beside(*self.places, chosen, np.zeros(self.cover.shape, bool), found)
        return found

    def window_of(self, chosen: np.ndarray) -> Window:
        """The fine cells of the window that hold some pins, of one of few sizes."""
        rows, columns, sides = (of[chosen] for of in self.places)
        down, across = self.cover.shape
        return (
            side_around(int(rows.min()), int((rows + sides).max()) - 1, down),
            side_around(int(columns.min()), int((columns + sides).max()) - 1, across),
        )

    def places_mm(self) -> tuple[np.ndarray, np.ndarray]:
        """x and y of the pins' middles, each (n,), mm."""
        layer, (down, along) = self.layer, self.window
        middle = (self.sides - 1) / 2 * layer.pitch_mm
        return (
            layer.x_mm[along][self.columns] + middle,
            layer.y_mm[down][self.rows] + middle,
        )


def pins_under(
    layer: Layer,
    window: Window,
    per_cell: int,
    along: np.ndarray,
    seen: Footprint,
    first_touch_mm: float,
) -> Pins:
    """The pins under a shape's footprint on the window's fine cells.

    per_cell: fine cells a side of the coarse ones that along (rows, columns) of the window counts;
    along: how many pins stand along each, a divisor of per_cell; 0 for none.
    """
    rows, columns, sides = _blocks(np.ascontiguousarray(along), per_cell)
    cover = np.zeros(seen.shares.shape)
    # In a block that a wall crosses, only its upper part is the pressing surface.
    _cover(seen.heights_mm, seen.shares, STEEPEST * layer.pitch_mm, rows, columns, sides, cover)
    gap, edge, covered = np.empty((3, rows.size))
    _gather(
        seen.heights_mm, cover, layer.rest_mm[window], _edge_compliance(layer, cover),
        first_touch_mm, rows, columns, sides, gap, edge, covered,
    )  # fmt: skip
    there = covered > 0
    return Pins(
        layer, window, rows[there], columns[there], sides[there],
        gap[there], covered[there], edge[there], cover, seen.heights_mm, first_touch_mm,
    )  # fmt: skip


@compiled("Tuple((i8[::1], i8[::1], i8[::1]))(i8[:, ::1], i8)", nogil=True)
def _blocks(along, per_cell):
    """First rows and columns of all blocks, and their sides, in fine cells."""
    count = 0
    for i in range(along.shape[0]):
        for j in range(along.shape[1]):
            count += along[i, j] ** 2
    rows, columns = np.empty(count, np.int64), np.empty(count, np.int64)
    sides = np.empty(count, np.int64)
    n = 0
    for i in range(along.shape[0]):
        for j in range(along.shape[1]):
            for a in range(along[i, j]):
                for b in range(along[i, j]):
                    side = per_cell // along[i, j]
                    rows[n], columns[n] = i * per_cell + a * side, j * per_cell + b * side
                    sides[n] = side
                    n += 1
    return rows, columns, sides


@compiled("void(f8[::1], i8[::1], i8[::1], i8[::1], f8[:, ::1], f4[:, ::1])", nogil=True)
def spread(pressure, rows, columns, sides, cover, fine):
    """Each pin's pressure on the covered part of its cells, into fine, zero elsewhere."""
    fine[:] = 0.0
    for n in range(pressure.size):
        for i in range(rows[n], rows[n] + sides[n]):
            for j in range(columns[n], columns[n] + sides[n]):
                fine[i, j] = pressure[n] * cover[i, j]


@compiled("void(f8[:, ::1], i8[::1], i8[::1], i8[::1], f8[::1])", nogil=True)
def _sum_up(fine, rows, columns, sides, sums):
    for n in range(sums.size):
        total = 0.0
        for i in range(rows[n], rows[n] + sides[n]):
            for j in range(columns[n], columns[n] + sides[n]):
                total += fine[i, j]
        sums[n] = total


@compiled("void(i8[::1], i8[::1], i8[::1], b1[::1], b1[:, ::1], b1[::1])", nogil=True)
def _beside(rows, columns, sides, chosen, near, found):
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


@compiled(
    "void(f8[:, ::1], f8[:, ::1], f8, i8[::1], i8[::1], i8[::1], f8[:, ::1])",
    nogil=True,
)
def _cover(heights, shares, wall, rows, columns, sides, cover):
    """The covered part of each fine cell, for pins that are covered enough; zero elsewhere.

    wall: height, mm, a fine cell's side from the highest place, beyond which it is not the pin's.
    """
    for n in range(rows.size):
        side, highest, covered = sides[n], NOTHING_MM, 0.0
        for i in range(rows[n], rows[n] + side):
            for j in range(columns[n], columns[n] + side):
                highest = max(highest, heights[i, j])
        lowest = max(highest - wall * side, NOTHING_MM / 2)
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


@compiled(
    "void(f8[:, ::1], f8[:, ::1], f8[:, :], f8[:, ::1], f8, i8[::1], i8[::1], i8[::1],"
    " f8[::1], f8[::1], f8[::1])",
    nogil=True,
)
def _gather(heights, cover, surface, edges, first_touch, rows, columns, sides, gap, edge, covered):
    """Each pin's mean gap over the covered part of its block, its edge's compliance, its cover."""
    for n in range(rows.size):
        total, distance, giving = 0.0, 0.0, 0.0
        for i in range(rows[n], rows[n] + sides[n]):
            for j in range(columns[n], columns[n] + sides[n]):
                part = cover[i, j]
                if part > 0.0:
                    total += part
                    distance += part * (-surface[i, j] - heights[i, j] - first_touch)
                    giving += part**2 * edges[i, j]
        gap[n] = distance / total if total > 0.0 else np.inf
        edge[n] = giving / max(total, MIN_COVER)
        covered[n] = total


def _edge_compliance(layer: Layer, cover: np.ndarray) -> np.ndarray:
    """What a fine cell at the shape's edge gives way more than one within it, mm/MPa.

    A cell covered by a share c carries its force on that share, and a punch's pressure rises
    towards its edge, which a pressure constant on cells cannot: both matter only in edge cells,
    and are put right by EDGE_SHARE / c - EDGE_RISE times the cell's own compliance.
    """
    elastomer = layer.elastomer
    half_space = SQUARE_MEAN * (1 - elastomer.poisson**2) / elastomer.young_mpa * layer.pitch_mm
    # A layer thinner than a cell gives way less than a half-space.
    own = min(half_space, layer.softest_mm_per_mpa)
    more = np.zeros(cover.shape)
    _at_edges(cover, own, more)
    return more


@compiled("void(f8[:, ::1], f8, f8[:, ::1])", nogil=True)
def _at_edges(cover, own, more):
    rows, columns = cover.shape
    for i in range(rows):
        for j in range(columns):
            share = cover[i, j]
            if share == 0.0:
                continue
            inner = share >= 1.0
            if inner and i > 0:
                inner = cover[i - 1, j] > 0.0
            if inner and i + 1 < rows:
                inner = cover[i + 1, j] > 0.0
            if inner and j > 0:
                inner = cover[i, j - 1] > 0.0
            if inner and j + 1 < columns:
                inner = cover[i, j + 1] > 0.0
            if not inner:
                more[i, j] = own * (EDGE_SHARE / max(share, MIN_COVER) - EDGE_RISE)
