"""Compiles and caches the loops of t2twin.sim.optical in a second process.

Numba compiles one loop at a time in each process. This module imports nothing slow, such as numba,
so that the process starts early.
"""

import os
import subprocess
import sys
import threading
from pathlib import Path

from t2twin.core.cache_dir import cache_dir
from t2twin.core.machine import cores

PACKAGE = "t2twin.sim.optical"

_helper: subprocess.Popen | None = None


def compile_optics_ahead() -> bool:
    """Start the second process if nothing is cached yet and a second core exists.

    Returns whether the process was started. It ends when its standard input closes, that is with
    the process that started it.
    """
    global _helper
    given, folder = os.environ.get("NUMBA_CACHE_DIR"), cache_dir()
    if _helper is not None or folder is None or cores() < 2:
        return False
    cached = Path(given) if given else folder / "numba"  # as in t2twin.core.jit
    if any(cached.glob("optical-*/*/*/*.nbi")):
        return False
    _helper = subprocess.Popen(
        [sys.executable, "-m", __name__],
        stdin=subprocess.PIPE, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
    )  # fmt: skip
    from t2twin.core.jit import wait_before_compiling

    wait_before_compiling(PACKAGE, _wait)
    return True


def _wait() -> None:
    """Wait for the second process to end."""
    global _helper
    if _helper is not None:
        _helper.wait()
        assert _helper.stdin is not None
        _helper.stdin.close()
        _helper = None


def main() -> None:
    """Render any surface, which compiles all loops of the package; end with standard input."""
    threading.Thread(target=lambda: (sys.stdin.read(), os._exit(0)), daemon=True).start()
    import numpy as np

    from t2twin.sim.optical.camera.pinhole import optical_grid
    from t2twin.sim.sensors.pair import SensorPair

    camera = SensorPair().camera
    x, y = optical_grid(camera.elastomer)
    camera.image_renderer.render(np.exp(-np.hypot(x, y[:, None]).astype(np.float32)))
    os._exit(0)


if __name__ == "__main__":
    main()
