"""A worker that always processes the latest state: requests that arrive meanwhile are merged.

A queue.Queue does not merge requests, and its `join` has no timeout.
"""

from collections.abc import Callable
from threading import Condition, Thread


class LatestOnlyWorker:
    """Calls `work` in a thread of its own, once for all requests since the last call began.

    when_idle: called if no request arrives within idle_s seconds after `work`. An exception of
    either ends the thread.
    """

    def __init__(
        self, work: Callable[[], object], when_idle: Callable[[], object], idle_s: float = 0.1
    ) -> None:
        self._work, self._when_idle, self._idle_s = work, when_idle, idle_s
        self._requested, self._stopped, self._busy = False, False, False
        self._changed = Condition()
        # A daemon thread: the process does not wait for a press when it stops.
        self._thread = Thread(target=self._run, daemon=True)
        self._thread.start()

    def request(self) -> None:
        """Requests a call of `work`."""
        with self._changed:
            self._requested = True
            self._changed.notify_all()

    def stop(self) -> None:
        """Starts no further work."""
        with self._changed:
            self._stopped = True
            self._changed.notify_all()

    def join(self, timeout_s: float) -> None:
        """Waits for the work that began before `stop`."""
        self._thread.join(timeout_s)

    def wait(self, timeout_s: float) -> bool:
        """Waits until no work is pending; False after the timeout."""
        with self._changed:
            return self._changed.wait_for(lambda: not (self._requested or self._busy), timeout_s)

    def _run(self) -> None:
        while True:
            with self._changed:
                self._changed.wait_for(lambda: self._requested or self._stopped)
                if self._stopped:
                    return
                self._requested, self._busy = False, True
            self._work()
            with self._changed:
                is_idle = not self._changed.wait_for(
                    lambda: self._requested or self._stopped, self._idle_s
                )
            if is_idle:
                self._when_idle()
            with self._changed:
                self._busy = False
                self._changed.notify_all()
