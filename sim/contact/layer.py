"""How an elastic layer, bonded to a rigid base and frictionless on top, answers a pressure.

Everything is linear elasticity in plane-wave form: a surface pressure p cos(k.x) gives a surface
deflection C(k) p cos(k.x), and a normal stress T(k) p cos(k.x) at the base.
"""

from collections import OrderedDict
from functools import lru_cache
from threading import Lock

import numpy as np
from scipy import fft
from scipy.fft import next_fast_len

from t2twin.core.cached_files import kept_array
from t2twin.core.jit import compiled
from t2twin.sim.contact.elastomer import Elastomer
from t2twin.sim.contact.splines import CubicSpline

THICKNESSES = 17
"""Thicknesses at which a domed layer's answer is worked out."""

COMPONENTS = 2
"""Principal components about their mean that all of them are made of: 0.6 % of the deflection is
left out on the DIGIT's gel (by interpolating between three thicknesses, 1 to 3 %)."""

SMOOTH_REACH = 30.0
"""Wavenumber times thickness up to which the base is felt: there the rest is below exp(-60)."""

HANKEL_POINTS_A_WAVE = 25
"""Points a wave of the Hankel transform's integrand at the farthest distance."""

HANKEL_RADII = 500
"""Distances at which the transform is worked out, and splined between."""

MAX_KEPT_BYTES = 100_000_000
"""Most memory for the transforms that a layer keeps: the windows of a hundred presses and more."""

WHOLE = (slice(None), slice(None))
"""The window that is the whole grid."""


def compliance_mm_per_mpa(
    wavenumber: np.ndarray, thickness_mm: float, young_mpa: float, poisson: float
) -> np.ndarray:
    """Surface deflection per pressure at wavenumber k (rad/mm), mm/MPa; same shape as k.

    Closed form of the bonded layer (Johnson, Contact Mechanics, 1985, section 5.8 gives the
    plane-strain layer; the plane-wave problem is the same in three dimensions). As k goes to 0 it
    is the confined compression h (1 - 2 nu)(1 + nu) / ((1 - nu) E), as k grows the half-space's
    2 (1 - nu^2) / (E k).
    """
    s, kappa = _reduced(wavenumber, thickness_mm), 3 - 4 * poisson
    shape = (2 * kappa * np.sinh(2 * s) - 4 * s) / _denominator(s, kappa)
    return 2 * (1 - poisson**2) / young_mpa * thickness_mm * shape / s


def base_stress(wavenumber: np.ndarray, thickness_mm: float, poisson: float) -> np.ndarray:
    """Normal stress at the base per pressure on top, at wavenumber k (rad/mm); same shape as k.

    From the same solution: T = 8 (1 - nu)(2 (1 - nu) cosh s + s sinh s) / D(s), s = k h. T(0) = 1:
    the base carries the whole force.
    """
    s, kappa = _reduced(wavenumber, thickness_mm), 3 - 4 * poisson
    return (
        8
        * (1 - poisson)
        * (2 * (1 - poisson) * np.cosh(s) + s * np.sinh(s))
        / _denominator(s, kappa)
    )


def _reduced(wavenumber: np.ndarray, thickness_mm: float) -> np.ndarray:
    # Beyond s = 300 the hyperbolic functions overflow; there the layer is a half-space already,
    # but for the 1 / s in the compliance, which matters only for k far beyond any grid here.
    return np.clip(wavenumber * thickness_mm, 1e-6, 300.0)


def _denominator(s: np.ndarray, kappa: float) -> np.ndarray:
    return 2 * kappa * np.cosh(2 * s) + 1 + kappa**2 + 4 * s**2


