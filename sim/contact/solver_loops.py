"""The loops of a press's step, compiled.

Pins are listed by their first rows and columns in the window and their sides, all (n,) in cells of
the layer. All are of one thread and one order of sums, so that no bit depends on the machine's
load.
"""

import numpy as np

from t2twin.core.jit import compiled
from t2twin.sim.contact.elastomer import stiffened

MAX_NEWTON_STEPS = 200
"""Steps of Newton's method on a convex, piecewise linear function: it ends far sooner, as each step
leaves out pins that the next one does not take up again."""


@compiled(
    "void(f4[:, :, :], f4[:, :, :], f8[:, :], b1, i8[::1], i8[::1], i8[::1], f8[:, ::1], f8[::1],"
    " f8[::1], f8[::1])",
    nogil=True,
)
def means_over_cover(
    answers, weights, thickness, stiffens, rows, columns, sides, cover, covered, deflection, slope
):
    """Mean deflection by the elastomer's law, and its slope, over the covered part of each pin's
    block, from the layer's answers."""
    for n in range(rows.size):
        total, total_slope = 0.0, 0.0
        for i in range(rows[n], rows[n] + sides[n]):
            for j in range(columns[n], columns[n] + sides[n]):
                if cover[i, j] == 0.0:
                    continue
                linear = answers[0, i, j] * weights[0, i, j]
                for k in range(1, answers.shape[0]):
                    linear += answers[k, i, j] * weights[k, i, j]
                if stiffens:
                    sunk, steep = stiffened(np.float64(linear), thickness[i, j])
                else:
                    sunk, steep = np.float64(linear), 1.0
                total += sunk * cover[i, j]
                total_slope += steep * cover[i, j]
        deflection[n] = total / covered[n]
        slope[n] = total_slope / covered[n]


@compiled("f8(f8, f8[::1], f8[::1])", nogil=True)
def depth_carrying(force, tops, stiffness):
    """The depth at which independent springs under a rigid shape carry a force.

    tops: (n,) depths at which each is met. stiffness: (n,), > 0. Newton's method from above, where
    the force is convex in the depth: exact after a finite number of steps.
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
def springs(force, compliance, least_slope, gap, edge, area, surface, slope, ahead, local, rest):
    """What the pins' springs are while the surface lies where the pressure `ahead` has brought it,
    into local and rest; returns the depth at which they carry the force.

    surface, slope: means over the pins' cells. local: compliance of a pin on its own, mm/MPa. rest:
    where its spring carries nothing, mm: what the springs leave out of the layer's answer.
    """
    tops, stiffness = np.empty(gap.size), np.empty(gap.size)
    for n in range(gap.size):
        # A stiffened place is stiffer in its pin's spring too. Where the surface settles does not
        # depend on the springs, so that only they are kept from getting all too stiff.
        steep = max(slope[n], least_slope)
        local[n] = (compliance + edge[n]) * steep
        rest[n] = surface[n] + (edge[n] * slope[n] - local[n]) * ahead[n]
        tops[n] = gap[n] + rest[n]
        stiffness[n] = area[n] * compliance / local[n]
    return depth_carrying(force, tops, stiffness)


@compiled("f8(f8[::1], f8[::1], f8[::1], f8[::1], f8[::1], f8[::1])", nogil=True)
def carried(deflection, rest, local, area, ahead, pressure):
    """The pressure that springs give when they are pressed so far, into pressure; returns how much
    of the force has moved since `ahead`, as a share, inf where nothing carries any."""
    total, moved = 0.0, 0.0
    for n in range(rest.size):
        pressure[n] = max(deflection[n] - rest[n], 0.0) / local[n]
        total += pressure[n] * area[n]
        moved += abs(pressure[n] - ahead[n]) * area[n]
    return moved / total if total > 0.0 else np.inf


@compiled(
    "void(f8[::1], f8[::1], i8[::1], i8[::1], i8[::1], i8[::1], f8[::1], f8[:, :, ::1])",
    nogil=True,
)
def sharpen(pressure, ahead, rows, columns, sides, reaches, gains, sums):
    """Enlarge a step from `ahead` to pressure, in place, where it differs from the pressed pins'
    around.

    A layer answers a pressure the less the shorter its waves are, and springs answer all alike, so
    that steps change the short ones too little. reaches, gains: (k,) of k squares about each pin:
    fine cells beyond its own, and what of the difference from their mean is added. sums:
    (rows + 1, columns + 1, 2), the first row and column zero; overwritten.
    """
    down, across = sums.shape[0] - 1, sums.shape[1] - 1
    sums[1:, 1:] = 0.0
    for n in range(rows.size):
        change = pressure[n] - ahead[n]
        if pressure[n] > 0.0 or ahead[n] > 0.0:
            for i in range(rows[n] + 1, rows[n] + sides[n] + 1):
                for j in range(columns[n] + 1, columns[n] + sides[n] + 1):
                    sums[i, j, 0] = change
                    sums[i, j, 1] = 1.0
    for i in range(1, down + 1):
        change, pressed = 0.0, 0.0
        for j in range(1, across + 1):
            change += sums[i, j, 0]
            pressed += sums[i, j, 1]
            sums[i, j, 0] = sums[i - 1, j, 0] + change
            sums[i, j, 1] = sums[i - 1, j, 1] + pressed
    for n in range(rows.size):
        change = pressure[n] - ahead[n]
        if change == 0.0:
            continue
        for k in range(gains.size):
            top, left = max(rows[n] - reaches[k], 0), max(columns[n] - reaches[k], 0)
            bottom = min(rows[n] + sides[n] + reaches[k], down)
            right = min(columns[n] + sides[n] + reaches[k], across)
            a, b, c, d = sums[bottom, right], sums[top, right], sums[bottom, left], sums[top, left]
            around, pressed = a[0] - b[0] - c[0] + d[0], a[1] - b[1] - c[1] + d[1]
            pressure[n] += gains[k] * (change - around / pressed)
