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
    """Prints messages at the limited rate. Several threads may use one log."""

    def __init__(self) -> None:
        self._tokens, self._refilled_s, self._suppressed = BURST, time.monotonic(), 0
        self._lock = Lock()

    def __call__(self, message: str) -> None:
        text = "".join(c if c.isprintable() else " " for c in message)
        text = text if len(text) <= MAX_LINE else text[: MAX_LINE - 3] + "..."
        with self._lock, suppress(OSError, ValueError):  # of a closed standard error
            refill = (time.monotonic() - self._refilled_s) * LINES_PER_S
            self._tokens, self._refilled_s = min(BURST, self._tokens + refill), time.monotonic()
            if self._tokens < 1.0:
                self._suppressed += 1
                return
            more = (
                f" ({self._suppressed} earlier lines were suppressed)" if self._suppressed else ""
            )
            self._tokens, self._suppressed = self._tokens - 1.0, 0
            print(f"t2twin: {text}{more}", file=sys.stderr, flush=True)


log = Log()
"""Log of the process."""
