"""Frames of a source, and reports of skipped frames at a limited rate."""

import time
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

REPORT_EVERY_S = 5.0
"""Minimum time between two reports of one source, s (assumed)."""

Report = Callable[[str], None]
"""Receives a message for the user."""


@dataclass(frozen=True)
class Frame:
    """One frame of a source.

    image: (h, w, 3) or (h, w) uint8, upright. number: position in the source, from 0. name: file
    name in a folder, None otherwise. arrived_s: arrival on the clock of time.perf_counter.
    """

    image: np.ndarray
    number: int
    name: str | None
    arrived_s: float


def rotated(image: np.ndarray, turn_deg: int) -> np.ndarray:
    """The image rotated clockwise by a multiple of 90 degrees."""
    return np.ascontiguousarray(np.rot90(image, -turn_deg // 90))


class SkippedFrames:
    """Counts the skipped frames of one source and reports them at a limited rate."""

    def __init__(self, report: Report) -> None:
        self._report = report
        self._count = 0
        self._reported_s: float | None = None

    def add(self, reason: str) -> None:
        """Counts a skipped frame. reason: name of the frame and error."""
        self._count += 1
        now_s = time.monotonic()
        if self._reported_s is not None and now_s - self._reported_s < REPORT_EVERY_S:
            return
        self._reported_s = now_s
        frames = "frame" if self._count == 1 else "frames"
        self._report(f"{self._count} {frames} skipped so far; latest: {reason}")
