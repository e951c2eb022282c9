"""Dry friction of a contact: its tangential traction in one step of a motion.

Kalker's problem (Three-Dimensional Elastic Bodies in Rolling Contact, 1990): among the tractions
that nowhere exceed the limit of friction, that of the contact minimizes

    1/2 q . A q - q . w

with A the layer's tangential compliance and w the displacement that the shape would give the
surface without slip. Where the traction is below its limit the surface sticks, A q = w. Elsewhere
the shape slips over it, along the traction. The problem is convex, so its solution is unique.

Bodies with prescribed forces and torques restrict the traction too; their rigid motions are then
unknowns. A wrench is (3,): the force along x and y, and the torque over a length, all over the area
of a cell, MPa. A rigid motion is (3,): along x and y, and the rotation times the same length, mm.
The length and the center of rotation are those of a lever, (3,): x and y of the center and the
length, mm. With u the displacement of a cell by a rigid motion, wrench . motion is the sum of
q . u.
"""

from functools import lru_cache
from math import ceil, sqrt

import numpy as np

from t2twin.core.jit import INNER, compiled
from t2twin.sim.contact.grid import window_around
from t2twin.sim.contact.layer import WindowTransforms, respond, shear_work
from t2twin.sim.contact.solver_loops import eliminate

# Share by which a traction may be below the limit of friction where the shape slips: three times
# the tolerance of the traction.
AT_LIMIT = 1e-3
# A cell that the contact covers by a share c has c ** -COVER_EXPONENT times the compliance of a
# whole one. A part that slips adds SLIP_COMPLIANCE times the product of `partial_slip`. Both are
# fitted to contacts on cells of a quarter of the side.
COVER_EXPONENT, MIN_COVER, SLIP_COMPLIANCE = 0.6, 0.1, 0.5
# Convergence: largest residual of the slip condition over the largest wanted displacement.
TOLERANCE = 3e-4
# The same of the traction under the pressure before a step, from which the step starts (assumed:
# 3e-3 takes more time and saves no round).
PREDICTION_TOLERANCE = 1e-2
MAX_STEPS = 500  # of the minimization (assumed: twenty times as many as presses need)
# Values of the energy above whose maximum a step may not end (Grippo, Lampariello and Lucidi 1986).
STEPS_BACK = 6
MAX_NEWTON_STEPS = 100  # for the rigid motion of a body (assumed: most need one or two)
# Tolerance of a wrench: a share of the force that friction can carry, and of the wrench itself
# (assumed: far below the tolerance of the traction).
EXACT, EXACT_SHARE = 1e-8, 1e-6
# Addition to the diagonal of the Newton equations, as a share of a stuck body's, and its factor
# from step to step: where all cells slip, the equations are almost singular (assumed).
RIDGE, LESS_RIDGE, MIN_RIDGE = 1e-4, 0.1, 1e-14
ROUNDING = 1e-12  # relative increase of the potential that is due to rounding


# Bodies with prescribed forces and torques, arguments of the loops: x, (columns,), and y, (rows,),
# mm; owner, (rows, columns) index of each cell's body; levers, wrenches, (bodies, 3); slides,
# (bodies,), bodies whose traction is at the limit, along their rigid motion, whatever the gradient;
# rigid, (bodies, 3), the rigid motions, which are unknowns of the others.
Bodies = tuple[np.ndarray, ...]
NO_BODIES: Bodies = (
    np.empty(0), np.empty(0), np.empty((0, 0), int), np.empty((0, 3)), np.empty((0, 3)),
    np.empty(0, bool), np.empty((0, 3)),
)  # fmt: skip


def solve_traction(
    layer: WindowTransforms, limit_mpa: np.ndarray, wanted_mm: np.ndarray, start_mpa: np.ndarray,
    bodies: Bodies = NO_BODIES, tolerance: float = TOLERANCE, own: np.ndarray | float = 0.0,
) -> tuple[np.ndarray, np.ndarray, bool]:  # fmt: skip
    """The traction of one step along x and y, MPa, the displacement of the surface by it, mm, both
    (2, rows, columns), and whether it converged. By spectral projected gradients (Birgin, Martinez,
    Raydan 2000).

    limit_mpa: (rows, columns) largest traction, 0 outside the contact. wanted_mm: (2, rows,
    columns) w. start_mpa: (2, rows, columns) an initial guess. bodies: with prescribed forces; the
    wanted displacement then lacks their rigid motions, which are written to the last array. own:
    (rows, columns) additional compliance of each cell. The displacement is that of the cells of a
    window around the contact, and 0 elsewhere.
    """
    found, displacement = np.zeros(wanted_mm.shape), np.zeros(wanted_mm.shape)
    inside = limit_mpa > 0
    if not inside.any():  # without friction
        return found, displacement, True
    near = window_around(inside)
    part, limit = (slice(None), *near), np.ascontiguousarray(limit_mpa[near], np.float32)
    wanted = np.where(limit > 0, wanted_mm[part], 0.0).astype(np.float32)
    q, moved = np.array(start_mpa[part], np.float32, order="C"), np.empty_like(wanted)
    own = np.broadcast_to(own, inside.shape)[near].astype(np.float32)
    if bodies is not NO_BODIES:
        x, y, owner, *others = bodies
        bodies = x[near[1]], y[near[0]], np.ascontiguousarray(owner[near]), *others
    # A square of the contact's area, within the layer's window.
    side = min(ceil(sqrt(inside.sum())), *limit.shape)
    residual = _minimize(
        layer.of(limit.shape), shear_work(limit.shape, 2), limit, own, wanted, bodies,
        1.0 / _compliance(layer, side), tolerance, q, moved,
    )  # fmt: skip
    found[part], displacement[part] = q, moved
    return found, displacement, residual <= tolerance


