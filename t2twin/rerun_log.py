"""Recordings for the viewer of Rerun, of touches and of predictions; the extra t2twin[rerun]."""

import importlib
from collections.abc import Iterable, Iterator
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np

from t2twin.core.errors import T2TwinError, how_to_install
from t2twin.core.files import check_own, record_own, sha256_of, write_error
from t2twin.sim.touch import Touch

SUFFIX = ".rrd"
PREDICTED = (  # recorded values of a line of `t2twin live`
    "counts", "counts_std", "force_n", "force_std_n", "latency_ms", "contact/largest_depth_mm",
    "contact/area_mm2", "contact/force_in_view_n",
)  # fmt: skip
MM_PER_M = 1000.0  # of depth images


class RerunLog:
    """A recording that is written to a file, with the suffix .rrd, while it grows; an earlier one
    is replaced. Raises T2TwinError without the extra, and for a file that cannot be written or is
    another's."""

    def __init__(self, file: Path) -> None:
        if file.suffix != SUFFIX:
            raise T2TwinError(f"{file} is no recording; expected a name that ends in {SUFFIX}")
        if find_spec("rerun") is None:
            raise T2TwinError(f"a recording needs Rerun; {how_to_install('rerun')}")
        try:
            file.parent.mkdir(parents=True, exist_ok=True)
            check_own(file.parent, [file.name], file.name)
            file.open("ab").close()
        except OSError as error:
            raise write_error(file, error) from error
        self._file = file
        self._rerun: Any = importlib.import_module("rerun")
        self._stream = self._rerun.RecordingStream("t2twin")
        self._stream.save(file)

    def touch(self, time_s: float, touch: Touch) -> None:
        """Record the images, the counts and the forces of a touch at a time."""
        self._stream.set_time("time", duration=time_s)
        for sensor, reading in touch.readings.items():
            for name in ("image", "counts"):
                if (value := getattr(reading, name, None)) is not None:
                    self._log(f"{sensor}/{name}", value)
        for sensor, contact in touch.contacts.items():
            self._log(f"{sensor}/force_n", contact.force_n)
            self._log(f"{sensor}/depth_mm", contact.depth_mm)
            self._log(f"{sensor}/shear_n", float(np.hypot(*contact.shear_n)))
            self._log(f"{sensor}/slip_share", contact.slip_share)

    def prediction(
        self,
        time_s: float,
        image: np.ndarray,
        line: dict[str, Any],
        depth_mm: np.ndarray | None = None,
    ) -> None:
        """Record an image, (h, w, 3) or (h, w) uint8, a line of `t2twin live` of it, and the (h, w)
        predicted depth of the gel's surface."""
        self._stream.set_time("time", duration=time_s)
        self._log("image", image)
        contact = {f"contact/{name}": value for name, value in line.get("contact", {}).items()}
        values = line | contact
        for name in PREDICTED:
            if name in values:
                self._log(f"prediction/{name}", values[name])
        if depth_mm is not None:
            depth = self._rerun.DepthImage(np.maximum(depth_mm, 0), meter=MM_PER_M)
            self._stream.log("prediction/contact/depth", depth)

    def close(self) -> None:
        """Write what is not yet in the file."""
        self._stream.flush()
        self._stream.disconnect()
        record_own(self._file.parent, self._file.name, {self._file.name: [sha256_of(self._file)]})

    def _log(self, place: str, value: Any) -> None:
        """Record a number, counts or an image."""
        if np.ndim(value) == 0:
            shown = self._rerun.Scalars(value)
        elif np.ndim(value) == 1:
            shown = self._rerun.BarChart(np.asarray(value))
        else:
            shown = self._rerun.Image(value).compress()
        self._stream.log(place, shown)


def recorded(log: RerunLog, touches: Iterable[Touch], step_s: float) -> Iterator[Touch]:
    """The touches, each recorded at its step times step_s."""
    for step, touch in enumerate(touches):
        log.touch(step * step_s, touch)
        yield touch
