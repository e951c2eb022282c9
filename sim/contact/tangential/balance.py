"""Tractions within the limit of friction that have a prescribed force and torque.

A wrench is (3,): the force along x and y, and the torque over a length, all over the area of a
cell, MPa. A rigid motion is (3,): along x and y, and the rotation times the same length, mm. The
length and the center of rotation are those of a lever, (3,): x and y of the center and the length,
mm. With u the displacement of a cell by a rigid motion, wrench . motion is the sum of q . u.
"""

import numpy as np

from t2twin.core.jit import compiled

MAX_NEWTON_STEPS = 100
"""Limit on Newton steps for the rigid motion of a body (assumed: most need one or two)."""

EXACT, EXACT_SHARE = 1e-8, 1e-6
"""Tolerance of a wrench: a share of the force that friction can carry, and of the wrench itself
(assumed: far below the tolerance of the traction)."""

RIDGE, LESS_RIDGE, MIN_RIDGE = 1e-4, 0.1, 1e-14
"""Addition to the diagonal of the Newton equations, as a share of a stuck body's, and its factor
from step to step: where all cells slip, the equations are almost singular (assumed)."""

ROUNDING = 1e-12
"""Relative increase of the potential that is due to rounding."""


@compiled("b1(f8[:, ::1], f8[::1], f8[::1])", nogil=True)
def _solve(matrix, right, solution):
    """Solve a positive definite (3, 3) system by Cholesky's factors; False where it is not."""
    lower = np.zeros((3, 3))
    for i in range(3):
        for j in range(i + 1):
            total = matrix[i, j]
            for k in range(j):
                total -= lower[i, k] * lower[j, k]
            if i == j:
                if not total > 0.0:
                    return False
                lower[i, i] = np.sqrt(total)
            else:
                lower[i, j] = total / lower[j, j]
    for i in range(3):
        total = right[i]
        for k in range(i):
            total -= lower[i, k] * solution[k]
        solution[i] = total / lower[i, i]
    for m in range(3):
        i = 2 - m
        total = solution[i]
        for k in range(i + 1, 3):
            total -= lower[k, i] * solution[k]
        solution[i] = total / lower[i, i]
    return True


@compiled(
    "f8(f4[:, :, ::1], f4[:, :, ::1], f8, f4[:, ::1], f8[::1], f8[::1], i8[:, ::1], i8, f8[::1],"
    " f8[::1], f8[::1], f8[::1], f8[:, ::1])",
    nogil=True,
)
def _residual(q, gradient, length, limit, x, y, owner, body, lever, wrench, rigid, error, slope):
    """Potential of a rigid motion, see `balance`; writes its gradient and its Hessian."""
    center_x, center_y, radius = lever[0], lever[1], lever[2]
    value = 0.0
    error[:], slope[:] = 0.0, 0.0
    for i in range(limit.shape[0]):
        turn_x = (center_y - y[i]) / radius
        for j in range(limit.shape[1]):
            bound = np.float64(limit[i, j])
            if bound <= 0.0 or owner[i, j] != body:
                continue
            turn_y = (x[j] - center_x) / radius
            a = q[0, i, j] + length * (rigid[0] + turn_x * rigid[2] - gradient[0, i, j])
            b = q[1, i, j] + length * (rigid[1] + turn_y * rigid[2] - gradient[1, i, j])
            square = a * a + b * b
            xx, xy, yy = length, 0.0, length
            if square > bound * bound:
                size = np.sqrt(square)
                value += (bound * size - bound * bound / 2) / length
                along, across = a / size, b / size
                rate = length * bound / size
                xx, xy, yy = rate * across * across, -rate * along * across, rate * along * along
                a, b = bound * along, bound * across
            else:
                value += square / 2 / length
            error[0] += a
            error[1] += b
            error[2] += turn_x * a + turn_y * b
            slope[0, 0] += xx
            slope[1, 0] += xy
            slope[1, 1] += yy
            slope[2, 0] += turn_x * xx + turn_y * xy
            slope[2, 1] += turn_x * xy + turn_y * yy
            slope[2, 2] += turn_x * (turn_x * xx + 2 * turn_y * xy) + turn_y * turn_y * yy
    for k in range(3):
        value -= wrench[k] * rigid[k]
        error[k] -= wrench[k]
    return value


