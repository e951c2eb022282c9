"""Compiled loops of the contact solver's fixed-point iteration, and its Anderson acceleration.

Every loop runs in one thread and sums in a fixed order: results are identical on every run.
"""

from collections.abc import Callable

import numpy as np

from t2twin.core.jit import compiled
from t2twin.sim.contact.elastomer import stiffened
from t2twin.sim.contact.layer import convolve

MIN_STEPS = 2  # the first step does not include pins that were added before it
PENETRATION_MM = 1e-3  # of the shape into an inactive pin that is tolerated, mm: a converged step
# Limit on Newton steps on a convex, piecewise linear function. Each step drops springs that later
# steps do not add again, so the iteration ends far sooner.
MAX_NEWTON_STEPS = 200
FAR_MM = 1e9  # deflection at which the spring of an inactive pin carries nothing, mm
MEMORY = 4  # earlier steps that Anderson acceleration stores; more does not reduce the steps
RIDGE = 1e-8  # relative addition to the diagonal of the normal equations: for equal steps
RESTART_GROWTH = 2.0  # growth of the residual in a step above which the stored ones are discarded


@compiled(nogil=True)
def spread(pressure, bodies, rows, columns, sides, cover, fine):
    """Write the sum of the pins' pressures, times their cover, to fine, (rows, >= columns)."""
    for i in range(fine.shape[0]):
        for j in range(fine.shape[1]):
            fine[i, j] = 0.0
    for n in range(pressure.size):
        if pressure[n] == 0.0:
            continue
        for i in range(rows[n], rows[n] + sides[n]):
            for j in range(columns[n], columns[n] + sides[n]):
                fine[i, j] += pressure[n] * cover[bodies[n], i, j]


@compiled(inline="always")
def _mean_linear(linear, cover, body, row, column, side, covered):
    """Mean and variance of the linear deflection over the covered part of a pin."""
    total, squares = 0.0, 0.0
    for i in range(row, row + side):
        for j in range(column, column + side):
            part, mm = cover[body, i, j], np.float64(linear[i, j])
            total += part * mm
            squares += part * mm * mm
    mean = total / covered
    return mean, max(squares / covered - mean * mean, 0.0)


@compiled(inline="always")
def _mean_deflections(
    linear, cover, bodies, rows, columns, sides, area, thickness, stiffens, surface, slope
):
    """Write the mean deflection by the law of each pin, to second order, and the law's slope."""
    for n in range(area.size):
        surface[n], slope[n] = _mean_linear(
            linear, cover, bodies[n], rows[n], columns[n], sides[n], area[n]
        )
    for n in range(area.size):
        mean, variance = surface[n], slope[n]
        slope[n] = 1.0
        if stiffens:
            sunk, slope[n], curvature = stiffened(mean, thickness[n])
            surface[n] = sunk + 0.5 * curvature * variance


@compiled(nogil=True)
def spring_depth(force, tops, stiffness, near):
    """Depth at which springs with these tops and stiffnesses, (n,), carry a force.

    Newton's method, from above on a convex function, ends exactly. near: an expected depth, or inf.
    """
    depth = near
    for steps in range(MAX_NEWTON_STEPS):
        total, moment = 0.0, 0.0
        for n in range(tops.size):
            if tops[n] < depth:
                total += stiffness[n]
                moment += stiffness[n] * tops[n]
        after = (force + moment) / total if total > 0.0 else np.inf
        if steps > 0 and not after < depth:
            break
        depth = after
    return depth


@compiled(nogil=True)
def redistribute_force(deflection, rest, local, area, current, pressure):
    """Write the pressure of springs compressed by `deflection`, (n,), MPa. Returns the share of the
    force that differs from `current`; inf where nothing is loaded."""
    total, moved = 0.0, 0.0
    for n in range(rest.size):
        pressure[n] = max(deflection[n] - rest[n], 0.0) / local[n]
        total += pressure[n] * area[n]
        moved += abs(pressure[n] - current[n]) * area[n]
    return moved / total if total > 0.0 else np.inf


@compiled(inline="always")
def _sum_of(sums, k, top, bottom, left, right):
    """Sum over a box by one of the summed-area tables, (rows + 1, columns + 1, tables)."""
    return sums[bottom, right, k] - sums[top, right, k] - sums[bottom, left, k] + sums[top, left, k]


