"""Measures a unit's camera noise in its frames."""

import numpy as np
from scipy.ndimage import gaussian_filter
from scipy.optimize import least_squares

from t2twin.sim.digit.calibrate.frames import background_pixels
from t2twin.sim.digit.camera.noise import REACH, TAPS, Noise

DRIFT_PX = 8.0
"""Length scale above which variation is drift of the light, not noise, px (assumed)."""
LAGS = 4
"""Largest lag of the autocorrelation along an axis, px."""
MIN_PIXELS = 2_000
"""Smallest number of background pixels of a frame (assumed)."""
QUIETEST_GREY = 0.05
"""Standard deviation of the noise of frames without any, such as edited ones, grey levels."""


def measure_noise(clean: np.ndarray, frames: np.ndarray, background: np.ndarray) -> Noise | None:
    """The noise of frames (n, ROWS, COLUMNS, 3) uint8, from their background pixels.

    clean: the background with its noise averaged out. background: the frame. Returns None if no
    frame has MIN_PIXELS.
    """
    covariance, autocovariance, count = np.zeros((3, 3)), np.zeros((LAGS, 3)), 0
    for frame in frames:
        mask = background_pixels(frame, background)
        if np.count_nonzero(mask) < MIN_PIXELS:
            continue
        noise = frame.astype(float) - clean
        noise -= gaussian_filter(noise, (DRIFT_PX, DRIFT_PX, 0.0), mode="nearest")
        noise -= noise[mask].mean(axis=0)
        covariance += noise[mask].T @ noise[mask] / np.count_nonzero(mask)
        autocovariance += [_autocovariance(noise, mask, lag) for lag in range(1, LAGS + 1)]
        count += 1
    if not count:
        return None
    covariance = covariance / count + QUIETEST_GREY**2 * np.eye(3)
    correlation = (autocovariance / count / np.diag(covariance)).mean(axis=1)
    return Noise(np.linalg.cholesky(covariance), _taps(correlation))


def _autocovariance(noise: np.ndarray, mask: np.ndarray, lag: int) -> np.ndarray:
    """(RGB) mean product of the noise of masked pixels at a lag along an axis."""
    products = []
    for axis in (0, 1):
        first, second = (
            np.take(np.arange(mask.shape[axis]), part)
            for part in (range(mask.shape[axis] - lag), range(lag, mask.shape[axis]))
        )
        both = np.take(mask, first, axis) & np.take(mask, second, axis)
        product = np.take(noise, first, axis) * np.take(noise, second, axis)
        products.append(product[both].mean(axis=0))
    return np.mean(products, axis=0)


def _taps(correlation: np.ndarray) -> np.ndarray:
    """(TAPS,) symmetric weights of unit energy whose output on white noise has this
    autocorrelation, (LAGS,)."""

    def weights(sides: np.ndarray) -> np.ndarray:
        taps = np.concatenate([sides[::-1], [1.0], sides])
        return taps / np.sqrt(np.sum(taps**2))

    def residual(sides: np.ndarray) -> np.ndarray:
        taps = weights(sides)
        own = np.correlate(taps, taps, "full")[TAPS : TAPS + LAGS]
        return own - correlation

    fit = least_squares(residual, np.full(REACH, 0.3), bounds=(-1.0, 1.0))
    return weights(fit.x)
