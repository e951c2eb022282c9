"""Work of which only the newest matters: while one piece is being done, later ones replace each
other."""

from collections.abc import Callable
from threading import Condition, Thread


class LatestOnlyWorker:
    """Does `work` in a thread of its own, again whenever it was asked for since it last began.

    work: done once for any number of calls of `ask` that come meanwhile. then: done where nothing
    was asked for within `quiet_s` seconds after it. What either raises ends the thread.
    """

    def __init__(
        self, work: Callable[[], object], then: Callable[[], object], quiet_s: float = 0.1
    ) -> None:
        self._work, self._then, self._quiet_s = work, then, quiet_s
        self._asked, self._ended, self._busy = False, False, False
        self._changed = Condition()
        # A daemon: the process must not wait for a press when it is stopped.
        self._thread = Thread(target=self._run, daemon=True)
        self._thread.start()

    def ask(self) -> None:
        """From here on there is something new."""
        with self._changed:
            self._asked = True
            self._changed.notify_all()

    def end(self) -> None:
        """No more work is begun."""
        with self._changed:
            self._ended = True
            self._changed.notify_all()

    def join(self, timeout_s: float) -> None:
        """Waits until the work that was begun before `end` is done."""
        self._thread.join(timeout_s)

    def wait(self, timeout_s: float) -> bool:
        """Until there is nothing to do; False where that took longer."""
        with self._changed:
            return self._changed.wait_for(lambda: not (self._asked or self._busy), timeout_s)

    def _run(self) -> None:
        while True:
            with self._changed:
                self._changed.wait_for(lambda: self._asked or self._ended)
                if self._ended:
                    return
                self._asked, self._busy = False, True
            self._work()
            with self._changed:
                quiet = not self._changed.wait_for(
                    lambda: self._asked or self._ended, self._quiet_s
                )
            if quiet:
                self._then()
            with self._changed:
                self._busy = False
                self._changed.notify_all()