class Layer:
    """One elastomer's linear answer on a grid of square cells.

    Cells of pitch_mm, each cut into per_side x per_side finer ones.
    rows, columns: the fine grid. pitch_mm: its cell. x_mm (columns,), y_mm (rows,): cell centers.
    softest_mm_per_mpa: the largest deflection per pressure over all wavelengths, mm/MPa.
    weights: (n, rows, columns) float32, how much of each kernel's answer a place gives.
    """

    def __init__(self, elastomer: Elastomer, pitch_mm: float, per_side: int = 1) -> None:
        self.elastomer = elastomer
        # Even numbers both, so that a quarter turn about the middle maps cells onto cells.
        self.columns = per_side * 2 * int(elastomer.width_mm / pitch_mm / 2 + 1e-9)
        self.rows = per_side * 2 * int(elastomer.length_mm / pitch_mm / 2 + 1e-9)
        self.per_side = per_side
        self.pitch_mm = pitch_mm = pitch_mm / per_side
        self.x_mm = (np.arange(self.columns) - (self.columns - 1) / 2) * pitch_mm
        self.y_mm = (np.arange(self.rows) - (self.rows - 1) / 2) * pitch_mm
        x, y = np.meshgrid(self.x_mm, self.y_mm)
        self.rest_mm = elastomer.rest_surface_mm(x, y)
        self.thickness_mm = elastomer.thickness_at_mm(x, y)

        self.weights, self._kernels, self._softest = _answers(self, elastomer)
        self._largest: dict[tuple[int, ...], float] = {}
        self._lock = Lock()  # threads share a layer
        self._transforms: OrderedDict[tuple[int, int], np.ndarray] = OrderedDict()
        thickest = float(self.thickness_mm.max())
        wavenumbers = np.linspace(1e-3, 10, 2000) / thickest
        spectrum = compliance_mm_per_mpa(
            wavenumbers, thickest, elastomer.young_mpa, elastomer.poisson
        )
        self.softest_mm_per_mpa = float(spectrum.max())

    def largest_compliance_mm_per_mpa(self, span: tuple[int, ...]) -> float:
        """A bound of the deflection per pressure in a window of so many rows and columns, mm/MPa.

        The lesser of the largest over all wavelengths and the largest row sum of the operator.
        """
        if span not in self._largest:
            rows, columns = min(span[0], self.rows) // 2 + 1, min(span[1], self.columns) // 2 + 1
            near = self._softest[
                self.rows - rows : self.rows + rows - 1,
                self.columns - columns : self.columns + columns - 1,
            ]
            self._largest[span] = min(self.softest_mm_per_mpa, float(np.abs(near).sum()))
        return self._largest[span]

    def deflection_mm(
        self, pressure_mpa: np.ndarray, window: tuple[slice, slice] = WHOLE
    ) -> np.ndarray:
        """Surface deflection of the linear layer, mm, under a pressure, MPa.

        Both are the part of the grid in the window (rows, columns); pressure outside it is taken
        as zero. Where the layer is domed, each place answers as a layer of its own thickness would.
        """
        answers = self.answers(pressure_mpa.astype(np.float32))
        if len(answers) == 1:
            return answers[0].astype(np.float64)
        weights = self.weights[:, *window]
        return np.einsum("lyx,lyx->yx", weights, answers).astype(np.float64)

    def answers(self, pressure_mpa: np.ndarray) -> np.ndarray:
        """What each kernel gives for a pressure on a window, (n, rows, columns) float32, mm, of
        which `weights` make the deflection. pressure_mpa: (rows, columns) float32.

        Single precision: 1e-6 of the deflection, and twice as fast. Rows that are zero, or that
        nobody looks at, are not transformed.
        """
        rows, columns = pressure_mpa.shape
        down, across = _fast(2 * rows - 1), _fast(2 * columns - 1)
        spectrum = fft.fft(fft.rfft(pressure_mpa, across), down, axis=0, overwrite_x=True)
        kernels = self._transform(rows, columns, (down, across))
        spectra = np.empty(kernels.shape, np.complex64)
        _multiply(kernels, spectrum, spectra)
        upright = np.asarray(fft.ifft(spectra, axis=1, overwrite_x=True))[:, :rows]
        return np.asarray(fft.irfft(upright, across))[:, :, :columns]

    def _transform(self, rows: int, columns: int, padded: tuple[int, int]) -> np.ndarray:
        """Transforms of the kernels cut to what a window of this size needs; the last are kept."""
        with self._lock:
            if (rows, columns) in self._transforms:
                self._transforms.move_to_end((rows, columns))
                return self._transforms[rows, columns]
        made = self._cut_and_transformed(rows, columns, padded)
        with self._lock:
            kept = self._transforms
            kept[rows, columns] = made
            while len(kept) > 1 and sum(each.nbytes for each in kept.values()) > MAX_KEPT_BYTES:
                kept.popitem(last=False)
        return made

    def _cut_and_transformed(self, rows: int, columns: int, padded: tuple[int, int]) -> np.ndarray:
        middle_row, middle_column = self.rows - 1, self.columns - 1
        cut = np.zeros((len(self._kernels), *padded), np.float32)
        offset_rows, offset_columns = np.arange(1 - rows, rows), np.arange(1 - columns, columns)
        cut[:, *np.ix_(offset_rows % padded[0], offset_columns % padded[1])] = self._kernels[
            :, *np.ix_(offset_rows + middle_row, offset_columns + middle_column)
        ]
        # Kernels are even along both axes, and so their transforms are real.
        return np.ascontiguousarray(np.real(np.asarray(fft.rfft2(cut))))


@compiled("void(f4[:, :, ::1], c8[:, ::1], c8[:, :, ::1])", nogil=True)
def _multiply(kernels, spectrum, spectra):
    for k in range(len(kernels)):
        for i in range(kernels.shape[1]):
            for j in range(kernels.shape[2]):
                spectra[k, i, j] = kernels[k, i, j] * spectrum[i, j]


@lru_cache(maxsize=16)
def cached_layer(elastomer: Elastomer, pitch_mm: float, per_side: int = 1) -> Layer:
    """The layer of an elastomer on cells of a pitch cut into parts, worked out once a process."""
    return Layer(elastomer, pitch_mm, per_side)


def _fast(length: int) -> int:
    """The next length that transforms fast."""
    return int(next_fast_len(length, real=True) or length)


