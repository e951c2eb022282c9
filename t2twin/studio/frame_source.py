"""The source of frames that a studio was started with, which all its pages share.

What opens it is imported with it: the studio listens before that.
"""

from pathlib import Path
from threading import Lock
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from t2twin.live.latest_frame import LatestFrame
    from t2twin.live.sources import Source

Named = tuple[np.ndarray, str]
"""A frame, (h, w, 3) or (h, w) uint8, and what it is called."""


class Frames:
    """A camera, a video file or a folder, opened here and read when the first page wants it.

    name: as for `t2twin live`. Raises T2TwinError where it cannot be opened.
    """

    def __init__(self, name: str) -> None:
        from t2twin.live.sources import open_source

        self.name = f"camera {name}" if name.isdigit() else Path(name).name
        self._given = name
        self._source: Source | None = open_source(name)
        self._newest: LatestFrame | None = None
        self._lock = Lock()

    def newest(self) -> "LatestFrame":
        """Its newest frame from now on; a video that has ended begins again."""
        from t2twin.live.latest_frame import LatestFrame
        from t2twin.live.sources import open_source

        with self._lock:
            if self._newest is None or self._newest.ended:
                self._newest = LatestFrame(self._source or open_source(self._given))
                self._source = None
            return self._newest

    def files(self) -> list[Path]:
        """A folder's images just now, sorted by name; none of another source."""
        from t2twin.translate.inference.batch import SUFFIXES

        folder = Path(self._given)
        if self._given.isdigit() or not folder.is_dir():
            return []
        images = (path for path in folder.iterdir() if path.suffix.lower() in SUFFIXES)
        return sorted(path for path in images if not path.name.startswith("."))


def read_frame(path: Path) -> Named:
    """An image file and its name. Raises T2TwinError where it is no image."""
    from t2twin.translate.data.images import open_image

    return np.asarray(open_image(path)), path.name
