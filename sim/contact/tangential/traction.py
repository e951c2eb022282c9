"""Tangential traction of a contact with dry friction, in one step of its motion.

Kalker's problem (Three-Dimensional Elastic Bodies in Rolling Contact, 1990): among the tractions
that nowhere exceed friction times pressure, that of the contact minimizes

    1/2 q . A q - q . w

with A the layer's tangential compliance and w the displacement that the shape would give the
surface without slip. Where the traction is below its limit the surface sticks, A q = w. Elsewhere
the shape slips over it, along the traction. The problem is convex, so its solution is unique.
"""

from collections import OrderedDict
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import lru_cache
from threading import Lock
from typing import NamedTuple

import numpy as np
from scipy import fft

from t2twin.core.jit import compiled
from t2twin.sim.contact.elastomer import Elastomer
from t2twin.sim.contact.grid import Window
from t2twin.sim.contact.tangential.kernels import Kernels, shear_kernels

TOLERANCE = 3e-4
"""Convergence: largest residual of the slip condition over the largest wanted displacement."""

MAX_STEPS = 500
"""Limit on the steps of the minimization (assumed: twenty times as many as presses need)."""

STEPS_BACK = 6
"""Values of the energy above whose maximum a step may not end (Grippo, Lampariello and Lucidi
1986)."""

MAX_TRANSFORMS = 20
"""Windows whose transforms are kept (assumed: those of a few paths)."""

