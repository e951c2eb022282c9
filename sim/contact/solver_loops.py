"""Compiled loops of the contact solver's fixed-point iteration, and its Anderson acceleration.

Pins are given by their first row, first column and side in the window, all (n,) int64 in cells of
the layer's fine grid. Every loop runs in one thread and sums in a fixed order, so that results are
identical on every run.
"""

import numpy as np

from t2twin.core.jit import compiled
from t2twin.sim.contact.elastomer import stiffened

MAX_NEWTON_STEPS = 200
"""Limit on Newton steps on a convex, piecewise linear function. Each step drops springs that later
steps do not add again, so the iteration ends far sooner."""

MEMORY = 4
"""Earlier steps that Anderson acceleration stores; more does not reduce the number of steps."""

RIDGE = 1e-8
"""Relative addition to the diagonal of the normal equations, which regularizes equal steps."""

RESTART_GROWTH = 2.0
"""Growth of the residual in one step above which the stored steps are discarded."""


@compiled(
    "void(f4[:, :, :], f4[:, :, :], f8[:, :], b1, i8[::1], i8[::1], i8[::1], i8[::1],"
    " f8[:, :, ::1], f8[::1], f8[::1], f8[::1])",
    nogil=True,
)
def mean_deflection(
    responses, weights, thickness, stiffens, bodies, rows, columns, sides, cover, covered,
    deflection, slope,
):  # fmt: skip
    """Mean deflection and mean slope of the elastomer's law over the covered part of each pin.

    responses, weights: (kernels, rows, columns) of the layer. Writes deflection and slope, (n,).
    """
    for n in range(rows.size):
        total, total_slope = 0.0, 0.0
        for i in range(rows[n], rows[n] + sides[n]):
            for j in range(columns[n], columns[n] + sides[n]):
                part = cover[bodies[n], i, j]
                if part == 0.0:
                    continue
                linear = responses[0, i, j] * weights[0, i, j]
                for k in range(1, responses.shape[0]):
                    linear += responses[k, i, j] * weights[k, i, j]
                if stiffens:
                    sunk, steep = stiffened(np.float64(linear), thickness[i, j])
                else:
                    sunk, steep = np.float64(linear), 1.0
                total += sunk * part
                total_slope += steep * part
        deflection[n] = total / covered[n]
        slope[n] = total_slope / covered[n]


@compiled("f8(f8, f8[::1], f8[::1])", nogil=True)
def spring_depth(force, tops, stiffness):
    """Depth at which independent springs under a rigid shape carry a force.

    tops: (n,) depth at which the shape meets each spring. stiffness: (n,), > 0. Newton's method
    from above, where the force is convex in the depth: exact after a finite number of steps.
    """
    depth = np.inf
    for _ in range(MAX_NEWTON_STEPS):
        total, moment = 0.0, 0.0
        for n in range(tops.size):
            if tops[n] < depth:
                total += stiffness[n]
                moment += stiffness[n] * tops[n]
        after = (force + moment) / total
        if not after < depth:
            break
        depth = after
    return depth


@compiled(
    "f8(f8, f8, f8, f8[::1], f8[::1], f8[::1], f8[::1], f8[::1], f8[::1], f8[::1], f8[::1])",
    nogil=True,
)
def fit_springs(
    force, compliance, min_slope, gap, edge, area, surface, slope, current, local, rest
):
    """Fit the pins' springs to the surface under the pressure `current`; return the shape's depth.

    surface, slope: (n,) means over the pins' cells. Writes local, (n,) compliance of each pin,
    mm/MPa, and rest, (n,) deflection at which its spring carries nothing, mm. rest is the part of
    the layer's response that the springs do not represent.
    """
    tops, stiffness = np.empty(gap.size), np.empty(gap.size)
    for n in range(gap.size):
        # A stiffened place has a stiffer spring. The converged surface does not depend on the
        # springs, so limiting the slope only keeps them finite.
        steep = max(slope[n], min_slope)
        local[n] = (compliance + edge[n]) * steep
        rest[n] = surface[n] + (edge[n] * slope[n] - local[n]) * current[n]
        tops[n] = gap[n] + rest[n]
        stiffness[n] = area[n] * compliance / local[n]
    return spring_depth(force, tops, stiffness)


@compiled("f8(f8[::1], f8[::1], f8[::1], f8[::1], f8[::1], f8[::1])", nogil=True)
def redistribute_force(deflection, rest, local, area, current, pressure):
    """Pressure of springs compressed by `deflection`, written to pressure, (n,), MPa.

    Returns the share of the force that differs from `current`; inf where nothing is loaded.
    """
    total, moved = 0.0, 0.0
    for n in range(rest.size):
        pressure[n] = max(deflection[n] - rest[n], 0.0) / local[n]
        total += pressure[n] * area[n]
        moved += abs(pressure[n] - current[n]) * area[n]
    return moved / total if total > 0.0 else np.inf


