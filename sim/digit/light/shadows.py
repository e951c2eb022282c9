"""Shadows: the part of each LED's disc that each place of the gel has in sight.

G is the optical grid (ny, nx), C its shadow grid (ny // SHADOW_STRIDE, nx // SHADOW_STRIDE).
Regions are (first row, end row, first column, end column). All numbers but the LEDs' sizes are
float32: twice as fast as mixed ones.

Along the ray to an LED's middle a blocker at distance s with clearance c hides the disc up to
c D / s from its middle, D being the LED's distance, by similar triangles.
"""

import numpy as np

from t2twin.sim.digit.camera.compiled import bilinear, inlined, jit_finite

SHADOW_STRIDE = 2
"""Cells of the optical grid to a cell of the shadow grid: 0.2 mm."""
CASTER_LEAST_MM = 0.02
"""Least deflection that casts a shadow, mm (assumed). The untouched gel casts none: its LEDs shine
through its sides."""
SHADOW_BIAS_MM = 0.01
"""Clearance given to every ray, mm, so that a surface does not shade itself (assumed)."""
MIN_GAP_MM = np.float32(1e-4)
"""Least distance to an LED along an axis, mm, so that it can be divided by."""


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
PER_STOP = (1.0 / RAY_STOPS_MM).astype(np.float32)
FIRST_STOPS = np.searchsorted(RAY_STOPS_MM, np.arange(100.0))
"""Index of the first of RAY_STOPS_MM at or after each whole millimeter."""

_ZERO, _ONE, _BIAS = np.float32(0.0), np.float32(1.0), np.float32(SHADOW_BIAS_MM)
_FAR_ABOVE, _TWO, _SIX = np.float32(1e9), np.float32(2.0), np.float32(6.0)


@jit_finite
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


@jit_finite
def sight_of_leds(heights, x0, y0, pitch, caster, window, leds, sizes, sight, shadowed):
    """Fill sight (LEDs, C), which is whole, with the part of each LED's disc that each cell sees,
    and shadowed (LEDs, 4) with the region of C where that was less than whole.

    heights: (C), mm. x0, y0: center of its first cell; pitch: its pitch, mm.
    caster: region of C that may block. window: region of C whose cells are wanted.
    leds: (LEDs, 3), mm. sizes: (LEDs,) radii of their discs, mm.
    Every other cell is looked at first, and those between only where not all of these about them
    see the whole disc: no shadow of a disc is thinner.
    """
    shadowed[:] = 0
    if caster[1] <= caster[0] or caster[3] <= caster[2]:
        return
    nearest = heights[caster[0], caster[2]]
    for i in range(caster[0], caster[1]):
        for j in range(caster[2], caster[3]):
            nearest = min(nearest, heights[i, j])
    nearest = nearest - _BIAS
    columns = heights.shape[1]
    fars, begins = np.empty(columns, dtype=np.float32), np.empty(columns, dtype=np.float32)
    ends = np.empty(columns, dtype=np.float32)
    for k in range(leds.shape[0]):
        led, size, seen = leds[k], np.float32(sizes[k]), sight[k]
        top, bottom, left, right = heights.shape[0], 0, heights.shape[1], 0
        for turn in range(2 * (window[1] - window[0])):
            i, first = _row_and_column(turn, window)
            row = heights[i, window[2] : window[3]]
            dy = led[1] - (y0 + np.float32(i) * pitch)
            if first == window[2]:
                _spans(row, i, first, dy, led, size, x0, pitch, caster, nearest, fars, begins, ends)
            for j in range(first, window[3], 2):
                m = j - window[2]
                begin, end, far, z = begins[m], ends[m], fars[m], row[m]
                if end <= begin or end < RAY_STOPS_MM[0]:
                    continue
                if _whole_about(seen, i, j, window):
                    continue
                # grid steps and fall of the ray per mm of ground
                per_mm = _ONE / far
                gi = dy * per_mm / pitch
                gj = (led[0] - (x0 + np.float32(j) * pitch)) * per_mm / pitch
                least = _least_rise(heights, i, j, gi, gj, z, begin, end)
                cut = (least - (led[2] - z) * per_mm) * far / size
                if cut >= _ONE:
                    continue
                seen[i, j] = _part_above_chord(cut)
                top, bottom = min(top, i), max(bottom, i + 1)
                left, right = min(left, j), max(right, j + 1)
        if bottom > top:
            shadowed[k, 0], shadowed[k, 1] = top, bottom
            shadowed[k, 2], shadowed[k, 3] = left, right


