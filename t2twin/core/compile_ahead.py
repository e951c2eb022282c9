"""Preparations for compiling: a notice before the first compilation, and a second process.

This module imports nothing slow, such as numba, so that every command can use it.
"""

import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

from t2twin.core.cache_dir import cache_dir
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
"""A program that renders any surface, which compiles and caches the loops of t2twin.sim.digit. It
ends when its standard input closes, that is with the process that started it."""

_notices: list[Callable[[], None]] = []
_helper: subprocess.Popen | None = None


def before_compiling(notify: Callable[[], None]) -> None:
    """Call notify once, before this process compiles its first loop that is not cached."""
    _notices[:] = [notify]


def announce_compiling() -> None:
    """Give the notice, if it is still due; called before every compilation."""
    if _notices:
        _notices.pop()()


def compile_optics_ahead() -> bool:
    """Start the second process if nothing is cached yet and a second core exists.

    Numba compiles one loop at a time in each process. Returns whether the process was started.
    """
    global _helper
    folder = cache_dir()
    if _helper is not None or folder is None or cores() < 2:
        return False
    cached = Path(os.environ.get("NUMBA_CACHE_DIR") or folder / "numba")  # as in t2twin.core.jit
    if any(cached.glob("digit-*/*/*.loop")):
        return False
    _helper = subprocess.Popen(
        [sys.executable, "-c", COMPILE_OPTICS],
        stdin=subprocess.PIPE, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
    )  # fmt: skip
    return True


def wait_for_helper() -> None:
    """Wait for the second process, if there is one, to end."""
    global _helper
    if _helper is not None:
        _helper.wait()
        assert _helper.stdin is not None
        _helper.stdin.close()
        _helper = None
