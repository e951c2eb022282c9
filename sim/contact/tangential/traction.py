"""Tangential traction of a contact with dry friction, in one step of its motion.

Kalker's problem (Three-Dimensional Elastic Bodies in Rolling Contact, 1990): among the tractions
that nowhere exceed friction times pressure, that of the contact minimizes

    1/2 q . A q - q . w

with A the layer's tangential compliance and w the displacement that the shape would give the
surface without slip. Where the traction is below its limit the surface sticks, A q = w. Elsewhere
the shape slips over it, along the traction. The problem is convex, so its solution is unique.
"""

from collections import OrderedDict
from functools import lru_cache
from threading import Lock
from typing import NamedTuple

import numpy as np
from scipy import fft

from t2twin.sim.contact.elastomer import Elastomer
from t2twin.sim.contact.tangential.kernels import Kernels, shear_kernels

TOLERANCE = 1e-4
"""Convergence: largest residual of the slip condition over the largest wanted displacement."""

MAX_STEPS = 500
"""Limit on the steps of the minimization (assumed: twenty times as many as presses need)."""

STEPS_BACK = 6
"""Values of the energy above whose maximum a step may not end (Grippo, Lampariello and Lucidi
1986)."""

MAX_TRANSFORMS = 20
"""Windows whose transforms are kept (assumed: those of a few paths)."""


class Traction(NamedTuple):
    """The result of one step. q_mpa: (2, rows, columns), along x and y. displacement_mm: (2, rows,
    columns), of the surface by it. residual: see TOLERANCE. steps: of the minimization."""

    q_mpa: np.ndarray
    displacement_mm: np.ndarray
    residual: float
    steps: int

    @property
    def converged(self) -> bool:
        return self.residual <= TOLERANCE


class ShearLayer:
    """Displacement of a layer's surface by tangential traction, on windows of a grid.

    The layer has one thickness; `largest` is the number of rows and columns of the largest window.
    """

    def __init__(
        self, elastomer: Elastomer, thickness_mm: float, pitch_mm: float, largest: tuple[int, int]
    ) -> None:
        self.pitch_mm = pitch_mm
        self._largest = largest
        self._kernels = shear_kernels(elastomer, thickness_mm, *largest, pitch_mm)
        self._transforms: OrderedDict[tuple[int, int], Kernels] = OrderedDict()
        self._lock = Lock()  # threads share a layer

    def displacement_mm(self, traction_mpa: np.ndarray) -> np.ndarray:
        """(2, rows, columns) displacement along x and y, mm, by traction along x and y, MPa."""
        shape = traction_mpa.shape[1:]
        kernels = self._transform(shape)
        x, y = self._forward(traction_mpa)
        return self._backward(
            np.stack([kernels.xx * x + kernels.xy * y, kernels.xy * x + kernels.yy * y]), shape
        )

    def deflection_mm(self, traction_mpa: np.ndarray) -> np.ndarray:
        """(rows, columns) deflection into the sensor, mm, by traction along x and y, MPa."""
        shape = traction_mpa.shape[1:]
        kernels = self._transform(shape)
        x, y = self._forward(traction_mpa)
        return self._backward((kernels.xz * x + kernels.yz * y)[None], shape)[0]

    def spread_mm(self, pressure_mpa: np.ndarray) -> np.ndarray:
        """(2, rows, columns) displacement along x and y, mm, by pressure, MPa."""
        shape = pressure_mpa.shape
        kernels = self._transform(shape)
        (pressure,) = self._forward(pressure_mpa[None])
        # By reciprocity; the kernels are odd.
        return self._backward(-np.stack([kernels.xz, kernels.yz]) * pressure, shape)

    def _forward(self, values: np.ndarray) -> np.ndarray:
        return np.asarray(fft.rfft2(values.astype(np.float32), _padded(values.shape[1:])))

    def _backward(self, spectrum: np.ndarray, shape: tuple[int, ...]) -> np.ndarray:
        values = np.asarray(fft.irfft2(spectrum, _padded(shape)))
        return values[:, : shape[0], : shape[1]]

    def _transform(self, shape: tuple[int, ...]) -> Kernels:
        """Transforms of the kernels for a window of (rows, columns); the last are cached."""
        rows, columns = shape
        with self._lock:
            if (rows, columns) in self._transforms:
                self._transforms.move_to_end((rows, columns))
                return self._transforms[rows, columns]
        padded = _padded(shape)
        offset_rows, offset_columns = np.arange(1 - rows, rows), np.arange(1 - columns, columns)
        to = np.ix_(offset_rows % padded[0], offset_columns % padded[1])
        of = np.ix_(offset_rows + self._largest[0] - 1, offset_columns + self._largest[1] - 1)
        cut = np.zeros((len(self._kernels), *padded), np.float32)
        for target, kernel in zip(cut, self._kernels, strict=True):
            target[to] = kernel[of]
        transforms = Kernels(*np.asarray(fft.rfft2(cut)))
        with self._lock:
            self._transforms[rows, columns] = transforms
            while len(self._transforms) > MAX_TRANSFORMS:
                self._transforms.popitem(last=False)
        return transforms


