"""The one folder in which everything is kept that would otherwise be made again."""

import os
import stat
import tempfile
from collections.abc import Callable
from pathlib import Path

import platformdirs

from t2twin.core.errors import T2TwinError

NAME = "t2twin"
"""The folder's name, below the user's folder for caches."""

VARIABLE = "T2TWIN_CACHE"
"""Environment variable that names another folder."""


def cache_home() -> Path | None:
    """The folder, which is made where it is not there; None where none can be written.

    It is the one that T2TWIN_CACHE names, else the user's own as the system has it
    (~/.cache/t2twin), else, without a home that can be written, one below the temporary directory
    that only this user may enter.
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
    return _users_own(platformdirs.user_cache_path, NAME) or _temporary()


def is_writable(folder: Path) -> bool:
    """Whether files can be made in this folder, which is itself made where that is possible."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError:
        return False
    return os.access(folder, os.W_OK | os.X_OK)


def matplotlib_home() -> None:
    """Where matplotlib could not write its own folders, gives it one in the cache home.

    To be called before matplotlib is imported, which else makes one anew each time and says so.
    """
    places = (platformdirs.user_config_path, platformdirs.user_cache_path)
    if "MPLCONFIGDIR" in os.environ or all(_users_own(place, "matplotlib") for place in places):
        return
    home = cache_home()
    if home is not None:
        os.environ["MPLCONFIGDIR"] = str(home / "matplotlib")


def lend_home() -> None:
    """Makes the cache home the home, for this process and those that it starts."""
    home = cache_home()
    os.environ["HOME"] = str(home or "/")
    if home is not None:
        os.environ[VARIABLE] = str(home)


def _users_own(place: Callable[[str], Path], name: str) -> Path | None:
    """A folder in the user's home; None where it cannot be written."""
    try:
        folder = place(name)
    except RuntimeError:
        return None  # nobody knows where this user's home is
    return folder if is_writable(folder) else None


def _temporary() -> Path | None:
    """A folder below the temporary directory; None where it is not this user's alone."""
    try:
        folder = Path(tempfile.gettempdir()) / f"{NAME}-{os.getuid()}"
        folder.mkdir(mode=stat.S_IRWXU, exist_ok=True)
        found = folder.lstat()
    except OSError:
        return None
    others_enter = found.st_mode & (stat.S_IRWXG | stat.S_IRWXO)
    ours = stat.S_ISDIR(found.st_mode) and found.st_uid == os.getuid() and not others_enter
    return folder if ours and is_writable(folder) else None
