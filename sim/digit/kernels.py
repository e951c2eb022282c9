"""The baked model's inner loops, compiled: sight of the lamps, light on the gel, the picture.

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
    return np.array(stops)


RAY_STOPS_MM = _ray_stops()

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
    finite = True
    for i in range(ny):
        for j in range(nx):
            w = surface[i, j]
            if not np.isfinite(w):
                finite = False
            if abs(w) > least:
                top = min(top, i)
                bottom = max(bottom, i + 1)
                left = min(left, j)
                right = max(right, j + 1)
    return top, bottom, left, right, finite


@_jit_finite
def coated(surface):
    """(G) surface smoothed by COAT_TAPS along both axes; its edge cells continue outwards."""
    ny, nx = surface.shape
    reach = COAT_TAPS.size // 2
    across = np.empty_like(surface)
    out = np.empty_like(surface)
    for i in range(ny):
        for j in range(nx):
            total = np.float32(0.0)
            for k in range(COAT_TAPS.size):
                total += COAT_TAPS[k] * surface[i, min(max(j + k - reach, 0), nx - 1)]
            across[i, j] = total
    for i in range(ny):
        for j in range(nx):
            out[i, j] = 0.0
        for k in range(COAT_TAPS.size):
            row = across[min(max(i + k - reach, 0), ny - 1)]
            for j in range(nx):
                out[i, j] += COAT_TAPS[k] * row[j]
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
def sight_of_lamps(heights, x0, y0, pitch, caster, window, lamps, size, sight):
    """Fill sight (lamps, C) with the part of each lamp's disc that each cell sees.

    heights: (C), mm. x0, y0: centre of its first cell; pitch: its pitch, mm.
    caster: region of C that may block. window: region of C whose cells are wanted.
    lamps: (lamps, 3), mm. size: radius of their discs, mm.
    Returns the region of C where some sight was less than whole.

    Along the ray to a lamp's middle a blocker at distance s with clearance c hides the disc up
    to c D / s from its middle, D being the lamp's distance, by similar triangles.
    """
    r0, r1, c0, c1 = caster
    top, bottom, left, right = heights.shape[0], 0, heights.shape[1], 0
    if r1 <= r0 or c1 <= c0:
        return 0, 0, 0, 0
    nearest = heights[r0:r1, c0:c1].min() - SHADOW_BIAS_MM
    last_i, last_j = heights.shape[0] - 2, heights.shape[1] - 2
    for k in range(lamps.shape[0]):
        for i in range(window[0], window[1]):
            for j in range(window[2], window[3]):
                z = heights[i, j]
                dx = lamps[k, 0] - (x0 + j * pitch)
                dy = lamps[k, 1] - (y0 + i * pitch)
                far = np.sqrt(dx * dx + dy * dy)
                # grid steps and fall of the ray per mm of ground
                gi, gj = dy / (far * pitch), dx / (far * pitch)
                fall = (lamps[k, 2] - z) / far
                begin, end = 0.0, far
                # only over the caster, and only below its nearest point to the camera
                if gi != 0.0:
                    a, b = (r0 - i) / gi, (r1 - 1 - i) / gi
                    begin, end = max(begin, min(a, b)), min(end, max(a, b))
                elif i < r0 or i >= r1:
                    continue
                if gj != 0.0:
                    a, b = (c0 - j) / gj, (c1 - 1 - j) / gj
                    begin, end = max(begin, min(a, b)), min(end, max(a, b))
                elif j < c0 or j >= c1:
                    continue
                # the shallowest ray, to the disc's lower edge, stays longest among blockers
                shallow = fall + size / far
                if shallow < 0.0:
                    end = min(end, (nearest - z) / shallow)
                if end <= begin:
                    continue
                n = 0
                while n < RAY_STOPS_MM.size and RAY_STOPS_MM[n] < begin:
                    n += 1
                least = 1e9
                while n < RAY_STOPS_MM.size and RAY_STOPS_MM[n] <= end:
                    s = RAY_STOPS_MM[n]
                    fi, fj = i + gi * s, j + gj * s
                    a, b = min(max(int(fi), 0), last_i), min(max(int(fj), 0), last_j)
                    u, v = fi - a, fj - b
                    ground = (1 - u) * ((1 - v) * heights[a, b] + v * heights[a, b + 1]) + u * (
                        (1 - v) * heights[a + 1, b] + v * heights[a + 1, b + 1]
                    )
                    least = min(least, (ground - z + SHADOW_BIAS_MM) / s - fall)
                    n += 1
                cut = least * far / size
                if cut >= 1.0:
                    continue
                if cut <= -1.0:
                    sight[k, i, j] = 0.0
                else:
                    # part of a disc above a chord, as an odd cubic: within 0.01
                    sight[k, i, j] = 0.5 + cut * (0.6366 - 0.1366 * cut * cut)
                top, bottom = min(top, i), max(bottom, i + 1)
                left, right = min(left, j), max(right, j + 1)
    return top, bottom, left, right


@_jit_finite
def soften(sight, region, softened):
    """Fill a region of softened with sight (lamps, C) blurred by 1, 2, 1 along both axes.

    Stands for the discs' width, which hides behind a side edge over about one cell.
    """
    ny, nx = sight.shape[1], sight.shape[2]
    for k in range(sight.shape[0]):
        for i in range(max(region[0], 1), min(region[1], ny - 1)):
            for j in range(max(region[2], 1), min(region[3], nx - 1)):
                total = 0.0
                for a in range(-1, 2):
                    row = 0.25 * sight[k, i + a, j - 1] + 0.25 * sight[k, i + a, j + 1]
                    row += 0.5 * sight[k, i + a, j]
                    total += row * (0.5 if a == 0 else 0.25)
                softened[k, i, j] = total


@_jit_finite
def light(
    z, sight, gain, lamps, colours, reach_mm, across, down, distance, x0, y0, pitch, region, steps,
    depth, seen,
):  # fmt: skip
    """Fill regions of depth (S) and seen (S, RGB): where the rays end, and the light there.

    z: heights (G), mm. sight: (lamps, C). gain: (S, lamps, COSINE_TERMS). depth holds a first
    guess of z. across, down: slopes of the samples' rays. The formula stands in sim.digit.baked.
    All numbers are float32: twice as fast as mixed ones.
    """
    one, two, nought = np.float32(1.0), np.float32(2.0), np.float32(0.0)
    last_i, last_j = z.shape[0] - 3, z.shape[1] - 3
    coarse_i, coarse_j = sight.shape[1] - 2, sight.shape[2] - 2
    shift, per_cell = np.float32(0.5 * (SHADOW_STRIDE - 1)), np.float32(1.0 / SHADOW_STRIDE)
    per_mm = one / pitch
    per_slope = per_mm / two
    reach2 = reach_mm * reach_mm
    for row in range(region[0], region[1]):
        for column in range(region[2], region[3]):
            height = depth[row, column]
            for step in range(steps + 1):
                x, y = across[column] * (distance + height), down[row] * (distance + height)
                fi, fj = (y - y0) * per_mm, (x - x0) * per_mm
                i, j = min(max(int(fi), 1), last_i), min(max(int(fj), 1), last_j)
                u, v = fi - np.float32(i), fj - np.float32(j)
                if step == steps:
                    break
                upper = z[i, j] + v * (z[i, j + 1] - z[i, j])
                lower = z[i + 1, j] + v * (z[i + 1, j + 1] - z[i + 1, j])
                height = upper + u * (lower - upper)
            depth[row, column] = height
            # central differences at the cell's corners, interpolated
            p, q = one - u, one - v
            sx = p * (q * (z[i, j + 1] - z[i, j - 1]) + v * (z[i, j + 2] - z[i, j])) + u * (
                q * (z[i + 1, j + 1] - z[i + 1, j - 1]) + v * (z[i + 1, j + 2] - z[i + 1, j])
            )
            sy = q * (p * (z[i + 1, j] - z[i - 1, j]) + u * (z[i + 2, j] - z[i, j])) + v * (
                p * (z[i + 1, j + 1] - z[i - 1, j + 1]) + u * (z[i + 2, j + 1] - z[i, j + 1])
            )
            sx, sy = sx * per_slope, sy * per_slope
            length2 = one + sx * sx + sy * sy
            ci, cj = (fi - shift) * per_cell, (fj - shift) * per_cell
            a, b = min(max(int(ci), 0), coarse_i), min(max(int(cj), 0), coarse_j)
            p, q = ci - np.float32(a), cj - np.float32(b)
            red, green, blue = nought, nought, nought
            for k in range(lamps.shape[0]):
                dx, dy, dz = lamps[k, 0] - x, lamps[k, 1] - y, lamps[k, 2] - height
                facing = sx * dx + sy * dy - dz
                if facing <= nought:
                    continue
                upper = sight[k, a, b] + q * (sight[k, a, b + 1] - sight[k, a, b])
                lower = sight[k, a + 1, b] + q * (sight[k, a + 1, b + 1] - sight[k, a + 1, b])
                part = upper + p * (lower - upper)
                if part <= nought:
                    continue
                far2 = dx * dx + dy * dy + dz * dz
                m = facing / np.sqrt(length2 * far2)
                g = gain[row, column, k]
                table = g[0] + m * (g[1] + m * (g[2] + m * g[3]))
                value = max(table, nought) * m * part * reach2 / far2
                red += colours[k, 0] * value
                green += colours[k, 1] * value
                blue += colours[k, 2] * value
            seen[row, column, 0] = red
            seen[row, column, 1] = green
            seen[row, column, 2] = blue


@_jit_finite
def picture(change, background, rest, table, region, draws, quantiles, sigma, out):
    """Fill out (P, RGB) uint8: the background's light and the change, encoded, noisy, rounded.

    change: (S, RGB) linear light, interpolated to the pixels of a region; the others show the
    background (P, RGB) grey levels. rest: (P, RGB) the background's linear light.
    table: grey levels over the square root of linear light, 0 to 1.
    draws: (P * RGB,) uint16, each turned into noise by quantiles, sigma grey levels; or (0,).
    """
    near, apart = np.float32(0.75), np.float32(0.25)
    nought, one, half = np.float32(0.0), np.float32(1.0), np.float32(0.5)
    last, brightest = np.float32(table.size - 1), np.float32(255.0)
    rows, columns = background.shape[0], background.shape[1]
    noisy = draws.size > 0
    line = np.empty(change.shape[1] * 3, dtype=np.float32)
    grey = np.empty(columns * 3, dtype=np.float32)
    for row in range(rows):
        still = background[row].ravel()
        for n in range(columns * 3):
            grey[n] = still[n]
        if region[0] <= row < region[1]:
            i = (row + 1) // 2
            u, w = (apart, near) if row % 2 == 0 else (near, apart)
            above, below = change[i].ravel(), change[i + 1].ravel()
            for n in range(line.size):
                line[n] = u * above[n] + w * below[n]
            for column in range(region[2], region[3]):
                n = 3 * ((column + 1) // 2)
                u, w = (apart, near) if column % 2 == 0 else (near, apart)
                for c in range(3):
                    value = u * line[n + c] + w * line[n + c + 3] + rest[row, column, c]
                    value = np.sqrt(min(max(value, nought), one))
                    grey[3 * column + c] = table[np.int32(value * last + half)]
        if noisy:
            first = row * columns * 3
            for n in range(columns * 3):
                grey[n] += sigma * quantiles[draws[first + n]]
        filled = out[row].ravel()
        for n in range(columns * 3):
            filled[n] = np.uint8(min(max(grey[n], nought), brightest) + half)
