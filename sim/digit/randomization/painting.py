"""Paints artifacts of DIGIT units on a background frame: compiled loops."""

import numpy as np

from t2twin.sim.digit.camera.compiled import jit

SPECKLE_PX, FINE_DRIFT_PX = 4, 8
"""Distance of neighboring nodes of a worn gel's albedo and of a drift, px (assumed)."""
GLARE_REACH = 5.0
"""Distance at which a glare ends, in its radii: 0.15 % of its brightness."""

_ZERO, _ONE, _HALF = np.float32(0.0), np.float32(1.0), np.float32(0.5)
_BRIGHTEST, _REACH = np.float32(255.0), np.float32(GLARE_REACH)


@jit
def enlarge(nodes, step, out):
    """Fill out, linear between nodes, step apart."""
    for row in range(out.shape[0]):
        _enlarge_row(nodes, step, row, out[row])


@jit
def _enlarge_row(nodes, step, row, out):
    """Fill out (columns) with a row, linear between nodes, step apart."""
    i, down = row // step, np.float32(row % step) / np.float32(step)
    for j in range(nodes.shape[1] - 1):
        left = nodes[i, j] + down * (nodes[i + 1, j] - nodes[i, j])
        right = nodes[i, j + 1] + down * (nodes[i + 1, j + 1] - nodes[i, j + 1])
        for n in range(step):
            out[j * step + n] = left + np.float32(n) / np.float32(step) * (right - left)


@jit
def compose(background, shade, drift, streaks, glares, out):
    """Fill out (P, RGB) uint8 with the background (P, RGB), shaded, plus drift and lights.

    P is the image (rows, columns). shade: (nodes) factors SPECKLE_PX apart, or empty. drift: (RGB,
    nodes) grey levels FINE_DRIFT_PX apart, or empty. streaks: (n, 10) row, column, direction (down,
    right), half length, half width, bend, RGB. glares: (n, 6) row, column, radius, RGB.
    """
    rows, columns = out.shape[0], out.shape[1]
    grey, values = np.empty((columns, 3), dtype=np.float32), np.empty(columns, dtype=np.float32)
    for row in range(rows):
        flat, still, filled = grey.ravel(), background[row].ravel(), out[row].ravel()
        for n in range(flat.size):
            flat[n] = still[n]
        if shade.size > 0:
            _enlarge_row(shade, SPECKLE_PX, row, values)
            for column in range(columns):
                for c in range(3):
                    grey[column, c] *= values[column]
        if drift.size > 0:
            _add_drift(drift, row, grey)
        for n in range(streaks.shape[0]):
            _add_streak(streaks[n], row, grey)
        for n in range(glares.shape[0]):
            _add_glare(glares[n], row, grey)
        for n in range(flat.size):
            filled[n] = np.uint8(min(max(flat[n], _ZERO), _BRIGHTEST) + _HALF)


@jit
def _add_drift(drift, row, grey):
    """Add a row of a drift (RGB, nodes) to grey (columns, RGB), linear between the nodes."""
    per_step = _ONE / np.float32(FINE_DRIFT_PX)
    i, down = row // FINE_DRIFT_PX, np.float32(row % FINE_DRIFT_PX) * per_step
    line = drift[:, i] + down * (drift[:, i + 1] - drift[:, i])
    for j in range(line.shape[1] - 1):
        red, green, blue = line[0, j], line[1, j], line[2, j]
        red_per_px = (line[0, j + 1] - red) * per_step
        green_per_px = (line[1, j + 1] - green) * per_step
        blue_per_px = (line[2, j + 1] - blue) * per_step
        for n in range(FINE_DRIFT_PX):
            column, far = j * FINE_DRIFT_PX + n, np.float32(n)
            grey[column, 0] += red + far * red_per_px
            grey[column, 1] += green + far * green_per_px
            grey[column, 2] += blue + far * blue_per_px


@jit
def _add_streak(streak, row, grey):
    """Add a row of a streak to grey (columns, RGB).

    Its profile is 1 - u^2 along and (1 - v^2)^2 across, with u and v the place relative to its
    half length and half width; its middle line is a parabola.
    """
    down, right, length, width, bend = streak[2], streak[3], streak[4], streak[5], streak[6]
    high = np.float32(row) - streak[0]
    side = width + abs(bend)
    if abs(high) > abs(down) * length + abs(right) * side:
        return
    half = abs(right) * length + abs(down) * side
    first = max(int(streak[1] - half), 0)
    end = min(int(streak[1] + half) + 2, grey.shape[0])
    red, green, blue = streak[7], streak[8], streak[9]
    per_length, per_width = _ONE / length, _ONE / width
    for column in range(first, end):
        far = np.float32(column) - streak[1]
        u = (far * right + high * down) * per_length
        v = (far * down - high * right - bend * u * u) * per_width
        across = max(_ONE - v * v, _ZERO)
        profile = max(_ONE - u * u, _ZERO) * across * across
        grey[column, 0] += profile * red
        grey[column, 1] += profile * green
        grey[column, 2] += profile * blue


@jit
def _add_glare(glare, row, grey):
    """Add a row of a glare to grey (columns, RGB): 1 / (1 + d^2)^2 of its distance in radii d."""
    radius = glare[2]
    high = (np.float32(row) - glare[0]) / radius
    if abs(high) > _REACH:
        return
    first = max(int(glare[1] - _REACH * radius), 0)
    end = min(int(glare[1] + _REACH * radius) + 1, grey.shape[0])
    for column in range(first, end):
        far = (np.float32(column) - glare[1]) / radius
        part = _ONE / (_ONE + far * far + high * high)
        for c in range(3):
            grey[column, c] += part * part * glare[3 + c]