@compiled(inline="always")
def precondition(pressure, current, rows, columns, sides, reaches, gains, sums):
    """Amplify, in place, the short waves of a step from `current` to pressure.

    A layer is stiffer the shorter the waves of a pressure, but the springs are equally stiff for
    all. Adds to each pin's step a gain, (k,), times its difference from the mean step of the loaded
    pins around it. Around it are squares that reach so many fine cells, (k,), beyond its own. sums:
    (rows + 1, columns + 1, 2) work array, its first row and column zero.
    """
    down, across = sums.shape[0] - 1, sums.shape[1] - 1
    for i in range(1, down + 1):
        for j in range(1, across + 1):
            sums[i, j, 0] = sums[i, j, 1] = 0.0
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
            around = _sum_of(sums, 0, top, bottom, left, right)
            loaded = _sum_of(sums, 1, top, bottom, left, right)
            pressure[n] += gains[k] * (change - around / loaded)


@compiled(inline="always")
def eliminate(system):
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


@compiled(inline="always")
def accelerate(memory, normal, counts, point, image, mixed):
    """Write the next point of Anderson acceleration; see `anderson`.

    memory: (2 MEMORY + 2, n), changes of the images, of the residuals, the last image and residual.
    counts: steps stored, the row of the next one, and whether there is a last step.
    """
    size = image.size
    images, changes, last = memory[:MEMORY], memory[MEMORY : 2 * MEMORY], memory[2 * MEMORY :]
    row, moved, moved_before = counts[1], 0.0, 0.0
    for n in range(size):
        residual = image[n] - point[n]
        moved += abs(residual)
        moved_before += abs(last[1, n])
        images[row, n], changes[row, n] = image[n] - last[0, n], residual - last[1, n]
        last[0, n], last[1, n] = image[n], residual
        mixed[n] = image[n]
    if counts[2] == 0 or moved > RESTART_GROWTH * moved_before:
        counts[0] = counts[1] = 0
        counts[2] = 1
        return
    counts[0], counts[1] = min(counts[0] + 1, MEMORY), (row + 1) % MEMORY
    stored = counts[0]
    system = np.empty((stored, stored + 1))
    for k in range(stored):
        product, side = 0.0, 0.0
        for n in range(size):
            product += changes[k, n] * changes[row, n]
            side += changes[k, n] * last[1, n]
        normal[row, k] = normal[k, row] = product
        system[k, stored] = side
    for k in range(stored):
        for m in range(stored):
            system[k, m] = normal[k, m] * (1 + RIDGE if k == m else 1.0)
    if not eliminate(system):  # the step is zero or repeats an earlier one
        counts[0] = counts[1] = 0
        return
    for k in range(stored):
        for n in range(size):
            mixed[n] -= system[k, stored] * images[k, n]


def anderson(size: int) -> Callable[[np.ndarray, np.ndarray], np.ndarray]:
    """Anderson acceleration of a fixed-point iteration x <- g(x) of (n,) unknowns.

    Returns a function of a point and its image g(point), both (n,), to the next point at which to
    evaluate g: of all mixtures of the last steps with weights that add up to 1, the one with the
    smallest linearized residual g(x) - x (Walker and Ni, SIAM J. Numer. Anal. 49, 2011).
    """
    memory, normal = np.zeros((2 * MEMORY + 2, size)), np.zeros((MEMORY, MEMORY))
    counts = np.zeros(3, np.int64)

    def following(point: np.ndarray, image: np.ndarray) -> np.ndarray:
        mixed = np.empty(image.size)
        accelerate(memory, normal, counts, point, image, mixed)
        return mixed

    return following


@compiled(inline="always")
def spring_step(
    min_slope, ends, gap, area, edge, forces, compliance, surface, slope, tops, stiffness, current,
    pressure, local, rest, depths,
):  # fmt: skip
    """Fit the springs of each body to the surface under `current`, and write the pressures on them;
    returns the largest change."""
    change = 0.0
    for body in range(forces.size):
        low, high = ends[body], ends[body + 1]
        for n in range(low, high):
            # A stiffened place has a stiffer spring. The converged surface does not depend on the
            # springs, so limiting the slope only keeps them finite.
            local[n] = (compliance[body] + edge[n]) * max(slope[n], min_slope)
            rest[n] = surface[n] + (edge[n] * slope[n] - local[n]) * current[n]
            tops[n] = gap[n] + rest[n]
            stiffness[n] = area[n] * compliance[body] / local[n]
        depths[body] = spring_depth(forces[body], tops[low:high], stiffness[low:high], depths[body])
        for n in range(low, high):
            tops[n] = depths[body] - gap[n]  # the deflection
        own = redistribute_force(
            tops[low:high], rest[low:high], local[low:high], area[low:high], current[low:high],
            pressure[low:high],
        )  # fmt: skip
        change = max(change, own)
    return change


