"""Faults of a frame that make it no measurement of any gel camera."""

import numpy as np

DARKEST_GREY = 12.0
"""Mean grey level below which an image is black (assumed: images have means of 70 to 135)."""

BRIGHT_GREY, BRIGHT_SHARE = 250, 0.3
"""An image is overexposed above this share of values of at least this grey level (assumed)."""

COLORED_GREY, COLORLESS_GREY = 6.0, 3.0
"""Median difference between the largest and the smallest color of a pixel, grey levels. A sensor
has colors if its mean image has at least the first; an image below the second has none (assumed).
The pretrained networks' mean images have 12 and 25, a grey image 0."""

NOISE_GREY = 20.0
"""Median difference of neighboring pixels above which an image is noise, grey levels (assumed:
a camera's noise of 7 has 7)."""

BLACK, OVEREXPOSED, COLORLESS, NOISE = "black", "overexposed", "without color", "noise"


def is_colored(image: np.ndarray) -> bool:
    """Whether a sensor with this mean image, (..., c) in grey levels, has colors."""
    return _color_grey(image) >= COLORED_GREY


def fault_of(image: np.ndarray, colored: bool) -> str | None:
    """BLACK, OVEREXPOSED, COLORLESS or None, at any size.

    image: (h, w, c) uint8. colored: whether the sensor has colors.
    """
    if image.mean() < DARKEST_GREY:
        return BLACK
    if (image >= BRIGHT_GREY).mean() > BRIGHT_SHARE:
        return OVEREXPOSED
    return COLORLESS if colored and _color_grey(image) < COLORLESS_GREY else None


def is_noise(frame: np.ndarray) -> bool:
    """Whether a frame at its own size, (h, w, c) or (h, w) uint8, is noise."""
    left, right = frame[:, :-1], frame[:, 1:]
    steps = np.maximum(left, right) - np.minimum(left, right)
    return bool(2 * np.count_nonzero(steps > NOISE_GREY) > steps.size)  # their median is above


def _color_grey(values: np.ndarray) -> float:
    """Median difference between the largest and the smallest of the last axis."""
    return float(np.median(values.max(axis=-1) - values.min(axis=-1)))
