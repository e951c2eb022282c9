"""The field: what a pad would count at each place of a fine triangular grid over the cover.

Any layout of such pads can be read from it. The grid contains the places of the default layout's
20 taxels: o + i b + j a, o being the first taxel.
"""

from functools import lru_cache

import numpy as np

from t2twin.core.jit import compiled
from t2twin.sim.contact.elastomer import CYSKIN_COVER, Elastomer
from t2twin.sim.contact.types import Contact
from t2twin.sim.cyskin import taxels
from t2twin.sim.cyskin.layout import DEFAULT_LAYOUT, PAD_DIAMETER_MM, Layout, load_layout

SPACING_MM = 2.5
"""Distance of neighboring places, mm: a third of the taxels' pitch (assumed: under a cover of some
mm nothing finer arrives)."""

STEPS_MM = np.array([[SPACING_MM * np.sqrt(0.75), SPACING_MM / 2], [0.0, SPACING_MM]])
"""The grid's two steps b and a, x and y each, mm."""


@lru_cache(maxsize=4)
def field_layout(cover: Elastomer = CYSKIN_COVER) -> Layout:
    """The field's places, all that lie on the cover, as a layout of pads of 4 mm.

    Column by column (i), rising in y (j).
    """
    first = load_layout(DEFAULT_LAYOUT)
    reach_x, reach_y = cover.width_mm / 2, cover.length_mm / 2
    most = int(np.ceil((cover.width_mm + 2 * cover.length_mm) / SPACING_MM))
    steps = np.arange(-most, most + 1)
    i, j = (each.ravel() for each in np.meshgrid(steps, steps, indexing="ij"))
    x, y = np.array([first.x_mm[0], first.y_mm[0]])[:, None] + STEPS_MM.T @ np.stack([i, j])
    # The layout's places are rounded to 0.1 um; here they are the same to the last bit.
    for taxel_x, taxel_y in zip(first.x_mm, first.y_mm, strict=True):
        nearest = int(np.hypot(x - taxel_x, y - taxel_y).argmin())
        x[nearest], y[nearest] = taxel_x, taxel_y
    on = (np.abs(x) <= reach_x - EDGE_MM) & (np.abs(y) <= reach_y - EDGE_MM)
    return Layout("field", x[on], y[on], np.full(int(on.sum()), PAD_DIAMETER_MM))


EDGE_MM = 0.25
"""How near to the cover's edge a place may lie, mm: half a cell of the contact's grid."""


def field_counts(contact: Contact) -> np.ndarray:
    """Noiseless counts at the places of field_layout, (n,) uint16, of a contact with the cover."""
    weights = _weights(contact.elastomer, contact.pitch_mm, contact.x_mm.size, contact.y_mm.size)
    pressure_mpa = np.zeros(weights.shape[1])
    _add_pressed(weights, 1e-3 * contact.pressure_kpa.ravel().astype(np.float64), pressure_mpa)
    return np.rint(taxels.counts(pressure_mpa)).astype(np.uint16)


@lru_cache(maxsize=4)
def _weights(cover: Elastomer, pitch_mm: float, columns: int, rows: int) -> np.ndarray:
    """What a unit pressure on each cell of a grid about the middle does to each pad's mean stress,
    (rows * columns, n): a cell's lie together, as few cells of many are pressed."""
    x_mm, y_mm = ((np.arange(n) - (n - 1) / 2) * pitch_mm for n in (columns, rows))
    return np.ascontiguousarray(taxels.pad_weights(cover, x_mm, y_mm, field_layout(cover)).T)


@compiled("void(f8[:, ::1], f8[::1], f8[::1])", nogil=True)
def _add_pressed(weights, on_top, on_pads):
    """Add to the pads' mean stress, (n,), what a pressure on the cells, (cells,), does to them."""
    for cell in range(on_top.size):
        if on_top[cell] > 0.0:
            for n in range(on_pads.size):
                on_pads[n] += weights[cell, n] * on_top[cell]
