"""The baked model's inner loops, compiled: sight of the lamps, light on the gel, the picture.

Shapes: G the optical grid (ny, nx), C its shadow grid (ny // stride, nx // stride), P the
picture (rows, columns). Regions are (first row, end row, first column, end column).
"""

import numba
import numpy as np

SHADOW_STRIDE = 2
"""Cells of the optical grid to a cell of the shadow grid: 0.2 mm."""
SHADOW_STEP_MM = 0.2
"""Step of a shadow ray, mm; the gel's features are wider."""
SHADOW_START_MM = 0.2
"""Where a shadow ray begins, mm: out of its own cell."""
SHADOW_BIAS_MM = 0.06
"""Clearance given to every ray, mm, so that a surface does not shade itself."""
STRIP_PLACES = np.array([-0.6, 0.0, 0.6])
"""Places of the rays over a lamp's width, in its radii: three upright strips of the disc."""
STRIP_HALF_HEIGHTS = np.array([0.8, 1.0, 0.8])
"""Half heights of the strips, in radii: sqrt(1 - place^2)."""
STRIP_WEIGHTS = np.array([0.29, 0.42, 0.29])
"""Parts of the disc's area in the strips, cut at 0.33 radii from the middle."""

_jit = numba.njit(cache=True, nogil=True, error_model="numpy")


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


@_jit
def coarse_heights(rest, surface):
    """(C) mean heights rest - surface over blocks of the grid, mm."""
    ny, nx = surface.shape[0] // SHADOW_STRIDE, surface.shape[1] // SHADOW_STRIDE
    out = np.empty((ny, nx), dtype=np.float32)
    for i in range(ny):
        for j in range(nx):
            total = 0.0
            for a in range(SHADOW_STRIDE):
                for b in range(SHADOW_STRIDE):
                    k, m = i * SHADOW_STRIDE + a, j * SHADOW_STRIDE + b
                    total += rest[k, m] - surface[k, m]
            out[i, j] = total / (SHADOW_STRIDE * SHADOW_STRIDE)
    return out


@_jit
def sight_of_lamps(heights, x0, y0, pitch, caster, window, strips, size, sight):
    """Fill sight (lamps, C) with the part of each lamp's disc that each cell sees.

    heights: (C), mm. x0, y0: centre of its first cell; pitch: its pitch, mm.
    caster: region of C that may block. window: region of C whose cells are wanted.
    strips: (lamps, strips, 3) middles of the strips of the discs. size: discs' radius, mm.
    Returns the region of C where some sight was less than whole.

    Along a ray to a strip's middle the blocker at distance s with clearance c hides the strip
    up to c D / s on the lamp, D away, by similar triangles.
    """
    r0, r1, c0, c1 = caster
    top, bottom, left, right = heights.shape[0], 0, heights.shape[1], 0
    if r1 <= r0 or c1 <= c0:
        return 0, 0, 0, 0
    nearest = heights[r0:r1, c0:c1].min()
    last_i, last_j = heights.shape[0] - 1.001, heights.shape[1] - 1.001
    for k in range(strips.shape[0]):
        for i in range(window[0], window[1]):
            for j in range(window[2], window[3]):
                z = heights[i, j]
                seen = 0.0
                for m in range(strips.shape[1]):
                    dx = strips[k, m, 0] - (x0 + j * pitch)
                    dy = strips[k, m, 1] - (y0 + i * pitch)
                    far = np.sqrt(dx * dx + dy * dy)
                    # grid steps and fall of the ray per mm of ground
                    gi, gj = dy / (far * pitch), dx / (far * pitch)
                    fall = (strips[k, m, 2] - z) / far
                    begin, end = SHADOW_START_MM, far
                    # only over the caster, and only below its nearest point to the camera
                    if gi != 0.0:
                        a, b = (r0 - i) / gi, (r1 - 1 - i) / gi
                        begin, end = max(begin, min(a, b)), min(end, max(a, b))
                    elif i < r0 or i >= r1:
                        end = 0.0
                    if gj != 0.0:
                        a, b = (c0 - j) / gj, (c1 - 1 - j) / gj
                        begin, end = max(begin, min(a, b)), min(end, max(a, b))
                    elif j < c0 or j >= c1:
                        end = 0.0
                    half = size * STRIP_HALF_HEIGHTS[m]
                    if fall < 0.0:
                        # the strip's lower edge is the shallowest ray of the strip
                        shallow = min(fall + half / far, -1e-3)
                        end = min(end, (nearest - z - SHADOW_BIAS_MM) / shallow)
                    least = half
                    s = begin
                    while s <= end:
                        fi = min(max(i + gi * s, 0.0), last_i)
                        fj = min(max(j + gj * s, 0.0), last_j)
                        a, b = int(fi), int(fj)
                        u, v = fi - a, fj - b
                        ground = (1 - u) * ((1 - v) * heights[a, b] + v * heights[a, b + 1]) + u * (
                            (1 - v) * heights[a + 1, b] + v * heights[a + 1, b + 1]
                        )
                        clear = (ground - (z + fall * s) + SHADOW_BIAS_MM) * far / s
                        if clear < least:
                            least = clear
                            if least <= -half:
                                break
                        s += SHADOW_STEP_MM
                    seen += STRIP_WEIGHTS[m] * min(max(0.5 + 0.5 * least / half, 0.0), 1.0)
                sight[k, i, j] = seen
                if seen < 0.999:
                    top, bottom = min(top, i), max(bottom, i + 1)
                    left, right = min(left, j), max(right, j + 1)
    return top, bottom, left, right


