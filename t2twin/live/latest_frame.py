"""The latest frame of a source. Frames that are not taken in time are dropped.

A queue.Queue would give each frame to one taker only; here all takers get the latest one.
"""

from threading import Condition, Thread

from t2twin.live.frame import Frame
from t2twin.live.sources import Source


class LatestFrame:
    """Reads a source in a thread of its own. read: number of frames read so far."""

    def __init__(self, source: Source) -> None:
        self.read = 0
        self._source = source
        self._frame: Frame | None = None
        self._ended = self._closed = False
        self._error: Exception | None = None
        self._changed = Condition()
        # A daemon thread: the process does not wait for a camera when it stops.
        Thread(target=self._run, daemon=True).start()

    def take(self, after: int = -1, timeout_s: float | None = None) -> Frame | None:
        """Waits for a frame with a number above `after` and returns the latest one.

        Returns None after the end of the source and after the timeout. Several threads may take
        frames. Raises the exception that the source raised.
        """
        with self._changed:
            self._changed.wait_for(lambda: self.read > after + 1 or self._ended, timeout_s)
            if self._frame is not None and self._frame.number > after:
                return self._frame
            if self._error is not None:
                raise self._error
            return None

    def close(self) -> None:
        """Stops reading, without waiting for a frame that is being read."""
        self._closed = True
        close = getattr(self._source, "close", None)
        if close is not None:
            close()

    @property
    def ended(self) -> bool:
        """Whether the source has ended."""
        with self._changed:
            return self._ended

    def _run(self) -> None:
        try:
            while not self._closed and (frame := self._source.read()) is not None:
                with self._changed:
                    self._frame, self.read = frame, frame.number + 1
                    self._changed.notify_all()
        except Exception as error:  # `take` raises it
            self._error = error
        with self._changed:
            self._ended = True
            self._changed.notify_all()
