"""Closed forms of an elastic layer that is bonded to a rigid base, and kernels on a grid of cells.

The spectra are the response of the layer to shear and pressure on its surface, by wavevector.
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
plane-strain solution, and T from antiplane shear. For large s they are the half-space's,
N = 2 (1 - nu^2) / (E k). For k = 0 they are the layer's simple shear h / G and its confined
compression h (1 - 2 nu) (1 + nu) / ((1 - nu) E).

A kernel is the mean displacement of each cell per unit load on the central one, mm/MPa. The
half-space's part has closed forms (Boussinesq and Cerruti; Johnson, section 3.6). What the rigid
base changes is smooth, a Hankel transform of the difference of the spectra. With loads constant on
cells this is a Galerkin method; its error at a punch's edges is half that of deflections at cell
centers.
"""

from collections.abc import Callable
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from t2twin.core.cache_dir import cached_array
from t2twin.core.cubic_spline import cubic_spline
from t2twin.sim.contact.elastomer import Elastomer

# Limits on s, between which the hyperbolic functions are accurate and finite. At the upper one the
# layer is a half-space.
MIN_REDUCED, MAX_REDUCED = 1e-6, 300.0
SMOOTH_REACH = 30.0  # wavenumber times thickness above which the base has an effect below exp(-60)
HANKEL_POINTS_A_WAVE = 25  # points per wave of the transform's integrand at the largest distance
MIN_HANKEL_POINTS = 1000  # of the transform up to SMOOTH_REACH of the thickest layer
HANKEL_RADII = 500  # distances of the transform; splines interpolate between them
SMALL_ARGUMENT = 1e-3  # below it J2 is its first term, whose relative error is below 1e-7


class Spectra(NamedTuple):
    """The coefficients at wavenumbers k, each of the shape of k."""

    transverse: np.ndarray  # T, mm/MPa, as the next three
    longitudinal: np.ndarray  # L
    normal: np.ndarray  # N
    coupling: np.ndarray  # C
    base_pressure: np.ndarray  # R, pressure at the base per pressure on the surface
    base_shear: np.ndarray  # B, the same per longitudinal traction


def spectra(
    wavenumber: np.ndarray, thickness_mm: float, young_mpa: float, poisson: float
) -> Spectra:
    """All coefficients at wavenumber k, rad/mm, of any shape; see the module."""
    shear_mpa = young_mpa / 2 / (1 + poisson)
    s = np.clip(np.asarray(wavenumber, float) * thickness_mm, MIN_REDUCED, MAX_REDUCED)
    kappa = 3 - 4 * poisson
    # All terms are divided by exp(2 s).
    decay = np.exp(-2 * s)
    cosh_2s, sinh_2s = (1 + decay**2) / 2, (1 - decay**2) / 2
    cosh, sinh = (1 + decay) / 2, (1 - decay) / 2
    denominator = 2 * kappa * cosh_2s + (1 + kappa**2 + 4 * s**2) * decay
    unit = thickness_mm / shear_mpa / s
    normal_part, odd_part = 2 * kappa * sinh_2s, 4 * s * decay
    base = 8 * (1 - poisson) * np.exp(-s) / denominator
    bent = 2 * s**2 * decay - kappa * (1 - 2 * poisson) * (cosh_2s - decay)
    return Spectra(
        transverse=unit * np.tanh(s),
        longitudinal=unit * (1 - poisson) * (normal_part + odd_part) / denominator,
        normal=unit * (1 - poisson) * (normal_part - odd_part) / denominator,
        coupling=unit * bent / denominator,
        base_pressure=base * (2 * (1 - poisson) * cosh + s * sinh),
        base_shear=base * ((1 - 2 * poisson) * sinh + s * cosh),
    )


def half_space_deflection(
    elastomer: Elastomer, x_mm: np.ndarray, y_mm: np.ndarray, pitch_mm: float
) -> np.ndarray:
    """(y, x): deflection of a half-space by unit pressure on the cell at the origin, mm/MPa."""
    unit = (1 - elastomer.poisson**2) / (np.pi * elastomer.young_mpa)
    return unit * _cell_mean(_inverse_distance, x_mm, y_mm, pitch_mm)


def shear_kernels(
    elastomer: Elastomer, thickness_mm: float, rows: int, columns: int, pitch_mm: float
) -> np.ndarray:
    """(5, 2 rows - 1, 2 columns - 1) kernels of a layer of this thickness, laterally unbounded.

    xx, xy, yy: displacement along one axis by shear along the other. xz, yz: deflection into the
    sensor by shear along x and y; the same with the other sign is the displacement by pressure.
    """
    half_space = _half_space_shear(rows, columns, pitch_mm, elastomer)
    return smooth_shear_kernels(elastomer, thickness_mm, rows, columns, pitch_mm) + half_space


@lru_cache(maxsize=4)  # neighboring thicknesses are used together
def smooth_shear_kernels(
    elastomer: Elastomer, thickness_mm: float, rows: int, columns: int, pitch_mm: float
) -> np.ndarray:
    """What the rigid base changes in the kernels of a half-space; see `shear_kernels`."""
    x = np.arange(1 - columns, columns) * pitch_mm
    y = np.arange(1 - rows, rows) * pitch_mm
    # The distances are those of a quarter of the grid.
    quarter = np.hypot(x[columns - 1 :], y[rows - 1 :, None])
    every = np.ix_(np.abs(np.arange(1 - rows, rows)), np.abs(np.arange(1 - columns, columns)))
    radii = np.linspace(0.0, float(quarter.max()), HANKEL_RADII)
    profiles = base_part(elastomer, np.array([thickness_mm]), radii, pitch_mm, True)[:, 0]
    mean, difference, coupling = (
        pitch_mm**2 * cubic_spline(radii, profile, quarter)[every] for profile in profiles
    )
    distance = np.maximum(quarter[every], 1e-12)
    cos, sin = x / distance, y[:, None] / distance
    double = cos**2 - sin**2
    return np.stack([
        mean - double * difference, -2 * cos * sin * difference, mean + double * difference,
        -cos * coupling, -sin * coupling,
    ])  # fmt: skip


