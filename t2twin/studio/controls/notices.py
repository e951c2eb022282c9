"""What one client is told besides its pictures: errors, and that something takes a while."""

import traceback
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from threading import RLock

import viser

from t2twin.core.errors import T2TwinError
from t2twin.studio.transport.log import log

UNEXPECTED = "something went wrong that should not; what, is said where the studio was started"
"""What a page says of an error that is none of the user's."""


class Notices:
    """At most one error at a time, which stays until what it names is well again. Several threads
    may use one."""

    def __init__(self, client: viser.ClientHandle) -> None:
        self._client = client
        self._error: viser.NotificationHandle | None = None
        self._said = ""
        self._lock = RLock()

    def well(self) -> None:
        """What was wrong is no more."""
        with self._lock:
            if self._error is not None:
                self._error.remove()
            self._error, self._said = None, ""

    def wrong(self, error: Exception) -> None:
        """Says why something cannot be done, in the words of the command line."""
        if isinstance(error, T2TwinError):
            sentence = str(error)
        elif isinstance(error, OSError):
            sentence = f"{error.filename or 'a file'} cannot be used: {error.strerror or error}"
        else:
            sentence = UNEXPECTED
            (*_, place) = traceback.extract_tb(error.__traceback__) or [None]
            at = "" if place is None else f" at {place.filename}:{place.lineno}"
            log(f"the studio goes on after an error{at}: {error!r}")
        with self._lock:
            if sentence == self._said:
                return
            self.well()
            self._said = sentence
            self._error = self._client.add_notification("Not possible", sentence, color="red")

    def guarded(self, do: Callable[[], object]) -> bool:
        """Does something, and says so where it cannot be done; True where it could."""
        try:
            do()
        except Exception as error:  # whatever it is, the page goes on
            self.wrong(error)
            return False
        return True

    @contextmanager
    def busy(self, title: str, text: str) -> Iterator[None]:
        """Says within the block that something takes a while."""
        notice = self._client.add_notification(title, text, loading=True, with_close_button=False)
        self._client.flush()
        try:
            yield
        finally:
            notice.remove()
