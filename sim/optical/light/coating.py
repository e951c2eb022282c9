"""The gel's reflective coating: its smoothed deflection, and the deflected region.

G is the optical grid (ny, nx). Regions are (first row, end row, first column, end column).
"""

import numpy as np

from t2twin.sim.optical.camera.compiled import jit_finite

COATING_TAPS = np.array([0.0614, 0.2448, 0.3876, 0.2448, 0.0614], dtype=np.float32)
"""Weights of a Gaussian of one cell, 0.1 mm (assumed: the coating's thickness)."""


@jit_finite
def bounds(coated, deflected_mm, deep_mm):
    """Regions of the cells deflected by more than deflected_mm in either direction, and by more
    than deep_mm, which is not less, into the sensor (empty: end <= first)."""
    ny, nx = coated.shape
    limit, high = np.float32(deflected_mm), np.float32(deep_mm)
    region, deep = np.array([ny, 0, nx, 0]), np.array([ny, 0, nx, 0])
    for i in range(ny):
        row = coated[i]
        # counts instead of branches, so that the loop is vectorized
        deflected, deeper = 0, 0
        for j in range(nx):
            deflected += abs(row[j]) > limit
            deeper += row[j] > high
        if deflected == 0:
            continue
        region[0], region[1] = min(region[0], i), i + 1
        j = 0
        while j < region[2] and not abs(row[j]) > limit:
            j += 1
        region[2] = min(region[2], j)
        j = nx
        while j > region[3] and not abs(row[j - 1]) > limit:
            j -= 1
        region[3] = max(region[3], j)
        if deeper == 0:
            continue
        deep[0], deep[1] = min(deep[0], i), i + 1
        j = 0
        while j < deep[2] and not row[j] > high:
            j += 1
        deep[2] = min(deep[2], j)
        j = nx
        while j > deep[3] and not row[j - 1] > high:
            j -= 1
        deep[3] = max(deep[3], j)
    return region, deep


@jit_finite
def coated(surface):
    """(G) surface smoothed by COATING_TAPS along both axes; edge cells are repeated outwards."""
    ny, nx = surface.shape
    taps, reach = COATING_TAPS.size, COATING_TAPS.size // 2
    padded = np.empty(nx + 2 * reach, dtype=np.float32)
    across = np.zeros_like(surface)
    out = np.zeros_like(surface)
    for i in range(ny):
        padded[:reach] = surface[i, 0]
        row = surface[i]
        for j in range(nx):  # an assignment of arrays would compile its error messages
            padded[reach + j] = row[j]
        padded[reach + nx :] = surface[i, nx - 1]
        row = across[i]
        for k in range(taps):
            tap, shifted = COATING_TAPS[k], padded[k : k + nx]
            for j in range(nx):
                row[j] += tap * shifted[j]
    for i in range(ny):
        row = out[i]
        for k in range(taps):
            tap, shifted = COATING_TAPS[k], across[min(max(i + k - reach, 0), ny - 1)]
            for j in range(nx):
                row[j] += tap * shifted[j]
    return out