@inlined
def _row_and_column(turn, window):
    """The row whose turn it is and the first of every other column: all even rows come before the
    odd ones, and in a row the even columns."""
    rows = window[1] - window[0]
    even = (rows + 1) // 2
    place, odd_row = (turn // 2, 0) if turn < 2 * even else (turn // 2 - even, 1)
    return window[0] + 2 * place + odd_row, window[2] + turn % 2


@inlined
def _whole_about(seen, i, j, window):
    """Whether the cells about a cell that have been looked at before it see the whole disc."""
    if (i - window[0]) % 2 == 0:
        if (j - window[2]) % 2 == 0 or j + 1 == window[3]:
            return False
        return seen[i, j - 1] + seen[i, j + 1] >= _TWO
    if i + 1 == window[1]:
        return False
    left, right = max(j - 1, 0), min(j + 1, seen.shape[1] - 1)
    above = seen[i - 1, left] + seen[i - 1, j] + seen[i - 1, right]
    below = seen[i + 1, left] + seen[i + 1, j] + seen[i + 1, right]
    return above + below >= _SIX


@inlined
def _spans(row, i, first, dy, led, size, x0, pitch, caster, nearest, fars, begins, ends):
    """Fill, for the cells of a row from column `first` on, how far the LED is and between which
    distances its ray must be looked along, mm: only there can it be blocked.

    dy: from the row to the LED along y, mm. nearest: z of the caster's nearest point to the camera.
    """
    # rays along an axis are turned a little, for the divisions
    gap_y = dy if abs(dy) > MIN_GAP_MM else MIN_GAP_MM
    per_gap = pitch / gap_y
    near_y, far_y = np.float32(caster[0] - i) * per_gap, np.float32(caster[1] - 1 - i) * per_gap
    near_y, far_y = min(near_y, far_y), max(near_y, far_y)
    for m in range(row.size):
        j = m + first
        dx = led[0] - (x0 + np.float32(j) * pitch)
        gap_x = dx if abs(dx) > MIN_GAP_MM else MIN_GAP_MM
        per_gap = pitch / gap_x
        near_x, far_x = np.float32(caster[2] - j) * per_gap, np.float32(caster[3] - 1 - j) * per_gap
        far = np.sqrt(dx * dx + dy * dy)
        # only over the caster (parts of the way to the LED so far) ...
        begin = max(max(near_y, min(near_x, far_x)), _ZERO)
        end = min(min(far_y, max(near_x, far_x)), _ONE)
        # ... and only below its nearest point to the camera: the shallowest ray, to the
        # disc's lower edge, stays longest among blockers
        fall = min(led[2] - row[m] + size, -MIN_GAP_MM)
        end = min(end, (nearest - row[m]) / fall)
        fars[m], begins[m], ends[m] = far, begin * far, end * far


@inlined
def _least_rise(heights, i, j, gi, gj, z, begin, end):
    """Least z of the surface over a cell's own, per mm of ground, where its ray may be blocked.

    gi, gj: rows and columns that the ray passes per mm. begin, end: from where to where, mm.
    """
    last_i, last_j = heights.shape[0] - 2, heights.shape[1] - 2
    n = FIRST_STOPS[int(begin)]
    while n < RAY_STOPS_MM.size and RAY_STOPS_MM[n] < begin:
        n += 1
    least = _FAR_ABOVE
    while n < RAY_STOPS_MM.size and RAY_STOPS_MM[n] <= end:
        s = RAY_STOPS_MM[n]
        fi, fj = np.float32(i) + gi * s, np.float32(j) + gj * s
        a, b = min(max(int(fi), 0), last_i), min(max(int(fj), 0), last_j)
        u, v = fi - np.float32(a), fj - np.float32(b)
        there = bilinear(
            heights[a, b], heights[a, b + 1], heights[a + 1, b], heights[a + 1, b + 1], u, v
        )
        least = min(least, (there - z + _BIAS) * PER_STOP[n])
        n += 1
    return least


@inlined
def _part_above_chord(cut):
    """Part of a disc above a chord at cut radii from its middle, below 1: an odd cubic, to 0.01."""
    if cut <= -_ONE:
        return 0.0
    return 0.5 + cut * (0.6366 - 0.1366 * cut * cut)


@jit_finite
def soften(sight, shadowed, softened):
    """Fill the regions shadowed (LEDs, 4) of softened with sight (LEDs, C) blurred by 1, 2, 1 along
    both axes.

    Stands for the discs' width, which hides behind a side edge over about one cell.
    """
    ny, nx = sight.shape[1], sight.shape[2]
    half, quarter = np.float32(0.5), np.float32(0.25)
    down = np.empty(nx, dtype=np.float32)
    for k in range(sight.shape[0]):
        left, right = max(shadowed[k, 2], 1), min(shadowed[k, 3], nx - 1)
        for i in range(max(shadowed[k, 0], 1), min(shadowed[k, 1], ny - 1)):
            above, row, below = sight[k, i - 1], sight[k, i], sight[k, i + 1]
            filled = softened[k, i]
            for j in range(nx):
                down[j] = half * row[j] + quarter * (above[j] + below[j])
            for j in range(left, right):
                filled[j] = half * down[j] + quarter * (down[j - 1] + down[j + 1])
