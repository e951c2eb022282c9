"""Progress of long work: a bar on a terminal, elsewhere one line per minute."""

import io
import sys
import time
from typing import Any

from tqdm import tqdm

INTERVAL_S = 60.0
"""Interval of the lines that are not on a terminal, s."""


class Progress(tqdm):
    """tqdm's bar, with its arguments; plain lines where standard error is not a terminal."""

    def __init__(self, *arguments: Any, **options: Any) -> None:
        self._plain, self._printed_at = not sys.stderr.isatty(), time.monotonic()
        self._first_update: tuple[float, float] | None = None
        if self._plain:
            options |= {
                "file": io.StringIO(),
                "mininterval": INTERVAL_S,
                "maxinterval": INTERVAL_S,
            }
        super().__init__(*arguments, **options)

    def update(self, n: float | None = 1) -> bool | None:
        """Count n more steps. The estimate leaves out the time before the first update, in which
        code is compiled and workers start."""
        displayed = super().update(n)
        if self._first_update is None and not self.disable and self.n > self.initial:
            self._first_update = time.monotonic(), self.n
        return displayed

    def _left_s(self) -> float:
        """Estimated time for the remaining steps, s."""
        elapsed, done = self.format_dict["elapsed"], self.n - self.initial
        if self._first_update is not None and self.n > self._first_update[1]:
            elapsed, done = time.monotonic() - self._first_update[0], self.n - self._first_update[1]
        return elapsed * (self.total - self.n) / max(done, 1)

    def display(self, msg: str | None = None, pos: int | None = None) -> None:
        """Display the progress."""
        if not self._plain:
            super().display(msg, pos)
        elif (
            self.total
            and 0 < self.n < self.total
            and time.monotonic() >= self._printed_at + INTERVAL_S
        ):
            self._printed_at = time.monotonic()
            print(
                f"{self.desc.removesuffix(': ')}: {self.n:,} of {self.total:,} {self.unit}s, about "
                f"{self._left_s() / 60:.1f} minutes left",
                file=sys.stderr,
                flush=True,
            )
