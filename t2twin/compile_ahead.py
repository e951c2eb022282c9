"""Compiles and caches a part of a press's loops in a second process.

Numba compiles one loop at a time in each process. This module imports nothing slow, such as numba,
so that the process starts early.
"""

import atexit
import os
import subprocess
import sys
import threading
from pathlib import Path

from t2twin.core.cache_dir import cache_dir
from t2twin.core.machine import cores

_process: subprocess.Popen | None = None


def compile_ahead() -> bool:
    """Start the second process if nothing is cached yet and a second core exists.

    Returns whether the process was started. It ends when its standard input closes, that is with
    the process that started it.
    """
    global _process
    given, folder = os.environ.get("NUMBA_CACHE_DIR"), cache_dir()
    if _process is not None or folder is None or cores() < 2:
        return False
    cached = Path(given) if given else folder / "numba"  # as in t2twin.core.jit
    if any(cached.glob("optical-*/*/*/*.nbi")):
        return False
    _process = subprocess.Popen(
        [sys.executable, "-m", __name__],
        stdin=subprocess.PIPE, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
    )  # fmt: skip
    atexit.register(_end, _process)
    return True


def _end(process: subprocess.Popen) -> None:
    """End the second process."""
    assert process.stdin is not None
    process.stdin.close()
    process.wait()


def main() -> None:
    """Compile the last loops of the contact, then all of the optics; end with standard input.

    The process that waits compiles the others meanwhile, in the order of their use; each loop is
    compiled by one of the two.
    """
    threading.Thread(target=lambda: (sys.stdin.read(), os._exit(0)), daemon=True).start()
    from t2twin.sim.contact.layer import convolve
    from t2twin.sim.contact.solver_loops import precondition, spring_step

    for loop in (convolve, spring_step, precondition):
        loop.prepare()

    import numpy as np

    from t2twin.sim.optical.camera import optical_grid
    from t2twin.sim.sensors.pair import SensorPair

    camera = SensorPair().camera
    x, y = optical_grid(camera.elastomer)
    camera.image_renderer.render(np.exp(-np.hypot(x, y[:, None]).astype(np.float32)))
    os._exit(0)


if __name__ == "__main__":
    main()
