"""State shared by all pages of a studio: runs, sensors and frames, prepared while the browser
starts.

Slow modules are imported on demand, because the studio listens before that.
"""

from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from threading import Event, Lock
from typing import TYPE_CHECKING

import numpy as np

from t2twin.compile_ahead import compile_ahead
from t2twin.core.errors import T2TwinError
from t2twin.studio.translators import Translators

if TYPE_CHECKING:
    from t2twin.live.sources import LatestFrame, Source
    from t2twin.sim.sensors.pair import SensorPair

PAGE_TIMEOUT_S = 10.0
"""Maximum time for which loading of translators waits for a first page, s (assumed: the start of a
browser). PyTorch takes seconds to import, which would delay the first image."""

NamedFrame = tuple[np.ndarray, str]
"""A frame, (h, w, 3) or (h, w) uint8, and its name."""


def read_frame(path: Path) -> NamedFrame:
    """Reads an image file. Raises T2TwinError if it is not an image."""
    from t2twin.translate.data.images import open_image

    return np.asarray(open_image(path)), path.name


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
        from t2twin.live.sources import LatestFrame, open_source

        with self._lock:
            if self._latest is None or self._latest.ended:
                self._latest = LatestFrame(self._source or open_source(self._argument))
                self._source = None
            return self._latest

    def files(self) -> list[Path]:
        """The image files of a folder, sorted by name; empty for other sources."""
        from t2twin.translate.inference.files import find_images

        if not self._argument.isdigit() and Path(self._argument).is_dir():
            with suppress(T2TwinError):  # a folder without images so far
                return find_images([self._argument])
        return []


@dataclass
class SharedState:
    """State shared by all clients of a studio.

    folder: temporary folder for their files. frame_source, background: as for `studio`.
    press_ready: set after the first press. page_shown: set after a page shows a press.
    """

    translators: Translators
    folder: Path
    frame_source: FrameSource | None = None
    background: NamedFrame | None = None
    press_ready: Event = field(default_factory=Event)
    page_shown: Event = field(default_factory=Event)

    @cached_property
    def sensors(self) -> "SensorPair":
        """The default sensors; created by the first press, which pages wait for."""
        from t2twin.sim.sensors.pair import SensorPair

        return SensorPair()


def warm_up(
    state: SharedState, search: bool, when_done: Callable[[], object] = lambda: None
) -> None:
    """Presses once, then loads the default translators.

    search: whether to search for runs in the folder `runs`. when_done: called at the end.
    """
    compile_ahead()
    try:
        _press(state)
    finally:
        state.press_ready.set()
    state.page_shown.wait(PAGE_TIMEOUT_S)
    if search:
        state.translators.search()
    state.translators.load(state.translators.default_names)
    when_done()


def _press(state: SharedState) -> None:
    from t2twin.studio.press_state import PressState
    from t2twin.studio.session import Session

    Session(state.translators, state.sensors).press(PressState())
