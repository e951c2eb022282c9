"""The field: counts of a pad at each place of a fine triangular grid over the cover.

Counts of any layout of pads can be computed from it. The grid consists of the places o + i b + j a,
with the default layout's first taxel o, and contains all 20 taxels of that layout.
"""

from functools import lru_cache

import numpy as np
from scipy.spatial import KDTree

from t2twin.sim.contact.elastomer import CYSKIN_COVER, Elastomer
from t2twin.sim.contact.types import Contact
from t2twin.sim.cyskin import taxels
from t2twin.sim.cyskin.layout import DEFAULT_LAYOUT, PAD_DIAMETER_MM, Layout, load_layout

SPACING_MM = 2.5
"""Distance of neighboring places, mm: a third of the taxels' pitch (assumed: a cover of some mm
blurs anything finer)."""

EDGE_MM = 0.25
"""Least distance of a place from the cover's edge, mm: half a cell of the contact's grid."""

STEPS_MM = np.array([[SPACING_MM * np.sqrt(0.75), SPACING_MM / 2], [0.0, SPACING_MM]])
"""The grid's two steps b and a, (2, 2), x and y each, mm."""


CELL_MM2 = SPACING_MM**2 * np.sqrt(0.75)
"""Area of the surface for each place, mm^2."""


@lru_cache(maxsize=4)
def field_layout(cover: Elastomer = CYSKIN_COVER) -> Layout:
    """The field's places on the cover as a layout of pads of PAD_DIAMETER_MM.

    Column by column (i), rising in y (j).
    """
    first = load_layout(DEFAULT_LAYOUT)
    reach_x, reach_y = cover.width_mm / 2, cover.length_mm / 2
    most = int(np.ceil((cover.width_mm + 2 * cover.length_mm) / SPACING_MM))
    steps = np.arange(-most, most + 1)
    i, j = (each.ravel() for each in np.meshgrid(steps, steps, indexing="ij"))
    x, y = np.array([first.x_mm[0], first.y_mm[0]])[:, None] + STEPS_MM.T @ np.stack([i, j])
    # The layout is rounded to 0.1 um; its places replace the computed ones.
    for taxel_x, taxel_y in zip(first.x_mm, first.y_mm, strict=True):
        nearest = int(np.hypot(x - taxel_x, y - taxel_y).argmin())
        x[nearest], y[nearest] = taxel_x, taxel_y
    on = (np.abs(x) <= reach_x - EDGE_MM) & (np.abs(y) <= reach_y - EDGE_MM)
    return Layout("field", x[on], y[on], np.full(int(on.sum()), PAD_DIAMETER_MM))


def field_counts(contact: Contact) -> np.ndarray:
    """Noiseless counts of a contact at the places of field_layout, (n,) uint16."""
    pressure_mpa = taxels.pad_pressure_mpa(contact, field_layout(contact.elastomer))
    return np.rint(taxels.counts(pressure_mpa)).astype(np.uint16)


def field_tractions(contact: Contact) -> np.ndarray:
    """Normal pressure and traction along x and y on the cover, (3, n) float32, kPa.

    Each value is the force on the part of the surface that is nearest to a place of field_layout,
    over CELL_MM2. Their sums times CELL_MM2 are the forces on the sensor.
    """
    places = field_layout(contact.elastomer)
    nearest = _nearest(contact.elastomer, tuple(contact.x_mm), tuple(contact.y_mm))
    share = contact.pitch_mm**2 / CELL_MM2
    stresses = (contact.pressure_kpa, *contact.shear_kpa)
    return np.stack(
        [share * np.bincount(nearest, each.ravel(), places.size) for each in stresses]
    ).astype(np.float32)


@lru_cache(maxsize=4)
def _nearest(cover: Elastomer, x_mm: tuple[float, ...], y_mm: tuple[float, ...]) -> np.ndarray:
    """(rows * columns,) the place nearest to each cell of a grid."""
    places = field_layout(cover)
    cells = np.stack(np.meshgrid(x_mm, y_mm), axis=-1).reshape(-1, 2)
    return np.asarray(KDTree(np.column_stack([places.x_mm, places.y_mm])).query(cells)[1])
