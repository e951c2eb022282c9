"""Tangential traction of a contact with dry friction, in one step of its motion.

Kalker's problem (Three-Dimensional Elastic Bodies in Rolling Contact, 1990): among the tractions
that nowhere exceed friction times pressure, that of the contact minimizes

    1/2 q . A q - q . w

with A the layer's tangential compliance and w the displacement that the shape would give the
surface without slip. Where the traction is below its limit the surface sticks, A q = w. Elsewhere
the shape slips over it, along the traction. The problem is convex, so its solution is unique.
"""

from collections.abc import Callable
from functools import lru_cache
from math import ceil, sqrt
from typing import NamedTuple

import numpy as np

from t2twin.core.jit import compiled
from t2twin.sim.contact.tangential.shear_layer import ShearLayer

TOLERANCE = 3e-4
"""Convergence: largest residual of the slip condition over the largest wanted displacement."""

MAX_STEPS = 500
"""Limit on the steps of the minimization (assumed: twenty times as many as presses need)."""

STEPS_BACK = 6
"""Values of the energy above whose maximum a step may not end (Grippo, Lampariello and Lucidi
1986)."""


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
    tolerance: float = TOLERANCE,
) -> Traction:
    """The traction of one step.

    limit_mpa: (rows, columns) friction times pressure, 0 outside the contact. wanted_mm: (2, rows,
    columns) w. start_mpa: (2, rows, columns) an initial guess, such as the last step's traction.
    towards: takes the place of step_towards where more than the limit restricts the traction; the
    wanted displacement then lacks a part that it finds. tolerance: of the residual.

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
    # A square of the contact's area, within the layer's window.
    side = min(ceil(sqrt(inside.sum())), *inside.shape)
    length, steps = 1.0 / _typical_compliance(layer, side), 0
    while True:
        largest, square, slope = towards_limit(q, gradient, limit, length, direction)
        residual = largest / length / scale
        if residual <= tolerance or steps == MAX_STEPS or (slope >= 0 and towards is not None):
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
    if towards is not None:
        q = q + direction  # within the restrictions, as the steps before need not be
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


@lru_cache(maxsize=256)
def _typical_compliance(layer: ShearLayer, side: int) -> float:
    """Displacement per uniform traction on a square of cells, mm/MPa."""
    ones = np.stack([np.ones((side, side)), np.zeros((side, side))])
    return float(layer.displacement_mm(ones)[0].mean())