@compiled(nogil=True)
def additional_compliance(own, cover, traction, limit):
    """(rows, columns) additional compliance, mm/MPa, of cells in contact with an own one. The
    contact covers a share of a cell, a part of which slips under a traction."""
    slip, found = partial_slip(traction, limit), np.zeros(limit.shape)
    for i in range(limit.shape[0]):
        for j in range(limit.shape[1]):
            if limit[i, j] > 0.0:
                by_cover = max(cover[i, j], MIN_COVER) ** -COVER_EXPONENT - 1.0
                by_slip = SLIP_COMPLIANCE * slip[0, i, j] * slip[1, i, j]
                found[i, j] = own * (by_cover + by_slip)
    return found


@compiled(nogil=True)
def partial_slip(traction, limit):
    """(2, rows, columns) share of each cell that slips under a traction, (2, rows, columns), and
    change of the traction's distance from the limit within the cell, over the limit.

    The distance is taken to change evenly in the part that sticks, as it does from the neighbors.
    """
    rows, columns = limit.shape
    found, below = np.ones((2, rows, columns)), np.zeros(limit.shape)
    for i in range(rows):
        for j in range(columns):
            size, bound = np.hypot(traction[0, i, j], traction[1, i, j]), np.float64(limit[i, j])
            below[i, j] = bound - size if size < (1 - AT_LIMIT) * bound else 0.0
    for i in range(rows):
        for j in range(columns):
            down = below[min(i + 1, rows - 1), j] - below[max(i - 1, 0), j]
            across = below[i, min(j + 1, columns - 1)] - below[i, max(j - 1, 0)]
            bound = max(limit[i, j], 1e-30)
            change = max(min(np.hypot(down, across) / 2, bound), 1e-30)
            found[0, i, j] = max(1 - np.sqrt(below[i, j] / change), 0.0)
            found[1, i, j] = change / bound
    return found


