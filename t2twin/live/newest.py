"""The newest frame of a source; those that nobody took in time are dropped."""

from threading import Condition, Thread

from t2twin.live.sources import Frame, Source


class Newest:
    """Reads a source in a thread of its own from now on. read: how many frames came so far."""

    def __init__(self, source: Source) -> None:
        self.read = 0
        self._source = source
        self._frame: Frame | None = None
        self._ended = False
        self._error: Exception | None = None
        self._changed = Condition()
        # A daemon: nobody waits for a camera when the process is stopped.
        Thread(target=self._run, daemon=True).start()

    def take(self, timeout_s: float | None = None) -> Frame | None:
        """Waits for a frame that has not been taken yet, the newest; None where there will be
        none, or none came in time. Raises what the source raised."""
        with self._changed:
            self._changed.wait_for(lambda: self._frame is not None or self._ended, timeout_s)
            frame, self._frame = self._frame, None
            if frame is None and self._error is not None:
                raise self._error
            return frame

    @property
    def ended(self) -> bool:
        """Whether there will be no more frames."""
        with self._changed:
            return self._ended and self._frame is None

    def _run(self) -> None:
        try:
            while (frame := self._source.read()) is not None:
                with self._changed:
                    self._frame, self.read = frame, frame.number + 1
                    self._changed.notify_all()
        except Exception as error:  # it is raised again where frames are taken
            self._error = error
        with self._changed:
            self._ended = True
            self._changed.notify_all()
