"""Response of an elastic layer, bonded to a rigid base and frictionless on top, to a pressure.

Linear elasticity in plane-wave form: a surface pressure p cos(k.x) causes a surface deflection
C(k) p cos(k.x), and a normal stress T(k) p cos(k.x) at the base.
"""

from collections import OrderedDict
from collections.abc import Callable
from functools import lru_cache
from threading import Lock
from typing import Any

import numpy as np
from scipy import fft
from scipy.fft import next_fast_len

from t2twin.core.cached_files import cached_array
from t2twin.sim.contact.convolution import (
    PADDING,
    Transforms,
    convolve,
    interpolation,
    work_arrays,
)
from t2twin.sim.contact.elastomer import Elastomer
from t2twin.sim.contact.grid import block_means
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

NODE_MM = 0.5
"""Largest distance of the nodes on which the smooth kernels are applied, mm, unless the cells are
larger: an eighth of the thickness over which they vary (assumed)."""


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
    - max_compliance_mm_per_mpa, largest deflection per pressure over all wavelengths, mm/MPa.
    """

    def __init__(self, elastomer: Elastomer, pitch_mm: float, per_side: int = 1) -> None:
        self.elastomer = elastomer
        # Both even, so that a quarter turn about the center maps cells onto cells.
        self.columns = per_side * 2 * int(elastomer.width_mm / pitch_mm / 2 + 1e-9)
        self.rows = per_side * 2 * int(elastomer.length_mm / pitch_mm / 2 + 1e-9)
        self.per_side = per_side
        self.per_node = per_side * (2 if 2 * pitch_mm <= NODE_MM + 1e-9 else 1)
        self.pitch_mm = pitch_mm = pitch_mm / per_side
        self.x_mm = (np.arange(self.columns) - (self.columns - 1) / 2) * pitch_mm
        self.y_mm = (np.arange(self.rows) - (self.rows - 1) / 2) * pitch_mm
        x, y = np.meshgrid(self.x_mm, self.y_mm)
        self.rest_mm = elastomer.rest_surface_mm(x, y)
        self.thickness_mm = elastomer.thickness_at_mm(x, y)

        self._kernel, self._smooth, self._weights, self._thickest = _kernels(self, elastomer)
        self._interpolation = interpolation(self.per_node)
        self._bounds: dict[tuple[int, ...], float] = {}
        self._coarse: dict[int, tuple[np.ndarray, np.ndarray, np.ndarray]] = {}
        self._lock = Lock()  # threads share a layer
        self._transforms: OrderedDict[tuple[int, ...], Transforms] = OrderedDict()
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
            near = self._thickest[
                self.rows - rows : self.rows + rows - 1,
                self.columns - columns : self.columns + columns - 1,
            ]
            self._bounds[shape] = min(self.max_compliance_mm_per_mpa, float(np.abs(near).sum()))
        return self._bounds[shape]

    def coarse(self, per_side: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """x, y, and the mean height at rest, (y, x), of cells of per_side x per_side fine ones,
        mm."""
        if per_side not in self._coarse:
            x, y = (axis.reshape(-1, per_side).mean(axis=1) for axis in (self.x_mm, self.y_mm))
            self._coarse[per_side] = x, y, block_means(self.rest_mm, per_side)
        return self._coarse[per_side]

    def deflection_mm(
        self, pressure_mpa: np.ndarray, window: tuple[slice, slice] | None = None
    ) -> np.ndarray:
        """Surface deflection of the linear layer, mm, under a pressure, MPa.

        Both (rows, columns) in the window, whose sides are multiples of per_node; None is the whole
        grid. The pressure outside it is zero. Each place of a domed layer responds as a layer of
        its thickness.
        """
        operator = self.operator(window or (slice(0, self.rows), slice(0, self.columns)))
        padded = np.zeros((len(pressure_mpa), operator[1]), np.float32)
        padded[:, : pressure_mpa.shape[1]] = pressure_mpa
        linear = np.empty(pressure_mpa.shape, np.float32)
        convolve(padded, *operator, linear)
        return linear.astype(np.float64)

    def operator(self, window: tuple[slice, slice]) -> tuple[Any, ...]:
        """Arguments of `convolution.convolve` for a window, from kernel to work."""
        rows, columns = window
        shape = rows.stop - rows.start, columns.stop - columns.start
        nodes = tuple(
            slice(side.start // self.per_node, side.stop // self.per_node + 2 * PADDING)
            for side in window
        )
        transforms, weights = self._transformed(*shape), self._weights[:, *nodes]
        work = work_arrays(transforms, shape, (weights.shape[1], weights.shape[2]))
        return *transforms, weights, *self._interpolation, work

    def _transformed(self, rows: int, columns: int) -> Transforms:
        """Transforms of the kernels for a window of this size; the last are cached."""
        with self._lock:
            if (rows, columns) in self._transforms:
                self._transforms.move_to_end((rows, columns))
                return self._transforms[rows, columns]
        kernel, padded = _transform(self._kernel[None], rows, columns)
        smooth, node_padded = self._smooth, 0
        if len(smooth):
            nodes = (side // self.per_node + 2 * PADDING for side in (rows, columns))
            smooth, node_padded = _transform(smooth, *nodes)
        transforms = Transforms(kernel[0], padded, smooth, node_padded)
        with self._lock:
            cached = self._transforms
            cached[rows, columns] = transforms
            while (
                len(cached) > 1 and sum(each.nbytes for each in cached.values()) > MAX_CACHE_BYTES
            ):
                cached.popitem(last=False)
        return transforms


def _transform(kernels: np.ndarray, rows: int, columns: int) -> tuple[np.ndarray, int]:
    """Real transforms of kernels, (kernels, 2 n - 1, 2 m - 1), for windows of rows x columns, and
    the columns of the transforms."""
    down, across = (int(next_fast_len(2 * side - 1, real=True) or 0) for side in (rows, columns))
    middle_row, middle_column = kernels.shape[1] // 2, kernels.shape[2] // 2
    cut = np.zeros((len(kernels), down, across), np.float32)
    offset_rows, offset_columns = np.arange(1 - rows, rows), np.arange(1 - columns, columns)
    cut[:, *np.ix_(offset_rows % down, offset_columns % across)] = kernels[
        :, *np.ix_(offset_rows + middle_row, offset_columns + middle_column)
    ]
    return np.ascontiguousarray(np.real(np.asarray(fft.rfft2(cut)))), across


@lru_cache(maxsize=16)
def cached_layer(elastomer: Elastomer, pitch_mm: float, per_side: int = 1) -> Layer:
    """The layer of an elastomer on a grid, see Layer, computed once per process."""
    return Layer(elastomer, pitch_mm, per_side)


def _kernels(
    layer: Layer, elastomer: Elastomer
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Response of each place as a sum of a kernel and of further ones with weights.

    Returns the kernel, (2 rows - 1, 2 columns - 1) float32; the further ones on the layer's nodes,
    (kernels, 2 M - 1, 2 N - 1) float32; their weights, (kernels, M, N) float32; and the kernel of
    the thickest place, as the first. M and N include the nodes around the grid. A kernel is the
    mean deflection of each cell per unit pressure on the central one, mm/MPa. With pressures
    constant on cells this is a Galerkin method; its error at a punch's edges is half that of
    deflections at cell centers.

    The half-space's kernel has a closed form. The base reduces it by a smooth part that depends on
    the thickness and is expanded into its mean and principal components over the thicknesses. The
    layer is laterally unbounded and not periodic.
    """
    young, poisson, pitch = elastomer.young_mpa, elastomer.poisson, layer.pitch_mm
    x = np.arange(1 - layer.columns, layer.columns) * pitch
    y = np.arange(1 - layer.rows, layer.rows) * pitch
    half_space = (1 - poisson**2) / (np.pi * young) * mean_inverse_distance(x, y, pitch)
    distance = np.hypot(x[None, :], y[:, None])
    node_distance, at_nodes = _nodes(layer, elastomer)
    radii = np.linspace(0.0, float(node_distance.max()), HANKEL_RADII)

    def kernel_of(profile: np.ndarray, distance_mm: np.ndarray) -> np.ndarray:
        return pitch**2 * CubicSpline(0.0, radii[-1], profile)(distance_mm)

    thickness = layer.thickness_mm
    thinnest, thickest = float(thickness.min()), float(thickness.max())
    if thickest - thinnest < 1e-6:
        profile = _base_part(np.array([thickest]), radii, elastomer, pitch)[0]
        kernel = half_space + kernel_of(profile, distance)
        none = np.zeros((0, 1, 1), np.float32)
        weights = np.zeros((0, *at_nodes.shape), np.float32)
        return kernel.astype(np.float32), none, weights, kernel

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
    smooth = np.stack([kernel_of(each, node_distance) for each in axes / ring])
    weights = np.moveaxis(scores(at_nodes.clip(thinnest, thickest)), -1, 0)
    kernel = (half_space + kernel_of(mean, distance)).astype(np.float32)
    weights = np.ascontiguousarray(weights, np.float32)
    return (
        kernel,
        smooth.astype(np.float32),
        weights,
        half_space + kernel_of(profiles[-1], distance),
    )


def _nodes(layer: Layer, elastomer: Elastomer) -> tuple[np.ndarray, np.ndarray]:
    """Distances of the nodes from one of them, (2 M - 1, 2 N - 1), and the thickness at each,
    (M, N), mm."""
    x, y = (
        np.arange(1 - nodes, nodes) * layer.per_node * layer.pitch_mm
        for nodes in (side // layer.per_node + 2 * PADDING for side in (layer.columns, layer.rows))
    )
    # The second half of an axis has the distances from the first node.
    at_x, at_y = np.meshgrid(*(axis[axis.size // 2 :] - axis[-1] / 2 for axis in (x, y)))
    return np.hypot(x[None, :], y[:, None]), elastomer.thickness_at_mm(at_x, at_y)


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
