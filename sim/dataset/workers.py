"""The processes that make groups and shards.

`t2twin simdata` starts them first, so that they import what they need while it imports what it
needs. This module therefore imports nothing slow.
"""

import multiprocessing
import os
import signal
import threading
from collections.abc import Generator, Iterator
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager, suppress

from t2twin.core.errors import T2TwinError


class StoppedError(Exception):
    """Another worker has failed."""


class Workers:
    """Processes, which are started at once. number: of them; made: pairs so far, of all.

    Their signals SIGINT and SIGTERM are blocked: the run stops them; the same signal would end
    them too, some of them while they start.
    """

    def __init__(self, number: int) -> None:
        spawn = multiprocessing.get_context("spawn")
        self.number = number
        self.made, self._stop, self._has_started = spawn.Value("i", 0), spawn.Event(), spawn.Event()
        self._others = set(multiprocessing.active_children())
        shared = self.made, self._stop, self._has_started
        self.pool = ProcessPoolExecutor(
            number, mp_context=spawn, initializer=_start, initargs=shared
        )
        # If they cannot start, the first work raises the error again. One that starts while the
        # pool breaks finds its pipes closed, a ValueError.
        with blocked_signals(), suppress(BrokenProcessPool, ValueError):
            for _ in range(number):  # a process for each
                self.pool.submit(_ready)

    @contextmanager
    def at_work(self) -> Iterator[None]:
        """End the processes after the block, at an error after their current pair.

        Raises T2TwinError where one of them is killed or cannot start.
        """
        try:
            yield
        except BrokenProcessPool as error:
            # The pool ends its registered workers, but waits forever for one that was starting when
            # another died.
            self.kill()
            if not self._has_started.is_set():
                raise T2TwinError(
                    "no worker could start; a script must make the dataset below "
                    "`if __name__ == '__main__':`"
                ) from error
            raise T2TwinError(
                "a worker was killed, as the system does when memory runs out; repeat the command "
                "with fewer --workers to continue"
            ) from error
        except BaseException:
            self._stop.set()
            self.pool.shutdown(wait=True, cancel_futures=True)
            raise
        self.pool.shutdown(wait=True)

    def kill(self) -> None:
        """End the processes at once."""
        for child in set(multiprocessing.active_children()) - self._others:
            child.kill()


_early: Workers | None = None
"""Workers that were started and not used yet."""


@contextmanager
def started_early(number: int) -> Generator[None]:
    """Start workers for a run within the block; one worker is this process itself."""
    global _early
    if number > 1:
        _early = Workers(number)
    try:
        yield
    finally:
        unused, _early = _early, None
        if unused is not None:
            unused.kill()
            unused.pool.shutdown(wait=False, cancel_futures=True)


def take(number: int) -> Workers:
    """The workers that were started early, or new ones."""
    global _early
    found, _early = _early, None
    return found or Workers(number)


@contextmanager
def blocked_signals() -> Iterator[None]:
    """Block SIGINT and SIGTERM: processes that start in the block inherit that."""
    before = signal.pthread_sigmask(signal.SIG_BLOCK, (signal.SIGINT, signal.SIGTERM))
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


_made = None
_stop = None


def _start(made, stop, has_started) -> None:
    """Initializes a worker: the shared counter of pairs, the event to stop, modules and code."""
    global _made, _stop
    has_started.set()
    _made, _stop = made, stop
    threading.Thread(target=_end_with_parent, daemon=True).start()
    from t2twin.sim.dataset.shard import warm_up

    with suppress(Exception):  # the work raises it again
        warm_up()


def _end_with_parent() -> None:
    """Ends a worker whose parent was killed; it would wait for tasks forever."""
    parent = multiprocessing.parent_process()
    if parent is not None:
        parent.join()
        os._exit(1)


def _ready() -> None:
    """The first task of each worker."""


def count_pair() -> None:
    """Count a pair in a worker. Raises StoppedError where the workers are to stop."""
    assert _made is not None and _stop is not None
    with _made.get_lock():
        _made.value += 1
    if _stop.is_set():
        raise StoppedError
