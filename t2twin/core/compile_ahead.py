"""What happens before the first loop is compiled: a notice, and a second process that helps.

This module imports neither numba nor anything else that is slow, so that commands can prepare it.
"""

import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

from t2twin.core.cache_dir import cache_home
from t2twin.core.machine import cores

COMPILE_OPTICS = (
    "import os, sys, threading\n"
    "threading.Thread(target=lambda: (sys.stdin.read(), os._exit(0)), daemon=True).start()\n"
    "import numpy as np\n"
    "from t2twin.sim.digit.camera.pinhole import optical_grid\n"
    "from t2twin.sim.digit.optics import DigitOptics\n"
    "x, y = optical_grid()\n"
    "DigitOptics.load().render(np.exp(-np.hypot(x, y[:, None]).astype(np.float32)))\n"
    "os._exit(0)\n"
)
"""A process that compiles the loops of t2twin.sim.digit, by a picture of any surface, and keeps
them. It ends when its standard input does, so with the process that started it."""

_notices: list[Callable[[], None]] = []
_helper: subprocess.Popen | None = None


def before_compiling(notify: Callable[[], None]) -> None:
    """Call notify once, before this process compiles its first loop that is not kept yet."""
    _notices[:] = [notify]


def announce_compiling() -> None:
    """Give the notice; for whoever compiles."""
    if _notices:
        _notices.pop()()


def compile_optics_ahead() -> bool:
    """Start the second process where nothing has been compiled yet and a core is free for it;
    numba compiles one loop at a time in each process. Returns whether it was started."""
    global _helper
    home = cache_home()
    if _helper is not None or home is None or cores() < 2:
        return False
    # A folder that the user has given to numba is used instead: t2twin.core.jit.
    kept = Path(os.environ.get("NUMBA_CACHE_DIR") or home / "numba")
    if any(kept.glob("digit-*/*/*.loop")):
        return False
    _helper = subprocess.Popen(
        [sys.executable, "-c", COMPILE_OPTICS],
        stdin=subprocess.PIPE, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
    )  # fmt: skip
    return True


def wait_for_helper() -> None:
    """Wait until the second process has ended, if there is one."""
    global _helper
    if _helper is not None:
        _helper.wait()
        assert _helper.stdin is not None
        _helper.stdin.close()
        _helper = None
