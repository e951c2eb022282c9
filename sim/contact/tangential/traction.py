"""Tangential traction of a contact with dry friction, in one step of its motion.

Kalker's problem (Three-Dimensional Elastic Bodies in Rolling Contact, 1990): among the tractions
that nowhere exceed friction times pressure, that of the contact minimizes

    1/2 q . A q - q . w

with A the layer's tangential compliance and w the displacement that the shape would give the
surface without slip. Where the traction is below its limit the surface sticks, A q = w. Elsewhere
the shape slips over it, along the traction. The problem is convex, so its solution is unique.
"""

from functools import lru_cache
from math import ceil, sqrt
from typing import NamedTuple

import numpy as np

from t2twin.core.jit import INNER, compiled
from t2twin.sim.contact.tangential.balance import BODIES, balanced_step
from t2twin.sim.contact.tangential.shear_layer import (
    KERNELS,
    WORK,
    ShearLayer,
    respond,
    work_arrays,
)

TOLERANCE = 3e-4
"""Convergence: largest residual of the slip condition over the largest wanted displacement."""

MAX_STEPS = 500
"""Limit on the steps of the minimization (assumed: twenty times as many as presses need)."""

STEPS_BACK = 6
"""Values of the energy above whose maximum a step may not end (Grippo, Lampariello and Lucidi
1986)."""


@lru_cache(maxsize=256)
def _compliance(layer: ShearLayer, side: int) -> float:
    return layer.compliance_mm_per_mpa(side)


class Traction(NamedTuple):
    """The result of one step. q_mpa: (2, rows, columns), along x and y. displacement_mm: (2, rows,
    columns), of the surface by it. residual: see TOLERANCE. tolerance: of the residual. steps: of
    the minimization."""

    q_mpa: np.ndarray
    displacement_mm: np.ndarray
    residual: float
    tolerance: float
    steps: int

    @property
    def converged(self) -> bool:
        return self.residual <= self.tolerance


Bodies = tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, np.ndarray, np.ndarray, np.ndarray]
"""Bodies with prescribed forces and torques: x, y, owner, levers, wrenches, slides and rigid of
`balanced_step`."""

NO_BODIES: Bodies = (
    np.empty(0), np.empty(0), np.empty((0, 0), int), np.empty((0, 3)), np.empty((0, 3)),
    np.empty(0, bool), np.empty((0, 3)),
)  # fmt: skip


def solve_traction(
    layer: ShearLayer,
    limit_mpa: np.ndarray,
    wanted_mm: np.ndarray,
    start_mpa: np.ndarray,
    bodies: Bodies = NO_BODIES,
    tolerance: float = TOLERANCE,
) -> Traction:
    """The traction of one step.

    limit_mpa: (rows, columns) friction times pressure, 0 outside the contact. wanted_mm: (2, rows,
    columns) w. start_mpa: (2, rows, columns) an initial guess, such as the last step's traction.
    bodies: with prescribed forces, which restrict the traction too; the wanted displacement then
    lacks their rigid motions, which are written to the last array. tolerance: of the residual.

    Spectral projected gradients (Birgin, Martinez, Raydan 2000).
    """
    limit = np.ascontiguousarray(limit_mpa, np.float32)
    inside = limit > 0
    wanted = np.where(inside, wanted_mm, 0.0).astype(np.float32)
    q = np.array(start_mpa, np.float32, order="C")
    displacement = np.empty_like(wanted)
    # A square of the contact's area, within the layer's window.
    side = min(ceil(sqrt(inside.sum())), *inside.shape)
    residual, steps = _minimize(
        layer.transforms(limit.shape), work_arrays(limit.shape, 2), limit, wanted, *bodies,
        1.0 / _compliance(layer, side), tolerance, q, displacement,
    )  # fmt: skip
    return Traction(q.astype(float), displacement.astype(float), residual, tolerance, steps)


@compiled(
    f"Tuple((f8, i8))({KERNELS}, {WORK}, f4[:, ::1], f4[:, :, ::1], {BODIES}, f8, f8,"
    " f4[:, :, ::1], f4[:, :, ::1])",
    nogil=True,
)
def _minimize(
    kernels, work, limit, wanted, x, y, owner, levers, wrenches, slides, rigid, length, tolerance,
    q, displacement,
):  # fmt: skip
    """See `solve_traction`. length: of the first step. q: the initial guess, replaced by the
    traction. Writes the displacement; returns the residual and the number of steps."""
    has_bodies = levers.shape[0] > 0
    direction, moved = np.zeros_like(q), np.empty_like(q)
    gradient, energies = np.zeros_like(q), np.empty(STEPS_BACK)
    # The first step is the projection of the initial guess.
    _towards(
        has_bodies, q, gradient, limit, 1.0, x, y, owner, levers, wrenches, slides, rigid, direction
    )
    _add(q, direction, 1.0)
    respond(q, kernels, work, False, displacement)
    scale = 1e-9
    for k in range(2):
        for i in range(limit.shape[0]):
            for j in range(limit.shape[1]):
                if limit[i, j] > 0:
                    gradient[k, i, j] = displacement[k, i, j] - wanted[k, i, j]
                    scale = max(scale, abs(wanted[k, i, j]))
                    if has_bodies:
                        scale = max(scale, abs(displacement[k, i, j]))
    energy = _dot(q, displacement) / 2 - _dot(q, wanted)
    energies[:] = -np.inf
    energies[0] = energy
    steps = 0
    while True:
        largest, square, slope = _towards(
            has_bodies, q, gradient, limit, length, x, y, owner, levers, wrenches, slides, rigid,
            direction,
        )  # fmt: skip
        residual = largest / length / scale
        if residual <= tolerance or steps == MAX_STEPS or (slope >= 0 and has_bodies):
            break
        steps += 1
        respond(direction, kernels, work, False, moved)
        curvature = _dot(direction, moved)
        # The energy is quadratic, so the best fraction of the step is known.
        fraction = 1.0
        if energy + slope + curvature / 2 > energies.max():
            fraction = min(1.0, -slope / curvature)
        _add(q, direction, fraction)
        take_step(displacement, moved, fraction, wanted, limit, gradient)
        energy += fraction * slope + fraction**2 * curvature / 2
        energies[steps % STEPS_BACK] = energy
        length = square / max(curvature, 1e-30)
    if has_bodies:
        _add(q, direction, 1.0)  # within the restrictions, as the steps before need not be
    return residual, steps


@compiled(nogil=True, **INNER)
def _towards(
    has_bodies, q, gradient, limit, length, x, y, owner, levers, wrenches, slides, rigid, direction
):
    """See `step_towards` and `balanced_step`."""
    if has_bodies:
        return balanced_step(
            q, gradient, limit, length, x, y, owner, levers, wrenches, slides, rigid, direction
        )
    return step_towards(q, gradient, limit, length, direction)


@compiled(nogil=True, **INNER)
def _add(values, more, share):
    share = np.float32(share)
    for k in range(values.shape[0]):
        for i in range(values.shape[1]):
            for j in range(values.shape[2]):
                values[k, i, j] += share * more[k, i, j]


@compiled(nogil=True, **INNER)
def _dot(a, b):
    total = 0.0
    for k in range(a.shape[0]):
        for i in range(a.shape[1]):
            for j in range(a.shape[2]):
                total += np.float64(a[k, i, j]) * np.float64(b[k, i, j])
    return total


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
