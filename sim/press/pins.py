"""The pins of a press: what of the shape stands over each, in a window of the elastomer's grid.

Pins stand on square cells; the layer's answer may be worked out on a finer grid, of
per_side x per_side cells a pin. A pin's force is shared evenly over the part of its cell that the
shape covers, and it feels the mean deflection there: a Galerkin method whose pressures know where
the shape ends.
"""

from dataclasses import dataclass

import numpy as np

from t2twin.primitives_cad.jit import compiled
from t2twin.primitives_cad.shape import NOTHING_MM
from t2twin.sim.press.footprint import LEAST_COVER, STEEPEST, Footprint
from t2twin.sim.press.grid import Window, repeated, sums
from t2twin.sim.press.layer import Layer

SQUARE_MEAN = 0.946
"""Mean deflection of a uniformly loaded square of side s on a half-space, over (1 - nu^2) p s / E
(Johnson, Contact Mechanics, 1985, section 3.3)."""

EDGE_SHARE, EDGE_RISE = 0.95, 1.3
"""Fitted so that the depth of flat punches 1 to 8 mm wide does not depend on how their edges fall
on the grid; the truth was the same layer on finer grids, extrapolated."""


@dataclass(frozen=True)
class PinGrid:
    """Pins over a window of a layer's grid; pin arrays are (rows, columns).

    ground: the layer, on its fine grid. window: the fine cells that are looked at.
    parts: fine cells a pin, one way.
    gap_mm: how far the surface is from the shape at first touch, its mean over the covered part,
        mm; inf where nothing stands.
    share: covered part of the pin's cell, 0 to 1.
    cover: (rows parts, columns parts) the same of each fine cell.
    edge_mm_per_mpa: what a pin at an edge gives way more than one within the shape.
    heights_mm: (rows parts, columns parts) the shape's heights.
    first_touch_mm: how far the shape's highest point lies below the apex at first touch.
    """

    layer: Layer
    window: Window
    per_side: int
    gap_mm: np.ndarray
    share: np.ndarray
    cover: np.ndarray
    edge_mm_per_mpa: np.ndarray
    heights_mm: np.ndarray
    first_touch_mm: float

    @property
    def weights(self) -> np.ndarray:
        """Of the layer's answers in the window, (n, rows parts, columns parts)."""
        return self.layer.weights[:, *self.window]

    @property
    def thickness_mm(self) -> np.ndarray:
        """The layer's in the window, (rows parts, columns parts), mm."""
        return self.layer.thickness_mm[self.window]

    @property
    def stiffens(self) -> bool:
        """Whether the elastomer's law is not linear."""
        return self.layer.elastomer.law != "linear"

    @property
    def pitch_mm(self) -> float:
        return self.layer.pitch_mm * self.per_side

    def spread(self, pressure_mpa: np.ndarray) -> np.ndarray:
        """Mean pressure of each fine cell from that on the covered part of each pin's cell."""
        return repeated(pressure_mpa, self.per_side) * self.cover

    def mean_over_cover(self, fine: np.ndarray) -> np.ndarray:
        """Mean over the covered part of each pin's cell, (rows, columns); 0 where there is none."""
        whole = np.maximum(self.share * self.per_side**2, LEAST_COVER)
        return sums(fine * self.cover, self.per_side) / whole

    def places_mm(self) -> tuple[np.ndarray, np.ndarray]:
        """x and y of the pins, each (rows, columns), mm."""
        rows, columns = self.window
        x = self.layer.x_mm[columns].reshape(-1, self.per_side).mean(axis=1)
        y = self.layer.y_mm[rows].reshape(-1, self.per_side).mean(axis=1)
        along, down = np.meshgrid(x, y)
        return along, down


def pins_under(
    layer: Layer, window: Window, per_side: int, seen: Footprint, first_touch_mm: float
) -> PinGrid:
    """The pins under a shape's footprint on the window's fine cells."""
    # In a cell that a wall crosses, only its upper part is the pressing surface.
    wall = STEEPEST * per_side * layer.pitch_mm
    cover = np.zeros(seen.shares.shape)
    of_pins = tuple(side // per_side for side in seen.shares.shape)
    gap, edge, share = np.empty(of_pins), np.empty(of_pins), np.empty(of_pins)
    _cover(seen.heights_mm, seen.shares, wall, per_side, cover)
    _gather(
        seen.heights_mm, cover, layer.rest_mm[window], _edge_compliance(layer, cover),
        first_touch_mm, per_side, gap, edge, share,
    )  # fmt: skip
    return PinGrid(
        layer, window, per_side, gap, share, cover, edge, seen.heights_mm, first_touch_mm
    )


@compiled("void(f8[:, ::1], f8[:, ::1], f8, i8, f8[:, ::1])", nogil=True)
def _cover(heights, shares, wall, per_side, cover):
    """The covered part of each fine cell, for pins that are covered enough; zero elsewhere."""
    for row in range(0, heights.shape[0], per_side):
        for column in range(0, heights.shape[1], per_side):
            highest, covered = NOTHING_MM, 0.0
            for i in range(row, row + per_side):
                for j in range(column, column + per_side):
                    highest = max(highest, heights[i, j])
            lowest = max(highest - wall, NOTHING_MM / 2)
            for i in range(row, row + per_side):
                for j in range(column, column + per_side):
                    if heights[i, j] >= lowest:
                        covered += shares[i, j]
            if covered < LEAST_COVER * per_side**2:
                continue
            for i in range(row, row + per_side):
                for j in range(column, column + per_side):
                    if heights[i, j] >= lowest:
                        cover[i, j] = shares[i, j]


@compiled(
    "void(f8[:, ::1], f8[:, ::1], f8[:, :], f8[:, ::1], f8, i8, f8[:, ::1], f8[:, ::1],"
    " f8[:, ::1])",
    nogil=True,
)
def _gather(heights, cover, surface, edges, first_touch, per_side, gap, edge, share):
    """Each pin's mean gap over the covered part of its cell, its edge's compliance, its share."""
    for m in range(gap.shape[0]):
        for n in range(gap.shape[1]):
            covered, distance, giving = 0.0, 0.0, 0.0
            for i in range(m * per_side, (m + 1) * per_side):
                for j in range(n * per_side, (n + 1) * per_side):
                    part = cover[i, j]
                    if part > 0.0:
                        covered += part
                        distance += part * (-surface[i, j] - heights[i, j] - first_touch)
                        giving += part**2 * edges[i, j]
            gap[m, n] = distance / covered if covered > 0.0 else np.inf
            edge[m, n] = giving / max(covered, LEAST_COVER)
            share[m, n] = covered / per_side**2


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
                more[i, j] = own * (EDGE_SHARE / max(share, LEAST_COVER) - EDGE_RISE)
