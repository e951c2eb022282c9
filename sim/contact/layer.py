"""Response of an elastic layer, bonded to a rigid base, to pressure and shear on its surface.

Convolutions with the kernels of `closed_forms`, by FFTs in single precision, which has an error of
1e-6 and is twice as fast as double precision. Shape letters: R rows and C columns of a window, M
rows and N columns of its nodes, D >= 2 R - 1 rows and A >= 2 C - 1 columns of its transforms.
"""

from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any

import numpy as np

from t2twin.core.cubic_spline import cubic_spline
from t2twin.core.jit import INNER, c2c, c2r, compiled, next_fast_len, r2c
from t2twin.sim.contact.closed_forms import (
    HANKEL_RADII,
    base_part,
    half_space_deflection,
    shear_kernels,
    smooth_shear_kernels,
    spectra,
)
from t2twin.sim.contact.elastomer import Elastomer, neo_hookean_mm
from t2twin.sim.contact.grid import Window, block_means, window_shape

THICKNESSES = 17  # thicknesses at which a domed layer's response to pressure is computed
# Principal components that represent the responses of all thicknesses. The error is 0.6 % of the
# deflection on a domed gel of 4 mm; interpolation between three thicknesses has 1 to 3 %.
COMPONENTS = 2
# Largest distance of the nodes on which the smooth kernels are applied, mm, unless the cells are
# larger: an eighth of the thickness over which they vary (assumed).
NODE_MM = 0.5
PADDING = 2  # nodes around a window on each side, which cubic interpolation needs
SPRING_SHARE = 0.8  # a pin's compliance over the layer's largest; 0.6 to 1 converge equally fast
MAX_WINDOWS = 100  # windows of which a layer keeps the transforms (assumed: a hundred presses)
# Thicknesses at the middle of a contact with a domed layer are rounded to this, mm, so that few
# kernels are computed (assumed).
THICKNESS_STEP_MM = 0.25
MAX_LAYERS = 32  # layers that are kept (assumed: the thicknesses of two domed gels)


