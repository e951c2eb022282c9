"""Response of an elastic layer, bonded to a rigid base and frictionless on top, to a pressure.

Linear elasticity in plane-wave form: a surface pressure p cos(k.x) causes a surface deflection
C(k) p cos(k.x), and a normal stress T(k) p cos(k.x) at the base.
"""

from collections import OrderedDict
from collections.abc import Callable
from functools import lru_cache
from threading import Lock

import numpy as np
from scipy import fft
from scipy.fft import next_fast_len

from t2twin.core.cached_files import cached_array
from t2twin.core.jit import compiled
from t2twin.sim.contact.elastomer import Elastomer
from t2twin.sim.splines import CubicSpline

THICKNESSES = 17
"""Number of thicknesses at which a domed layer's response is computed."""

COMPONENTS = 2
"""Principal components that represent the responses of all thicknesses. The error is 0.6 % of the
deflection on a domed gel of 4 mm; interpolation between three thicknesses has 1 to 3 %."""

SMOOTH_REACH = 30.0
"""Wavenumber times thickness above which the base has no effect: it is below exp(-60)."""

HANKEL_POINTS_A_WAVE = 25
"""Points per wave of the Hankel transform's integrand at the largest distance."""

MIN_HANKEL_POINTS = 1000
"""Points of the transform up to SMOOTH_REACH of the thickest layer."""

HANKEL_RADII = 500
"""Number of distances at which the transform is computed; splines interpolate between them."""

MAX_CACHE_BYTES = 100_000_000
"""Memory limit for a layer's cached transforms: the windows of a hundred presses and more."""

WHOLE = (slice(None), slice(None))
"""The window of the whole grid."""


def compliance_mm_per_mpa(
    wavenumber: np.ndarray, thickness_mm: float, young_mpa: float, poisson: float
) -> np.ndarray:
    """Surface deflection per pressure at wavenumber k (rad/mm), mm/MPa; same shape as k.

    Closed form of the bonded layer (Johnson, Contact Mechanics, 1985, section 5.8 gives the
    plane-strain layer; the plane-wave problem is the same in three dimensions). Its limits are the
    confined compression h (1 - 2 nu)(1 + nu) / ((1 - nu) E) for k = 0, and the half-space's
    2 (1 - nu^2) / (E k) for large k.
    """
    s, kappa = _reduced(wavenumber, thickness_mm), 3 - 4 * poisson
    shape = (2 * kappa * np.sinh(2 * s) - 4 * s) / _denominator(s, kappa)
    return 2 * (1 - poisson**2) / young_mpa * thickness_mm * shape / s


def base_stress(wavenumber: np.ndarray, thickness_mm: float, poisson: float) -> np.ndarray:
    """Normal stress at the base per pressure on top, at wavenumber k (rad/mm); same shape as k.

    From the same solution: T = 8 (1 - nu)(2 (1 - nu) cosh s + s sinh s) / D(s), s = k h. T(0) = 1:
    the base carries the entire force.
    """
    s, kappa = _reduced(wavenumber, thickness_mm), 3 - 4 * poisson
    return (
        8
        * (1 - poisson)
        * (2 * (1 - poisson) * np.cosh(s) + s * np.sinh(s))
        / _denominator(s, kappa)
    )


def _reduced(wavenumber: np.ndarray, thickness_mm: float) -> np.ndarray:
    # Above s = 300 the hyperbolic functions overflow. The layer is a half-space there, except for
    # the 1 / s in the compliance, which matters only for k far beyond the grids used here.
    return np.clip(wavenumber * thickness_mm, 1e-6, 300.0)


def _denominator(s: np.ndarray, kappa: float) -> np.ndarray:
    return 2 * kappa * np.cosh(2 * s) + 1 + kappa**2 + 4 * s**2


