"""One frame of a source.

Reports frames that are skipped, at a bounded rate.
"""

import time
from collections.abc import Callable
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


REPORT_EVERY_S = 5.0
"""Least time between two reports of one source, s (assumed)."""

Report = Callable[[str], None]
"""Takes a message for the user."""


class Skipped:
    """Counts the skipped frames of one source. report: takes a message now and then."""

    def __init__(self, report: Report) -> None:
        self._report = report
        self._count = 0
        self._reported_s: float | None = None

    def add(self, reason: str) -> None:
        """One frame is skipped. reason: which one and why."""
        self._count += 1
        now_s = time.monotonic()
        if self._reported_s is not None and now_s - self._reported_s < REPORT_EVERY_S:
            return
        self._reported_s = now_s
        frames = "frame" if self._count == 1 else "frames"
        self._report(f"{self._count} {frames} skipped so far, the last one: {reason}")
