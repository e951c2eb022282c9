"""Recordings for the viewer of Rerun, of touches and of predictions.

The extra t2twin[rerun] installs it; `rerun FILE.rrd` shows a recording.
"""

import importlib
from collections.abc import Iterable, Iterator
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np

from t2twin.core.errors import T2TwinError
from t2twin.sim.touch import Touch

SUFFIX = ".rrd"

MM_PER_M = 1000.0
"""Unit of depth images, mm."""


class RerunLog:
    """A recording that is written to a file while it grows.

    file: with the suffix .rrd; an earlier recording is replaced.
    Raises T2TwinError without the extra, for another suffix, and for a file that cannot be written.
    """

    def __init__(self, file: Path) -> None:
        if file.suffix != SUFFIX:
            raise T2TwinError(f"{file} is no recording; expected a name that ends in {SUFFIX}")
        if find_spec("rerun") is None:
            raise T2TwinError("a recording needs Rerun: `pip install 't2twin[rerun]'`")
        try:
            file.parent.mkdir(parents=True, exist_ok=True)
            file.open("ab").close()
        except OSError as error:
            raise T2TwinError(f"{file} cannot be written: {error.strerror}") from error
        self._rerun: Any = importlib.import_module("rerun")
        self._stream = self._rerun.RecordingStream("t2twin")
        self._stream.save(file)

    def touch(self, time_s: float, touch: Touch) -> None:
        """Record the images, the counts and the forces of a touch at a time."""
        self._stream.set_time("time", duration=time_s)
        for sensor, reading in touch.readings.items():
            if (image := getattr(reading, "image", None)) is not None:
                self._image(f"{sensor}/image", image)
            if (counts := getattr(reading, "counts", None)) is not None:
                self._counts(f"{sensor}/counts", counts)
        for sensor, contact in touch.contacts.items():
            self._number(f"{sensor}/force_n", contact.force_n)
            self._number(f"{sensor}/depth_mm", contact.depth_mm)
            self._number(f"{sensor}/shear_n", float(np.hypot(*contact.shear_n)))
            self._number(f"{sensor}/slip_share", contact.slip_share)

    def prediction(
        self,
        time_s: float,
        image: np.ndarray,
        line: dict[str, Any],
        depth_mm: np.ndarray | None = None,
    ) -> None:
        """Record an image and the prediction of `t2twin live` from it.

        image: (h, w, 3) or (h, w) uint8. line: the values of a line of `t2twin live`. depth_mm:
        (h, w) predicted depth of the gel's surface, mm.
        """
        self._stream.set_time("time", duration=time_s)
        self._image("image", image)
        for name in ("counts", "counts_std"):
            if name in line:
                self._counts(f"prediction/{name}", np.asarray(line[name]))
        for name in ("force_n", "force_std_n", "latency_ms"):
            if name in line:
                self._number(f"prediction/{name}", line[name])
        for name in ("largest_depth_mm", "area_mm2", "force_in_view_n"):
            if name in line.get("contact", {}):
                self._number(f"prediction/contact/{name}", line["contact"][name])
        if depth_mm is not None:
            depth = self._rerun.DepthImage(np.maximum(depth_mm, 0), meter=MM_PER_M)
            self._stream.log("prediction/contact/depth", depth)

    def close(self) -> None:
        """Write what is not yet in the file."""
        self._stream.flush()
        self._stream.disconnect()

    def _image(self, place: str, image: np.ndarray) -> None:
        self._stream.log(place, self._rerun.Image(image).compress())

    def _counts(self, place: str, counts: np.ndarray) -> None:
        self._stream.log(place, self._rerun.BarChart(counts))

    def _number(self, place: str, value: float) -> None:
        self._stream.log(place, self._rerun.Scalars(value))


def recorded(log: RerunLog, touches: Iterable[Touch], step_s: float) -> Iterator[Touch]:
    """The touches, each recorded at its step times step_s."""
    for step, touch in enumerate(touches):
        log.touch(step * step_s, touch)
        yield touch