def iterate_work(of_layer: tuple[np.ndarray, ...], pins: int) -> tuple[np.ndarray, ...]:
    """Arrays that `iterate` works in. of_layer: the same of `convolve`, see Layer.operator."""
    fine, lines = np.empty_like(of_layer[1]), of_layer[-1]
    sums = np.empty((fine.shape[0] + 1, lines.shape[1] + 1, 2))
    sums[0] = sums[:, 0] = 0.0
    memory = np.empty((2 * MEMORY + 2, pins)), np.zeros((MEMORY, MEMORY)), np.zeros(3, np.int64)
    return fine, sums, np.empty((5, pins)), *memory


@compiled(nogil=True)
def iterate(
    tolerance, step, max_steps, min_slope, pins, cover, ends, forces, compliance, stiffens,
    operator, reaches, gains, work, current, pressure, local, rest, depths, linear,
):  # fmt: skip
    """Steps on n pins until the pressure changes by less than a tolerance, a share of the force.

    step: size of the steps, 1 for full ones, which are preconditioned and accelerated. pins: see
    Pins.arrays. ends: (bodies + 1,) of the bodies among the pins. forces: (bodies,) in units of a
    fine cell's spring x mm. compliance: (bodies,) of the springs, mm/MPa. work: see `iterate_work`.
    current: (n,) the initial pressure, MPa; afterwards that at which the last step started. Writes
    pressure, local, rest, (n,), depths, (bodies,), and linear, (R, C), the deflection of the linear
    layer, of the last step. Returns the last change and the number of steps.
    """
    kernel, smooth, weights, first, taps, of_layer = operator
    fine, sums, of_pins, memory, normal, counts = work
    bodies, rows, columns, sides, gap, area, edge, thickness = pins
    surface, slope, tops, stiffness = of_pins[0], of_pins[1], of_pins[2], of_pins[3]
    size, change, mixed = gap.size, np.inf, of_pins[4]
    for steps in range(1, max_steps + 1):
        spread(current, bodies, rows, columns, sides, cover, fine)
        convolve(fine, kernel, smooth, weights, first, taps, of_layer, linear)
        _mean_deflections(
            linear, cover, bodies, rows, columns, sides, area, thickness, stiffens, surface, slope
        )
        change = spring_step(
            min_slope, ends, gap, area, edge, forces, compliance, surface, slope, tops, stiffness,
            current, pressure, local, rest, depths,
        )  # fmt: skip
        if steps >= MIN_STEPS and change < tolerance:
            return change, steps
        if steps == max_steps:
            break
        if step < 1.0:
            for n in range(size):
                current[n] += step * (pressure[n] - current[n])
        else:
            precondition(pressure, current, rows, columns, sides, reaches, gains, sums)
            accelerate(memory, normal, counts, current, pressure, mixed)
            for n in range(size):
                current[n] = max(mixed[n], 0.0)
    return (change if max_steps >= MIN_STEPS else np.inf), max_steps


@compiled(nogil=True)
def penetrated(linear, stiffens, pins, cover, depths, active, found):
    """Write which inactive pins, (n,) bool, have the shape above the surface; whether any."""
    bodies, rows, columns, sides, gap, area, _, thickness = pins
    some = False
    for n in range(gap.size):
        found[n] = False
        if active[n]:
            continue
        inside = depths[bodies[n]] - gap[n] - PENETRATION_MM
        mean, variance = _mean_linear(
            linear, cover, bodies[n], rows[n], columns[n], sides[n], area[n]
        )
        # The law bends by up to 2 / thickness where the surface is pressed.
        if mean > 0.0 and inside <= -variance / thickness[n]:
            continue
        if stiffens:
            mean, _, curvature = stiffened(mean, thickness[n])
            mean += 0.5 * curvature * variance
        found[n] = inside > mean
        some |= found[n]
    return some
