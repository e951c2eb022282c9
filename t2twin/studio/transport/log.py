"""Messages on standard error about clients, one line each, at a limited rate."""

import sys
import time
from contextlib import suppress
from threading import Lock

BURST, LINES_PER_S = 200.0, 2.0
"""Number of lines that may be printed at once, and lines per second after that (assumed)."""

MAX_LINE = 300
"""Maximum length of a line, characters: it may quote the content of a client's message."""


class Log:
    """Prints messages, at most `burst` at once and `per_s` a second after that.

    The next line states the number of suppressed lines. Several threads may use one log.
    """

    def __init__(self, burst: float = BURST, per_s: float = LINES_PER_S) -> None:
        self._burst, self._per_s = burst, per_s
        self._tokens, self._refilled_s = burst, time.monotonic()
        self._suppressed = 0
        self._lock = Lock()

    def __call__(self, message: str) -> None:
        with self._lock:
            now_s = time.monotonic()
            refill = (now_s - self._refilled_s) * self._per_s
            self._tokens, self._refilled_s = min(self._burst, self._tokens + refill), now_s
            if self._tokens < 1.0:
                self._suppressed += 1
                return
            self._tokens -= 1.0
            suppressed, self._suppressed = self._suppressed, 0
        more = f" ({suppressed} earlier lines were suppressed)" if suppressed else ""
        # A closed standard error must not end the studio.
        with suppress(OSError, ValueError):
            print(f"t2twin: {one_line(message)}{more}", file=sys.stderr, flush=True)


def one_line(text: str) -> str:
    """Text without line breaks and control characters, at most MAX_LINE characters."""
    text = "".join(c if c.isprintable() else " " for c in text)
    return text if len(text) <= MAX_LINE else text[: MAX_LINE - 3] + "..."


log = Log()
"""Log of the process."""
