"""How the LEDs' light falls on the deflected gel, where the camera's rays end.

G is the optical grid (ny, nx), C its shadow grid, P the picture (rows, columns), S the picture's
lattice of samples: one in the middle of every 2 x 2 pixels and one more beyond each edge
(rows / 2 + 2, columns / 2 + 2). Regions are (first row, end row, first column, end column).
All numbers are float32: twice as fast as mixed ones.
"""

import numpy as np

from t2twin.sim.digit.compiled import bilinear, inlined, jit, jit_finite

COSINE_TERMS = 4
"""Powers of the cosine of incidence beside the first: m^0 to m^3."""
NEAR_ENOUGH_MM = np.float32(2e-3)
"""A ray whose height changed by less in a step, mm, has met the gel: 0.02 pixels."""

_ZERO, _ONE, _TWO = np.float32(0.0), np.float32(1.0), np.float32(2.0)


@jit_finite
def incidence(
    z, sight, stride, shadowed, leds, reach_mm, across, down, distance, x0, y0, pitch, region,
    steps, depth, cosine, weight,
):  # fmt: skip
    """Fill regions of depth (S), cosine and weight (LEDs, S): where the rays end, LEDs there.

    z: heights (G), mm. sight: (LEDs, C), a cell of C being stride cells of G; whole outside the
    region shadowed of G. leds: (LEDs, 3), mm. depth holds the untouched surface's z.
    across, down: slopes of the samples' rays. distance: from the pinhole to the apex; x0, y0:
    centre of G's first cell; pitch: G's, mm. cosine: m_k; weight: V_k m_k (REACH / d_k)^2 of the
    formula in t2twin.sim.digit.baked, 0 where an LED is not seen.
    A ray's first guess is what the row above was moved by; it takes as many fixed-point steps as
    it needs, at most steps.
    A row is worked out in two sweeps: the surface, read here and there, then the LEDs, in vector
    loops.
    """
    per_mm = _ONE / pitch
    per_slope = per_mm / _TWO
    reach2 = reach_mm * reach_mm
    first, end = region[2], region[3]
    across = across[first:end]
    slope_x, slope_y = np.empty_like(across), np.empty_like(across)
    part = np.ones((leds.shape[0], across.size), dtype=np.float32)
    moved = np.zeros_like(across)
    top, bottom, left, right = shadowed
    for row in range(region[0], region[1]):
        heights = depth[row, first:end]
        for n in range(across.size):
            height, fi, fj, i, j = _meeting(
                z, across[n], down[row], heights[n] + moved[n], distance, x0, y0, per_mm, steps
            )
            moved[n] = height - heights[n]
            heights[n] = height
            slope_x[n], slope_y[n] = _slopes(z, fi, fj, i, j, per_slope)
            if top <= i < bottom and left <= j < right:
                _look_up(sight, stride, fi, fj, part, n)
            else:
                for k in range(leds.shape[0]):
                    part[k, n] = _ONE
        for k in range(leds.shape[0]):
            _shine(
                leds[k], part[k], reach2, across, down[row], distance, heights, slope_x, slope_y,
                cosine[k, row, first:end], weight[k, row, first:end],
            )  # fmt: skip


@inlined
def _meeting(z, across, down, height, distance, x0, y0, per_mm, steps):
    """Where a ray meets the surface: its z, its row and column in G as fractions and as cells.

    across, down: the ray's slopes. height: the first guess of its z, mm.
    """
    last_i, last_j = z.shape[0] - 3, z.shape[1] - 3
    step = 0
    while True:
        x, y = across * (distance + height), down * (distance + height)
        fi, fj = (y - y0) * per_mm, (x - x0) * per_mm
        i, j = min(max(int(fi), 1), last_i), min(max(int(fj), 1), last_j)
        u, v = fi - np.float32(i), fj - np.float32(j)
        before = height
        height = bilinear(z[i, j], z[i, j + 1], z[i + 1, j], z[i + 1, j + 1], u, v)
        if abs(height - before) < NEAR_ENOUGH_MM or step == steps:
            break
        step += 1
    return height, fi, fj, i, j


