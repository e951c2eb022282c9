"""The baked model's inner loops, compiled: sight of the LEDs, light on the gel, the picture.

Shapes: G the optical grid (ny, nx), C its shadow grid (ny // stride, nx // stride), P the
picture (rows, columns), S the picture's lattice of samples: one in the middle of every 2 x 2
pixels and one more beyond each edge (rows / 2 + 2, columns / 2 + 2).
Regions are (first row, end row, first column, end column).
"""

import numba
import numpy as np

SHADOW_STRIDE = 2
"""Cells of the optical grid to a cell of the shadow grid: 0.2 mm."""
SHADOW_BIAS_MM = 0.01
"""Clearance given to every ray, mm, so that a surface does not shade itself."""
COSINE_TERMS = 4
"""Powers of the cosine of incidence beside the first: m^0 to m^3."""


NEAR_ENOUGH_MM = np.float32(2e-3)
"""A ray whose height changed by less in a step, mm, has met the gel: 0.02 pixels."""

COAT_TAPS = np.array([0.0614, 0.2448, 0.3876, 0.2448, 0.0614], dtype=np.float32)
"""Weights of five cells: a Gaussian of one cell, 0.1 mm."""


def _ray_stops() -> np.ndarray:
    """Distances from a cell, mm, at which its rays look for blockers, rising.

    Near blockers are looked for at the shadow grid's pitch; the step then grows with the
    distance as the penumbra does.
    """
    stops, step_mm, growth, reach_mm = [0.2], 0.2, 0.05, 40.0
    while stops[-1] < reach_mm:
        stops.append(stops[-1] + step_mm + growth * stops[-1])
    return np.array(stops, dtype=np.float32)


RAY_STOPS_MM = _ray_stops()
FIRST_STOPS = np.searchsorted(RAY_STOPS_MM, np.arange(100.0))
"""Index of the first of RAY_STOPS_MM at or after each whole millimetre."""
LEAST_GAP_MM = np.float32(1e-4)
"""Least distance to a LED along an axis, mm, so that it can be divided by."""

_jit = numba.njit(cache=True, nogil=True, error_model="numpy")
# finite numbers only: lets minima and maxima be vectorised, changes no rounding
_jit_finite = numba.njit(
    cache=True, nogil=True, error_model="numpy", fastmath={"nnan", "ninf", "nsz"}
)


@_jit
def bounds(surface, least):
    """Region of the cells deflected by more than least (empty: end <= first), and finiteness."""
    ny, nx = surface.shape
    top, bottom, left, right = ny, 0, nx, 0
    limit, largest = np.float32(least), np.float32(np.finfo(np.float32).max)
    finite = True
    for i in range(ny):
        row = surface[i]
        # counts, not branches, so that a row is one vector loop
        deflected, good = 0, 0
        for j in range(nx):
            w = abs(row[j])
            deflected += w > limit
            good += w <= largest
        finite = finite and good == nx
        if deflected == 0:
            continue
        top, bottom = min(top, i), i + 1
        j = 0
        while j < left and not abs(row[j]) > limit:
            j += 1
        left = min(left, j)
        j = nx
        while j > right and not abs(row[j - 1]) > limit:
            j -= 1
        right = max(right, j)
    return top, bottom, left, right, finite


@_jit_finite
def coated(surface):
    """(G) surface smoothed by COAT_TAPS along both axes; its edge cells continue outwards."""
    ny, nx = surface.shape
    taps, reach = COAT_TAPS.size, COAT_TAPS.size // 2
    padded = np.empty(nx + 2 * reach, dtype=np.float32)
    across = np.zeros_like(surface)
    out = np.zeros_like(surface)
    for i in range(ny):
        padded[:reach] = surface[i, 0]
        padded[reach : reach + nx] = surface[i]
        padded[reach + nx :] = surface[i, nx - 1]
        row = across[i]
        for k in range(taps):
            tap, shifted = COAT_TAPS[k], padded[k : k + nx]
            for j in range(nx):
                row[j] += tap * shifted[j]
    for i in range(ny):
        row = out[i]
        for k in range(taps):
            tap, shifted = COAT_TAPS[k], across[min(max(i + k - reach, 0), ny - 1)]
            for j in range(nx):
                row[j] += tap * shifted[j]
    return out


@_jit_finite
def coarse_heights(z):
    """(C) means of heights z (G) over blocks of the grid, mm."""
    ny, nx = z.shape[0] // SHADOW_STRIDE, z.shape[1] // SHADOW_STRIDE
    out = np.empty((ny, nx), dtype=np.float32)
    for i in range(ny):
        for j in range(nx):
            total = 0.0
            for a in range(SHADOW_STRIDE):
                for b in range(SHADOW_STRIDE):
                    total += z[i * SHADOW_STRIDE + a, j * SHADOW_STRIDE + b]
            out[i, j] = total / (SHADOW_STRIDE * SHADOW_STRIDE)
    return out


