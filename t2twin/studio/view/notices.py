"""Notifications of one client: errors, and progress of slow tasks."""

import traceback
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from threading import RLock

import viser

from t2twin.core.errors import T2TwinError
from t2twin.studio.transport.log import log

UNEXPECTED = "an unexpected error occurred; its message is in the terminal of the studio"
"""Text of an error that the user did not cause."""


class Notices:
    """Shows at most one error, until it is cleared. Several threads may use one."""

    def __init__(self, client: viser.ClientHandle) -> None:
        self._client = client
        self._error: viser.NotificationHandle | None = None
        self._shown = ""
        self._lock = RLock()

    def clear(self) -> None:
        """Removes the error."""
        with self._lock:
            if self._error is not None:
                self._error.remove()
            self._error, self._shown = None, ""

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
            if message != self._shown:
                self.clear()
                self._shown = message
                self._error = self._client.add_notification("Not possible", message, color="red")

    def guard(self, task: Callable[[], object]) -> bool:
        """Runs a task and shows its error; True if there was none."""
        try:
            task()
        except Exception as error:  # the page continues after any error
            self.show_error(error)
            return False
        return True

    @contextmanager
    def progress(self, title: str, text: str) -> Iterator[None]:
        """Shows a progress notification within the block."""
        notice = self._client.add_notification(title, text, loading=True, with_close_button=False)
        self._client.flush()
        try:
            yield
        finally:
            notice.remove()
