"""Fields of the displacement by shear: their means, motion with the bodies, and tolerance."""

import numpy as np
from scipy import ndimage

COUPLING_TOLERANCE_MM, COUPLING_SHARE, DEFLECTION_SHARE = 5e-3, 1e-2, 5e-3
"""Convergence of a step: mean error, weighted with the pressure, of the displacement by shear that
the normal contact sees. Along the surface: mm, or a share of the mean displacement where that is
more. Into the sensor: a share of the depth."""

MIN_MOVE = 0.1
"""Motion of a contact, in cells, below which its displacement does not move with it (assumed)."""


def is_small(
    error_mm: np.ndarray, sheared_mm: np.ndarray, pressure: np.ndarray, depth_mm: float
) -> bool:
    """Whether an error of the displacement by shear, both (3, rows, columns), is in the tolerance.

    pressure: (rows, columns) weights of the means.
    """
    weights = pressure / pressure.sum()
    along_x, along_y, into = (np.abs(error_mm) * weights).sum(axis=(1, 2))
    displacement = (np.hypot(*sheared_mm[:2]) * weights).sum()
    allowed = max(COUPLING_TOLERANCE_MM, COUPLING_SHARE * displacement)
    return max(along_x, along_y) <= allowed and into <= DEFLECTION_SHARE * depth_mm


def means(values: np.ndarray, pressure: np.ndarray, over: list[np.ndarray]) -> np.ndarray:
    """Means of values along x and y, (2, rows, columns), weighted with the pressure, of each body,
    (bodies, 2). over: of each body, (rows, columns) bool, the cells nearest to it."""
    weights = [pressure * here for here in over]
    return np.array([(values * each).sum(axis=(1, 2)) / (each.sum() or 1.0) for each in weights])


def moved(
    values: np.ndarray, by_mm: np.ndarray, pitch_mm: float, over: list[np.ndarray]
) -> np.ndarray:
    """Values, (n, rows, columns), moved along x and y by those of each body, (bodies, 2).
    over: see `means`."""
    found = values
    for (along_x, along_y), here in zip(by_mm.tolist(), over, strict=True):
        if np.hypot(along_x, along_y) >= MIN_MOVE * pitch_mm:
            by_cells = (0, along_y / pitch_mm, along_x / pitch_mm)
            shifted = ndimage.shift(values, by_cells, order=1, mode="nearest")
            found = np.where(here, shifted, found)
    return found
