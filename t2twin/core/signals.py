"""What Ctrl-C and SIGTERM do to a command, from its first moment to its last.

Imports next to nothing, so that signals are handled before the rest is loaded.
"""

import os
import signal
import sys
from contextlib import suppress
from types import FrameType

SIGNALS = (signal.SIGINT, signal.SIGTERM)
"""Ctrl-C, and what `kill`, service managers and containers send."""

RESUMING = ("adapt", "primitives", "simdata", "train")
"""Commands that continue what an earlier call began; the others begin again and leave nothing."""

WRITING = "t2twin.core.files"
"""The module that knows what is being written; until it is loaded, nothing is."""

IMPORTING = "<frozen importlib."
"""How the names of the files begin whose frames run an import."""

_first: list[int] = []
"""The first signal that came; a second one ends the process without waiting."""


class Stopped(BaseException):
    """A signal came while something was being written: it is cleaned up on the way out."""

    def __init__(self, number: int) -> None:
        super().__init__(number)
        self.number = number


def install_handlers() -> None:
    """From here on SIGNALS end the process: by Stopped where something is being written, else at
    once. One that the parent process had ignored stays ignored."""
    for number in SIGNALS:
        if signal.getsignal(number) is not signal.SIG_IGN:
            signal.signal(number, _stop)


def say_stopped(number: int) -> int:
    """Says what the same command will do; returns the exit status that shells have for it."""
    resumes = len(sys.argv) > 1 and sys.argv[1] in RESUMING
    after = "continues from here" if resumes else "begins again"
    message = f"t2twin: stopped; the same command {after}\n"
    with suppress(OSError):  # where nobody reads it
        os.write(2, message.encode())  # not print: the signal may have come within one
    return 128 + number


def _stop(number: int, frame: FrameType | None) -> None:
    writing = sys.modules.get(WRITING)
    in_hand = getattr(writing, "in_hand", None)
    # An exception in an import may come out as another one, or not at all.
    if in_hand and not _first and not _is_importing(frame):
        _first.append(number)
        raise Stopped(number)
    for each in SIGNALS:
        signal.signal(each, signal.SIG_IGN)
    abandon = getattr(writing, "abandon", None)
    if abandon is not None:
        abandon()
    os._exit(say_stopped(number))


def _is_importing(frame: FrameType | None) -> bool:
    while frame is not None:
        if frame.f_code.co_filename.startswith(IMPORTING):
            return True
        frame = frame.f_back
    return False
