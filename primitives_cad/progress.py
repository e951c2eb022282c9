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
        if self._plain:
            options |= {
                "file": io.StringIO(),
                "mininterval": QUIET_SECONDS,
                "maxinterval": QUIET_SECONDS,
            }
        super().__init__(*arguments, **options)

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
            known = self.format_dict
            left_s = known["elapsed"] * (self.total - self.n) / max(self.n - self.initial, 1)
            print(
                f"{self.desc.removesuffix(': ')}: {self.n:,} of {self.total:,} {self.unit}s, about "
                f"{left_s / 60:.1f} minutes left",
                file=sys.stderr,
                flush=True,
            )
