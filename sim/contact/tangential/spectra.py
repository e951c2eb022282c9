"""Response of a bonded elastic layer to shear and pressure on its surface, by wavevector.

Linear elasticity in plane-wave form, for a layer of thickness h, shear modulus G and Poisson's
ratio nu. With s = k h, kappa = 3 - 4 nu and

    D = 2 kappa cosh 2s + 1 + kappa^2 + 4 s^2

a traction q and a pressure p on the surface displace it in the plane by u and downward by d:

    u = (L e e^T + T (1 - e e^T)) q - i C e p        e = (kx, ky) / k
    d = i C (e . q) + N p

    T = tanh s / (G k)                              transverse
    L = (1 - nu) (2 kappa sinh 2s + 4 s) / (G k D)    longitudinal
    N = (1 - nu) (2 kappa sinh 2s - 4 s) / (G k D)    normal
    C = (2 s^2 - kappa (1 - 2 nu) (cosh 2s - 1)) / (G k D)

The pressure at the base is R p - i B (e . q) with

    R = 8 (1 - nu) (2 (1 - nu) cosh s + s sinh s) / D
    B = 8 (1 - nu) ((1 - 2 nu) sinh s + s cosh s) / D

N and R are Johnson's (Contact Mechanics, 1985, section 5.8); the others follow from the same
plane-strain solution, and T from antiplane shear. For large s they are the half-space's, for
k = 0 the layer's simple shear h / G and confined compression.
"""

from typing import NamedTuple

import numpy as np

MIN_REDUCED, MAX_REDUCED = 1e-6, 300.0
"""Limits on s, between which the hyperbolic functions are accurate and finite. At the upper one the
layer is a half-space."""


class Spectra(NamedTuple):
    """The coefficients at wavenumbers k, each of the shape of k.

    transverse, longitudinal, normal, coupling: T, L, N, C, mm/MPa. base_pressure, base_shear: R,
    B, pressure at the base per pressure and per longitudinal traction on the surface.
    """

    transverse: np.ndarray
    longitudinal: np.ndarray
    normal: np.ndarray
    coupling: np.ndarray
    base_pressure: np.ndarray
    base_shear: np.ndarray


def spectra(
    wavenumber: np.ndarray, thickness_mm: float, young_mpa: float, poisson: float
) -> Spectra:
    """All coefficients at wavenumber k, rad/mm, of any shape; see the module."""
    shear_mpa = young_mpa / 2 / (1 + poisson)
    k = np.asarray(wavenumber, float)
    s = np.clip(k * thickness_mm, MIN_REDUCED, MAX_REDUCED)
    kappa = 3 - 4 * poisson
    # All terms are divided by exp(2 s).
    decay = np.exp(-2 * s)
    cosh_2s, sinh_2s = (1 + decay**2) / 2, (1 - decay**2) / 2
    cosh, sinh = (1 + decay) / 2, (1 - decay) / 2
    denominator = 2 * kappa * cosh_2s + (1 + kappa**2 + 4 * s**2) * decay
    unit = thickness_mm / shear_mpa / s
    normal_part, odd_part = 2 * kappa * sinh_2s, 4 * s * decay
    base = 8 * (1 - poisson) * np.exp(-s) / denominator
    return Spectra(
        transverse=unit * np.tanh(s),
        longitudinal=unit * (1 - poisson) * (normal_part + odd_part) / denominator,
        normal=unit * (1 - poisson) * (normal_part - odd_part) / denominator,
        coupling=unit
        * (2 * s**2 * decay - kappa * (1 - 2 * poisson) * (cosh_2s - decay))
        / denominator,
        base_pressure=base * (2 * (1 - poisson) * cosh + s * sinh),
        base_shear=base * ((1 - 2 * poisson) * sinh + s * cosh),
    )
