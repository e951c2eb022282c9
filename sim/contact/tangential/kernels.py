"""Displacement of an elastic layer's surface by traction on one cell of a grid, and its spectra.

A kernel is the mean displacement of each cell per unit traction on the central one, mm/MPa. The
half-space's part has closed forms (Boussinesq and Cerruti; Johnson, Contact Mechanics, 1985,
section 3.6). What the rigid base changes is smooth, a Hankel transform of the difference of the
spectra.

The spectra are the response of a bonded layer to shear and pressure on its surface, by wavevector.
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

from functools import lru_cache
from typing import NamedTuple

import numpy as np

from t2twin.core.cached_files import cached_array
from t2twin.sim.contact.elastomer import Elastomer
from t2twin.sim.contact.layer import HANKEL_RADII, cell_mean, hankel_rule, mean_inverse_distance
from t2twin.sim.splines import CubicSpline

MIN_REDUCED, MAX_REDUCED = 1e-6, 300.0
"""Limits on s, between which the hyperbolic functions are accurate and finite. At the upper one the
layer is a half-space."""

SMALL_ARGUMENT = 1e-3
"""Argument below which J2 is its first term, whose relative error is below 1e-7."""


class Kernels(NamedTuple):
    """Kernels of a layer on a grid, each (2 rows - 1, 2 columns - 1), mm/MPa.

    xx, xy, yy: displacement along one axis by shear along the other. xz, yz: deflection into the
    sensor by shear along x and y; the same with the other sign is the displacement by pressure.
    """

    xx: np.ndarray
    xy: np.ndarray
    yy: np.ndarray
    xz: np.ndarray
    yz: np.ndarray


def shear_kernels(
    elastomer: Elastomer, thickness_mm: float, rows: int, columns: int, pitch_mm: float
) -> Kernels:
    """The kernels of a layer of this thickness, laterally unbounded, on a grid of square cells."""
    smooth = smooth_kernels(elastomer, thickness_mm, rows, columns, pitch_mm)
    half_space = _half_space(rows, columns, pitch_mm, elastomer)
    return Kernels(*(a + b for a, b in zip(smooth, half_space, strict=True)))


def smooth_kernels(
    elastomer: Elastomer, thickness_mm: float, rows: int, columns: int, pitch_mm: float
) -> Kernels:
    """What the rigid base changes in the kernels of a half-space; see `shear_kernels`."""
    x = np.arange(1 - columns, columns) * pitch_mm
    y = np.arange(1 - rows, rows) * pitch_mm
    # The distances are those of a quarter of the grid.
    quarter = np.hypot(x[columns - 1 :], y[rows - 1 :, None])
    every = np.ix_(np.abs(np.arange(1 - rows, rows)), np.abs(np.arange(1 - columns, columns)))
    radii = np.linspace(0.0, float(quarter.max()), HANKEL_RADII)
    mean, difference, coupling = (
        pitch_mm**2 * CubicSpline(0.0, radii[-1], profile)(quarter)[every]
        for profile in _base_part(elastomer, thickness_mm, radii, pitch_mm)
    )
    distance = np.maximum(quarter[every], 1e-12)
    cos, sin = x / distance, y[:, None] / distance
    return Kernels(
        xx=mean - (cos**2 - sin**2) * difference,
        xy=-2 * cos * sin * difference,
        yy=mean + (cos**2 - sin**2) * difference,
        xz=-cos * coupling,
        yz=-sin * coupling,
    )


@lru_cache(maxsize=4)
def _half_space(rows: int, columns: int, pitch_mm: float, elastomer: Elastomer) -> Kernels:
    """The kernels of a half-space; see `shear_kernels`."""
    x_mm = np.arange(1 - columns, columns) * pitch_mm
    y_mm = np.arange(1 - rows, rows) * pitch_mm
    nu = elastomer.poisson
    unit = (1 + nu) / np.pi / elastomer.young_mpa
    inverse = mean_inverse_distance(x_mm, y_mm, pitch_mm)
    along_x = cell_mean(_x2_over_r3, x_mm, y_mm, pitch_mm)
    along_y = inverse - along_x
    across = cell_mean(_xy_over_r3, x_mm, y_mm, pitch_mm)
    odd_x = cell_mean(_x_over_r2, x_mm, y_mm, pitch_mm)
    odd_y = cell_mean(_x_over_r2, y_mm, x_mm, pitch_mm).T
    return Kernels(
        xx=unit * ((1 - nu) * inverse + nu * along_x),
        xy=unit * nu * across,
        yy=unit * ((1 - nu) * inverse + nu * along_y),
        xz=unit * (1 - 2 * nu) / 2 * odd_x,
        yz=unit * (1 - 2 * nu) / 2 * odd_y,
    )


def _x2_over_r3(x: np.ndarray, y: np.ndarray, r: np.ndarray) -> np.ndarray:
    return r**3 / 6 + y**2 / 2 * (x * np.arcsinh(x / np.maximum(np.abs(y), 1e-12)) - r)


def _xy_over_r3(x: np.ndarray, y: np.ndarray, r: np.ndarray) -> np.ndarray:
    ax, ay = np.maximum(np.abs(x), 1e-12), np.maximum(np.abs(y), 1e-12)
    return -(x * y * r / 3 + x**3 / 6 * np.arcsinh(y / ax) + y**3 / 6 * np.arcsinh(x / ay))


def _x_over_r2(x: np.ndarray, y: np.ndarray, r: np.ndarray) -> np.ndarray:
    quarter = np.pi / 2
    x_over_y = np.arctan(x / np.where(y == 0, 1e-12, y)) * (y != 0)
    y_over_x = np.where(x == 0, quarter * np.sign(y), np.arctan(y / np.where(x == 0, 1.0, x)))
    return (x * y**2 / 2 - x**3 / 6) * np.log(r) + y**3 / 6 * x_over_y + x**2 * y / 2 * y_over_x


def _base_part(
    elastomer: Elastomer, thickness_mm: float, radii_mm: np.ndarray, pitch_mm: float
) -> np.ndarray:
    """(3, radii): effect of the base on mean, difference and coupling, mm/MPa per mm^2. Cached."""
    nu = elastomer.poisson
    key = repr((thickness_mm, float(radii_mm[-1]), radii_mm.size, nu, pitch_mm))
    of_unit_modulus = cached_array(
        "shear", key, __file__, lambda: _hankel(thickness_mm, radii_mm, nu, pitch_mm)
    )
    return of_unit_modulus / elastomer.young_mpa


def _hankel(
    thickness_mm: float, radii_mm: np.ndarray, poisson: float, pitch_mm: float
) -> np.ndarray:
    from scipy import special

    k, rule = hankel_rule(np.array([thickness_mm]), float(radii_mm[-1]), pitch_mm)
    rule = k * rule
    of_layer, unit = spectra(k, thickness_mm, 1.0, poisson), 2 * (1 + poisson) / k
    mean = (of_layer.longitudinal + of_layer.transverse) / 2 - unit * (2 - poisson) / 2
    difference = (of_layer.longitudinal - of_layer.transverse) / 2 + unit * poisson / 2
    coupling = of_layer.coupling + unit * (1 - 2 * poisson) / 2
    argument = k[:, None] * radii_mm
    zeroth, first = special.j0(argument), special.j1(argument)
    # The recurrence of Bessel functions; J2 is near x^2 / 8 where its terms cancel.
    second = 2 * first / np.maximum(argument, SMALL_ARGUMENT) - zeroth
    second = np.where(argument < SMALL_ARGUMENT, argument**2 / 8, second)
    # einsum, because the last bits of a BLAS product depend on the number of threads.
    return np.stack(
        [
            np.einsum("k,kr->r", part * rule, bessel)
            for part, bessel in ((mean, zeroth), (difference, second), (coupling, first))
        ]
    )


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