class WindowTransforms:
    """Transforms of kernels that are even or odd along both axes, for windows of a grid.

    kernels: (n, rows, columns) around the central cell. odd: how many of the last are odd in one
    axis; of their transforms the imaginary parts are kept, of the others the real ones.
    """

    def __init__(self, kernels: np.ndarray, odd: int = 0) -> None:
        self.kernels, self._odd = kernels, odd
        self.of = lru_cache(maxsize=MAX_WINDOWS)(self._of)  # threads share a layer

    def _of(self, shape: tuple[int, ...]) -> np.ndarray:
        """(n, D, A // 2 + 1) float32 for windows of (R, C)."""
        padded = padded_shape(shape)
        cut = np.zeros((len(self.kernels), *padded), np.float32)
        found = np.empty((*cut.shape[:2], padded[1] // 2 + 1), np.complex64)
        _transform(self.kernels, *shape, cut, found)
        even = len(cut) - self._odd
        return np.concatenate([np.real(found[:even]), np.imag(found[even:])])


@lru_cache(maxsize=256)
def padded_shape(shape: tuple[int, ...]) -> tuple[int, int]:
    """D and A of windows of (R, C): fast transforms without wrapping around."""
    rows, columns = (next_fast_len(2 * length - 1, True) for length in shape)
    return rows, columns


class Layer:
    """Linear response of one elastomer to pressure on a grid of square cells.

    pitch_mm: side of the cells. per_side: number of fine cells along each. The attributes are of
    the fine grid. A domed layer has further kernels, with weights that depend on the place. They
    are smooth over several cells and are applied on coarser nodes: cubic interpolation has an error
    of 1e-5 there. A copy or a pickle of a layer is the layer of the same arguments.
    """

    def __init__(self, elastomer: Elastomer, pitch_mm: float, per_side: int = 1) -> None:
        self._arguments = elastomer, pitch_mm, per_side
        self.elastomer = elastomer
        self.columns, self.rows = (per_side * count for count in elastomer.cells(pitch_mm))
        self.per_side = per_side
        self.per_node = per_side * (2 if 2 * pitch_mm <= NODE_MM + 1e-9 else 1)
        self.pitch_mm = pitch_mm = pitch_mm / per_side
        self.x_mm = (np.arange(self.columns) - (self.columns - 1) / 2) * pitch_mm
        self.y_mm = (np.arange(self.rows) - (self.rows - 1) / 2) * pitch_mm
        x, y = np.meshgrid(self.x_mm, self.y_mm)
        self.rest_mm = elastomer.rest_surface_mm(x, y)
        self.thickness_mm = elastomer.thickness_at_mm(x, y)
        kernel, smooth, self._weights, self._thickest = _kernels(self)
        self._kernel, self._smooth = WindowTransforms(kernel[None]), WindowTransforms(smooth)
        self._interpolation = interpolation(self.per_node)
        self._bounds: dict[tuple[int, ...], float] = {}
        self._coarse: dict[int, tuple[np.ndarray, np.ndarray, np.ndarray]] = {}
        thickest = float(self.thickness_mm.max())
        waves = np.linspace(1e-3, 10, 2000) / thickest
        of_waves = spectra(waves, thickest, elastomer.young_mpa, elastomer.poisson).normal
        self.max_compliance_mm_per_mpa = float(of_waves.max())

    def __reduce__(self) -> tuple[Any, ...]:
        return cached_layer, self._arguments

    def spring_mm_per_mpa(self, loaded: Window) -> float:
        """The pins' springs' compliance, mm/MPa: a share of the largest in a window."""
        shape = window_shape(loaded)
        if shape not in self._bounds:
            rows, columns = min(shape[0], self.rows) // 2 + 1, min(shape[1], self.columns) // 2 + 1
            near = self._thickest[
                self.rows - rows : self.rows + rows - 1,
                self.columns - columns : self.columns + columns - 1,
            ]
            self._bounds[shape] = min(self.max_compliance_mm_per_mpa, float(np.abs(near).sum()))
        return SPRING_SHARE * self._bounds[shape]

    def coarse(self, per_side: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """x, y, and the mean height at rest, (y, x), of cells of per_side x per_side, mm."""
        if per_side not in self._coarse:
            x, y = (axis.reshape(-1, per_side).mean(axis=1) for axis in (self.x_mm, self.y_mm))
            self._coarse[per_side] = x, y, block_means(self.rest_mm, per_side)
        return self._coarse[per_side]

    def deflection_mm(self, pressure_mpa: np.ndarray, window: Window | None = None) -> np.ndarray:
        """Surface deflection by the elastomer's law, mm, under a pressure, MPa.

        Both (rows, columns) in the window, whose sides are multiples of per_node; None is the whole
        grid. The pressure outside it is zero.
        """
        window = window or (slice(0, self.rows), slice(0, self.columns))
        operator = self.operator(window)
        padded = np.zeros_like(operator[-1][1])
        padded[:, : pressure_mpa.shape[1]] = pressure_mpa
        linear = np.empty(pressure_mpa.shape, np.float32)
        convolve(padded, *operator, linear)
        linear_mm = linear.astype(np.float64)
        if self.elastomer.law == "linear":
            return linear_mm
        return neo_hookean_mm(linear_mm, np.ascontiguousarray(self.thickness_mm[window]))

    def operator(self, window: Window) -> tuple[Any, ...]:
        """Arguments of `convolve` for a window, from kernel to work."""
        shape = window_shape(window)
        nodes = tuple(
            slice(side.start // self.per_node, side.stop // self.per_node + 2 * PADDING)
            for side in window
        )
        weights = np.ascontiguousarray(self._weights[:, *nodes])
        smooth, node_columns = NO_KERNELS, 0
        if len(weights):
            smooth = self._smooth.of(weights.shape[1:])
            node_columns = padded_shape(weights.shape[1:])[1]
        kernel = self._kernel.of(shape)[0]
        work = (
            np.empty(kernel.shape, np.complex64),
            np.empty((shape[0], padded_shape(shape)[1]), np.float32),
            np.zeros((weights.shape[1], node_columns), np.float32),
            *np.empty((2, *smooth.shape[1:]), np.complex64),
            np.empty(weights.shape[1:], np.float32),
            np.empty((weights.shape[1], shape[1]), np.float32),
        )
        return kernel, smooth, weights, *self._interpolation, work


DOWN, ALONG, BOTH = np.array([0]), np.array([1]), np.array([1, 2])  # axes of transforms
NO_KERNELS = np.zeros((0, 1, 1), np.float32)


@lru_cache(maxsize=16)
def cached_layer(elastomer: Elastomer, pitch_mm: float, per_side: int = 1) -> Layer:
    """The layer of an elastomer on a grid, see Layer, computed once per process."""
    return Layer(elastomer, pitch_mm, per_side)


def _kernels(layer: Layer) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """The kernel, the further ones on nodes and their weights, and the thickest place's kernel."""
    elastomer, pitch = layer.elastomer, layer.pitch_mm
    x, y = (np.arange(1 - size, size) * pitch for size in (layer.columns, layer.rows))
    half_space = half_space_deflection(elastomer, x, y, pitch)
    distance = np.hypot(x[None, :], y[:, None])
    # Of the nodes: distances from one of them, (2 M - 1, 2 N - 1), and the thickness, (M, N).
    x, y = (
        np.arange(1 - nodes, nodes) * layer.per_node * pitch
        for nodes in (side // layer.per_node + 2 * PADDING for side in (layer.columns, layer.rows))
    )
    # The second half of an axis has the distances from the first node.
    places = np.meshgrid(*(axis[axis.size // 2 :] - axis[-1] / 2 for axis in (x, y)))
    node_distance, at_nodes = np.hypot(x[None, :], y[:, None]), elastomer.thickness_at_mm(*places)
    radii = np.linspace(0.0, float(node_distance.max()), HANKEL_RADII)

    def kernel_of(profile: np.ndarray, distance_mm: np.ndarray) -> np.ndarray:
        return pitch**2 * cubic_spline(radii, profile, distance_mm)

    thickness = layer.thickness_mm
    thinnest, thickest = float(thickness.min()), float(thickness.max())
    if thickest - thinnest < 1e-6:
        profile = base_part(elastomer, np.array([thickest]), radii, pitch, False)[0, 0]
        kernel = half_space + kernel_of(profile, distance)
        return kernel.astype(np.float32), NO_KERNELS, np.zeros((0, *at_nodes.shape), "f4"), kernel
    levels = np.linspace(thinnest, thickest, THICKNESSES)
    profiles = base_part(elastomer, levels, radii, pitch, False)[0]
    nearest = np.rint((thickness - thinnest) / (levels[1] - levels[0])).astype(int)
    shares = np.bincount(nearest.ravel(), minlength=THICKNESSES) / nearest.size
    mean = shares @ profiles
    ring = np.sqrt(radii + pitch)
    deviations = (profiles - mean) * ring
    _, _, axes = np.linalg.svd(np.sqrt(shares)[:, None] * deviations, full_matrices=False)
    axes = axes[:COMPONENTS]
    scores, inside = deviations @ axes.T, at_nodes.clip(thinnest, thickest)
    smooth = np.stack([kernel_of(each, node_distance) for each in axes / ring])
    weights = np.stack([cubic_spline(levels, each, inside) for each in scores.T])
    return (
        (half_space + kernel_of(mean, distance)).astype(np.float32),
        smooth.astype(np.float32),
        np.ascontiguousarray(weights, np.float32),
        half_space + kernel_of(profiles[-1], distance),
    )


@dataclass(frozen=True)
class DomedLayer:
    """A layer under shear whose thickness varies from place to place.

    Each place responds as a layer of its thickness, to first order in the difference from the
    thickness at the middle of the contact. The transforms are those of `shear_kernels`.
    """

    middle: WindowTransforms  # of a layer as thick as at the middle
    slope: WindowTransforms | None  # change per mm of thickness; None for a flat layer
    excess_mm: np.ndarray  # (rows, columns) thickness above that of the middle
    full_mpa: float = np.inf  # see Elastomer.full_mpa
    middle_mm: float | None = None  # thickness at the middle; None for a flat layer

    def window(self, window: Window) -> "DomedLayer":
        """The same layer on a part of the grid."""
        return replace(self, excess_mm=self.excess_mm[window])

    def response_mm(self, traction_mpa: np.ndarray) -> np.ndarray:
        """(3, rows, columns) displacement along x, y and into the sensor, mm, by traction, MPa."""
        return self.parts_mm(traction_mpa).sum(axis=0)

    def spread_mm(self, pressure_mpa: np.ndarray) -> np.ndarray:
        """(2, rows, columns) displacement along x and y, mm, by pressure, MPa."""
        return self.parts_mm(np.minimum(pressure_mpa, self.full_mpa)[None], 2).sum(axis=0)

    def parts_mm(self, loads: np.ndarray, components: int = 3) -> np.ndarray:
        """(2, components, rows, columns) response of the layer of the middle to loads, mm, see
        `respond`, and what the dome adds."""
        loads = np.ascontiguousarray(loads, np.float32)
        shape, work = loads.shape[1:], shear_work(loads.shape[1:], len(loads))
        found = np.zeros((2, components, *shape), np.float32)
        respond(loads, self.middle.of(shape), work, False, found[0])
        if self.slope is not None:
            respond(loads, self.slope.of(shape), work, True, found[1])
        parts = found.astype(float)
        parts[1] *= self.excess_mm
        return parts


def domed_layer(
    elastomer: Elastomer, x_mm: np.ndarray, y_mm: np.ndarray, pressure: np.ndarray
) -> DomedLayer:
    """The layer under a contact with a pressure, (ny, nx), on the axes x_mm, (nx,), y_mm, (ny,)."""
    pitch, shape = float(x_mm[1] - x_mm[0]), pressure.shape
    thickness = _thickness_mm(elastomer, x_mm.tobytes(), y_mm.tobytes())
    if np.ptp(thickness) == 0:
        layer = cached_shear_layer(elastomer, elastomer.thickness_mm, pitch, shape)
        return DomedLayer(layer, None, thickness, elastomer.full_mpa)
    middle = float((pressure * thickness).sum() / pressure.sum())
    middle = max(round(middle / THICKNESS_STEP_MM), 2) * THICKNESS_STEP_MM
    layer = cached_shear_layer(elastomer, middle, pitch, shape)
    slope = _cached_slope(elastomer, middle, pitch, shape)
    return DomedLayer(layer, slope, thickness - middle, elastomer.full_mpa, middle)


def prepare_shear(elastomer: Elastomer, pitch_mm: float) -> None:
    """Compute the kernels of every thickness that `domed_layer` takes, so that no contact waits."""
    layer = cached_layer(elastomer, pitch_mm)
    steps = np.rint(layer.thickness_mm / THICKNESS_STEP_MM)
    for each in np.unique(steps):
        domed_layer(elastomer, layer.x_mm, layer.y_mm, steps == each)


@lru_cache(maxsize=8)
def _thickness_mm(elastomer: Elastomer, x_mm: bytes, y_mm: bytes) -> np.ndarray:
    """(ny, nx) thickness over axes of float64, mm."""
    return elastomer.thickness_at_mm(*np.meshgrid(np.frombuffer(x_mm), np.frombuffer(y_mm)))


@lru_cache(maxsize=MAX_LAYERS)
def cached_shear_layer(
    elastomer: Elastomer, thickness_mm: float, pitch_mm: float, largest: tuple[int, int]
) -> WindowTransforms:
    """Of a layer of one thickness for windows of up to `largest`, see `shear_kernels`."""
    return WindowTransforms(shear_kernels(elastomer, thickness_mm, *largest, pitch_mm), odd=2)


@lru_cache(maxsize=MAX_LAYERS)
def _cached_slope(
    elastomer: Elastomer, thickness_mm: float, pitch_mm: float, largest: tuple[int, int]
) -> WindowTransforms:
    """Change of a layer's response per mm of thickness, a central difference."""
    # The half-space's part does not depend on the thickness.
    thinner, thicker = (
        smooth_shear_kernels(elastomer, thickness_mm + step, *largest, pitch_mm)
        for step in (-THICKNESS_STEP_MM, THICKNESS_STEP_MM)
    )
    return WindowTransforms((thicker - thinner) / (2 * THICKNESS_STEP_MM), odd=2)


def shear_work(shape: tuple[int, ...], loads: int) -> tuple[np.ndarray, ...]:
    """Arrays that `respond` works in for a number of loads on (R, C)."""
    rows, (down, across) = shape[0], padded_shape(shape)
    half = across // 2 + 1
    return (
        np.zeros((rows, across), np.float32),
        np.empty((loads, down, half), np.complex64),
        np.empty((down, half), np.complex64),
        np.empty((rows, across), np.float32),
    )


def interpolation(per_node: int) -> tuple[np.ndarray, np.ndarray]:
    """Cubic interpolation from nodes at the centers of blocks of per_node cells to the cells.

    Returns for each cell of a block the first of its four nodes, (per_node,), counted from the
    block's node less PADDING, and their weights, (per_node, 4) float32.
    """
    place = (np.arange(per_node) + 0.5) / per_node - 0.5
    first = np.where(place < 0, 0, 1)
    u = place + (1 - first)
    weights = [
        -u * (u - 1) * (u - 2) / 6,
        (u + 1) * (u - 1) * (u - 2) / 2,
        -(u + 1) * u * (u - 2) / 2,
        (u + 1) * u * (u - 1) / 6,
    ]
    return first, np.ascontiguousarray(np.stack(weights, axis=1), np.float32)


@compiled(nogil=True)
def convolve(pressure, kernel, smooth, weights, first, taps, work, linear):
    """Write the response to a pressure, linear, (R, C) float32, mm.

    pressure: (R, A) float32, MPa, zero from column C on. kernel: (D, A // 2 + 1) transform. smooth:
    those of the further kernels on the nodes. weights: (kernels, M, N) of these. first, taps: see
    `interpolation`. work: see `Layer.operator`.
    """
    spectrum, back, node_pressure, node_spectrum, part, nodes, lines = work
    _forward(pressure, spectrum)
    _multiply(spectrum, kernel, spectrum)
    _back(spectrum, back)
    # Element by element: assigning an array compiles its error messages too, for seconds.
    for i in range(linear.shape[0]):
        for j in range(linear.shape[1]):
            linear[i, j] = back[i, j]
    if smooth.shape[0] == 0:
        return
    _to_nodes(pressure, first, taps, lines, node_pressure)
    _forward(node_pressure, node_spectrum)
    for k in range(smooth.shape[0]):
        _multiply(node_spectrum, smooth[k], part)
        _back(part, node_pressure)
        for i in range(nodes.shape[0]):
            for j in range(nodes.shape[1]):
                before = nodes[i, j] if k > 0 else np.float32(0.0)
                nodes[i, j] = before + weights[k, i, j] * node_pressure[i, j]
    _add_from_nodes(nodes, first, taps, lines, linear)


@compiled(nogil=True)
def _transform(kernels, rows, columns, cut, spectra):
    """Write the transforms of kernels around their central cell, for windows of rows x columns."""
    middle_row, middle_column = kernels.shape[1] // 2, kernels.shape[2] // 2
    for k in range(kernels.shape[0]):
        for i in range(1 - rows, rows):
            for j in range(1 - columns, columns):  # negative places are at the end
                cut[k, i, j] = kernels[k, middle_row + i, middle_column + j]
    r2c(cut, spectra, BOTH, True, 1.0, 1)


@compiled(nogil=True, **INNER)
def _forward(values, spectrum):
    """Write the transform of values, (R, A), followed by rows of zeros."""
    r2c(values, spectrum[: values.shape[0]], ALONG, True, 1.0, 1)
    for i in range(values.shape[0], spectrum.shape[0]):
        for j in range(spectrum.shape[1]):
            spectrum[i, j] = 0.0
    c2c(spectrum, spectrum, DOWN, True, 1.0, 1)


@compiled(nogil=True, **INNER)
def _back(spectrum, values):
    """Write the values, (R, A), of a transform, which is overwritten; inverse of `_forward`."""
    c2c(spectrum, spectrum, DOWN, False, 1.0, 1)
    scale = 1.0 / (spectrum.shape[0] * values.shape[1])
    c2r(spectrum[: values.shape[0]], values, ALONG, False, scale, 1)


@compiled(inline="always")
def _multiply(spectrum, kernel, product):
    for i in range(spectrum.shape[0]):
        for j in range(spectrum.shape[1]):
            value, factor = spectrum[i, j], kernel[i, j]
            product[i, j] = complex(value.real * factor, value.imag * factor)


@compiled(inline="always")
def _to_nodes(pressure, first, taps, lines, nodes):
    """Write the pressure, (R, >= C), distributed to the nodes, (M, >= N); lines: (M, C) work."""
    per_node, columns = first.size, lines.shape[1]
    lines.fill(0.0)
    for i in range(pressure.shape[0]):
        row, weights = i // per_node + first[i % per_node], taps[i % per_node]
        for t in range(4):
            for j in range(columns):
                lines[row + t, j] += weights[t] * pressure[i, j]
    nodes.fill(0.0)
    for i in range(lines.shape[0]):
        for block in range(columns // per_node):
            for cell in range(per_node):
                value, at = lines[i, block * per_node + cell], block + first[cell]
                for t in range(4):
                    nodes[i, at + t] += taps[cell, t] * value


@compiled(inline="always")
def _add_from_nodes(nodes, first, taps, lines, values):
    """Add the interpolated nodes, (M, N), to values, (R, C). lines: (M, C) work array."""
    per_node = first.size
    for i in range(lines.shape[0]):
        for block in range(lines.shape[1] // per_node):
            for cell in range(per_node):
                at, total = block + first[cell], np.float32(0.0)
                for t in range(4):
                    total += taps[cell, t] * nodes[i, at + t]
                lines[i, block * per_node + cell] = total
    for i in range(values.shape[0]):
        row, weights = i // per_node + first[i % per_node], taps[i % per_node]
        for j in range(values.shape[1]):
            values[i, j] += (
                weights[0] * lines[row, j]
                + weights[1] * lines[row + 1, j]
                + weights[2] * lines[row + 2, j]
                + weights[3] * lines[row + 3, j]
            )


@compiled(nogil=True)
def respond(loads, kernels, work, is_known, response):
    """Write the response of a layer, (2 or 3, rows, columns), mm, to traction along x and y,
    (2, rows, columns), or to pressure, (1, rows, columns), MPa.

    kernels: the layer's transforms. is_known: whether the work arrays have the transforms of
    these loads.
    """
    lines, spectra, spectrum, back = work
    if not is_known:
        for k in range(loads.shape[0]):
            for i in range(loads.shape[1]):
                for j in range(loads.shape[2]):
                    lines[i, j] = loads[k, i, j]
            _forward(lines, spectra[k])
    for k in range(response.shape[0]):
        if loads.shape[0] == 1:
            _by_pressure(kernels[3 + k], spectra[0], spectrum)
        else:
            first, second = kernels[(0, 1, 3)[k]], kernels[(1, 2, 4)[k]]
            _by_shear(first, second, spectra, k == 2, spectrum)
        _back(spectrum, back)
        for i in range(response.shape[1]):
            for j in range(response.shape[2]):
                response[k, i, j] = back[i, j]


@compiled(inline="always")
def _by_shear(first, second, traction, into, response):
    """Write the transform of a component of the response to a traction; into: of odd kernels."""
    for i in range(first.shape[0]):
        for j in range(first.shape[1]):
            a, b, x, y = first[i, j], second[i, j], traction[0, i, j], traction[1, i, j]
            real, imag = a * x.real + b * y.real, a * x.imag + b * y.imag
            response[i, j] = complex(-imag, real) if into else complex(real, imag)


@compiled(inline="always")
def _by_pressure(kernel, pressure, response):
    """Write the transform of the displacement by a pressure; see `_by_shear` (reciprocity)."""
    for i in range(kernel.shape[0]):
        for j in range(kernel.shape[1]):
            factor, value = kernel[i, j], pressure[i, j]
            response[i, j] = complex(factor * value.imag, -(factor * value.real))
