"""Preparation while the browser starts: a first press, then the search and loading of runs."""

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from threading import Event
from typing import TYPE_CHECKING

from t2twin.core.compile_ahead import compile_optics_ahead
from t2twin.studio.frame_source import FrameSource, NamedFrame
from t2twin.studio.translators import Translators
from t2twin.studio.transport.uploads import Uploads

if TYPE_CHECKING:
    from t2twin.sim.sensors import SensorPair

PAGE_TIMEOUT_S = 10.0
"""Maximum time for which loading of translators waits for a first page, s (assumed: the start of a
browser). PyTorch takes seconds to import, which would delay the first image."""


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
    uploads: Uploads = field(default_factory=Uploads, repr=False)

    @cached_property
    def sensors(self) -> "SensorPair":
        """The default sensors; created by the first press, which pages wait for."""
        from t2twin.sim.sensors import SensorPair

        return SensorPair()


def warm_up(
    state: SharedState, search: bool, when_done: Callable[[], object] = lambda: None
) -> None:
    """Presses once, then loads the default translators.

    search: whether to search for runs in the folder `runs`. when_done: called at the end.
    """
    compile_optics_ahead()
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
