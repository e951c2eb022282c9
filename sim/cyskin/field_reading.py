"""Any layout of pads read from the field.

What a pad counts is the pressure on the cover, smoothed by the cover and by the pad. Of a pressure
that is taken as white noise (assumed: contacts have edges), what pads at two places say goes
together as their two kernels overlap, and the best linear estimate of one pad from the field's is
that covariance times the inverse of the field's own (Wiener; simple kriging). So a pad of another
size is read as one of that size, and a pad at a place of the field, of the field's size, is that
place's count and nothing else.

Pressures add up and counts only nearly do; what the dielectric's thinning bends is left out.

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
"""A taxel this near to a place of the field lies on it, mm (assumed: positions are rounded)."""

NOISE_PART = 1e-2
"""Variance of what a place's count says wrongly, in parts of its own (assumed): a told field is not
as smooth as a true one, and without it the weights would make more of that."""

WAVENUMBERS = 2000
"""Points of the Hankel transform, up to where the cover lets a ten-thousandth through."""

RADII = 600
"""Distances at which the transform is worked out, and interpolated between."""


def reading_matrix(layout: Layout, cover: Elastomer = CYSKIN_COVER) -> np.ndarray:
    """(N, F): times the field's counts, those of a layout's taxels.

    Raises T2TwinError for taxels that do not lie on the cover.
    """
    off = (np.abs(layout.x_mm) > cover.width_mm / 2) | (np.abs(layout.y_mm) > cover.length_mm / 2)
    if off.any():
        n = int(np.flatnonzero(off)[0])
        raise T2TwinError(
            f"the layout {layout.name} has {int(off.sum())} taxel(s) off the cover, such as taxel "
            f"{n} at x {layout.x_mm[n]:g} mm, y {layout.y_mm[n]:g} mm; it reaches "
            f"{cover.width_mm / 2:g} mm in x and {cover.length_mm / 2:g} mm in y from its middle"
        )
    places = field_layout(cover)
    inverse = _inverse(cover)
    reading = np.empty((layout.size, places.size))
    apart = _apart(layout, places)
    for diameter in set(layout.pad_diameter_mm):
        same = layout.pad_diameter_mm == diameter
        reading[same] = _covariance(apart[same], diameter, cover) @ inverse
    at = apart.argmin(axis=1)
    own = (apart.min(axis=1) < SAME_MM) & (layout.pad_diameter_mm == PAD_DIAMETER_MM)
    reading[own] = np.eye(places.size)[at[own]]
    return reading


@lru_cache(maxsize=4)
def _inverse(cover: Elastomer) -> np.ndarray:
    """(F, F): of the covariance of the field's own places."""
    places = field_layout(cover)
    covariance = _covariance(_apart(places, places), PAD_DIAMETER_MM, cover)
    return np.linalg.inv(covariance + NOISE_PART * covariance[0, 0] * np.eye(places.size))


def _apart(one: Layout, other: Layout) -> np.ndarray:
    """(n, m): distances, mm."""
    return np.hypot(
        one.x_mm[:, None] - other.x_mm[None, :], one.y_mm[:, None] - other.y_mm[None, :]
    )


def _covariance(apart_mm: np.ndarray, diameter_mm: float, cover: Elastomer) -> np.ndarray:
    """What a pad of a diameter and one of the field's, so far apart, say in common of a white
    pressure, same shape: the Hankel transform of the product of their spectra."""
    most = 25.0 / cover.thickness_mm
    k = np.linspace(1e-4, most, WAVENUMBERS)
    through = base_stress(k, cover.thickness_mm, cover.poisson) ** 2
    spectrum = through * _disc(k, diameter_mm) * _disc(k, PAD_DIAMETER_MM) * k / (2 * np.pi)
    radii = np.linspace(0.0, float(apart_mm.max()) + 0.1, RADII)
    profile = np.trapezoid(spectrum * special.j0(radii[:, None] * k), k, axis=1)
    return np.interp(apart_mm, radii, profile)


def _disc(wavenumber: np.ndarray, diameter_mm: float) -> np.ndarray:
    """Transform of a round pad's mean."""
    reach = wavenumber * diameter_mm / 2
    return 2 * special.j1(reach) / reach
