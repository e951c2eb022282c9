"""Handling of Ctrl-C and SIGTERM by a command.

Imports only standard modules, so that signals are handled before the rest is loaded.
"""

import os
import signal
import sys
from contextlib import suppress
from types import FrameType

SIGNALS = (signal.SIGINT, signal.SIGTERM)
"""Ctrl-C, and the signal of `kill`, service managers and containers."""

RESUMING = ("adapt", "demo", "simdata", "train")
"""Commands that continue an earlier call; the others start again and leave no files."""

FILES = "t2twin.core.files"
"""The module that lists pending writes; until it is loaded, there are none."""

IMPORTING = "<frozen importlib."
"""Start of the file names of frames that run an import."""

_first: list[int] = []
"""The first signal; a second one ends the process at once."""


class Stopped(BaseException):
    """Raised by a signal during a write, so that context managers clean up."""

    def __init__(self, number: int) -> None:
        super().__init__(number)
        self.number = number


def install_handlers() -> None:
    """Let SIGNALS end the process: by Stopped during a write, else at once.

    Signals that the parent process ignored stay ignored.
    """
    for number in SIGNALS:
        if signal.getsignal(number) is not signal.SIG_IGN:
            signal.signal(number, _stop)


def report_stop(number: int) -> int:
    """Print what running the command again does; returns the exit status of the signal."""
    resumes = len(sys.argv) > 1 and sys.argv[1] in RESUMING
    effect = "continues from its last saved state" if resumes else "begins again"
    message = f"t2twin: stopped; the same command {effect}\n"
    with suppress(OSError):  # standard error is closed
        os.write(2, message.encode())  # not print, which the signal may have interrupted
    return 128 + number


def _stop(number: int, frame: FrameType | None) -> None:
    files = sys.modules.get(FILES)
    # Imports may swallow or replace an exception.
    if getattr(files, "pending_writes", None) and not _first and not _is_importing(frame):
        _first.append(number)
        raise Stopped(number)
    for each in SIGNALS:
        signal.signal(each, signal.SIG_IGN)
    remove_pending = getattr(files, "remove_pending", None)
    if remove_pending is not None:
        remove_pending()
    os._exit(report_stop(number))


def _is_importing(frame: FrameType | None) -> bool:
    while frame is not None:
        if frame.f_code.co_filename.startswith(IMPORTING):
            return True
        frame = frame.f_back
    return False