@_jit
def shade(z, sight, x, y, lamps, response, colours, place_mm, reach_mm, region, light):
    """Fill a region of light (G, 3), linear RGB, from heights z (G) and sight (lamps, C).

    The formula stands in sim.digit.baked.
    """
    ny, nx = z.shape
    cy, cx = sight.shape[1], sight.shape[2]
    pitch = x[1] - x[0]
    for i in range(region[0], region[1]):
        above, below = max(i - 1, 0), min(i + 1, ny - 1)
        fi = min(max((i - 0.5 * (SHADOW_STRIDE - 1)) / SHADOW_STRIDE, 0.0), cy - 1.001)
        a = int(fi)
        u = fi - a
        v = y[i] / place_mm
        for j in range(region[2], region[3]):
            before, after = max(j - 1, 0), min(j + 1, nx - 1)
            sx = (z[i, after] - z[i, before]) / ((after - before) * pitch)
            sy = (z[below, j] - z[above, j]) / ((below - above) * pitch)
            length = np.sqrt(1.0 + sx * sx + sy * sy)
            fj = min(max((j - 0.5 * (SHADOW_STRIDE - 1)) / SHADOW_STRIDE, 0.0), cx - 1.001)
            b = int(fj)
            t = fj - b
            h = x[j] / place_mm
            red, green, blue = 0.0, 0.0, 0.0
            for k in range(lamps.shape[0]):
                dx, dy, dz = lamps[k, 0] - x[j], lamps[k, 1] - y[i], lamps[k, 2] - z[i, j]
                far2 = dx * dx + dy * dy + dz * dz
                m = (sx * dx + sy * dy - dz) / (length * np.sqrt(far2))
                if m <= 0.0:
                    continue
                r = response[k]
                gain = (
                    r[0, 0] + h * r[1, 0] + v * r[2, 0] + h * h * r[3, 0]
                    + h * v * r[4, 0] + v * v * r[5, 0]
                    + m * (
                        r[0, 1] + h * r[1, 1] + v * r[2, 1] + h * h * r[3, 1]
                        + h * v * r[4, 1] + v * v * r[5, 1]
                        + m * (
                            r[0, 2] + h * r[1, 2] + v * r[2, 2] + h * h * r[3, 2]
                            + h * v * r[4, 2] + v * v * r[5, 2]
                        )
                    )
                )  # fmt: skip
                part = (1 - u) * ((1 - t) * sight[k, a, b] + t * sight[k, a, b + 1]) + u * (
                    (1 - t) * sight[k, a + 1, b] + t * sight[k, a + 1, b + 1]
                )
                value = max(gain, 0.0) * m * part * reach_mm * reach_mm / far2
                red += colours[k, 0] * value
                green += colours[k, 1] * value
                blue += colours[k, 2] * value
            light[i, j, 0] = red
            light[i, j, 1] = green
            light[i, j, 2] = blue


@_jit
def meet(z, across, down, distance, x0, y0, pitch, region, steps, depth):
    """Refine depth (P), the z at which each pixel's ray meets the heights z (G), in place."""
    last_i, last_j = z.shape[0] - 1.001, z.shape[1] - 1.001
    for row in range(region[0], region[1]):
        for column in range(region[2], region[3]):
            height = depth[row, column]
            for _ in range(steps):
                fi = min(max((down[row] * (distance + height) - y0) / pitch, 0.0), last_i)
                fj = min(max((across[column] * (distance + height) - x0) / pitch, 0.0), last_j)
                i, j = int(fi), int(fj)
                u, v = fi - i, fj - j
                height = (1 - u) * ((1 - v) * z[i, j] + v * z[i, j + 1]) + u * (
                    (1 - v) * z[i + 1, j] + v * z[i + 1, j + 1]
                )
            depth[row, column] = height


@_jit
def look_up(light, depth, across, down, distance, x0, y0, pitch, region, seen):
    """Fill a region of seen (P, 3) with the light (G, 3) where each pixel's ray ends."""
    last_i, last_j = light.shape[0] - 1.001, light.shape[1] - 1.001
    for row in range(region[0], region[1]):
        for column in range(region[2], region[3]):
            reach = distance + depth[row, column]
            fi = min(max((down[row] * reach - y0) / pitch, 0.0), last_i)
            fj = min(max((across[column] * reach - x0) / pitch, 0.0), last_j)
            i, j = int(fi), int(fj)
            u, v = fi - i, fj - j
            for c in range(3):
                seen[row, column, c] = (1 - u) * (
                    (1 - v) * light[i, j, c] + v * light[i, j + 1, c]
                ) + u * ((1 - v) * light[i + 1, j, c] + v * light[i + 1, j + 1, c])


@_jit
def encode(seen, residual, table, region, picture):
    """Fill a region of picture (P, 3), grey levels, with encoded seen + residual light.

    table: grey levels over the square root of linear light, 0 to 1.
    """
    last = table.size - 1
    for row in range(region[0], region[1]):
        for column in range(region[2], region[3]):
            for c in range(3):
                light = min(max(seen[row, column, c] + residual[row, column, c], 0.0), 1.0)
                picture[row, column, c] = table[int(np.sqrt(light) * last + 0.5)]
