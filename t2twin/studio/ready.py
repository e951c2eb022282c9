"""What is made ready while the browser is being opened: what all pages share, in the order in which
they need it. The first press comes first, the translators when it is on a page.
"""

import os
import subprocess
import sys
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from threading import Event, Lock
from typing import TYPE_CHECKING

from t2twin.primitives_cad.cache_home import cache_home
from t2twin.studio.frames import Frames, Named
from t2twin.studio.transfers import Uploads
from t2twin.studio.translators import Translators

if TYPE_CHECKING:
    from t2twin.sim.sensors import SensorPair

PAGE_S = 10.0
"""How long the translators wait for a page's first picture, s (assumed: a browser's own start);
PyTorch takes seconds to import, and a page would get its picture that much later."""

COMPILE_OPTICS = (
    "import os, sys, threading\n"
    "threading.Thread(target=lambda: (sys.stdin.read(), os._exit(0)), daemon=True).start()\n"
    "import numpy as np\n"
    "from t2twin.sim.digit.camera import optical_grid\n"
    "from t2twin.sim.digit.optics import DigitOptics\n"
    "x, y = optical_grid()\n"
    "DigitOptics.load().render(np.exp(-np.hypot(x, y[:, None]).astype(np.float32)))\n"
    "os._exit(0)\n"
)
"""A process that compiles the optics' loops, by a picture of any surface, and keeps them for all.
It ends when its standard input does, so with the one that started it."""


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
    compiling = _compiling_optics()
    try:
        _press(shared, compiling)
    finally:
        shared.can_press.set()
    shared.is_seen.wait(PAGE_S)
    if search:
        shared.translators.search()
    shared.translators.load(shared.translators.chosen)


def _press(shared: Shared, compiling: subprocess.Popen | None) -> None:
    from t2twin.studio.press_state import PressState
    from t2twin.studio.session import Session
    from t2twin.twin import load_shape

    load_shape(PressState().shape)
    if compiling is not None:
        compiling.wait()
        assert compiling.stdin is not None
        compiling.stdin.close()
    Session(shared.translators, shared.sensors).look(PressState())


def _compiling_optics() -> subprocess.Popen | None:
    """A second process that compiles half of what there is, on a machine where nothing has been;
    numba compiles one loop at a time in each."""
    home = cache_home()
    if home is None or (os.cpu_count() or 1) < 2:
        return None
    # A folder that the user has given to numba is taken instead: t2twin.primitives_cad.jit.
    kept = Path(os.environ.get("NUMBA_CACHE_DIR") or home / "numba")
    if any(kept.glob("digit-*")):
        return None
    return subprocess.Popen(
        [sys.executable, "-c", COMPILE_OPTICS],
        stdin=subprocess.PIPE, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
    )  # fmt: skip
