"""Light of the LEDs on the deflected gel, where the camera's rays meet it.

G is the optical grid (ny, nx), C its shadow grid, P the image (rows, columns), S the image's
lattice of samples: one in the middle of every 2 x 2 pixels and one more beyond each edge
(rows / 2 + 2, columns / 2 + 2). Regions are (first row, end row, first column, end column).
All numbers are float32, which is twice as fast as mixed types.

The lobe is light that depends on the direction of the gel's normal, not only on the cosine of
incidence. A semi-specular coating and LEDs that are wider than a disc shift an LED's highlight. The
lobe is a quadratic polynomial of the normal's lateral components times a quadratic polynomial of
the place.
"""

import numpy as np

from t2twin.sim.optical.camera.compiled import bilinear, inlined, jit_finite

COSINE_TERMS = 4
"""Number of powers of the cosine of incidence: m^0 to m^3."""
GAIN_STRIDE = 2
"""Distance of the rows of S with stored gains; the others are interpolated. The gains of all rows
would exceed the processor's cache. One grey level in a thousand changes, by one."""
RAY_TOLERANCE_MM = np.float32(2e-3)
"""Tolerance of a ray's height at the gel, mm: 0.02 pixels."""

LOBE_DEGREE = 2
"""Degree of the lobe in the place (assumed; others were not compared)."""
LOBE_PLACES = (LOBE_DEGREE + 1) * (LOBE_DEGREE + 2) // 2
LOBE_TERMS = 5
"""Number of normal_terms."""

_ZERO, _ONE, _TWO = np.float32(0.0), np.float32(1.0), np.float32(2.0)


@jit_finite
def incidence(
    z, sight, stride, shadowed, leds, reach_mm, across, down, distance, x0, y0, pitch, region,
    steps, depth, cosine, weight,
):  # fmt: skip
    """Fill a region of depth (S), cosine and weight (LEDs, S) where the rays meet the gel.

    z: heights (G), mm. sight: (LEDs, C) visible fractions of the LEDs' discs, 1 outside each LED's
    region of G, shadowed (LEDs, 4); a cell of C is stride cells of G. leds: (LEDs, 3), mm. depth:
    initially z of the gel at rest. across, down: slopes of the samples' rays. distance: from the
    pinhole to the apex; x0, y0: center of G's first cell; pitch: G's, mm. cosine: m_k; weight:
    V_k m_k (REACH / d_k)^2 of the formula in t2twin.sim.optical.image_renderer, 0 where an LED is
    hidden. A ray starts from the displacement in the row above and takes at most `steps`
    fixed-point steps. Each row is computed in two passes: the surface, with scattered reads, then
    the LEDs, in vectorized loops.
    """
    per_mm = _ONE / pitch
    per_slope = per_mm / _TWO
    reach2 = reach_mm * reach_mm
    first, end = region[2], region[3]
    across = across[first:end]
    slope_x, slope_y = np.empty_like(across), np.empty_like(across)
    part = np.ones((leds.shape[0], across.size), dtype=np.float32)
    moved = np.zeros_like(across)
    rows, columns = np.empty_like(across), np.empty_like(across)
    shift, per_cell = np.float32(0.5 * (stride - 1)), np.float32(1.0 / stride)
    for row in range(region[0], region[1]):
        heights = depth[row, first:end]
        for n in range(across.size):
            height, fi, fj, i, j = _intersection(
                z, across[n], down[row], heights[n] + moved[n], distance, x0, y0, per_mm, steps
            )
            moved[n] = height - heights[n]
            heights[n] = height
            slope_x[n], slope_y[n] = slopes(z, fi, fj, i, j, per_slope)
            rows[n], columns[n] = fi, fj
        for k in range(leds.shape[0]):
            top, bottom = shadowed[k, 0], shadowed[k, 1]
            left, right = shadowed[k, 2], shadowed[k, 3]
            for n in range(across.size):
                part[k, n] = _ONE
                if top <= rows[n] < bottom and left <= columns[n] < right:
                    part[k, n] = _look_up(
                        sight[k], (rows[n] - shift) * per_cell, (columns[n] - shift) * per_cell
                    )
            _shine(
                leds[k], part[k], reach2, across, down[row], distance, heights, slope_x, slope_y,
                cosine[k, row, first:end], weight[k, row, first:end],
            )  # fmt: skip


