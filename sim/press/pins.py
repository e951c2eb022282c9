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
from t2twin.sim.press.grid import Window, blocks, repeated, sums
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
    highest = repeated(blocks(seen.heights_mm, per_side).max(axis=(1, 3)), per_side)
    wall = STEEPEST * per_side * layer.pitch_mm
    pressing = (seen.heights_mm >= highest - wall) & (seen.heights_mm > NOTHING_MM / 2)
    cover = np.where(pressing, seen.shares, 0.0)
    cover *= repeated(sums(cover, per_side), per_side) >= LEAST_COVER * per_side**2
    covered = sums(cover, per_side)

    distance = np.where(cover > 0, -layer.rest_mm[window] - seen.heights_mm - first_touch_mm, 0.0)
    some = np.maximum(covered, LEAST_COVER)
    gap = np.where(covered > 0, sums(cover * distance, per_side) / some, np.inf)
    edge = sums(_edge_compliance(layer, cover) * cover**2, per_side) / some
    return PinGrid(
        layer,
        window,
        per_side,
        gap,
        covered / per_side**2,
        cover,
        edge,
        seen.heights_mm,
        first_touch_mm,
    )


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
