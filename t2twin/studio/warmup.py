"""What is made ready while the browser is being opened: what all pages share, in the order in which
they need it. The first press comes first, the translators when it is on a page.
"""

from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from threading import Event, Lock
from typing import TYPE_CHECKING

from t2twin.core.compile_ahead import compile_optics_ahead
from t2twin.studio.frame_source import Frames, Named
from t2twin.studio.translators import Translators
from t2twin.studio.transport.transfers import Uploads

if TYPE_CHECKING:
    from t2twin.sim.sensors import SensorPair

PAGE_S = 10.0
"""How long the translators wait for a page's first picture, s (assumed: a browser's own start);
PyTorch takes seconds to import, and a page would get its picture that much later."""


@dataclass
class Shared:
    """What all clients of a studio have in common. folder: the temporary one for their files.
    frames: the source that it was started with. background: the frame of its DIGIT with nothing
    touching it. can_press: set when the first press is done. is_seen: set when a page shows one.
    uploads: of all clients."""

    translators: Translators
    folder: Path
    frames: Frames | None = None
    background: Named | None = None
    can_press: Event = field(default_factory=Event)
    is_seen: Event = field(default_factory=Event)
    uploads: Uploads = field(default_factory=Uploads, repr=False)
    _making: Lock = field(default_factory=Lock, repr=False)

    @property
    def sensors(self) -> "SensorPair":
        """Both as they come; made when they are first asked for."""
        with self._making:
            return self._sensors

    @cached_property
    def _sensors(self) -> "SensorPair":
        from t2twin.sim.sensors import SensorPair

        return SensorPair()


def get_ready(shared: Shared, search: bool) -> None:
    """The first press, then the runs and their first translation. search: whether runs are to be
    looked for, below `runs`."""
    compile_optics_ahead()
    try:
        _press(shared)
    finally:
        shared.can_press.set()
    shared.is_seen.wait(PAGE_S)
    if search:
        shared.translators.search()
    shared.translators.load(shared.translators.chosen)


def _press(shared: Shared) -> None:
    from t2twin.studio.press_state import PressState
    from t2twin.studio.session import Session
    from t2twin.twin import load_shape

    load_shape(PressState().shape)
    Session(shared.translators, shared.sensors).look(PressState())
