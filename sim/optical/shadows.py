"""Soft shadows: the visible fraction of each LED's disc at each place of the gel.

G is the optical grid (ny, nx), C its shadow grid (ny // SHADOW_STRIDE, nx // SHADOW_STRIDE).
Regions are (first row, end row, first column, end column). All numbers but the LEDs' sizes are
float32, which is twice as fast as mixed types.

Let D be the LED's distance. By similar triangles, a blocker at distance s along the ray to the
LED's middle, with clearance c, hides the disc up to c D / s from its middle.
"""

import numpy as np

from t2twin.sim.optical.compiled import bilinear, inlined, jit_finite

SHADOW_STRIDE = 2  # cells of the optical grid per cell of the shadow grid, 0.2 mm
MIN_CASTER_MM = 0.02
"""Smallest deflection that casts a shadow, mm (assumed). The gel at rest casts none: the LEDs shine
through its sides."""
SHADOW_BIAS_MM = 0.01  # clearance added to every ray, mm, which avoids self-shadowing (assumed)
MIN_GAP_MM = np.float32(1e-4)
"""Smallest distance to an LED along an axis, mm, which avoids divisions by zero."""


def _ray_stops() -> np.ndarray:
    """Distances along a ray, mm, rising, at which heights are compared.

    They start at the shadow grid's pitch; the step grows with the distance as the penumbra does.
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
def led_visibility(heights, x0, y0, pitch, caster, window, leds, sizes, sight, shadowed):
    """Fill sight (LEDs, C), initially 1, with the visible fraction of each LED's disc at each cell,
    and shadowed (LEDs, 4) with the region of C where it is below 1.

    heights: (C), mm. x0, y0: center of its first cell; pitch: its pitch, mm.
    caster: region of C that may block rays. window: region of C to compute.
    leds: (LEDs, 3), mm. sizes: (LEDs,) radii of their discs, mm.
    Every second cell is computed first. A cell between is skipped if its computed neighbors see the
    whole disc, since no shadow of a disc is thinner.
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
                if _neighbors_are_lit(seen, i, j, window):
                    continue
                # grid steps and slope of the ray per mm along the ground
                per_mm = _ONE / far
                gi = dy * per_mm / pitch
                gj = (led[0] - (x0 + np.float32(j) * pitch)) * per_mm / pitch
                least = _min_slope(heights, i, j, gi, gj, z, begin, end)
                cut = (least - (led[2] - z) * per_mm) * far / size
                if cut >= _ONE:
                    continue
                seen[i, j] = _fraction_above_chord(cut)
                top, bottom = min(top, i), max(bottom, i + 1)
                left, right = min(left, j), max(right, j + 1)
        if bottom > top:
            shadowed[k, 0], shadowed[k, 1] = top, bottom
            shadowed[k, 2], shadowed[k, 3] = left, right


@inlined
def _row_and_column(turn, window):
    """The row and first column of a turn: even rows first, in each row even columns first."""
    rows = window[1] - window[0]
    even = (rows + 1) // 2
    place, odd_row = (turn // 2, 0) if turn < 2 * even else (turn // 2 - even, 1)
    return window[0] + 2 * place + odd_row, window[2] + turn % 2


@inlined
def _neighbors_are_lit(seen, i, j, window):
    """Whether the neighbors of a cell that were computed before it see the whole disc."""
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
    """Fill each cell's distance to the LED and the interval in which its ray can be blocked, mm."""
    # rays along an axis are rotated slightly, which avoids divisions by zero
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
        # over the caster, in parts of the distance to the LED
        begin = max(max(near_y, min(near_x, far_x)), _ZERO)
        end = min(min(far_y, max(near_x, far_x)), _ONE)
        # below the caster's point nearest to the camera, for the shallowest ray, to the disc's
        # lower edge
        fall = min(led[2] - row[m] + size, -MIN_GAP_MM)
        end = min(end, (nearest - row[m]) / fall)
        fars[m], begins[m], ends[m] = far, begin * far, end * far


@inlined
def _min_slope(heights, i, j, gi, gj, z, begin, end):
    """Smallest slope from a cell to the surface along its ray between two distances, mm."""
    n = FIRST_STOPS[int(begin)]
    while n < RAY_STOPS_MM.size and RAY_STOPS_MM[n] < begin:
        n += 1
    least = _FAR_ABOVE
    while n < RAY_STOPS_MM.size and RAY_STOPS_MM[n] <= end:
        s = RAY_STOPS_MM[n]
        there = at_cell(heights, np.float32(i) + gi * s, np.float32(j) + gj * s)
        least = min(least, (there - z + _BIAS) * PER_STOP[n])
        n += 1
    return least


@inlined
def at_cell(grid, row, column):
    """A float32 grid, interpolated at a place in cells; beyond the rim it is extrapolated."""
    i = min(max(int(row), 0), grid.shape[0] - 2)
    j = min(max(int(column), 0), grid.shape[1] - 2)
    down, across = row - np.float32(i), column - np.float32(j)
    return bilinear(grid[i, j], grid[i, j + 1], grid[i + 1, j], grid[i + 1, j + 1], down, across)


@inlined
def _fraction_above_chord(cut):
    """Fraction of a disc above a chord at cut < 1 radii from its middle: an odd cubic, to 0.01."""
    if cut <= -_ONE:
        return 0.0
    return 0.5 + cut * (0.6366 - 0.1366 * cut * cut)


@jit_finite
def soften(sight, shadowed, softened):
    """Fill the regions shadowed (LEDs, 4) of softened with sight (LEDs, C) blurred by 1, 2, 1 along
    both axes: the effect of the discs' width at edges along the ray, about one cell.
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
