"""Light that depends on the direction of the gel's normal, not only on the cosine of incidence.

A semi-specular coating and LEDs that are wider than a disc shift an LED's highlight. The lobe is a
quadratic polynomial of the normal's lateral components times a quadratic polynomial of the place.
S is the image's lattice of samples, as in t2twin.sim.optical.light.illumination.
"""

import numpy as np

from t2twin.sim.optical.camera.compiled import jit_finite
from t2twin.sim.optical.light.illumination import slopes

LOBE_DEGREE = 2
"""Degree of the lobe in the place (assumed; others were not compared)."""
LOBE_PLACES = (LOBE_DEGREE + 1) * (LOBE_DEGREE + 2) // 2
LOBE_TERMS = 5
"""Number of normal_terms."""

_ONE = np.float32(1.0)


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