@compiled(
    "void(f8[::1], f8[::1], i8[::1], i8[::1], i8[::1], i8[::1], f8[::1], f8[:, :, ::1])",
    nogil=True,
)
def precondition(pressure, current, rows, columns, sides, reaches, gains, sums):
    """Amplify, in place, the short waves of a step from `current` to pressure.

    A layer is stiffer the shorter the waves of a pressure, but the springs are equally stiff for
    all, so plain steps change short waves too little. Adds to each pin's step a gain times its
    difference from the mean step of the loaded pins around it.

    reaches: (k,) half widths of the squares that the mean is taken over, fine cells beyond the
    pin's own. gains: (k,). sums: (rows + 1, columns + 1, 2) work array for summed-area tables, its
    first row and column zero.
    """
    down, across = sums.shape[0] - 1, sums.shape[1] - 1
    sums[1:, 1:] = 0.0
    for n in range(rows.size):
        change = pressure[n] - current[n]
        if pressure[n] > 0.0 or current[n] > 0.0:
            for i in range(rows[n] + 1, rows[n] + sides[n] + 1):
                for j in range(columns[n] + 1, columns[n] + sides[n] + 1):
                    sums[i, j, 0] += change
                    sums[i, j, 1] += 1.0
    for i in range(1, down + 1):
        change, loaded = 0.0, 0.0
        for j in range(1, across + 1):
            change += sums[i, j, 0]
            loaded += sums[i, j, 1]
            sums[i, j, 0] = sums[i - 1, j, 0] + change
            sums[i, j, 1] = sums[i - 1, j, 1] + loaded
    for n in range(rows.size):
        change = pressure[n] - current[n]
        if change == 0.0:
            continue
        for k in range(gains.size):
            top, left = max(rows[n] - reaches[k], 0), max(columns[n] - reaches[k], 0)
            bottom = min(rows[n] + sides[n] + reaches[k], down)
            right = min(columns[n] + sides[n] + reaches[k], across)
            a, b, c, d = sums[bottom, right], sums[top, right], sums[bottom, left], sums[top, left]
            around, loaded = a[0] - b[0] - c[0] + d[0], a[1] - b[1] - c[1] + d[1]
            pressure[n] += gains[k] * (change - around / loaded)


class Anderson:
    """Anderson acceleration of a fixed-point iteration x <- g(x).

    Of all mixtures of the last steps with weights that add up to 1 it takes the one with the
    smallest linearized residual g(x) - x (Walker and Ni, SIAM J. Numer. Anal. 49, 2011).
    size: number of unknowns, n.
    """

    def __init__(self, size: int) -> None:
        self._images = np.empty((MEMORY, size))
        self._changes = np.empty((MEMORY, size))
        self._normal = np.empty((MEMORY, MEMORY))
        self._last: tuple[np.ndarray, np.ndarray] | None = None
        self._stored = self._next = 0

    def next(self, point: np.ndarray, image: np.ndarray) -> np.ndarray:
        """The next point at which to evaluate g, (n,), after g(point) = image, both (n,)."""
        residual = image - point
        last, self._last = self._last, (image, residual)
        if last is None:
            return image
        if np.abs(residual).sum() > RESTART_GROWTH * np.abs(last[1]).sum():
            self._stored = self._next = 0
            return image
        row, self._stored = self._next, min(self._stored + 1, MEMORY)
        self._next = (row + 1) % MEMORY
        mixed = np.empty_like(image)
        stored = self._images, self._changes, self._normal
        if _mix(*stored, row, self._stored, *last, image, residual, mixed):
            return mixed
        self._stored = self._next = 0  # the step is zero or repeats an earlier one
        return image


@compiled("b1(f8[:, ::1])", nogil=True)
def _eliminate(system):
    """Solve (k, k + 1) equations into their last column; False where they are singular."""
    size = len(system)
    for k in range(size):
        pivot = k
        for i in range(k, size):
            if not abs(system[i, k]) <= abs(system[pivot, k]):  # larger, or NaN
                pivot = i
        if not abs(system[pivot, k]) > 0.0:
            return False
        for m in range(size + 1):
            system[k, m], system[pivot, m] = system[pivot, m], system[k, m]
        for i in range(size):
            if i != k:
                part = system[i, k] / system[k, k]
                for m in range(k, size + 1):
                    system[i, m] -= part * system[k, m]
    for k in range(size):
        system[k, size] /= system[k, k]
    return True


@compiled(
    "b1(f8[:, ::1], f8[:, ::1], f8[:, ::1], i8, i8, f8[::1], f8[::1], f8[::1], f8[::1], f8[::1])",
    nogil=True,
)
def _mix(images, changes, normal, row, stored, last_image, last_residual, image, residual, mixed):
    """Store a step in `row` and mix the stored steps; False where they are linearly dependent."""
    size = image.size
    for n in range(size):
        images[row, n] = image[n] - last_image[n]
        changes[row, n] = residual[n] - last_residual[n]
    system = np.empty((stored, stored + 1))
    for k in range(stored):
        product, side = 0.0, 0.0
        for n in range(size):
            product += changes[k, n] * changes[row, n]
            side += changes[k, n] * residual[n]
        normal[row, k] = normal[k, row] = product
        system[k, stored] = side
    for k in range(stored):
        for m in range(stored):
            system[k, m] = normal[k, m] * (1 + RIDGE if k == m else 1.0)
    if not _eliminate(system):
        return False
    for n in range(size):  # element by element: assigning an array compiles its error messages too
        mixed[n] = image[n]
    for k in range(stored):
        for n in range(size):
            mixed[n] -= system[k, stored] * images[k, n]
    return True
