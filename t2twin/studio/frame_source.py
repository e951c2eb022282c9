"""The frame source of a studio, shared by all pages.

Modules that open sources are imported on demand, because the studio listens before that.
"""

from pathlib import Path
from threading import Lock
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from t2twin.live.latest_frame import LatestFrame
    from t2twin.live.sources import Source

NamedFrame = tuple[np.ndarray, str]
"""A frame, (h, w, 3) or (h, w) uint8, and its name."""


class FrameSource:
    """A camera, a video file or a folder; opened here, read when a page first requests frames.

    source: as for `t2twin live`. Raises T2TwinError if it cannot be opened.
    """

    def __init__(self, source: str) -> None:
        from t2twin.live.sources import open_source

        self.name = f"camera {source}" if source.isdigit() else Path(source).name
        self._argument = source
        self._source: Source | None = open_source(source)
        self._latest: LatestFrame | None = None
        self._lock = Lock()

    def latest(self) -> "LatestFrame":
        """The latest frame from now on; restarts a video that has ended."""
        from t2twin.live.latest_frame import LatestFrame
        from t2twin.live.sources import open_source

        with self._lock:
            if self._latest is None or self._latest.ended:
                self._latest = LatestFrame(self._source or open_source(self._argument))
                self._source = None
            return self._latest

    def files(self) -> list[Path]:
        """The image files of a folder, sorted by name; empty for other sources."""
        from t2twin.translate.inference.batch import SUFFIXES

        folder = Path(self._argument)
        if self._argument.isdigit() or not folder.is_dir():
            return []
        images = (path for path in folder.iterdir() if path.suffix.lower() in SUFFIXES)
        return sorted(path for path in images if not path.name.startswith("."))


def read_frame(path: Path) -> NamedFrame:
    """Reads an image file. Raises T2TwinError if it is not an image."""
    from t2twin.translate.data.images import open_image

    return np.asarray(open_image(path)), path.name