@inlined
def _intersection(z, across, down, height, distance, x0, y0, per_mm, steps):
    """Intersection of a ray and the surface: z, fractional row and column in G, and their cell.

    across, down: the ray's slopes. height: the initial z, mm.
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
        if abs(height - before) < RAY_TOLERANCE_MM or step == steps:
            break
        step += 1
    return height, fi, fj, i, j


@inlined
def slopes(z, fi, fj, i, j, per_slope):
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
def _look_up(sight, row, column):
    """sight (C), interpolated at a place in cells."""
    a = min(max(int(row), 0), sight.shape[0] - 2)
    b = min(max(int(column), 0), sight.shape[1] - 2)
    down, across = row - np.float32(a), column - np.float32(b)
    return bilinear(
        sight[a, b], sight[a, b + 1], sight[a + 1, b], sight[a + 1, b + 1], down, across
    )


@inlined
def _shine(
    led, parts, reach2, across, down, distance, heights, slope_x, slope_y, cosines, weights
):  # fmt: skip
    """Fill one LED's cosines and weights in a row, from heights and slopes at the rays' ends."""
    led_x, led_y, led_z = led[0], led[1], led[2]
    for n in range(across.size):
        height, sx, sy = heights[n], slope_x[n], slope_y[n]
        reached = distance + height
        dx, dy = led_x - across[n] * reached, led_y - down * reached
        dz = led_z - height
        facing = max(sx * dx + sy * dy - dz, _ZERO)
        nearness = _ONE / (dx * dx + dy * dy + dz * dz)
        m = facing * np.sqrt(nearness / (_ONE + sx * sx + sy * sy))
        cosines[n] = m
        weights[n] = m * max(parts[n], _ZERO) * reach2 * nearness


@jit_finite
def light(cosine, weight, gain, rest, region, seen):
    """Fill a region of seen (RGB, S) with the LEDs' light minus rest (RGB, S).

    cosine, weight: (LEDs, S), from incidence. gain: (gain_rows of S, LEDs, RGB, COSINE_TERMS,
    columns of S), interpolated linearly between its rows.
    """
    first, end = region[2], region[3]
    leds, colors, columns = gain.shape[1], gain.shape[2], gain.shape[4]
    between = np.empty((leds, colors, COSINE_TERMS, columns), dtype=np.float32)
    blended = between.ravel()
    total = np.empty(end - first, dtype=np.float32)
    for row in range(region[0], region[1]):
        above = row // GAIN_STRIDE
        apart = max(min(GAIN_STRIDE, cosine.shape[1] - 1 - GAIN_STRIDE * above), 1)
        part = np.float32(row % GAIN_STRIDE) / np.float32(apart)
        upper, lower = gain[above].ravel(), gain[above + 1].ravel()
        for n in range(blended.size):
            blended[n] = upper[n] + part * (lower[n] - upper[n])
        for c in range(colors):
            filled, less = seen[c, row, first:end], rest[c, row, first:end]
            for n in range(total.size):
                total[n] = -less[n]
            for k in range(leds):
                cosines, weights = cosine[k, row, first:end], weight[k, row, first:end]
                g0, g1 = between[k, c, 0, first:end], between[k, c, 1, first:end]
                g2, g3 = between[k, c, 2, first:end], between[k, c, 3, first:end]
                for n in range(total.size):
                    m = cosines[n]
                    total[n] += weights[n] * (g0[n] + m * (g1[n] + m * (g2[n] + m * g3[n])))
            for n in range(total.size):
                filled[n] = total[n]


def gain_rows(rows: int) -> np.ndarray:
    """(n,) the rows of S with stored gains, including the last one, for so many rows."""
    return np.minimum(GAIN_STRIDE * np.arange((rows - 1) // GAIN_STRIDE + 2), rows - 1)


def normal_terms(normals: np.ndarray) -> np.ndarray:
    """(..., LOBE_TERMS) n_x, n_y, n_x^2, n_x n_y, n_y^2 of normals (..., 2)."""
    x, y = normals[..., 0], normals[..., 1]
    return np.stack([x, y, x * x, x * y, y * y], axis=-1)


def lobe_columns(normals: np.ndarray, weight: np.ndarray, places: np.ndarray) -> np.ndarray:
    """(..., LOBE_PLACES * LOBE_TERMS): one LED's light per unit of each entry of its lobe.

    normals: (..., 2). weight: (...) of that LED. places: (..., places) polynomials.
    """
    terms = weight[..., None] * normal_terms(normals)
    columns = places[..., :LOBE_PLACES, None] * terms[..., None, :]
    return columns.reshape(*weight.shape, -1)


def lobe_gain(lobe: np.ndarray, places: np.ndarray) -> np.ndarray:
    """(LEDs, RGB, LOBE_TERMS, S) float32: the lobe at each place, for add_lobe.

    lobe: (LEDs, RGB, LOBE_PLACES, LOBE_TERMS). places: (S, places) polynomials.
    """
    gain = np.einsum("kcij,rsi->kcjrs", lobe, places[..., :LOBE_PLACES], optimize=True)
    return np.ascontiguousarray(gain, dtype=np.float32)


@jit_finite
def add_lobe(normals, weight, gain, region, seen):
    """Add the lobes' light to a region (first row, end row, first column, end column) of seen.

    normals: (2, S) x and y. weight: (LEDs, S), from incidence. gain: from lobe_gain.
    seen: (RGB, S).
    """
    first, end = region[2], region[3]
    for row in range(region[0], region[1]):
        x, y = normals[0, row, first:end], normals[1, row, first:end]
        for c in range(gain.shape[1]):
            filled = seen[c, row, first:end]
            for k in range(gain.shape[0]):
                weights = weight[k, row, first:end]
                g0, g1 = gain[k, c, 0, row, first:end], gain[k, c, 1, row, first:end]
                g2, g3 = gain[k, c, 2, row, first:end], gain[k, c, 3, row, first:end]
                g4 = gain[k, c, 4, row, first:end]
                for n in range(x.size):
                    along = g0[n] + x[n] * g2[n] + y[n] * g3[n]
                    filled[n] += weights[n] * (x[n] * along + y[n] * (g1[n] + y[n] * g4[n]))


@jit_finite
def fill_normals(z, depth, across, down, distance, x0, y0, pitch, region, normals):
    """Fill a region of normals (2, S): x and y of the unit normals towards the camera.

    z: heights of the optical grid, mm. depth: (S) heights where the rays meet the gel. The others
    are as in illumination.incidence.
    """
    per_mm = _ONE / pitch
    per_slope = np.float32(0.5) * per_mm
    last_i, last_j = z.shape[0] - 3, z.shape[1] - 3
    for row in range(region[0], region[1]):
        for n in range(region[2], region[3]):
            reached = distance + depth[row, n]
            fi, fj = (down[row] * reached - y0) * per_mm, (across[n] * reached - x0) * per_mm
            i, j = min(max(int(fi), 1), last_i), min(max(int(fj), 1), last_j)
            sx, sy = slopes(z, fi, fj, i, j, per_slope)
            length = np.sqrt(_ONE + sx * sx + sy * sy)
            normals[0, row, n], normals[1, row, n] = sx / length, sy / length