@_jit_finite
def sight_of_leds(heights, x0, y0, pitch, caster, window, leds, sizes, sight):
    """Fill sight (leds, C) with the part of each LED's disc that each cell sees.

    heights: (C), mm. x0, y0: centre of its first cell; pitch: its pitch, mm.
    caster: region of C that may block. window: region of C whose cells are wanted.
    leds: (leds, 3), mm. sizes: (leds,) radii of their discs, mm.
    Returns the region of C where some sight was less than whole.
    All numbers but sizes are float32: twice as fast as mixed ones.

    Along the ray to a LED's middle a blocker at distance s with clearance c hides the disc up
    to c D / s from its middle, D being the LED's distance, by similar triangles.
    """
    r0, r1, c0, c1 = caster
    top, bottom, left, right = heights.shape[0], 0, heights.shape[1], 0
    if r1 <= r0 or c1 <= c0:
        return 0, 0, 0, 0
    one, nought, bias = np.float32(1.0), np.float32(0.0), np.float32(SHADOW_BIAS_MM)
    nearest = heights[r0:r1, c0:c1].min() - bias
    last_i, last_j = heights.shape[0] - 2, heights.shape[1] - 2
    columns = heights.shape[1]
    fars, begins = np.empty(columns, dtype=np.float32), np.empty(columns, dtype=np.float32)
    ends = np.empty(columns, dtype=np.float32)
    for k in range(leds.shape[0]):
        size = np.float32(sizes[k])
        for i in range(window[0], window[1]):
            row = heights[i, window[2] : window[3]]
            dy = leds[k, 1] - (y0 + np.float32(i) * pitch)
            # rays along an axis are turned a little, for the divisions
            gap_y = dy if abs(dy) > LEAST_GAP_MM else LEAST_GAP_MM
            per_gap = pitch / gap_y
            near_y, far_y = np.float32(r0 - i) * per_gap, np.float32(r1 - 1 - i) * per_gap
            near_y, far_y = min(near_y, far_y), max(near_y, far_y)
            for m in range(row.size):
                j = m + window[2]
                dx = leds[k, 0] - (x0 + np.float32(j) * pitch)
                gap_x = dx if abs(dx) > LEAST_GAP_MM else LEAST_GAP_MM
                per_gap = pitch / gap_x
                near_x, far_x = np.float32(c0 - j) * per_gap, np.float32(c1 - 1 - j) * per_gap
                far = np.sqrt(dx * dx + dy * dy)
                # only over the caster (parts of the way to the LED so far) ...
                begin = max(max(near_y, min(near_x, far_x)), nought)
                end = min(min(far_y, max(near_x, far_x)), one)
                # ... and only below its nearest point to the camera: the shallowest ray, to the
                # disc's lower edge, stays longest among blockers
                fall = min(leds[k, 2] - row[m] + size, -LEAST_GAP_MM)
                end = min(end, (nearest - row[m]) / fall)
                fars[m], begins[m], ends[m] = far, begin * far, end * far
            for m in range(row.size):
                j, begin, end, far, z = m + window[2], begins[m], ends[m], fars[m], row[m]
                if end <= begin or end < RAY_STOPS_MM[0]:
                    continue
                # grid steps and fall of the ray per mm of ground
                per_mm = one / far
                gi = dy * per_mm / pitch
                gj = (leds[k, 0] - (x0 + np.float32(j) * pitch)) * per_mm / pitch
                n = FIRST_STOPS[int(begin)]
                while n < RAY_STOPS_MM.size and RAY_STOPS_MM[n] < begin:
                    n += 1
                least = np.float32(1e9)
                while n < RAY_STOPS_MM.size and RAY_STOPS_MM[n] <= end:
                    s = RAY_STOPS_MM[n]
                    fi, fj = np.float32(i) + gi * s, np.float32(j) + gj * s
                    a, b = min(max(int(fi), 0), last_i), min(max(int(fj), 0), last_j)
                    u, v = fi - np.float32(a), fj - np.float32(b)
                    upper = heights[a, b] + v * (heights[a, b + 1] - heights[a, b])
                    lower = heights[a + 1, b] + v * (heights[a + 1, b + 1] - heights[a + 1, b])
                    least = min(least, (upper + u * (lower - upper) - z + bias) / s)
                    n += 1
                cut = (least - (leds[k, 2] - z) * per_mm) * far / size
                if cut >= one:
                    continue
                if cut <= -one:
                    sight[k, i, j] = nought
                else:
                    # part of a disc above a chord, as an odd cubic: within 0.01
                    sight[k, i, j] = 0.5 + cut * (0.6366 - 0.1366 * cut * cut)
                top, bottom = min(top, i), max(bottom, i + 1)
                left, right = min(left, j), max(right, j + 1)
    return top, bottom, left, right


