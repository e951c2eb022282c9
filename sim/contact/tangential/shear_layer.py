"""Response of an elastic layer's surface to tangential traction and pressure, on windows of a grid.

Convolutions with the kernels of `t2twin.sim.contact.tangential.kernels`, by Fourier transform.
"""

from collections import OrderedDict
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from threading import Lock

import numpy as np
from scipy import fft

from t2twin.core.jit import compiled
from t2twin.sim.contact.elastomer import Elastomer
from t2twin.sim.contact.grid import Window
from t2twin.sim.contact.tangential.kernels import Kernels, shear_kernels

MAX_TRANSFORMS = 20
"""Windows whose transforms are kept (assumed: those of a few paths)."""

MAX_SPREADING = 4.0
"""Pressure, over Young's modulus, above which a stiffening layer is not displaced further along its
surface (assumed: it is compressed to a third there). A linear response would displace the surface
around a tip by several cells."""

THICKNESS_STEP_MM = 0.25
"""Thicknesses at the middle of a contact with a domed layer are rounded to this, mm, so that few
kernels are computed (assumed)."""


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
        shape = traction_mpa.shape[1:]
        spectrum = _forward(traction_mpa)
        spectra = np.empty_like(spectrum)
        _by_shear(self.transforms(shape), spectrum, spectra)
        return _backward(spectra, shape)

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
    above that of the middle. max_mpa: largest pressure that displaces it along its surface.
    """

    middle: ShearLayer
    slope: ShearLayer | None
    excess_mm: np.ndarray
    max_mpa: float = np.inf

    def window(self, window: Window) -> "DomedLayer":
        """The same layer on a part of the grid."""
        return replace(self, excess_mm=self.excess_mm[window])

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
    most = np.inf if elastomer.law == "linear" else MAX_SPREADING * elastomer.young_mpa
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


@lru_cache(maxsize=16)
def cached_shear_layer(
    elastomer: Elastomer, thickness_mm: float, pitch_mm: float, largest: tuple[int, int]
) -> ShearLayer:
    """A layer of one thickness for windows of up to `largest` rows and columns, computed once per
    process."""
    return ShearLayer(shear_kernels(elastomer, thickness_mm, *largest, pitch_mm), pitch_mm)


@lru_cache(maxsize=16)
def _cached_slope(
    elastomer: Elastomer, thickness_mm: float, pitch_mm: float, largest: tuple[int, int]
) -> ShearLayer:
    """Change of a layer's response per mm of thickness, a central difference."""
    thinner, thicker = (
        shear_kernels(elastomer, thickness_mm + step, *largest, pitch_mm)
        for step in (-THICKNESS_STEP_MM, THICKNESS_STEP_MM)
    )
    slope = [(b - a) / (2 * THICKNESS_STEP_MM) for a, b in zip(thinner, thicker, strict=True)]
    return ShearLayer(Kernels(*slope), pitch_mm)


def responses_mm(layers: Sequence[ShearLayer], traction_mpa: np.ndarray) -> np.ndarray:
    """(layers, 3, rows, columns) responses of layers; see ShearLayer.response_mm."""
    shape = traction_mpa.shape[1:]
    spectrum = _forward(traction_mpa)
    spectra = np.empty((len(layers), 3, *spectrum.shape[1:]), np.complex64)
    for layer, response in zip(layers, spectra, strict=True):
        _by_shear(layer.transforms(shape), spectrum, response)
    return _backward(spectra, shape)


def spreads_mm(layers: Sequence[ShearLayer], pressure_mpa: np.ndarray) -> np.ndarray:
    """(layers, 2, rows, columns) displacement by pressure; see ShearLayer.spread_mm."""
    shape = pressure_mpa.shape
    spectrum = _forward(pressure_mpa)
    spectra = np.empty((len(layers), 2, *spectrum.shape), np.complex64)
    for layer, spread in zip(layers, spectra, strict=True):
        _by_pressure(layer.transforms(shape), spectrum, spread)
    return _backward(spectra, shape)


@compiled("void(f4[:, :, ::1], c8[:, :, ::1], c8[:, :, ::1])", nogil=True)
def _by_shear(kernels, traction, response):
    """Write the transform of a response, whose last component is optional, to a traction."""
    for i in range(kernels.shape[1]):
        for j in range(kernels.shape[2]):
            x, y = traction[0, i, j], traction[1, i, j]
            response[0, i, j] = kernels[0, i, j] * x + kernels[1, i, j] * y
            response[1, i, j] = kernels[1, i, j] * x + kernels[2, i, j] * y
            if response.shape[0] == 3:
                into = kernels[3, i, j] * x + kernels[4, i, j] * y
                response[2, i, j] = complex(-into.imag, into.real)


@compiled("void(f4[:, :, ::1], c8[:, ::1], c8[:, :, ::1])", nogil=True)
def _by_pressure(kernels, pressure, spread):
    """Write the transform of the displacement by a pressure: by reciprocity, minus that of the
    deflection by traction."""
    for i in range(kernels.shape[1]):
        for j in range(kernels.shape[2]):
            turned = complex(pressure[i, j].imag, -pressure[i, j].real)
            spread[0, i, j] = kernels[3, i, j] * turned
            spread[1, i, j] = kernels[4, i, j] * turned


def _forward(values: np.ndarray) -> np.ndarray:
    """Transforms over the last two axes; rows of zeros are not transformed."""
    rows, columns = _padded(values.shape[-2:])
    along = fft.rfft(values.astype(np.float32, copy=False), columns)
    return np.asarray(fft.fft(along, rows, axis=-2, overwrite_x=True))


def _backward(spectra: np.ndarray, shape: tuple[int, ...]) -> np.ndarray:
    """The window's part of the inverse transforms; the other rows are not transformed."""
    rows, columns = shape
    kept = np.asarray(fft.ifft(spectra, axis=-2, overwrite_x=True))[..., :rows, :]
    return np.asarray(fft.irfft(kept, _padded(shape)[1]))[..., :columns]


@lru_cache(maxsize=64)
def _padded(shape: tuple[int, ...]) -> tuple[int, int]:
    """Numbers of rows and columns with fast transforms and without wrapping around."""
    rows, columns = (fft.next_fast_len(2 * length - 1, real=True) for length in shape)
    return int(rows or 1), int(columns or 1)
