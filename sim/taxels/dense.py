"""Dense counts: counts of a pad at each place of a fine triangular grid over the cover.

Counts of any layout of pads can be computed from it. The grid consists of the places o + i b + j a,
with the default layout's first taxel o, and contains all 20 taxels of that layout.

A pad's count is the pressure on the cover, smoothed by the cover and averaged over the pad. The
pressure is modeled as white noise (assumed: contacts have edges), so that the covariance of two
pads is the overlap of their kernels. The best linear estimate of a pad from the dense counts is
that covariance times the inverse of that of the dense counts (Wiener filter, simple kriging). It
takes the size of a pad into account. A pad of the same size at one of their places has that place's
count.

Pressures are additive, counts only approximately; the nonlinearity of the dielectric is neglected.

Shape letters: N taxels, F places of the dense counts.
"""

from functools import lru_cache

import numpy as np
from scipy import special
from scipy.spatial import KDTree

from t2twin.core.errors import T2TwinError
from t2twin.sim.contact.elastomer import CYSKIN_COVER, Elastomer
from t2twin.sim.contact.layer import base_stress
from t2twin.sim.contact.types import Contact
from t2twin.sim.taxels import pads
from t2twin.sim.taxels.layout import DEFAULT_LAYOUT, PAD_DIAMETER_MM, Layout, load_layout

SPACING_MM = 2.5
"""Distance of neighboring places, mm: a third of the taxels' pitch (assumed: a cover of some mm
blurs anything finer)."""

EDGE_MM = 0.25
"""Least distance of a place from the cover's edge, mm: half a cell of the contact's grid."""

STEPS_MM = np.array([[SPACING_MM * np.sqrt(0.75), SPACING_MM / 2], [0.0, SPACING_MM]])
"""The grid's two steps b and a, (2, 2), x and y each, mm."""

CELL_MM2 = SPACING_MM**2 * np.sqrt(0.75)
"""Area of the surface for each place, mm^2."""

SAME_MM = 1e-3
"""Distance within which a taxel lies on a place of the dense counts, mm (assumed: positions are
rounded).
"""

NOISE_SHARE = 1e-2
"""Variance of the error of a place's count over its own variance (assumed). Predicted dense counts
are less smooth than a true one; without this term the weights would amplify the difference."""

WAVENUMBERS = 2000
"""Points of the Hankel transform, up to where the cover transmits 1e-4."""

RADII = 600
"""Distances at which the transform is computed; it is interpolated between them."""


@lru_cache(maxsize=4)
def dense_layout(cover: Elastomer = CYSKIN_COVER) -> Layout:
    """The places of the dense counts on the cover as a layout of pads of PAD_DIAMETER_MM.

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


def dense_counts(contact: Contact) -> np.ndarray:
    """Noiseless counts of a contact at the places of dense_layout, (n,) uint16."""
    pressure_mpa = pads.pad_pressure_mpa(contact, dense_layout(contact.elastomer))
    return np.rint(pads.counts(pressure_mpa)).astype(np.uint16)


def dense_tractions(contact: Contact) -> np.ndarray:
    """Normal pressure and traction along x and y on the cover, (3, n) float32, kPa.

    Each value is the force on the part of the surface that is nearest to a place of dense_layout,
    over CELL_MM2. Their sums times CELL_MM2 are the forces on the sensor.
    """
    places = dense_layout(contact.elastomer)
    nearest = _nearest(contact.elastomer, tuple(contact.x_mm), tuple(contact.y_mm))
    share = contact.pitch_mm**2 / CELL_MM2
    stresses = (contact.pressure_kpa, *contact.shear_kpa)
    return np.stack(
        [share * np.bincount(nearest, each.ravel(), places.size) for each in stresses]
    ).astype(np.float32)


@lru_cache(maxsize=4)
def _nearest(cover: Elastomer, x_mm: tuple[float, ...], y_mm: tuple[float, ...]) -> np.ndarray:
    """(rows * columns,) the place nearest to each cell of a grid."""
    places = dense_layout(cover)
    cells = np.stack(np.meshgrid(x_mm, y_mm), axis=-1).reshape(-1, 2)
    return np.asarray(KDTree(np.column_stack([places.x_mm, places.y_mm])).query(cells)[1])


def reading_matrix(layout: Layout, cover: Elastomer = CYSKIN_COVER) -> np.ndarray:
    """The matrix (N, F) from the dense counts to the counts of a layout's taxels.

    Raises T2TwinError for taxels that do not lie on the cover.
    """
    half_x, half_y = cover.width_mm / 2, cover.length_mm / 2
    outside = (np.abs(layout.x_mm) > half_x) | (np.abs(layout.y_mm) > half_y)
    if outside.any():
        n = int(np.flatnonzero(outside)[0])
        raise T2TwinError(
            f"the layout {layout.name} has {int(outside.sum())} taxel(s) off the cover, such as "
            f"taxel {n} at x {layout.x_mm[n]:g} mm, y {layout.y_mm[n]:g} mm; it reaches {half_x:g} "
            f"mm in x and {half_y:g} mm in y from its center"
        )
    places = dense_layout(cover)
    inverse = _inverse(cover)
    matrix = np.empty((layout.size, places.size))
    distances = _distances(layout, places)
    for diameter in set(layout.pad_diameter_mm):
        same = layout.pad_diameter_mm == diameter
        matrix[same] = _covariance(distances[same], diameter, cover) @ inverse
    nearest = distances.argmin(axis=1)
    same = (distances.min(axis=1) < SAME_MM) & (layout.pad_diameter_mm == PAD_DIAMETER_MM)
    matrix[same] = np.eye(places.size)[nearest[same]]
    return matrix


@lru_cache(maxsize=4)
def _inverse(cover: Elastomer) -> np.ndarray:
    """Inverse of the covariance of the places of the dense counts, (F, F)."""
    places = dense_layout(cover)
    covariance = _covariance(_distances(places, places), PAD_DIAMETER_MM, cover)
    return np.linalg.inv(covariance + NOISE_SHARE * covariance[0, 0] * np.eye(places.size))


def _distances(one: Layout, other: Layout) -> np.ndarray:
    """Distances between the taxels of two layouts, (n, m), mm."""
    return np.hypot(
        one.x_mm[:, None] - other.x_mm[None, :], one.y_mm[:, None] - other.y_mm[None, :]
    )


def _covariance(distance_mm: np.ndarray, diameter_mm: float, cover: Elastomer) -> np.ndarray:
    """Covariance of a pad of a diameter and one of the dense counts at distances, same shape.

    The Hankel transform of the product of their spectra, for a white pressure.
    """
    k = np.linspace(1e-4, 25.0 / cover.thickness_mm, WAVENUMBERS)
    transmission = base_stress(k, cover.thickness_mm, cover.poisson) ** 2
    own, other = pads.disc_transform(k, diameter_mm), pads.disc_transform(k, PAD_DIAMETER_MM)
    spectrum = transmission * own * other * k / (2 * np.pi)
    radii = np.linspace(0.0, float(distance_mm.max()) + 0.1, RADII)
    profile = np.trapezoid(spectrum * special.j0(radii[:, None] * k), k, axis=1)
    return np.interp(distance_mm, radii, profile)