@_jit_finite
def soften(sight, region, softened):
    """Fill a region of softened with sight (leds, C) blurred by 1, 2, 1 along both axes.

    Stands for the discs' width, which hides behind a side edge over about one cell.
    """
    ny, nx = sight.shape[1], sight.shape[2]
    half, quarter = np.float32(0.5), np.float32(0.25)
    left, right = max(region[2], 1), min(region[3], nx - 1)
    down = np.empty(nx, dtype=np.float32)
    for k in range(sight.shape[0]):
        for i in range(max(region[0], 1), min(region[1], ny - 1)):
            above, row, below = sight[k, i - 1], sight[k, i], sight[k, i + 1]
            filled = softened[k, i]
            for j in range(nx):
                down[j] = half * row[j] + quarter * (above[j] + below[j])
            for j in range(left, right):
                filled[j] = half * down[j] + quarter * (down[j - 1] + down[j + 1])


@_jit_finite
def incidence(
    z, sight, shadowed, leds, reach_mm, across, down, distance, x0, y0, pitch, region, steps,
    depth, cosine, weight,
):  # fmt: skip
    """Fill regions of depth (S), cosine and weight (leds, S): where the rays end, LEDs there.

    z: heights (G), mm. sight: (leds, C), whole outside the region shadowed of G. depth holds the
    untouched surface's z. across, down: slopes of the samples' rays. cosine: m_k; weight:
    V_k m_k (REACH / d_k)^2 of the formula in t2twin.sim.digit.baked, 0 where an LED is not seen.
    A ray's first guess is what the row above was moved by; it takes as many fixed-point steps as
    it needs, at most steps.
    All numbers are float32: twice as fast as mixed ones. A row is worked out in two sweeps: the
    surface, read here and there, then the LEDs, in vector loops.
    """
    one, two, nought = np.float32(1.0), np.float32(2.0), np.float32(0.0)
    last_i, last_j = z.shape[0] - 3, z.shape[1] - 3
    coarse_i, coarse_j = sight.shape[1] - 2, sight.shape[2] - 2
    shift, per_cell = np.float32(0.5 * (SHADOW_STRIDE - 1)), np.float32(1.0 / SHADOW_STRIDE)
    per_mm = one / pitch
    per_slope = per_mm / two
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
            height = heights[n] + moved[n]
            step = 0
            while True:
                x, y = across[n] * (distance + height), down[row] * (distance + height)
                fi, fj = (y - y0) * per_mm, (x - x0) * per_mm
                i, j = min(max(int(fi), 1), last_i), min(max(int(fj), 1), last_j)
                u, v = fi - np.float32(i), fj - np.float32(j)
                upper = z[i, j] + v * (z[i, j + 1] - z[i, j])
                lower = z[i + 1, j] + v * (z[i + 1, j + 1] - z[i + 1, j])
                before, height = height, upper + u * (lower - upper)
                if abs(height - before) < NEAR_ENOUGH_MM or step == steps:
                    break
                step += 1
            moved[n] = height - heights[n]
            heights[n] = height
            # central differences at the cell's corners, interpolated
            p, q = one - u, one - v
            slope_x[n] = per_slope * (
                p * (q * (z[i, j + 1] - z[i, j - 1]) + v * (z[i, j + 2] - z[i, j]))
                + u * q * (z[i + 1, j + 1] - z[i + 1, j - 1])
                + u * v * (z[i + 1, j + 2] - z[i + 1, j])
            )
            slope_y[n] = per_slope * (
                q * (p * (z[i + 1, j] - z[i - 1, j]) + u * (z[i + 2, j] - z[i, j]))
                + v * p * (z[i + 1, j + 1] - z[i - 1, j + 1])
                + v * u * (z[i + 2, j + 1] - z[i, j + 1])
            )
            if not (top <= i < bottom and left <= j < right):
                for k in range(leds.shape[0]):
                    part[k, n] = one
                continue
            ci, cj = (fi - shift) * per_cell, (fj - shift) * per_cell
            a, b = min(max(int(ci), 0), coarse_i), min(max(int(cj), 0), coarse_j)
            p, q = ci - np.float32(a), cj - np.float32(b)
            for k in range(leds.shape[0]):
                upper = sight[k, a, b] + q * (sight[k, a, b + 1] - sight[k, a, b])
                lower = sight[k, a + 1, b] + q * (sight[k, a + 1, b + 1] - sight[k, a + 1, b])
                part[k, n] = upper + p * (lower - upper)
        for k in range(leds.shape[0]):
            led_x, led_y, led_z = leds[k, 0], leds[k, 1], leds[k, 2]
            cosines, weights = cosine[k, row, first:end], weight[k, row, first:end]
            parts = part[k]
            for n in range(across.size):
                height, sx, sy = heights[n], slope_x[n], slope_y[n]
                reached = distance + height
                dx, dy = led_x - across[n] * reached, led_y - down[row] * reached
                dz = led_z - height
                facing = max(sx * dx + sy * dy - dz, nought)
                far2 = dx * dx + dy * dy + dz * dz
                m = facing / np.sqrt((one + sx * sx + sy * sy) * far2)
                cosines[n] = m
                weights[n] = m * max(parts[n], nought) * reach2 / far2