@lru_cache(maxsize=256)
def _compliance(layer: WindowTransforms, side: int) -> float:
    """Mean displacement per uniform traction on a square of side x side cells, mm/MPa."""
    along_itself = layer.kernels[0]
    rows, columns = (length // 2 for length in along_itself.shape)
    along = np.maximum(side - np.abs(np.arange(-rows, rows + 1)), 0)
    across = np.maximum(side - np.abs(np.arange(-columns, columns + 1)), 0)
    return float((along[:, None] * across * along_itself).sum() / side**2)


@compiled(nogil=True)
def _residual(q, gradient, length, limit, bodies, body, rigid, error, slope):
    """Potential of a rigid motion, see `balance`; writes its gradient and its Hessian."""
    x, y, owner, levers, wrenches, _, _ = bodies
    center_x, center_y, radius = levers[body, 0], levers[body, 1], levers[body, 2]
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
        value -= wrenches[body, k] * rigid[k]
        error[k] -= wrenches[body, k]
    return value


@compiled(nogil=True)
def balance(q, gradient, length, limit, bodies, body, capacity, turns, rigid):
    """Find the rigid motion for which a body's traction has its wrench; False without convergence.

    The traction is the nearest one within the limit, (rows, columns), to q - length (gradient - u),
    with u the displacement by the rigid motion. capacity: sum of the body's limits. turns: whether
    the rotation is an unknown; else it is prescribed, and the torque is not. rigid: (3,) a guess,
    replaced by the motion. Newton's method with bisected steps on the potential, which is convex.
    """
    owner, wrench = bodies[2], bodies[4][body]
    error, slope, step = np.empty(3), np.empty((3, 3)), np.zeros(3)
    system = np.empty((3, 4))
    last, last_value, last_error = np.zeros(3), np.inf, np.inf
    size = np.sqrt(wrench[0] ** 2 + wrench[1] ** 2 + wrench[2] ** 2)
    allowed = EXACT * capacity + EXACT_SHARE * size
    ridge, cells = RIDGE, 0
    for i in range(limit.shape[0]):
        for j in range(limit.shape[1]):
            cells += limit[i, j] > 0.0 and owner[i, j] == body
    for number in range(MAX_NEWTON_STEPS):
        value = _residual(q, gradient, length, limit, bodies, body, rigid, error, slope)
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
            for m in range(3):
                system[k, m] = slope[max(k, m), min(k, m)]
            system[k, k] += ridge * length * cells
            system[k, 3] = -error[k]
        ridge = max(LESS_RIDGE * ridge, MIN_RIDGE)
        if not eliminate(system):
            return False
        for k in range(3):
            last[k], step[k] = rigid[k], system[k, 3]
            rigid[k] += step[k]
    return False


@compiled(nogil=True)
def step_towards(q, gradient, limit, length, bodies, direction):
    """Write the step from q, (2, rows, columns), against the gradient to the nearest traction
    within the limit, (rows, columns), with the bodies' wrenches. Returns its largest component, the
    sum of its squares, and its product with the gradient, without the rigid motions' part."""
    x, y, owner, levers, _, slides, rigid = bodies
    for body in range(levers.shape[0]):
        if not slides[body]:
            capacity = 0.0
            for i in range(limit.shape[0]):
                for j in range(limit.shape[1]):
                    if owner[i, j] == body:
                        capacity += limit[i, j]
            balance(q, gradient, length, limit, bodies, body, capacity, True, rigid[body])
    largest, square, slope = 0.0, 0.0, 0.0
    for i in range(limit.shape[0]):
        for j in range(limit.shape[1]):
            a, b, is_sliding, bound = 0.0, 0.0, False, np.float64(limit[i, j])
            if levers.shape[0] > 0:
                body, turn = owner[i, j], rigid[owner[i, j], 2] / levers[owner[i, j], 2]
                a = rigid[body, 0] + (levers[body, 1] - y[i]) * turn
                b = rigid[body, 1] + (x[j] - levers[body, 0]) * turn
                is_sliding = slides[body]
            against_x, against_y = gradient[0, i, j] - a, gradient[1, i, j] - b
            if not is_sliding:
                a, b = q[0, i, j] - length * against_x, q[1, i, j] - length * against_y
            size = np.sqrt(a * a + b * b)
            if size > bound or (is_sliding and size > 0.0):
                a, b = a * (bound / size), b * (bound / size)
            a -= q[0, i, j]
            b -= q[1, i, j]
            direction[0, i, j], direction[1, i, j] = a, b
            largest = max(largest, abs(a), abs(b))
            square += a * a + b * b
            slope += a * against_x + b * against_y
    return largest, square, slope


@compiled(nogil=True)
def _minimize(kernels, work, limit, own, wanted, bodies, length, tolerance, q, displacement):
    """See `solve_traction`; writes q and the displacement, returns the residual."""
    has_bodies = bodies[3].shape[0] > 0
    is_known = q.size == 0  # no; a constant would compile respond once more
    direction, moved = np.zeros_like(q), np.empty_like(q)
    gradient, energies = np.zeros_like(q), np.empty(STEPS_BACK)
    # The first step is the projection of the initial guess.
    step_towards(q, gradient, limit, 1.0, bodies, direction)
    q += direction
    respond(q, kernels, work, is_known, displacement)
    displacement += own * q
    scale = max(1e-9, np.abs(wanted).max(), has_bodies * np.abs(displacement).max())
    gradient[:] = displacement - wanted
    energy = _dot(q, displacement) / 2 - _dot(q, wanted)
    energies[:] = -np.inf
    energies[0] = energy
    steps = 0
    while True:
        largest, square, slope = step_towards(q, gradient, limit, length, bodies, direction)
        residual = largest / length / scale
        if residual <= tolerance or steps == MAX_STEPS or (slope >= 0 and has_bodies):
            break
        steps += 1
        respond(direction, kernels, work, is_known, moved)
        moved += own * direction
        curvature = _dot(direction, moved)
        # The energy is quadratic, so the best fraction of the step is known.
        fraction = 1.0
        if energy + slope + curvature / 2 > energies.max():
            fraction = min(1.0, -slope / curvature)
        q += np.float32(fraction) * direction
        gradient += np.float32(fraction) * moved
        energy += fraction * slope + fraction**2 * curvature / 2
        energies[steps % STEPS_BACK] = energy
        length = square / max(curvature, 1e-30)
    if has_bodies:
        q += direction  # within the restrictions, as the steps before need not be
    displacement[:] = gradient + wanted
    return residual


@compiled(nogil=True, **INNER)
def _dot(a, b):
    total = 0.0
    for k in range(a.shape[0]):
        for i in range(a.shape[1]):
            for j in range(a.shape[2]):
                total += np.float64(a[k, i, j]) * np.float64(b[k, i, j])
    return total
