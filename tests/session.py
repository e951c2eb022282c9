"""The temporary folders of a test session, and the products that its processes share.

The process that starts the session makes one folder. pytest-xdist's workers inherit it through the
environment, so that an expensive product is made once, by the worker that needs it first.
"""

import os
import shutil
import tempfile
from collections.abc import Callable
from pathlib import Path

from filelock import FileLock

from t2twin.core.cache_dir import VARIABLE

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
