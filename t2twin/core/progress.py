"""Progress of long work: a bar on a terminal, elsewhere one line per minute."""

import io
import sys
from time import time
from typing import Any

from tqdm import tqdm

INTERVAL_S = 60.0
"""Interval of the lines that are not on a terminal, s."""


class Progress(tqdm):
    """tqdm's bar, with its arguments; plain lines where standard error is not a terminal."""

    _printed_s = float("inf")  # until the bar begins

    def __init__(self, *arguments: Any, **options: Any) -> None:
        self._plain = not sys.stderr.isatty()
        if self._plain:
            options |= {"file": io.StringIO(), "mininterval": INTERVAL_S, "maxinterval": INTERVAL_S}
        super().__init__(*arguments, **options)
        self._printed_s = time()

    def display(self, msg: str | None = None, pos: int | None = None) -> None:
        """Display the progress."""
        if not self._plain:
            super().display(msg, pos)
        elif self.total and 0 < self.n < self.total and time() >= self._printed_s + INTERVAL_S:
            step_s = (time() - self.start_t) / max(self.n - self.initial, 1)
            self.print_line(
                f"{self.n:,} of {self.total:,} {self.unit}s, about "
                f"{step_s * (self.total - self.n) / 60:.1f} minutes left"
            )

    def print_line(self, text: str) -> None:
        """Print a line of its own where there is no bar; the next comes an interval later."""
        if self._plain and not self.disable:
            self._printed_s = time()
            print(f"{self.desc.removesuffix(': ')}: {text}", file=sys.stderr, flush=True)
