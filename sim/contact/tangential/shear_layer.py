"""Response of an elastic layer's surface to tangential traction and pressure, on windows of a grid.

Convolutions with the kernels of `t2twin.sim.contact.tangential.kernels`, by Fourier transform.
"""

from collections import OrderedDict
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from threading import Lock

import numpy as np
from rocket_fft import c2c, c2r, r2c
from scipy import fft

from t2twin.core.jit import INNER, compiled
from t2twin.sim.contact.elastomer import Elastomer
from t2twin.sim.contact.grid import Window
from t2twin.sim.contact.tangential.kernels import Kernels, shear_kernels, smooth_kernels

MAX_TRANSFORMS = 20
"""Windows whose transforms are kept (assumed: those of a few paths)."""

FULL_PRESSURE = 4.0
"""Pressure, over Young's modulus, above which neither the friction of a stiffening layer nor its
displacement along the surface increases (assumed: it is compressed to a third there). Friction is
proportional to the area of real contact, which pressure does not increase beyond full contact
(Trejo, Fretigny and Chateauminois, arXiv 1701.08013). A linear response would displace the surface
around a tip by several cells, and under an edge that is pressed almost through by several
thicknesses."""

THICKNESS_STEP_MM = 0.25
"""Thicknesses at the middle of a contact with a domed layer are rounded to this, mm, so that few
kernels are computed (assumed)."""

MAX_LAYERS = 32
"""Layers that are kept (assumed: the thicknesses of two domed gels)."""