@lru_cache(maxsize=8)
def cached_shear_layer(
    elastomer: Elastomer, thickness_mm: float, pitch_mm: float, largest: tuple[int, int]
) -> ShearLayer:
    """A layer, see ShearLayer, computed once per process."""
    return ShearLayer(elastomer, thickness_mm, pitch_mm, largest)


def _padded(shape: tuple[int, ...]) -> tuple[int, int]:
    """Numbers of rows and columns with fast transforms and without wrapping around."""
    rows, columns = (fft.next_fast_len(2 * length - 1, real=True) for length in shape)
    return int(rows or 1), int(columns or 1)


def solve_traction(
    layer: ShearLayer, limit_mpa: np.ndarray, wanted_mm: np.ndarray, start_mpa: np.ndarray
) -> Traction:
    """The traction of one step.

    limit_mpa: (rows, columns) friction times pressure, 0 outside the contact. wanted_mm: (2, rows,
    columns) w. start_mpa: (2, rows, columns) an initial guess, such as the last step's traction.

    Spectral projected gradients (Birgin, Martinez, Raydan 2000).
    """
    limit = limit_mpa.astype(np.float32)
    inside = limit > 0
    wanted = np.where(inside, wanted_mm, 0.0).astype(np.float32)
    scale = max(float(np.abs(wanted).max()), 1e-9)
    q = project(start_mpa.astype(np.float32), limit)
    displacement = layer.displacement_mm(q)
    gradient = np.where(inside, displacement - wanted, 0)
    energy = _energy(q, displacement, wanted)
    energies = [energy]
    length = 1.0 / _typical_compliance(layer, inside)
    steps = 0
    while (residual := _residual(q, gradient, limit, length) / scale) > TOLERANCE:
        if steps == MAX_STEPS:
            break
        steps += 1
        direction = project(q - length * gradient, limit) - q
        moved = layer.displacement_mm(direction)
        slope, curvature = _dot(gradient, direction), _dot(direction, moved)
        # The energy is quadratic, so the best fraction of the step is known.
        fraction = 1.0
        if energy + slope + curvature / 2 > max(energies[-STEPS_BACK:]):
            fraction = min(1.0, -slope / curvature)
        q = q + np.float32(fraction) * direction
        displacement = displacement + np.float32(fraction) * moved
        gradient = np.where(inside, displacement - wanted, 0)
        energy += fraction * slope + fraction**2 * curvature / 2
        energies.append(energy)
        length = _dot(direction, direction) / max(curvature, 1e-30)
    return Traction(q.astype(float), displacement.astype(float), residual, steps)


def project(traction: np.ndarray, limit: np.ndarray) -> np.ndarray:
    """The nearest traction whose magnitude is at most the limit at each place."""
    magnitude = np.hypot(traction[0], traction[1])
    return traction * (limit / np.maximum(magnitude, np.maximum(limit, 1e-30)))


def _residual(q: np.ndarray, gradient: np.ndarray, limit: np.ndarray, length: float) -> float:
    return float(np.abs(project(q - length * gradient, limit) - q).max()) / length


def _energy(q: np.ndarray, displacement: np.ndarray, wanted: np.ndarray) -> float:
    return _dot(q, displacement) / 2 - _dot(q, wanted)


def _dot(a: np.ndarray, b: np.ndarray) -> float:
    return float(np.vdot(a.astype(np.float64), b))


def _typical_compliance(layer: ShearLayer, inside: np.ndarray) -> float:
    """Displacement per uniform traction on the contact, mm/MPa, for the first step's length."""
    ones = np.stack([inside, np.zeros_like(inside)]).astype(np.float32)
    return float(layer.displacement_mm(ones)[0][inside].mean())
