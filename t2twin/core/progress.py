"""Progress of long work: a bar on a terminal, elsewhere a line a minute."""

import io
import sys
import time
from typing import Any

from tqdm import tqdm

QUIET_SECONDS = 60.0
"""How long nothing is said where nobody watches, s."""


class Progress(tqdm):
    """tqdm's bar, with its arguments; into a file or a pipe it writes plain lines, and few."""

    def __init__(self, *arguments: Any, **options: Any) -> None:
        self._plain, self._said = not sys.stderr.isatty(), time.monotonic()
        self._begun: tuple[float, float] | None = None
        if self._plain:
            options |= {
                "file": io.StringIO(),
                "mininterval": QUIET_SECONDS,
                "maxinterval": QUIET_SECONDS,
            }
        super().__init__(*arguments, **options)

    def update(self, n: float | None = 1) -> bool | None:
        """So many steps are done. What the first ones took, with all that came before them, says
        nothing of the others: compiled code is made or loaded, workers start."""
        shown = super().update(n)
        if self._begun is None and not self.disable and self.n > self.initial:
            self._begun = time.monotonic(), self.n
        return shown

    def _left_s(self) -> float:
        """About how long the rest takes, s."""
        elapsed, done = self.format_dict["elapsed"], self.n - self.initial
        if self._begun is not None and self.n > self._begun[1]:
            elapsed, done = time.monotonic() - self._begun[0], self.n - self._begun[1]
        return elapsed * (self.total - self.n) / max(done, 1)

    def display(self, msg: str | None = None, pos: int | None = None) -> None:
        """Shows where the work is."""
        if not self._plain:
            super().display(msg, pos)
        elif (
            self.total
            and 0 < self.n < self.total
            and time.monotonic() >= self._said + QUIET_SECONDS
        ):
            self._said = time.monotonic()
            print(
                f"{self.desc.removesuffix(': ')}: {self.n:,} of {self.total:,} {self.unit}s, about "
                f"{self._left_s() / 60:.1f} minutes left",
                file=sys.stderr,
                flush=True,
            )
