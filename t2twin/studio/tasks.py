"""Tasks of one client: a worker in a thread, notifications of errors and progress, and the log."""

import sys
import traceback
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from threading import Condition, RLock, Thread

import viser

from t2twin.core.errors import T2TwinError

UNEXPECTED = "an unexpected error occurred; its message is in the terminal of the studio"
"""Text of an error that the user did not cause."""


def log(message: str) -> None:
    """Prints a line on standard error."""
    with suppress(OSError, ValueError):  # of a closed standard error
        print(f"t2twin: {message}", file=sys.stderr, flush=True)


class Notices:
    """Shows at most one error, until it is cleared. Several threads may use one.

    shown: the error that is shown, if there is one.
    """

    def __init__(self, client: viser.ClientHandle) -> None:
        self._client = client
        self.shown: viser.NotificationHandle | None = None
        self._lock = RLock()

    def clear(self, error: viser.NotificationHandle | None) -> None:
        """Removes an error, unless a newer one has replaced it."""
        with self._lock:
            if error is not None and error is self.shown:
                error.remove()
                self.shown = None

    def show_error(self, error: Exception) -> None:
        """Shows an error with the message of the command line."""
        message = str(error)
        if isinstance(error, OSError):
            message = f"{error.filename or 'a file'} cannot be used: {error.strerror or error}"
        elif not isinstance(error, T2TwinError):
            message = UNEXPECTED
            places = traceback.extract_tb(error.__traceback__)
            at = f" at {places[-1].filename}:{places[-1].lineno}" if places else ""
            log(f"the studio continues after an error{at}: {error!r}")
        with self._lock:
            if self.shown is None or self.shown.body != message:
                self.clear(self.shown)
                self.shown = self._client.add_notification("Not possible", message, color="red")

    def guard(self, task: Callable[[], object]) -> None:
        """Runs a task and shows its error."""
        try:
            task()
        except Exception as error:  # the page continues after any error
            self.show_error(error)

    @contextmanager
    def progress(self, title: str, text: str) -> Iterator[None]:
        """Shows a progress notification within the block."""
        notice = self._client.add_notification(title, text, loading=True, with_close_button=False)
        self._client.flush()
        try:
            yield
        finally:
            notice.remove()


class LatestOnlyWorker:
    """Calls `work` in a thread of its own, once for all requests since the last call began.

    when_idle: called if no request arrives within idle_s seconds after `work`. An exception of
    either ends the thread. A queue.Queue does not merge requests, and its `join` has no timeout.
    """

    def __init__(
        self,
        work: Callable[[], object],
        when_idle: Callable[[], object] = lambda: None,
        idle_s: float = 0.1,
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