def _answers(layer: Layer, elastomer: Elastomer) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """How each place answers, as a sum of kernels: (n, rows, columns) weights, (n, ...) kernels.

    A kernel is the mean deflection of each cell per unit pressure on one, mm/MPa, float32,
    (2 rows - 1, 2 columns - 1), the loaded cell in the middle. The mean, and not the middle's:
    together with a pressure that is constant on a cell it is a Galerkin method, whose error at a
    punch's edges is about half as large. The half-space's part is in closed form; what the layer's
    base takes away from it is smooth and depends on the thickness, and is the mean of that over the
    thicknesses and their principal components about it. Laterally unbounded, no period. The third
    result is the kernel at the thickest place.
    """
    young, poisson, pitch = elastomer.young_mpa, elastomer.poisson, layer.pitch_mm
    x = np.arange(1 - layer.columns, layer.columns) * pitch
    y = np.arange(1 - layer.rows, layer.rows) * pitch
    half_space = (1 - poisson**2) / (np.pi * young) * _mean_inverse_distance(x, y, pitch)
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
    apart = (profiles - mean) * ring
    _, _, axes = np.linalg.svd(np.sqrt(shares)[:, None] * apart, full_matrices=False)
    axes = axes[:COMPONENTS]
    along = CubicSpline(thinnest, thickest, apart @ axes.T)
    weights = np.concatenate([np.ones((1, *thickness.shape)), np.moveaxis(along(thickness), -1, 0)])
    smooth = (CubicSpline(0.0, radii[-1], each)(distance) for each in (mean, *(axes / ring)))
    kernels = pitch**2 * np.stack(list(smooth))
    kernels[0] += half_space
    softest = np.tensordot(np.concatenate([[1.0], along(np.array(thickest))]), kernels, 1)
    return weights.astype(np.float32), kernels.astype(np.float32), softest


def _base_part(
    thicknesses_mm: np.ndarray, radii_mm: np.ndarray, elastomer: Elastomer, pitch_mm: float
) -> np.ndarray:
    """What a layer's base takes from a half-space's answer to a point load.

    (thicknesses, radii), mm/MPa per mm^2, averaged over a loaded and an answering cell. Kept
    between processes, as it takes a tenth of a second.
    """
    poisson, farthest = elastomer.poisson, float(radii_mm[-1])
    key = repr((thicknesses_mm.tolist(), farthest, radii_mm.size, poisson, pitch_mm))
    of_unit_modulus = kept_array(
        "layers", key, __file__, lambda: _hankel(thicknesses_mm, radii_mm, poisson, pitch_mm)
    )
    return of_unit_modulus / elastomer.young_mpa


def _hankel(
    thicknesses_mm: np.ndarray, radii_mm: np.ndarray, poisson: float, pitch_mm: float
) -> np.ndarray:
    """`_base_part` for a modulus of 1 MPa: Hankel transform."""
    from scipy import special

    reach = SMOOTH_REACH / float(thicknesses_mm.min())
    step = min(
        2 * np.pi / radii_mm[-1] / HANKEL_POINTS_A_WAVE,
        SMOOTH_REACH / float(thicknesses_mm.max()) / 1000,
    )
    k = np.arange(1e-9, reach, step)
    k = k[: len(k) - 1 + len(k) % 2]
    # Simpson's rule, and a cell's mean over a cell's load to second order: sinc^4 is
    # exp(-k^2 a^2 / 12) here.
    rule = np.full(k.size, 2.0)
    rule[1::2] = 4.0
    rule[[0, -1]] = 1.0
    rule *= step / 3 * np.exp(-((k * pitch_mm) ** 2) / 12) / (2 * np.pi)
    taken = np.stack(
        [
            k * compliance_mm_per_mpa(k, float(thickness), 1.0, poisson) - 2 * (1 - poisson**2)
            for thickness in thicknesses_mm
        ]
    )
    # einsum and not a BLAS product, whose last bits depend on the number of threads.
    return np.einsum("tk,kr->tr", taken * rule, special.j0(k[:, None] * radii_mm))


def _mean_inverse_distance(x_mm: np.ndarray, y_mm: np.ndarray, pitch_mm: float) -> np.ndarray:
    """The integral of 1 / distance over a square cell, averaged over one (x, y) away, mm.

    (y, x). The fourth difference of a function whose derivative d^4 / dx^2 dy^2 is 1 / r.
    """
    x = np.concatenate([[x_mm[0] - pitch_mm], x_mm, [x_mm[-1] + pitch_mm]])[None, :]
    y = np.concatenate([[y_mm[0] - pitch_mm], y_mm, [y_mm[-1] + pitch_mm]])[:, None]
    r = np.hypot(x, y)
    ax, ay = np.maximum(np.abs(x), 1e-12), np.maximum(np.abs(y), 1e-12)
    potential = ax**2 * ay / 2 * np.arcsinh(ay / ax) + ay**2 * ax / 2 * np.arcsinh(ax / ay)
    return np.diff(np.diff(potential - r**3 / 6, n=2, axis=0), n=2, axis=1) / pitch_mm**2