class Layer:
    """Linear response of one elastomer on a grid of square cells.

    pitch_mm: side of the cells. per_side: number of fine cells along each.
    Attributes, of the fine grid:

    - rows, columns; pitch_mm, side of a fine cell; x_mm (columns,), y_mm (rows,), cell centers;
    - rest_mm, thickness_mm, (rows, columns);
    - max_compliance_mm_per_mpa, largest deflection per pressure over all wavelengths, mm/MPa;
    - weights, (kernels, rows, columns) float32, weight of each kernel's response at each place.
    """

    def __init__(self, elastomer: Elastomer, pitch_mm: float, per_side: int = 1) -> None:
        self.elastomer = elastomer
        # Both even, so that a quarter turn about the center maps cells onto cells.
        self.columns = per_side * 2 * int(elastomer.width_mm / pitch_mm / 2 + 1e-9)
        self.rows = per_side * 2 * int(elastomer.length_mm / pitch_mm / 2 + 1e-9)
        self.per_side = per_side
        self.pitch_mm = pitch_mm = pitch_mm / per_side
        self.x_mm = (np.arange(self.columns) - (self.columns - 1) / 2) * pitch_mm
        self.y_mm = (np.arange(self.rows) - (self.rows - 1) / 2) * pitch_mm
        x, y = np.meshgrid(self.x_mm, self.y_mm)
        self.rest_mm = elastomer.rest_surface_mm(x, y)
        self.thickness_mm = elastomer.thickness_at_mm(x, y)

        self.weights, self._kernels, self._thickest_kernel = _response(self, elastomer)
        self._bounds: dict[tuple[int, ...], float] = {}
        self._lock = Lock()  # threads share a layer
        self._transforms: OrderedDict[tuple[int, int], np.ndarray] = OrderedDict()
        thickest = float(self.thickness_mm.max())
        wavenumbers = np.linspace(1e-3, 10, 2000) / thickest
        spectrum = compliance_mm_per_mpa(
            wavenumbers, thickest, elastomer.young_mpa, elastomer.poisson
        )
        self.max_compliance_mm_per_mpa = float(spectrum.max())

    def compliance_bound_mm_per_mpa(self, shape: tuple[int, ...]) -> float:
        """Upper bound on the deflection per pressure in a window of (rows, columns), mm/MPa.

        The smaller of the largest compliance over all wavelengths and the operator's row sum.
        """
        if shape not in self._bounds:
            rows, columns = min(shape[0], self.rows) // 2 + 1, min(shape[1], self.columns) // 2 + 1
            near = self._thickest_kernel[
                self.rows - rows : self.rows + rows - 1,
                self.columns - columns : self.columns + columns - 1,
            ]
            self._bounds[shape] = min(self.max_compliance_mm_per_mpa, float(np.abs(near).sum()))
        return self._bounds[shape]

    def deflection_mm(
        self, pressure_mpa: np.ndarray, window: tuple[slice, slice] = WHOLE
    ) -> np.ndarray:
        """Surface deflection of the linear layer, mm, under a pressure, MPa.

        Both (rows, columns) in the window; the pressure outside it is zero. Each place of a domed
        layer responds as a layer of its thickness.
        """
        responses = self.responses(pressure_mpa.astype(np.float32))
        if len(responses) == 1:
            return responses[0].astype(np.float64)
        weights = self.weights[:, *window]
        return np.einsum("lyx,lyx->yx", weights, responses).astype(np.float64)

    def responses(self, pressure_mpa: np.ndarray) -> np.ndarray:
        """Convolution of each kernel with a pressure on a window, (kernels, rows, columns), mm.

        pressure_mpa: (rows, columns) float32. The deflection is the sum over the kernels, weighted
        by `weights`. Single precision has an error of 1e-6 and is twice as fast. Rows of zeros, and
        rows that are cut off afterwards, are not transformed.
        """
        rows, columns = pressure_mpa.shape
        down, across = _fast_length(2 * rows - 1), _fast_length(2 * columns - 1)
        spectrum = fft.fft(fft.rfft(pressure_mpa, across), down, axis=0, overwrite_x=True)
        kernels = self._transform(rows, columns, (down, across))
        spectra = np.empty(kernels.shape, np.complex64)
        _multiply(kernels, spectrum, spectra)
        kept_rows = np.asarray(fft.ifft(spectra, axis=1, overwrite_x=True))[:, :rows]
        return np.asarray(fft.irfft(kept_rows, across))[:, :, :columns]

    def _transform(self, rows: int, columns: int, padded: tuple[int, int]) -> np.ndarray:
        """Transforms of the kernels for a window of this size; the last are cached."""
        with self._lock:
            if (rows, columns) in self._transforms:
                self._transforms.move_to_end((rows, columns))
                return self._transforms[rows, columns]
        transform = self._compute_transform(rows, columns, padded)
        with self._lock:
            cached = self._transforms
            cached[rows, columns] = transform
            while (
                len(cached) > 1 and sum(each.nbytes for each in cached.values()) > MAX_CACHE_BYTES
            ):
                cached.popitem(last=False)
        return transform

    def _compute_transform(self, rows: int, columns: int, padded: tuple[int, int]) -> np.ndarray:
        middle_row, middle_column = self.rows - 1, self.columns - 1
        cut = np.zeros((len(self._kernels), *padded), np.float32)
        offset_rows, offset_columns = np.arange(1 - rows, rows), np.arange(1 - columns, columns)
        cut[:, *np.ix_(offset_rows % padded[0], offset_columns % padded[1])] = self._kernels[
            :, *np.ix_(offset_rows + middle_row, offset_columns + middle_column)
        ]
        # The kernels are even along both axes, so their transforms are real.
        return np.ascontiguousarray(np.real(np.asarray(fft.rfft2(cut))))