@compiled(
    "b1(f4[:, :, ::1], f4[:, :, ::1], f8, f4[:, ::1], f8[::1], f8[::1], i8[:, ::1], i8, f8[::1],"
    " f8[::1], f8, b1, f8[::1])",
    nogil=True,
)
def balance(q, gradient, length, limit, x, y, owner, body, lever, wrench, capacity, turns, rigid):
    """Find the rigid motion for which a body's traction has a wrench; False without convergence.

    The traction is the nearest one within the limit to q - length (gradient - u), with u the
    displacement by the rigid motion. q, gradient: (2, rows, columns). limit: (rows, columns), 0
    outside the contact. x: (columns,), y: (rows,), mm. owner: (rows, columns) index of each cell's
    body. lever, wrench: the body's. capacity: sum of the limits. turns: whether the rotation is an
    unknown; otherwise it is prescribed, and the torque is not. rigid: (3,) an initial guess,
    replaced by the motion.

    Newton's method with bisected steps on the potential, which is convex.
    """
    error, slope, step = np.empty(3), np.empty((3, 3)), np.zeros(3)
    last, last_value, last_error = np.zeros(3), np.inf, np.inf
    size = np.sqrt(wrench[0] ** 2 + wrench[1] ** 2 + wrench[2] ** 2)
    allowed = EXACT * capacity + EXACT_SHARE * size
    ridge, cells = RIDGE, 0
    for i in range(limit.shape[0]):
        for j in range(limit.shape[1]):
            cells += limit[i, j] > 0.0 and owner[i, j] == body
    for number in range(MAX_NEWTON_STEPS):
        value = _residual(
            q, gradient, length, limit, x, y, owner, body, lever, wrench, rigid, error, slope
        )
        if not turns:
            error[2], slope[2, 0], slope[2, 1], slope[2, 2] = 0.0, 0.0, 0.0, 1.0
        wrong = np.sqrt(error[0] ** 2 + error[1] ** 2 + error[2] ** 2)
        if wrong <= allowed:
            return True
        rounding = ROUNDING * abs(last_value)
        if number > 0 and not (
            value < last_value or (value <= last_value + rounding and wrong < last_error)
        ):
            for k in range(3):
                step[k] /= 2
                rigid[k] = last[k] + step[k]
            continue
        last_value, last_error = value, wrong
        for k in range(3):
            slope[k, k] += ridge * length * cells
        ridge = max(LESS_RIDGE * ridge, MIN_RIDGE)
        if not _solve(slope, error, step):
            return False
        for k in range(3):
            last[k] = rigid[k]
            step[k] = -step[k]
            rigid[k] += step[k]
    return False


BODIES = "f8[::1], f8[::1], i8[:, ::1], f8[:, ::1], f8[:, ::1], b1[::1], f8[:, ::1]"
"""Types of the arguments of `balanced_step` from x to rigid."""


@compiled(
    f"UniTuple(f8, 3)(f4[:, :, ::1], f4[:, :, ::1], f4[:, ::1], f8, {BODIES}, f4[:, :, ::1])",
    nogil=True,
)
def balanced_step(
    q, gradient, limit, length, x, y, owner, levers, wrenches, slides, rigid, direction
):
    """Write the step from q against the gradient to the nearest traction with the bodies' wrenches;
    see `t2twin.sim.contact.tangential.traction.step_towards`.

    levers, wrenches, rigid: (bodies, 3), see `balance`. slides: (bodies,), bodies whose traction is
    at the limit, along their rigid motion, whatever the gradient. The returned product is with the
    gradient less the displacement by the rigid motions.
    """
    for body in range(levers.shape[0]):
        if not slides[body]:
            capacity = 0.0
            for i in range(limit.shape[0]):
                for j in range(limit.shape[1]):
                    if owner[i, j] == body:
                        capacity += limit[i, j]
            balance(
                q, gradient, length, limit, x, y, owner, body, levers[body], wrenches[body],
                capacity, True, rigid[body],
            )  # fmt: skip
    largest, square, slope = 0.0, 0.0, 0.0
    for i in range(limit.shape[0]):
        for j in range(limit.shape[1]):
            body, bound = owner[i, j], np.float64(limit[i, j])
            radius = levers[body, 2]
            a = rigid[body, 0] + (levers[body, 1] - y[i]) / radius * rigid[body, 2]
            b = rigid[body, 1] + (x[j] - levers[body, 0]) / radius * rigid[body, 2]
            against_x, against_y = gradient[0, i, j] - a, gradient[1, i, j] - b
            if not slides[body]:
                a, b = q[0, i, j] - length * against_x, q[1, i, j] - length * against_y
            size = np.sqrt(a * a + b * b)
            if size > bound or (slides[body] and size > 0.0):
                a, b = a * bound / size, b * bound / size
            a -= q[0, i, j]
            b -= q[1, i, j]
            direction[0, i, j], direction[1, i, j] = a, b
            largest = max(largest, abs(a), abs(b))
            square += a * a + b * b
            slope += a * against_x + b * against_y
    return largest, square, slope
