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

VARIABLE = "T2TWIN_CACHE"
"""Environment variable that names another directory."""

DIGEST_DIGITS = 16
"""Hexadecimal digits of a digest in a file name, 64 bits: collisions are negligible."""


def cache_dir() -> Path | None:
    """The cache directory, created if missing; None where none is writable.

    The first of: T2TWIN_CACHE, the user's (~/.cache/t2twin on Linux), and a directory below the
    temporary one that only this user can access.
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
    with suppress(RuntimeError):  # the user has no home
        folder = platformdirs.user_cache_path("t2twin")
        if is_writable(folder):
            return folder
    with suppress(OSError):
        folder = Path(tempfile.gettempdir()) / f"t2twin-{os.getuid()}"
        folder.mkdir(mode=stat.S_IRWXU, exist_ok=True)
        found = folder.lstat()
        if found.st_uid == os.getuid() and found.st_mode == stat.S_IFDIR | stat.S_IRWXU:
            return folder
    return None


def is_writable(folder: Path) -> bool:
    """Whether files can be created in a folder; creates the folder if that is missing."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError:
        return False
    return os.access(folder, os.W_OK | os.X_OK)


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
    return values
