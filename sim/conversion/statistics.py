"""Statistics of a converted dataset's features, in the form of LeRobot's meta/stats.json."""

from functools import lru_cache
from typing import Any

import numpy as np
import pyarrow as pa

from t2twin.core.images import decode_png
from t2twin.sim.conversion.features import IMAGE, Feature

QUANTILES = {"q01": 0.01, "q10": 0.1, "q50": 0.5, "q90": 0.9, "q99": 0.99}
"""Quantiles of LeRobot's statistics, by name."""

LEVELS = 256
"""Gray levels of an image."""

Statistics = dict[str, Any]
"""min, max, mean, std and QUANTILES as nested lists; count as a list of one number."""


def vector_statistics(values: np.ndarray) -> Statistics:
    """Statistics over the frames. values: (frames, components)."""
    values = values.astype(np.float64)
    found = {
        "min": values.min(0),
        "max": values.max(0),
        "mean": values.mean(0),
        "std": values.std(0),
        **dict(zip(QUANTILES, np.quantile(values, list(QUANTILES.values()), axis=0), strict=True)),
    }
    return {name: value.tolist() for name, value in found.items()} | {"count": [len(values)]}


def image_statistics(histogram: np.ndarray, frames: int) -> Statistics:
    """Statistics of all pixels of some images, for gray levels from 0 to 1.

    histogram: (3, LEVELS) pixels of each channel and level. A quantile is the lowest level that so
    large a share of the pixels does not exceed.
    """
    levels = np.arange(LEVELS) / (LEVELS - 1)
    shares = histogram / histogram.sum(1, keepdims=True)
    mean = shares @ levels
    present = histogram > 0
    found = {
        "min": levels[present.argmax(1)],
        "max": levels[LEVELS - 1 - present[:, ::-1].argmax(1)],
        "mean": mean,
        "std": np.sqrt((shares * (levels - mean[:, None]) ** 2).sum(1)),
    }
    below = np.cumsum(histogram, axis=1)
    for name, share in QUANTILES.items():
        found[name] = levels[(below >= share * below[:, -1:]).argmax(1)]
    return {name: value.reshape(3, 1, 1).tolist() for name, value in found.items()} | {
        "count": [frames]
    }


@lru_cache(maxsize=2)  # the rows of an episode repeat their background frame
def histogram_of(png: bytes) -> np.ndarray:
    """(3, LEVELS) int64: pixels of a PNG image by channel and level.

    Raises T2TwinError as decode_png does.
    """
    pixels = decode_png(png).reshape(-1, 3)
    return np.stack([np.bincount(channel, minlength=LEVELS) for channel in pixels.T])


class FeatureStatistics:
    """Collects the statistics of a feature, episode by episode."""

    def __init__(self, feature: Feature) -> None:
        self._is_image = feature.dtype == IMAGE
        self._values: list[np.ndarray] = []  # of the episodes, (frames, components) float32
        self._histogram = np.zeros((3, LEVELS), np.int64)
        self._frames = 0

    def add(self, values: list[Any]) -> Statistics:
        """Add an episode; returns its own statistics. values: one of each frame."""
        if self._is_image:
            histogram = sum(histogram_of(value["bytes"]) for value in values)
            self._histogram += histogram
            self._frames += len(values)
            return image_statistics(np.asarray(histogram), len(values))
        self._values.append(np.array(values, np.float32).reshape(len(values), -1))
        return vector_statistics(self._values[-1])

    def total(self) -> Statistics:
        """The statistics of all frames."""
        if self._is_image:
            return image_statistics(self._histogram, self._frames)
        return vector_statistics(np.concatenate(self._values))

    def types(self) -> dict[str, pa.DataType]:
        """Column types of an episode's statistics."""
        numbers = pa.list_(pa.float32())
        kind = pa.list_(pa.list_(numbers)) if self._is_image else numbers
        return dict.fromkeys(("min", "max", "mean", "std", *QUANTILES), kind) | {
            "count": pa.list_(pa.int64())
        }
