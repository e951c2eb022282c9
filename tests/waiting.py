"""Waiting for an event in a test, and ending a test that hangs."""

import signal
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import TypeVar

PATIENCE_S = 120
"""Longest wait for an event, s (assumed): far longer than it takes on a busy machine."""

INTERVAL_S = 0.01
"""Time between two looks, s."""

Value = TypeVar("Value")


def wait_until(condition: Callable[[], Value], seconds: float = PATIENCE_S) -> Value:
    """Returns the first true value of `condition`; fails where there is none in time."""
    deadline = time.monotonic() + seconds
    while not (value := condition()):
        assert time.monotonic() < deadline, f"no event in {seconds} s"
        time.sleep(INTERVAL_S)
    return value


@contextmanager
def no_hang(seconds: int = PATIENCE_S) -> Iterator[None]:
    """Fails where the block has not ended after so many seconds; in the main thread alone."""

    def fail(number: int, frame: object) -> None:
        raise AssertionError(f"still running after {seconds} s")

    before = signal.signal(signal.SIGALRM, fail)
    signal.alarm(seconds)
    try:
        yield
    finally:
        signal.alarm(0)
        signal.signal(signal.SIGALRM, before)