class ShearLayer:
    """Response of a layer's surface to tangential traction, on windows of a grid.

    kernels: of the layer, on a grid of at least the size of every window.
    """

    def __init__(self, kernels: Kernels, pitch_mm: float) -> None:
        self.pitch_mm = pitch_mm
        self._kernels = kernels
        self._transforms: OrderedDict[tuple[int, ...], np.ndarray] = OrderedDict()
        self._lock = Lock()  # threads share a layer

    def displacement_mm(self, traction_mpa: np.ndarray) -> np.ndarray:
        """(2, rows, columns) displacement along x and y, mm, by traction along x and y, MPa."""
        return _responses((self,), traction_mpa, 2)[0]

    def compliance_mm_per_mpa(self, side: int) -> float:
        """Mean displacement per uniform traction on a square of side x side cells, mm/MPa."""
        rows, columns = (length // 2 for length in self._kernels.xx.shape)
        along = np.maximum(side - np.abs(np.arange(-rows, rows + 1)), 0)
        across = np.maximum(side - np.abs(np.arange(-columns, columns + 1)), 0)
        return float((along[:, None] * across * self._kernels.xx).sum() / side**2)

    def response_mm(self, traction_mpa: np.ndarray) -> np.ndarray:
        """(3, rows, columns) displacement along x, along y and into the sensor, mm, by traction
        along x and y, (2, rows, columns), MPa."""
        return responses_mm((self,), traction_mpa)[0]

    def spread_mm(self, pressure_mpa: np.ndarray) -> np.ndarray:
        """(2, rows, columns) displacement along x and y, mm, by pressure, MPa."""
        return spreads_mm((self,), pressure_mpa)[0]

    def transforms(self, shape: tuple[int, ...]) -> np.ndarray:
        """Transforms of the kernels for a window of (rows, columns), (5, *padded) float32; the last
        windows' are cached.

        Those of xx, xy and yy, which are even, are real. Those of xz and yz, which are odd, are
        imaginary; these are the imaginary parts.
        """
        rows, columns = shape
        with self._lock:
            if shape in self._transforms:
                self._transforms.move_to_end(shape)
                return self._transforms[shape]
        padded = _padded(shape)
        offset_rows, offset_columns = np.arange(1 - rows, rows), np.arange(1 - columns, columns)
        to = np.ix_(offset_rows % padded[0], offset_columns % padded[1])
        middle = [length // 2 for length in self._kernels.xx.shape]
        of = np.ix_(offset_rows + middle[0], offset_columns + middle[1])
        cut = np.zeros((len(self._kernels), *padded), np.float32)
        for target, kernel in zip(cut, self._kernels, strict=True):
            target[to] = kernel[of]
        spectra = np.asarray(fft.rfft2(cut))
        transforms = np.concatenate([np.real(spectra[:3]), np.imag(spectra[3:])])
        with self._lock:
            self._transforms[shape] = transforms
            while len(self._transforms) > MAX_TRANSFORMS:
                self._transforms.popitem(last=False)
        return transforms


@dataclass(frozen=True)
class DomedLayer:
    """A layer whose thickness varies from place to place.

    Each place responds as a layer of its thickness, to first order in the difference from the
    thickness at the middle of the contact. middle: the layer of that thickness. slope: change of
    its response per mm of thickness; None for a flat layer. excess_mm: (rows, columns) thickness
    above that of the middle. max_mpa: pressure above which neither friction nor the displacement
    along its surface increases.
    """

    middle: ShearLayer
    slope: ShearLayer | None
    excess_mm: np.ndarray
    max_mpa: float = np.inf

    def window(self, window: Window) -> "DomedLayer":
        """The same layer on a part of the grid."""
        return replace(self, excess_mm=self.excess_mm[window])

    def limit_mpa(self, friction: float | np.ndarray, pressure_mpa: np.ndarray) -> np.ndarray:
        """The largest traction that friction can carry under a pressure, (rows, columns), MPa."""
        return friction * np.minimum(pressure_mpa, self.max_mpa)

    def response_mm(self, traction_mpa: np.ndarray) -> np.ndarray:
        """See ShearLayer.response_mm."""
        middle, dome = self.parts_mm(traction_mpa)
        return middle + dome

    def parts_mm(self, traction_mpa: np.ndarray) -> np.ndarray:
        """(2, 3, rows, columns) the response in two parts, mm: that of the layer of the middle, and
        what the dome adds."""
        if self.slope is None:
            response = self.middle.response_mm(traction_mpa).astype(float)
            return np.stack([response, np.zeros_like(response)])
        parts = responses_mm((self.middle, self.slope), traction_mpa).astype(float)
        parts[1] *= self.excess_mm
        return parts

    def spread_mm(self, pressure_mpa: np.ndarray) -> np.ndarray:
        """See ShearLayer.spread_mm."""
        pressure_mpa = np.minimum(pressure_mpa, self.max_mpa)
        if self.slope is None:
            return self.middle.spread_mm(pressure_mpa).astype(float)
        middle, slope = spreads_mm((self.middle, self.slope), pressure_mpa)
        return middle + self.excess_mm * slope


def domed_layer(
    elastomer: Elastomer, x_mm: np.ndarray, y_mm: np.ndarray, pressure: np.ndarray
) -> DomedLayer:
    """The layer under a contact with a pressure, (ny, nx), on the axes x_mm, (nx,), y_mm, (ny,)."""
    pitch, shape = float(x_mm[1] - x_mm[0]), pressure.shape
    thickness = _thickness_mm(elastomer, x_mm.tobytes(), y_mm.tobytes())
    middle = float((pressure * thickness).sum() / pressure.sum())
    middle = max(round(middle / THICKNESS_STEP_MM), 2) * THICKNESS_STEP_MM
    most = np.inf if elastomer.law == "linear" else FULL_PRESSURE * elastomer.young_mpa
    if np.ptp(thickness) == 0:
        layer = cached_shear_layer(elastomer, elastomer.thickness_mm, pitch, shape)
        return DomedLayer(layer, None, thickness, most)
    return DomedLayer(
        cached_shear_layer(elastomer, middle, pitch, shape),
        _cached_slope(elastomer, middle, pitch, shape),
        thickness - middle,
        most,
    )


@lru_cache(maxsize=8)
def _thickness_mm(elastomer: Elastomer, x_mm: bytes, y_mm: bytes) -> np.ndarray:
    """(ny, nx) thickness over axes of float64, mm."""
    return elastomer.thickness_at_mm(*np.meshgrid(np.frombuffer(x_mm), np.frombuffer(y_mm)))


@lru_cache(maxsize=MAX_LAYERS)
def cached_shear_layer(
    elastomer: Elastomer, thickness_mm: float, pitch_mm: float, largest: tuple[int, int]
) -> ShearLayer:
    """A layer of one thickness for windows of up to `largest` rows and columns, computed once per
    process."""
    return ShearLayer(shear_kernels(elastomer, thickness_mm, *largest, pitch_mm), pitch_mm)


@lru_cache(maxsize=MAX_LAYERS)
def _cached_slope(
    elastomer: Elastomer, thickness_mm: float, pitch_mm: float, largest: tuple[int, int]
) -> ShearLayer:
    """Change of a layer's response per mm of thickness, a central difference."""
    # The half-space's part does not depend on the thickness.
    thinner, thicker = (
        smooth_kernels(elastomer, thickness_mm + step, *largest, pitch_mm)
        for step in (-THICKNESS_STEP_MM, THICKNESS_STEP_MM)
    )
    slope = [(b - a) / (2 * THICKNESS_STEP_MM) for a, b in zip(thinner, thicker, strict=True)]
    return ShearLayer(Kernels(*slope), pitch_mm)


def responses_mm(layers: Sequence[ShearLayer], traction_mpa: np.ndarray) -> np.ndarray:
    """(layers, 3, rows, columns) responses of layers; see ShearLayer.response_mm."""
    return _responses(layers, traction_mpa, 3)


def spreads_mm(layers: Sequence[ShearLayer], pressure_mpa: np.ndarray) -> np.ndarray:
    """(layers, 2, rows, columns) displacement by pressure; see ShearLayer.spread_mm."""
    return _responses(layers, pressure_mpa[None], 2)


def _responses(layers: Sequence[ShearLayer], loads: np.ndarray, components: int) -> np.ndarray:
    """(layers, components, rows, columns) responses to loads, see `respond`."""
    loads = np.ascontiguousarray(loads, np.float32)
    shape = loads.shape[1:]
    found = np.empty((len(layers), components, *shape), np.float32)
    work = work_arrays(shape, len(loads))
    for number, (layer, response) in enumerate(zip(layers, found, strict=True)):
        respond(loads, layer.transforms(shape), work, number > 0, response)
    return found


def work_arrays(shape: tuple[int, ...], loads: int) -> tuple[np.ndarray, ...]:
    """Arrays that `respond` works in, of types WORK, for a number of loads on (rows, columns)."""
    (rows, _), (down, across) = shape, _padded(shape)
    half = across // 2 + 1
    return (
        np.zeros((rows, across), np.float32),
        np.empty((rows, half), np.complex64),
        np.empty((loads, down, half), np.complex64),
        np.empty((down, half), np.complex64),
        np.empty((rows, across), np.float32),
    )


WORK = "Tuple((f4[:, ::1], c8[:, ::1], c8[:, :, ::1], c8[:, ::1], f4[:, ::1]))"
KERNELS = "f4[:, :, ::1]"
"""Types of what `work_arrays` and `ShearLayer.transforms` return."""


@compiled(f"void(f4[:, :, ::1], {KERNELS}, {WORK}, b1, f4[:, :, ::1])", nogil=True)
def respond(loads, kernels, work, is_known, response):
    """Write the response of a layer, (2 or 3, rows, columns), mm, to traction along x and y,
    (2, rows, columns), or to pressure, (1, rows, columns), MPa.

    kernels: see ShearLayer.transforms. is_known: whether the work arrays have the transforms of
    these loads.
    """
    lines, rows, spectra, spectrum, back = work
    along, down = np.array([1]), np.array([0])
    if not is_known:
        for k in range(loads.shape[0]):
            for i in range(loads.shape[1]):
                for j in range(loads.shape[2]):
                    lines[i, j] = loads[k, i, j]
            r2c(lines, rows, along, True, 1.0, 1)
            c2c(rows, spectra[k], down, True, 1.0, 1)
    scale = 1.0 / (spectrum.shape[0] * lines.shape[1])
    for k in range(response.shape[0]):
        if loads.shape[0] == 1:
            _by_pressure(kernels[3 + k], spectra[0], spectrum)
        else:
            first, second = kernels[(0, 1, 3)[k]], kernels[(1, 2, 4)[k]]
            _by_shear(first, second, spectra, k == 2, spectrum)
        c2c(spectrum, spectrum, down, False, 1.0, 1)
        c2r(spectrum[: rows.shape[0]], back, along, False, scale, 1)
        for i in range(response.shape[1]):
            for j in range(response.shape[2]):
                response[k, i, j] = back[i, j]


@compiled(nogil=True, **INNER)
def _by_shear(first, second, traction, into, response):
    """Write the transform of a component of the response to a traction. first, second: the
    kernels of the traction along x and y. into: whether they are odd."""
    for i in range(first.shape[0]):
        for j in range(first.shape[1]):
            value = first[i, j] * traction[0, i, j] + second[i, j] * traction[1, i, j]
            response[i, j] = complex(-value.imag, value.real) if into else value


@compiled(nogil=True, **INNER)
def _by_pressure(kernel, pressure, response):
    """Write the transform of the displacement by a pressure: by reciprocity, minus that of the
    deflection by traction."""
    for i in range(kernel.shape[0]):
        for j in range(kernel.shape[1]):
            value = kernel[i, j] * pressure[i, j]
            response[i, j] = complex(value.imag, -value.real)


@lru_cache(maxsize=64)
def _padded(shape: tuple[int, ...]) -> tuple[int, int]:
    """Numbers of rows and columns with fast transforms and without wrapping around."""
    rows, columns = (fft.next_fast_len(2 * length - 1, real=True) for length in shape)
    return int(rows or 1), int(columns or 1)
