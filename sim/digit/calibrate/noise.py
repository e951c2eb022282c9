"""A unit's noise, measured in its own frames."""

import numpy as np
from scipy.ndimage import gaussian_filter
from scipy.optimize import least_squares

from t2twin.sim.digit.calibrate.frames import untouched_pixels
from t2twin.sim.digit.camera.noise import REACH, TAPS, Noise

SLOW_PX = 8.0
"""What varies over more than this is light that drifts, no noise, px (assumed)."""
LAGS = 4
"""Distances at which noise is compared with itself along an axis, 1 to this, px."""
MIN_PIXELS = 2_000
"""Untouched pixels that a frame must have to tell its noise (assumed)."""
QUIETEST_GREY = 0.05
"""Standard deviation taken where frames show no noise at all, as saved ones may, grey levels."""


def measured_noise(clean: np.ndarray, frames: np.ndarray, background: np.ndarray) -> Noise | None:
    """Of frames (n, ROWS, COLUMNS, 3) uint8, from their untouched pixels; None where these are few.

    clean: the background with its noise averaged out. background: as it was taken.
    """
    covariance, alike, counted = np.zeros((3, 3)), np.zeros((LAGS, 3)), 0
    for frame in frames:
        free = untouched_pixels(frame, background)
        if np.count_nonzero(free) < MIN_PIXELS:
            continue
        noise = frame.astype(float) - clean
        noise -= gaussian_filter(noise, (SLOW_PX, SLOW_PX, 0.0), mode="nearest")
        noise -= noise[free].mean(axis=0)
        covariance += noise[free].T @ noise[free] / np.count_nonzero(free)
        alike += [_alike(noise, free, lag) for lag in range(1, LAGS + 1)]
        counted += 1
    if not counted:
        return None
    covariance = covariance / counted + QUIETEST_GREY**2 * np.eye(3)
    correlation = (alike / counted / np.diag(covariance)).mean(axis=1)
    return Noise(np.linalg.cholesky(covariance), _taps(correlation))


def _alike(noise: np.ndarray, free: np.ndarray, lag: int) -> np.ndarray:
    """(RGB) mean product of the noise of pixels that lie a lag apart along an axis."""
    products = []
    for axis in (0, 1):
        first, second = (
            np.take(np.arange(free.shape[axis]), part)
            for part in (range(free.shape[axis] - lag), range(lag, free.shape[axis]))
        )
        both = np.take(free, first, axis) & np.take(free, second, axis)
        product = np.take(noise, first, axis) * np.take(noise, second, axis)
        products.append(product[both].mean(axis=0))
    return np.mean(products, axis=0)


def _taps(correlation: np.ndarray) -> np.ndarray:
    """(TAPS,) weights, symmetric and of unit energy, that make white noise as alike at each lag."""

    def weights(sides: np.ndarray) -> np.ndarray:
        taps = np.concatenate([sides[::-1], [1.0], sides])
        return taps / np.sqrt(np.sum(taps**2))

    def off(sides: np.ndarray) -> np.ndarray:
        taps = weights(sides)
        own = np.correlate(taps, taps, "full")[TAPS : TAPS + LAGS]
        return own - correlation

    fit = least_squares(off, np.full(REACH, 0.3), bounds=(-1.0, 1.0))
    return weights(fit.x)
