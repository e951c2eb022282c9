"""Computes the counts of any layout of pads from the field.

A pad's count is the pressure on the cover, smoothed by the cover and averaged over the pad. The
pressure is modeled as white noise (assumed: contacts have edges), so that the covariance of two
pads is the overlap of their kernels. The best linear estimate of a pad from the field is that
covariance times the inverse of the field's (Wiener filter, simple kriging). It takes the size of a
pad into account. A pad of the field's size at one of its places has that place's count.

Pressures are additive, counts only approximately; the nonlinearity of the dielectric is neglected.

Shape letters: N taxels, F places of the field.
"""

from functools import lru_cache

import numpy as np
from scipy import special

from t2twin.core.errors import T2TwinError
from t2twin.sim.contact.elastomer import CYSKIN_COVER, Elastomer
from t2twin.sim.contact.layer import base_stress
from t2twin.sim.cyskin.field import field_layout
from t2twin.sim.cyskin.layout import PAD_DIAMETER_MM, Layout

SAME_MM = 1e-3
"""Distance within which a taxel lies on a place of the field, mm (assumed: positions are rounded).
"""

NOISE_SHARE = 1e-2
"""Variance of the error of a place's count over its own variance (assumed). A predicted field is
less smooth than a true one; without this term the weights would amplify the difference."""

WAVENUMBERS = 2000
"""Points of the Hankel transform, up to where the cover transmits 1e-4."""

RADII = 600
"""Distances at which the transform is computed; it is interpolated between them."""


def reading_matrix(layout: Layout, cover: Elastomer = CYSKIN_COVER) -> np.ndarray:
    """The matrix (N, F) from the field's counts to the counts of a layout's taxels.

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
    places = field_layout(cover)
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
    """Inverse of the covariance of the field's places, (F, F)."""
    places = field_layout(cover)
    covariance = _covariance(_distances(places, places), PAD_DIAMETER_MM, cover)
    return np.linalg.inv(covariance + NOISE_SHARE * covariance[0, 0] * np.eye(places.size))


def _distances(one: Layout, other: Layout) -> np.ndarray:
    """Distances between the taxels of two layouts, (n, m), mm."""
    return np.hypot(
        one.x_mm[:, None] - other.x_mm[None, :], one.y_mm[:, None] - other.y_mm[None, :]
    )


def _covariance(distance_mm: np.ndarray, diameter_mm: float, cover: Elastomer) -> np.ndarray:
    """Covariance of a pad of a diameter and one of the field at distances, same shape.

    The Hankel transform of the product of their spectra, for a white pressure.
    """
    k = np.linspace(1e-4, 25.0 / cover.thickness_mm, WAVENUMBERS)
    transmission = base_stress(k, cover.thickness_mm, cover.poisson) ** 2
    spectrum = transmission * _disc(k, diameter_mm) * _disc(k, PAD_DIAMETER_MM) * k / (2 * np.pi)
    radii = np.linspace(0.0, float(distance_mm.max()) + 0.1, RADII)
    profile = np.trapezoid(spectrum * special.j0(radii[:, None] * k), k, axis=1)
    return np.interp(distance_mm, radii, profile)


def _disc(wavenumber: np.ndarray, diameter_mm: float) -> np.ndarray:
    """Hankel transform of the mean over a round pad."""
    reach = wavenumber * diameter_mm / 2
    return 2 * special.j1(reach) / reach
