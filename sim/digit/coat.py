"""What the gel's reflective coat shows of its deflection: smoothed, and where it is touched.

G is the optical grid (ny, nx). Regions are (first row, end row, first column, end column).
"""

import numpy as np

from t2twin.sim.digit.compiled import jit, jit_finite

COAT_TAPS = np.array([0.0614, 0.2448, 0.3876, 0.2448, 0.0614], dtype=np.float32)
"""Weights of five cells: a Gaussian of one cell, 0.1 mm (assumed: the coat's thickness)."""


@jit
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


@jit_finite
def coated(surface):
    """(G) surface smoothed by COAT_TAPS along both axes; its edge cells continue outwards."""
    ny, nx = surface.shape
    taps, reach = COAT_TAPS.size, COAT_TAPS.size // 2
    padded = np.empty(nx + 2 * reach, dtype=np.float32)
    across = np.zeros_like(surface)
    out = np.zeros_like(surface)
    for i in range(ny):
        padded[:reach] = surface[i, 0]
        row = surface[i]
        for j in range(nx):  # an array set to another compiles words for its errors
            padded[reach + j] = row[j]
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