@compiled("void(f4[:, :, ::1], c8[:, ::1], c8[:, :, ::1])", nogil=True)
def _multiply(kernels, spectrum, spectra):
    for k in range(len(kernels)):
        for i in range(kernels.shape[1]):
            for j in range(kernels.shape[2]):
                spectra[k, i, j] = kernels[k, i, j] * spectrum[i, j]


@lru_cache(maxsize=16)
def cached_layer(elastomer: Elastomer, pitch_mm: float, per_side: int = 1) -> Layer:
    """The layer of an elastomer on a grid, see Layer, computed once per process."""
    return Layer(elastomer, pitch_mm, per_side)


def _fast_length(length: int) -> int:
    """The next length with a fast transform."""
    return int(next_fast_len(length, real=True) or length)


def _response(layer: Layer, elastomer: Elastomer) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Response of each place as a weighted sum of kernels.

    Returns weights, (kernels, rows, columns), the kernels, (kernels, 2 rows - 1, 2 columns - 1),
    both float32, and the kernel at the thickest place. A kernel is the mean deflection of each cell
    per unit pressure on the central one, mm/MPa. With pressures constant on cells this is a
    Galerkin method; its error at a punch's edges is half that of deflections at cell centers.

    The half-space's kernel has a closed form. The base reduces it by a smooth part that depends on
    the thickness and is expanded into its mean and principal components over the thicknesses. The
    layer is laterally unbounded and not periodic.
    """
    young, poisson, pitch = elastomer.young_mpa, elastomer.poisson, layer.pitch_mm
    x = np.arange(1 - layer.columns, layer.columns) * pitch
    y = np.arange(1 - layer.rows, layer.rows) * pitch
    half_space = (1 - poisson**2) / (np.pi * young) * mean_inverse_distance(x, y, pitch)
    distance = np.hypot(x[None, :], y[:, None])
    radii = np.linspace(0.0, float(distance.max()), HANKEL_RADII)

    thickness = layer.thickness_mm
    thinnest, thickest = float(thickness.min()), float(thickness.max())
    if thickest - thinnest < 1e-6:
        profile = _base_part(np.array([thickest]), radii, elastomer, pitch)[0]
        kernel = half_space + pitch**2 * CubicSpline(0.0, radii[-1], profile)(distance)
        return np.ones((1, *thickness.shape), np.float32), kernel[None].astype(np.float32), kernel

    levels = np.linspace(thinnest, thickest, THICKNESSES)
    profiles = _base_part(levels, radii, elastomer, pitch)
    nearest = np.rint((thickness - thinnest) / (levels[1] - levels[0])).astype(int)
    shares = np.bincount(nearest.ravel(), minlength=THICKNESSES) / nearest.size
    mean = shares @ profiles
    ring = np.sqrt(radii + pitch)
    deviations = (profiles - mean) * ring
    _, _, axes = np.linalg.svd(np.sqrt(shares)[:, None] * deviations, full_matrices=False)
    axes = axes[:COMPONENTS]
    scores = CubicSpline(thinnest, thickest, deviations @ axes.T)
    weights = np.concatenate(
        [np.ones((1, *thickness.shape)), np.moveaxis(scores(thickness), -1, 0)]
    )
    smooth = (CubicSpline(0.0, radii[-1], each)(distance) for each in (mean, *(axes / ring)))
    kernels = pitch**2 * np.stack(list(smooth))
    kernels[0] += half_space
    at_thickest = np.concatenate([[1.0], scores(np.array(thickest))])
    thickest_kernel = np.tensordot(at_thickest, kernels, 1)
    return weights.astype(np.float32), kernels.astype(np.float32), thickest_kernel


def _base_part(
    thicknesses_mm: np.ndarray, radii_mm: np.ndarray, elastomer: Elastomer, pitch_mm: float
) -> np.ndarray:
    """Effect of the rigid base on a half-space's response to a point load.

    (thicknesses, radii), mm/MPa per mm^2, averaged over the loaded and the responding cell. Cached
    on disk, as it takes a tenth of a second.
    """
    poisson, farthest = elastomer.poisson, float(radii_mm[-1])
    key = repr((thicknesses_mm.tolist(), farthest, radii_mm.size, poisson, pitch_mm))
    of_unit_modulus = cached_array(
        "layers", key, __file__, lambda: _hankel(thicknesses_mm, radii_mm, poisson, pitch_mm)
    )
    return of_unit_modulus / elastomer.young_mpa


def _hankel(
    thicknesses_mm: np.ndarray, radii_mm: np.ndarray, poisson: float, pitch_mm: float
) -> np.ndarray:
    """`_base_part` for a modulus of 1 MPa, by a Hankel transform."""
    from scipy import special

    k, rule = hankel_rule(thicknesses_mm, float(radii_mm[-1]), pitch_mm)
    difference = np.stack(
        [
            k * compliance_mm_per_mpa(k, float(thickness), 1.0, poisson) - 2 * (1 - poisson**2)
            for thickness in thicknesses_mm
        ]
    )
    # einsum, because the last bits of a BLAS product depend on the number of threads.
    return np.einsum("tk,kr->tr", difference * rule, special.j0(k[:, None] * radii_mm))


def hankel_rule(
    thicknesses_mm: np.ndarray, farthest_mm: float, pitch_mm: float
) -> tuple[np.ndarray, np.ndarray]:
    """Wavenumbers k, rad/mm, and weights of a Hankel transform over them, both (k,).

    Simpson's rule, times the average over both cells to second order: sinc^4 is about
    exp(-k^2 a^2 / 12). The integrand is without the factor k.
    """
    reach = SMOOTH_REACH / float(thicknesses_mm.min())
    step = min(
        2 * np.pi / farthest_mm / HANKEL_POINTS_A_WAVE,
        SMOOTH_REACH / float(thicknesses_mm.max()) / MIN_HANKEL_POINTS,
    )
    k = np.arange(1e-9, reach, step)
    k = k[: len(k) - 1 + len(k) % 2]
    rule = np.full(k.size, 2.0)
    rule[1::2] = 4.0
    rule[[0, -1]] = 1.0
    rule *= step / 3 * np.exp(-((k * pitch_mm) ** 2) / 12) / (2 * np.pi)
    return k, rule


def mean_inverse_distance(x_mm: np.ndarray, y_mm: np.ndarray, pitch_mm: float) -> np.ndarray:
    """Integral of 1 / distance over a square cell, averaged over a cell at (x, y), mm; (y, x).

    The potential's derivative d^4 / dx^2 dy^2 is 1 / r.
    """
    return cell_mean(_inverse_distance, x_mm, y_mm, pitch_mm)


def _inverse_distance(x: np.ndarray, y: np.ndarray, r: np.ndarray) -> np.ndarray:
    ax, ay = np.maximum(np.abs(x), 1e-12), np.maximum(np.abs(y), 1e-12)
    potential = ax**2 * ay / 2 * np.arcsinh(ay / ax) + ay**2 * ax / 2 * np.arcsinh(ax / ay)
    return potential - r**3 / 6


def cell_mean(
    potential: Callable[..., np.ndarray], x_mm: np.ndarray, y_mm: np.ndarray, pitch_mm: float
) -> np.ndarray:
    """Integral of a function over a square cell, averaged over a cell at (x, y); (y, x).

    potential: its integral, twice over x and twice over y, of x, y and the distance r.
    """
    x = np.concatenate([[x_mm[0] - pitch_mm], x_mm, [x_mm[-1] + pitch_mm]])[None, :]
    y = np.concatenate([[y_mm[0] - pitch_mm], y_mm, [y_mm[-1] + pitch_mm]])[:, None]
    values = potential(x, y, np.maximum(np.hypot(x, y), 1e-12))
    return np.diff(np.diff(values, n=2, axis=0), n=2, axis=1) / pitch_mm**2
