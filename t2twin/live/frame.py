"""One frame of a source."""

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Frame:
    """image: (h, w, 3) or (h, w) uint8, upright. number: within its source, from 0. name: the
    file's, in a folder. arrived_s: when it was there, on time.perf_counter's clock."""

    image: np.ndarray
    number: int
    name: str | None
    arrived_s: float


def turned(image: np.ndarray, turn_deg: int) -> np.ndarray:
    """An image turned clockwise by a multiple of 90 degrees."""
    return np.ascontiguousarray(np.rot90(image, -turn_deg // 90))