@_jit_finite
def light(cosine, weight, gain, rest, region, seen):
    """Fill a region of seen (RGB, S) with the LEDs' light, less rest (RGB, S).

    cosine, weight: (leds, S), from incidence. gain: (rows of S, LEDs, RGB, COSINE_TERMS,
    columns of S): a row of the picture lies together, its columns next to each other.
    """
    first, end = region[2], region[3]
    for row in range(region[0], region[1]):
        for c in range(seen.shape[0]):
            filled = seen[c, row, first:end]
            filled[:] = -rest[c, row, first:end]
            for k in range(cosine.shape[0]):
                cosines, weights = cosine[k, row, first:end], weight[k, row, first:end]
                g0, g1 = gain[row, k, c, 0, first:end], gain[row, k, c, 1, first:end]
                g2, g3 = gain[row, k, c, 2, first:end], gain[row, k, c, 3, first:end]
                for n in range(filled.size):
                    m = cosines[n]
                    filled[n] += weights[n] * (g0[n] + m * (g1[n] + m * (g2[n] + m * g3[n])))


@_jit_finite
def picture(change, background, rest, table, region, draws, quantiles, sigma, out):
    """Fill out (P, RGB) uint8: the background's light and the change, encoded, noisy, rounded.

    change: (RGB, S) linear light, interpolated to the pixels of a region; the others show the
    background (P, RGB) grey levels. rest: (P, RGB) the background's linear light.
    table: grey levels over the square root of linear light, 0 to 1.
    draws: (P * RGB,) uint16, each turned into noise by quantiles, sigma grey levels; or (0,).
    """
    near, apart = np.float32(0.75), np.float32(0.25)
    nought, one, half = np.float32(0.0), np.float32(1.0), np.float32(0.5)
    last, brightest = np.float32(table.size - 1), np.float32(255.0)
    rows, columns = background.shape[0], background.shape[1]
    noisy = draws.size > 0
    line = np.empty(change.shape[2], dtype=np.float32)
    grey, value = np.empty(3 * columns, dtype=np.float32), np.empty(3 * columns, dtype=np.float32)
    entry = np.empty(3 * columns, dtype=np.int32)
    for row in range(rows):
        still, lit, filled = background[row].ravel(), rest[row].ravel(), out[row].ravel()
        changed = region[0] <= row < region[1]
        for n in range(3 * columns):
            grey[n] = still[n]
        if changed:
            i = (row + 1) // 2
            u, w = (apart, near) if row % 2 == 0 else (near, apart)
            for c in range(3):
                above, below = change[c, i], change[c, i + 1]
                for n in range(line.size):
                    line[n] = u * above[n] + w * below[n]
                # a pair of columns lies about its sample in the middle, n + 1
                for n in range(columns // 2):
                    value[6 * n + c] = apart * line[n] + near * line[n + 1]
                    value[6 * n + 3 + c] = near * line[n + 1] + apart * line[n + 2]
            for n in range(3 * columns):
                entry[n] = np.int32(np.sqrt(min(max(value[n] + lit[n], nought), one)) * last + half)
            for n in range(3 * region[2], 3 * region[3]):
                grey[n] = table[entry[n]]
        if noisy:
            drawn = draws[3 * columns * row : 3 * columns * (row + 1)]
            for n in range(3 * columns):
                grey[n] += sigma * quantiles[drawn[n]]
        for n in range(3 * columns):
            filled[n] = np.uint8(min(max(grey[n], nought), brightest) + half)
