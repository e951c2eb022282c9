"""What Ctrl-C and SIGTERM do to a command, from its first moment to its last."""

import os
import signal
import sys
from types import FrameType

from t2twin.primitives_cad.writing import in_hand

SIGNALS = (signal.SIGINT, signal.SIGTERM)
"""Ctrl-C, and what `kill`, service managers and containers send."""

RESUMING = ("primitives", "simdata", "train")
"""Commands that continue what an earlier call began; the others begin again and leave nothing."""


class Stopped(BaseException):
    """A signal came while something was being written: it is cleaned up on the way out."""

    def __init__(self, number: int) -> None:
        super().__init__(number)
        self.number = number


def heed_signals() -> None:
    """From here on SIGNALS end the process: at once where nothing is being written, else by
    Stopped. One that the parent process had ignored stays ignored."""
    for number in SIGNALS:
        if signal.getsignal(number) is not signal.SIG_IGN:
            signal.signal(number, _stop)


def say_stopped(number: int) -> int:
    """Says what the same command will do; returns the exit status that shells have for it."""
    resumes = len(sys.argv) > 1 and sys.argv[1] in RESUMING
    after = "continues from here" if resumes else "begins again"
    print(f"t2twin: stopped; the same command {after}", file=sys.stderr, flush=True)
    return 128 + number


def _stop(number: int, frame: FrameType | None) -> None:
    if in_hand:
        raise Stopped(number)
    # An exception could get lost in what is being loaded, and there is nothing to clean up.
    os._exit(say_stopped(number))