@lru_cache(maxsize=4)
def _half_space_shear(rows: int, columns: int, pitch_mm: float, elastomer: Elastomer) -> np.ndarray:
    """The kernels of a half-space; see `shear_kernels`."""
    x, y = (np.arange(1 - size, size) * pitch_mm for size in (columns, rows))
    nu = elastomer.poisson
    inverse = _cell_mean(_inverse_distance, x, y, pitch_mm)
    along_x = _cell_mean(_x2_over_r3, x, y, pitch_mm)
    odd = (1 - 2 * nu) / 2
    return (1 + nu) / np.pi / elastomer.young_mpa * np.stack([
        (1 - nu) * inverse + nu * along_x,
        nu * _cell_mean(_xy_over_r3, x, y, pitch_mm),
        (1 - nu) * inverse + nu * (inverse - along_x),
        odd * _cell_mean(_x_over_r2, x, y, pitch_mm),
        odd * _cell_mean(_x_over_r2, y, x, pitch_mm).T,
    ])  # fmt: skip


def base_part(
    elastomer: Elastomer, thicknesses_mm: np.ndarray, radii_mm: np.ndarray, pitch_mm: float,
    shear: bool,
) -> np.ndarray:  # fmt: skip
    """(parts, thicknesses, radii) effect of the base per unit force, mm/MPa/mm2, see `_hankel`.

    Of pressure one part. Cached on disk; the modulus only scales it.
    """
    nu = elastomer.poisson
    key = repr((thicknesses_mm.tolist(), float(radii_mm[-1]), radii_mm.size, nu, pitch_mm, shear))
    compute = lambda: _hankel(thicknesses_mm, radii_mm, nu, pitch_mm, shear)  # noqa: E731
    return cached_array("layers", key, __file__, compute) / elastomer.young_mpa


def _hankel(
    thicknesses_mm: np.ndarray, radii_mm: np.ndarray, poisson: float, pitch_mm: float, shear: bool
) -> np.ndarray:
    """Effect of the base per unit force, of a modulus of 1 MPa, in one or three parts."""
    from scipy import special

    # Simpson's rule over wavenumbers, rad/mm, times the average over both cells.
    reach = SMOOTH_REACH / float(thicknesses_mm.min())
    step = min(
        2 * np.pi / float(radii_mm[-1]) / HANKEL_POINTS_A_WAVE,
        SMOOTH_REACH / float(thicknesses_mm.max()) / MIN_HANKEL_POINTS,
    )
    k = np.arange(1e-9, reach, step)
    k = k[: len(k) - 1 + len(k) % 2]
    rule = np.full(k.size, 2.0)
    rule[1::2] = 4.0
    rule[[0, -1]] = 1.0
    rule *= step / 3 * np.exp(-((k * pitch_mm) ** 2) / 12) / (2 * np.pi)
    layers = [spectra(k, float(thickness), 1.0, poisson) for thickness in thicknesses_mm]
    unit, argument = 2 * (1 + poisson) / k, k[:, None] * radii_mm
    zeroth = special.j0(argument)
    if not shear:
        parts = [([each.normal - unit * (1 - poisson) for each in layers], zeroth)]
    else:
        first = special.j1(argument)
        # The recurrence of Bessel functions; J2 is near x^2 / 8 where its terms cancel.
        second = 2 * first / np.maximum(argument, SMALL_ARGUMENT) - zeroth
        second = np.where(argument < SMALL_ARGUMENT, argument**2 / 8, second)
        sums = [(each.longitudinal + each.transverse) / 2 for each in layers]
        differences = [(each.longitudinal - each.transverse) / 2 for each in layers]
        parts = [
            ([each - unit * (2 - poisson) / 2 for each in sums], zeroth),
            ([each + unit * poisson / 2 for each in differences], second),
            ([each.coupling + unit * (1 - 2 * poisson) / 2 for each in layers], first),
        ]
    # einsum, because the last bits of a BLAS product depend on the number of threads.
    return np.stack(
        [np.einsum("tk,kr->tr", np.array(values) * (k * rule), bessel) for values, bessel in parts]
    )


def _cell_mean(
    potential: Callable[..., np.ndarray], x_mm: np.ndarray, y_mm: np.ndarray, pitch_mm: float
) -> np.ndarray:
    """(y, x) integral of a function over a cell at (x, y), averaged over a cell at the origin."""
    x = np.concatenate([[x_mm[0] - pitch_mm], x_mm, [x_mm[-1] + pitch_mm]])[None, :]
    y = np.concatenate([[y_mm[0] - pitch_mm], y_mm, [y_mm[-1] + pitch_mm]])[:, None]
    values = potential(x, y, np.maximum(np.hypot(x, y), 1e-12))
    return np.diff(np.diff(values, n=2, axis=0), n=2, axis=1) / pitch_mm**2


def _inverse_distance(x: np.ndarray, y: np.ndarray, r: np.ndarray) -> np.ndarray:
    ax, ay = np.maximum(np.abs(x), 1e-12), np.maximum(np.abs(y), 1e-12)
    potential = ax**2 * ay / 2 * np.arcsinh(ay / ax) + ay**2 * ax / 2 * np.arcsinh(ax / ay)
    return potential - r**3 / 6


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
