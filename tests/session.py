"""The temporary folders of a test session, and the products that its processes share.

The process that starts the session makes one folder. pytest-xdist's workers inherit it through the
environment, so that an expensive product is made once, by the worker that needs it first.
"""

import os
import shutil
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path
from subprocess import DEVNULL, CompletedProcess, Popen, run
from typing import Any

import numba
from filelock import FileLock

from t2twin.core.cache_dir import VARIABLE
from t2twin.core.jit import cached_code
from t2twin.sim.contact import solver_loops

_numba: Any = numba
SESSION = "T2TWIN_TEST_SESSION"
"""Environment variable that names the folder of the session to the workers."""

FOLDERS = {
    "HOME": "home",
    "XDG_CACHE_HOME": "home/.cache",
    "XDG_CONFIG_HOME": "home/.config",
    "XDG_DATA_HOME": "home/.local/share",
    VARIABLE: "cache",
}
"""Environment variables that name a user's folders, and the folders that replace them."""

LOOPS = (
    """
from t2twin.cli import main
main(["slide", "hemisphere-1", "--sensor", "cyskin", "--dx-mm", "0.2", "--steps", "1"])
""",
    """
from t2twin.primitives_cad import catalogue, tilt
from t2twin.sim.optical.surface import ball_surface
from t2twin.sim.sensors.pair import SensorPair
camera = SensorPair().camera
camera.image_renderer.render(ball_surface(camera.elastomer, 0.0, 0.0, 1.0))
tilt.tilted(catalogue.load("hemisphere-1"), 0.1, 0.0)
import cadquery, torch._dynamo
""",
)
"""Programs that compile the loops of contacts with friction, and those of images and shapes. The
second also imports what takes longest, as libraries are installed without bytecode."""

DECODED = "cache"
"""Folder of a dataset that every reader may write to: its decoded images."""


def start(numba: Path, mujoco: Path, matplotlib: Path) -> Path:
    """Makes the folder of the session and sets the environment of all of its processes.

    numba, mujoco, matplotlib: where compiled code, models and the list of fonts are kept from one
    session to the next. They depend on the sources alone (t2twin/core/jit.py,
    sim/contact/mujoco_pins.py) or the machine, and compiling takes a minute.
    """
    folder = Path(tempfile.mkdtemp(prefix="t2twin-tests-"))
    os.environ[SESSION] = str(folder)
    for name, place in FOLDERS.items():
        (folder / place).mkdir(parents=True, exist_ok=True)
        os.environ[name] = str(folder / place)
    (folder / "empty").mkdir()
    (folder / FOLDERS[VARIABLE] / "mujoco").symlink_to(mujoco)
    os.environ["NUMBA_CACHE_DIR"], os.environ["MPLCONFIGDIR"] = str(numba), str(matplotlib)
    return folder


def compile_loops() -> None:
    """Compiles most loops, in two processes, unless they are cached: each worker would compile
    them."""
    _numba.core.config.reload_config()  # reads NUMBA_CACHE_DIR again
    if cached_code(solver_loops.__file__) == []:
        commands = [[sys.executable, "-c", program] for program in LOOPS]
        for process in [Popen(each, cwd=os.environ[SESSION], stdout=DEVNULL) for each in commands]:
            process.wait()


def python(*arguments: object, **variables: str) -> CompletedProcess[str]:
    """Runs Python in a process of its own; variables: added to its environment."""
    command = [sys.executable, *map(str, arguments)]
    return run(command, env=os.environ | variables, capture_output=True, text=True)


class Products:
    """Folders that the tests of all workers read, and none writes to."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self._listings: dict[Path, dict[str, tuple[int, int]]] = {}

    def make(self, name: str, build: Callable[[Path], object]) -> Path:
        """Returns the product of this name. `build` makes it at a path where nothing exists yet,
        unless another test or worker has made it."""
        product = self.folder / name
        product.parent.mkdir(parents=True, exist_ok=True)
        with FileLock(product.with_name(f".{product.name}.lock")):
            if not product.exists():
                # Of the product's own name, which a build may write into its files.
                partial = product.parent / ".part" / product.name
                shutil.rmtree(partial, ignore_errors=True)
                partial.parent.mkdir(exist_ok=True)
                build(partial)
                partial.rename(product)
        self._listings.setdefault(product, listing(product))
        return product

    def changed(self) -> list[str]:
        """The files of the products that a test changed, added or removed."""
        return sorted(
            f"{product.name}/{name}"
            for product, before in self._listings.items()
            for name, _ in set(before.items()) ^ set(listing(product).items())
        )


def listing(folder: Path) -> dict[str, tuple[int, int]]:
    """Size and time of change (ns) of every file, without those of DECODED folders."""
    found = {}
    for path in folder.rglob("*"):
        name = path.relative_to(folder)
        if path.is_file() and DECODED not in name.parts:
            status = path.stat()
            found[str(name)] = (status.st_size, status.st_mtime_ns)
    return found
