"""One line on standard error for each thing that a client did wrong, and no flood of them."""

import sys
import time
from contextlib import suppress
from threading import Lock

BURST, LINES_PER_S = 200.0, 2.0
"""Lines that are printed at once, and how many a second from then on (assumed: enough to see what
happens, too few to fill a disk)."""

MAX_LINE = 300
"""Longest line, characters: it may quote what a client sent."""


class Log:
    """Prints sentences, at most `burst` at once and `per_s` a second after that. What is left out
    is counted in the next line. Several threads may use one."""

    def __init__(self, burst: float = BURST, per_s: float = LINES_PER_S) -> None:
        self._burst, self._per_s = burst, per_s
        self._tokens, self._refilled_s = burst, time.monotonic()
        self._left_out = 0
        self._lock = Lock()

    def __call__(self, sentence: str) -> None:
        with self._lock:
            now_s = time.monotonic()
            refill = (now_s - self._refilled_s) * self._per_s
            self._tokens, self._refilled_s = min(self._burst, self._tokens + refill), now_s
            if self._tokens < 1.0:
                self._left_out += 1
                return
            self._tokens -= 1.0
            left_out, self._left_out = self._left_out, 0
        more = f" ({left_out} earlier lines were left out)" if left_out else ""
        # A closed standard error must not end the studio.
        with suppress(OSError, ValueError):
            print(f"t2twin: {one_line(sentence)}{more}", file=sys.stderr, flush=True)


def one_line(text: str) -> str:
    """Text of at most MAX_LINE characters without line breaks and control characters."""
    text = "".join(c if c.isprintable() else " " for c in text)
    return text if len(text) <= MAX_LINE else text[: MAX_LINE - 3] + "..."


log = Log()
"""The process's own, as its standard error is one."""