@inlined
def _slopes(z, fi, fj, i, j, per_slope):
    """dz/dx and dz/dy: central differences at the corners of cell (i, j), interpolated."""
    u, v = fi - np.float32(i), fj - np.float32(j)
    p, q = _ONE - u, _ONE - v
    along_x = per_slope * (
        p * (q * (z[i, j + 1] - z[i, j - 1]) + v * (z[i, j + 2] - z[i, j]))
        + u * q * (z[i + 1, j + 1] - z[i + 1, j - 1])
        + u * v * (z[i + 1, j + 2] - z[i + 1, j])
    )
    along_y = per_slope * (
        q * (p * (z[i + 1, j] - z[i - 1, j]) + u * (z[i + 2, j] - z[i, j]))
        + v * p * (z[i + 1, j + 1] - z[i - 1, j + 1])
        + v * u * (z[i + 2, j + 1] - z[i, j + 1])
    )
    return along_x, along_y


@inlined
def _look_up(sight, stride, fi, fj, part, n):
    """Fill part (LEDs, samples) of one sample with the sight (LEDs, C) of each LED there."""
    shift, per_cell = np.float32(0.5 * (stride - 1)), np.float32(1.0 / stride)
    ci, cj = (fi - shift) * per_cell, (fj - shift) * per_cell
    a = min(max(int(ci), 0), sight.shape[1] - 2)
    b = min(max(int(cj), 0), sight.shape[2] - 2)
    p, q = ci - np.float32(a), cj - np.float32(b)
    for k in range(sight.shape[0]):
        part[k, n] = bilinear(
            sight[k, a, b], sight[k, a, b + 1], sight[k, a + 1, b], sight[k, a + 1, b + 1], p, q
        )


@inlined
def _shine(
    led, parts, reach2, across, down, distance, heights, slope_x, slope_y, cosines, weights
):  # fmt: skip
    """Fill a row's cosines and weights of one LED, from where its rays end and the slopes there."""
    led_x, led_y, led_z = led[0], led[1], led[2]
    for n in range(across.size):
        height, sx, sy = heights[n], slope_x[n], slope_y[n]
        reached = distance + height
        dx, dy = led_x - across[n] * reached, led_y - down * reached
        dz = led_z - height
        facing = max(sx * dx + sy * dy - dz, _ZERO)
        far2 = dx * dx + dy * dy + dz * dz
        m = facing / np.sqrt((_ONE + sx * sx + sy * sy) * far2)
        cosines[n] = m
        weights[n] = m * max(parts[n], _ZERO) * reach2 / far2


@jit_finite
def light(cosine, weight, gain, rest, region, seen):
    """Fill a region of seen (RGB, S) with the LEDs' light, less rest (RGB, S).

    cosine, weight: (LEDs, S), from incidence. gain: (rows of S, LEDs, RGB, COSINE_TERMS,
    columns of S): a row of the picture lies together, its columns next to each other.
    """
    first, end = region[2], region[3]
    for row in range(region[0], region[1]):
        for c in range(seen.shape[0]):
            filled, less = seen[c, row, first:end], rest[c, row, first:end]
            for n in range(filled.size):  # an array set to another compiles words for its errors
                filled[n] = -less[n]
            for k in range(cosine.shape[0]):
                cosines, weights = cosine[k, row, first:end], weight[k, row, first:end]
                g0, g1 = gain[row, k, c, 0, first:end], gain[row, k, c, 1, first:end]
                g2, g3 = gain[row, k, c, 2, first:end], gain[row, k, c, 3, first:end]
                for n in range(filled.size):
                    m = cosines[n]
                    filled[n] += weights[n] * (g0[n] + m * (g1[n] + m * (g2[n] + m * g3[n])))


@jit
def gains(terms, response, gain):
    """Fill gain, as light takes it, from the response at every sample.

    terms: (rows of S, columns of S, PLACE_TERMS) float32 polynomials of the place. response:
    (LEDs, RGB, PLACE_TERMS, COSINE_TERMS) float64. Sums are float64, in the polynomials' order;
    entries of the response that are 0 cost nothing.
    """
    rows, columns, places = terms.shape
    by_term = np.empty((places, columns))
    total = np.empty(columns)
    for row in range(rows):
        for n in range(columns):
            for i in range(places):
                by_term[i, n] = terms[row, n, i]
        for k in range(response.shape[0]):
            for c in range(response.shape[1]):
                for j in range(response.shape[3]):
                    total[:] = 0.0
                    for i in range(places):
                        entry = response[k, c, i, j]
                        if entry != 0.0:
                            term = by_term[i]
                            for n in range(columns):
                                total[n] += entry * term[n]
                    filled = gain[row, k, c, j]
                    for n in range(columns):
                        filled[n] = np.float32(total[n])