THICKNESS_STEP_MM = 0.25
"""Thicknesses at the middle of a contact with a domed layer are rounded to this, mm, so that few
kernels are computed (assumed)."""


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
    """Response of a layer's surface to tangential traction, on windows of a grid.

    kernels: of the layer, on a grid of at least the size of every window.
    """

    def __init__(self, kernels: Kernels, pitch_mm: float) -> None:
        self.pitch_mm = pitch_mm
        self._kernels = kernels
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

    def response_mm(self, traction_mpa: np.ndarray) -> np.ndarray:
        """(3, rows, columns) displacement along x, along y and into the sensor, mm, by traction
        along x and y, (2, rows, columns), MPa."""
        return responses_mm((self,), traction_mpa)[0]

    def spread_mm(self, pressure_mpa: np.ndarray) -> np.ndarray:
        """(2, rows, columns) displacement along x and y, mm, by pressure, MPa."""
        shape = pressure_mpa.shape
        kernels = self._transform(shape)
        (pressure,) = self._forward(pressure_mpa[None])
        # By reciprocity; the kernels are odd.
        return self._backward(-np.stack([kernels.xz, kernels.yz]) * pressure, shape)

    def _forward(self, values: np.ndarray) -> np.ndarray:
        return np.asarray(fft.rfft2(values.astype(np.float32), _padded(values.shape[1:])))

    def _backward(self, spectrum: np.ndarray, shape: tuple[int, int]) -> np.ndarray:
        rows, columns = shape
        padded_columns = _padded(shape)[1]
        # Only the rows that are kept are transformed along the columns.
        kept = np.asarray(fft.ifft(spectrum, axis=1))[:, :rows]
        return np.asarray(fft.irfft(kept, padded_columns))[:, :, :columns]

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
        middle = [length // 2 for length in self._kernels.xx.shape]
        of = np.ix_(offset_rows + middle[0], offset_columns + middle[1])
        cut = np.zeros((len(self._kernels), *padded), np.float32)
        for target, kernel in zip(cut, self._kernels, strict=True):
            target[to] = kernel[of]
        transforms = Kernels(*np.asarray(fft.rfft2(cut)))
        with self._lock:
            self._transforms[rows, columns] = transforms
            while len(self._transforms) > MAX_TRANSFORMS:
                self._transforms.popitem(last=False)
        return transforms


@dataclass(frozen=True)
class DomedLayer:
    """A layer whose thickness varies from place to place.

    Each place responds as a layer of its thickness, to first order in the difference from the
    thickness at the middle of the contact. middle: the layer of that thickness. slope: change of
    its response per mm of thickness; None for a flat layer. excess_mm: (rows, columns) thickness
    above that of the middle.
    """

    middle: ShearLayer
    slope: ShearLayer | None
    excess_mm: np.ndarray

    def window(self, window: Window) -> "DomedLayer":
        """The same layer on a part of the grid."""
        return DomedLayer(self.middle, self.slope, self.excess_mm[window])

    def response_mm(self, traction_mpa: np.ndarray) -> np.ndarray:
        """See ShearLayer.response_mm."""
        middle, dome = self.parts_mm(traction_mpa)
        return middle + dome

    def parts_mm(self, traction_mpa: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """The response in two parts, each (3, rows, columns), mm: that of the layer of the middle,
        and what the dome adds."""
        if self.slope is None:
            response = self.middle.response_mm(traction_mpa).astype(float)
            return response, np.zeros_like(response)
        middle, slope = responses_mm((self.middle, self.slope), traction_mpa)
        return middle.astype(float), self.excess_mm * slope

    def spread_mm(self, pressure_mpa: np.ndarray) -> np.ndarray:
        """See ShearLayer.spread_mm."""
        spread = self.middle.spread_mm(pressure_mpa)
        if self.slope is None:
            return spread
        return spread + self.excess_mm * self.slope.spread_mm(pressure_mpa)


def domed_layer(
    elastomer: Elastomer, x_mm: np.ndarray, y_mm: np.ndarray, pressure: np.ndarray
) -> DomedLayer:
    """The layer under a contact with a pressure, (ny, nx), on the axes x_mm, (nx,), y_mm, (ny,)."""
    pitch, shape = float(x_mm[1] - x_mm[0]), pressure.shape
    thickness = _thickness_mm(elastomer, x_mm.tobytes(), y_mm.tobytes())
    middle = float((pressure * thickness).sum() / pressure.sum())
    middle = max(round(middle / THICKNESS_STEP_MM), 2) * THICKNESS_STEP_MM
    if np.ptp(thickness) == 0:
        layer = cached_shear_layer(elastomer, elastomer.thickness_mm, pitch, shape)
        return DomedLayer(layer, None, thickness)
    return DomedLayer(
        cached_shear_layer(elastomer, middle, pitch, shape),
        _cached_slope(elastomer, middle, pitch, shape),
        thickness - middle,
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
    x, y = layers[0]._forward(traction_mpa)
    spectrum = np.stack(
        [
            part
            for kernels in (layer._transform(shape) for layer in layers)
            for part in (
                kernels.xx * x + kernels.xy * y,
                kernels.xy * x + kernels.yy * y,
                kernels.xz * x + kernels.yz * y,
            )
        ]
    )
    return layers[0]._backward(spectrum, shape).reshape(len(layers), 3, *shape)


def _padded(shape: tuple[int, ...]) -> tuple[int, int]:
    """Numbers of rows and columns with fast transforms and without wrapping around."""
    rows, columns = (fft.next_fast_len(2 * length - 1, real=True) for length in shape)
    return int(rows or 1), int(columns or 1)


StepTowards = Callable[
    [np.ndarray, np.ndarray, np.ndarray, float, np.ndarray], tuple[float, float, float]
]
"""Signature of step_towards."""


def solve_traction(
    layer: ShearLayer,
    limit_mpa: np.ndarray,
    wanted_mm: np.ndarray,
    start_mpa: np.ndarray,
    towards: StepTowards | None = None,
) -> Traction:
    """The traction of one step.

    limit_mpa: (rows, columns) friction times pressure, 0 outside the contact. wanted_mm: (2, rows,
    columns) w. start_mpa: (2, rows, columns) an initial guess, such as the last step's traction.
    towards: takes the place of step_towards where more than the limit restricts the traction; the
    wanted displacement then lacks a part that it finds.

    Spectral projected gradients (Birgin, Martinez, Raydan 2000).
    """
    limit = np.ascontiguousarray(limit_mpa, np.float32)
    inside = limit > 0
    wanted = np.where(inside, wanted_mm, 0.0).astype(np.float32)
    scale = max(float(np.abs(wanted).max()), 1e-9)
    q, direction = np.ascontiguousarray(start_mpa, np.float32), np.zeros(wanted.shape, np.float32)
    displacement, gradient = np.zeros_like(wanted), np.zeros_like(wanted)
    towards_limit = towards or step_towards
    towards_limit(q, gradient, limit, 1.0, direction)  # the projection of the start
    q = q + direction
    take_step(displacement, layer.displacement_mm(q), 1.0, wanted, limit, gradient)
    if towards is not None:
        scale = max(scale, float(np.abs(displacement[:, inside]).max()))
    energies = [_dot(q, displacement) / 2 - _dot(q, wanted)]
    length, steps = 1.0 / _typical_compliance(layer, inside), 0
    while True:
        largest, square, slope = towards_limit(q, gradient, limit, length, direction)
        residual = largest / length / scale
        if residual <= TOLERANCE or steps == MAX_STEPS:
            break
        steps += 1
        moved = layer.displacement_mm(direction)
        curvature = _dot(direction, moved)
        # The energy is quadratic, so the best fraction of the step is known.
        fraction = 1.0
        if energies[-1] + slope + curvature / 2 > max(energies[-STEPS_BACK:]):
            fraction = min(1.0, -slope / curvature)
        q = q + np.float32(fraction) * direction
        take_step(displacement, moved, fraction, wanted, limit, gradient)
        energies.append(energies[-1] + fraction * slope + fraction**2 * curvature / 2)
        length = square / max(curvature, 1e-30)
    return Traction(q.astype(float), displacement.astype(float), residual, steps)


@compiled(
    "UniTuple(f8, 3)(f4[:, :, ::1], f4[:, :, ::1], f4[:, ::1], f8, f4[:, :, ::1])", nogil=True
)
def step_towards(q, gradient, limit, length, direction):
    """Write the step from q, (2, rows, columns), against the gradient to the nearest traction
    within the limit, (rows, columns).

    Returns the step's largest component, the sum of its squares, and its product with the gradient.
    """
    largest, square, slope = 0.0, 0.0, 0.0
    for i in range(limit.shape[0]):
        for j in range(limit.shape[1]):
            x = q[0, i, j] - length * gradient[0, i, j]
            y = q[1, i, j] - length * gradient[1, i, j]
            magnitude = np.sqrt(x * x + y * y)
            if magnitude > limit[i, j]:
                x *= limit[i, j] / magnitude
                y *= limit[i, j] / magnitude
            x -= q[0, i, j]
            y -= q[1, i, j]
            direction[0, i, j], direction[1, i, j] = x, y
            largest = max(largest, abs(x), abs(y))
            square += x * x + y * y
            slope += x * gradient[0, i, j] + y * gradient[1, i, j]
    return largest, square, slope


@compiled(
    "void(f4[:, :, ::1], f4[:, :, :], f8, f4[:, :, ::1], f4[:, ::1], f4[:, :, ::1])",
    nogil=True,
)
def take_step(displacement, moved, fraction, wanted, limit, gradient):
    """Add a fraction of a displacement, (2, rows, columns), and write the gradient of the energy,
    which is 0 outside the contact."""
    for k in range(2):
        for i in range(limit.shape[0]):
            for j in range(limit.shape[1]):
                displacement[k, i, j] += fraction * moved[k, i, j]
                if limit[i, j] > 0:
                    gradient[k, i, j] = displacement[k, i, j] - wanted[k, i, j]


def _dot(a: np.ndarray, b: np.ndarray) -> float:
    # A BLAS product depends on the number of threads in its last bits.
    return float((a.astype(np.float64) * b).sum())


def _typical_compliance(layer: ShearLayer, inside: np.ndarray) -> float:
    """Displacement per uniform traction on the contact, mm/MPa, for the first step's length."""
    ones = np.stack([inside, np.zeros_like(inside)]).astype(np.float32)
    return float(layer.displacement_mm(ones)[0][inside].mean())
