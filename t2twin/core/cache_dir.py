"""The cache directory: prepared shapes, arrays, compiled code and models."""

import hashlib
import os
import stat
import tempfile
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import BinaryIO

import numpy as np
import platformdirs

from t2twin.core.errors import T2TwinError
from t2twin.core.files import atomic_write

NAME = "t2twin"
"""Name of the directory below the user's directory for caches."""

VARIABLE = "T2TWIN_CACHE"
"""Environment variable that names another directory."""

DIGEST_DIGITS = 16
"""Hexadecimal digits of a digest in a file name, 64 bits: collisions are negligible."""

MAX_ARRAYS = 200
"""Limit on the arrays of one kind (assumed: some dozen elastomers); the oldest are removed."""


def cache_dir() -> Path | None:
    """The cache directory, created if missing; None where none is writable.

    The first of: T2TWIN_CACHE, the user's (~/.cache/t2twin on Linux), and a directory below the
    temporary one that only this user can read.
    Raises T2TwinError where T2TWIN_CACHE names a folder that cannot be written.
    """
    named = os.environ.get(VARIABLE)
    if named:
        folder = Path(named).absolute()
        if not is_writable(folder):
            raise T2TwinError(
                f"{VARIABLE} is {named}, which cannot be written; name a writable folder, or unset "
                "it"
            )
        return folder
    return _user_folder(platformdirs.user_cache_path, NAME) or _temporary()


def is_writable(folder: Path) -> bool:
    """Whether files can be created in a folder; creates the folder if that is missing."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError:
        return False
    return os.access(folder, os.W_OK | os.X_OK)


def configure_matplotlib_dir() -> None:
    """Point MPLCONFIGDIR to the cache directory where matplotlib's own folders are not writable.

    Call it before the import of matplotlib, which otherwise creates a temporary folder each time,
    with a warning.
    """
    places = (platformdirs.user_config_path, platformdirs.user_cache_path)
    if "MPLCONFIGDIR" in os.environ or all(_user_folder(place, "matplotlib") for place in places):
        return
    folder = cache_dir()
    if folder is not None:
        os.environ["MPLCONFIGDIR"] = str(folder / "matplotlib")


def use_cache_dir_as_home() -> None:
    """Set HOME to the cache directory, for this process and its children."""
    folder = cache_dir()
    os.environ["HOME"] = str(folder or "/")
    if folder is not None:
        os.environ[VARIABLE] = str(folder)


def _user_folder(place: Callable[[str], Path], name: str) -> Path | None:
    """A folder in the user's home; None where it is not writable."""
    try:
        folder = place(name)
    except RuntimeError:
        return None  # the user has no home
    return folder if is_writable(folder) else None


def _temporary() -> Path | None:
    """A folder below the temporary directory; None unless this user alone has access to it."""
    try:
        folder = Path(tempfile.gettempdir()) / f"{NAME}-{os.getuid()}"
        folder.mkdir(mode=stat.S_IRWXU, exist_ok=True)
        found = folder.lstat()
    except OSError:
        return None
    shared = found.st_mode & (stat.S_IRWXG | stat.S_IRWXO)
    ours = stat.S_ISDIR(found.st_mode) and found.st_uid == os.getuid() and not shared
    return folder if ours and is_writable(folder) else None


def short_digest(content: bytes) -> str:
    """The first DIGEST_DIGITS hexadecimal digits of the SHA-256."""
    return hashlib.sha256(content).hexdigest()[:DIGEST_DIGITS]


def write_once(path: Path, write: Callable[[BinaryIO], object]) -> None:
    """Write a file unless it exists. Raises T2TwinError where that fails."""
    if not path.is_file():
        with atomic_write(path) as temporary, temporary.open("w+b") as file:
            write(file)


def cached_array(kind: str, key: str, source: str, compute: Callable[[], np.ndarray]) -> np.ndarray:
    """The array that `compute` returns, computed once for each key.

    kind: subfolder of the cache directory. key: everything that the array depends on, besides the
    code in the file `source`. Without a cache directory the array is computed at every call.
    """
    folder = cache_dir()
    if folder is None:
        return compute()
    path = folder / kind / f"{short_digest(key.encode() + Path(source).read_bytes())}.npy"
    if path.is_file():
        return np.load(path)
    values = compute()
    with suppress(T2TwinError):  # a full disk
        write_once(path, lambda file: np.save(file, values))
        for oldest in sorted(path.parent.glob("*.npy"), key=os.path.getmtime)[:-MAX_ARRAYS]:
            oldest.unlink(missing_ok=True)
    return values
