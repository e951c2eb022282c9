"""Atomic writing of files, locks of folders, and reading of files that a user names.

A file is written under a temporary name, then renamed. A command that writes several files into a
folder holds its lock.
"""

import errno
import json
import os
import re
import shutil
import stat
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from threading import get_ident
from typing import Any, BinaryIO

from filelock import FileLock, Timeout

from t2twin.core.errors import T2TwinError

FULL = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG)
"""Errors of a write for which there is no room."""

LEFT_OVERS = ".*.part*"
"""What the names of everything that is still being written match."""

MAX_STEM_CHARACTERS = 40
"""Characters of a file's own name in its temporary one (assumed), which may have 255 bytes."""

in_hand: set[Path] = set()
"""What this process is writing just now; while there is any, it is ended with care."""

new_folders: list[Path] = []
"""Folders that were made for what is in hand."""


@contextmanager
def whole_file(path: Path) -> Iterator[Path]:
    """A temporary path to write to, of the same suffix, that becomes `path` if all goes well.

    Makes the folder. Raises T2TwinError where it cannot be written, and where the path is a folder
    or a device; then there is no file, and an earlier one of that name is as it was.
    """
    check_replaceable(path)
    # Of this thread alone, as several may prepare one shape at once.
    writer = f"{get_ident()}.{os.getpid()}"
    stem = path.stem[:MAX_STEM_CHARACTERS]
    temporary = path.with_name(f".{stem}.{writer}.part{path.suffix}")
    made = _missing(path.parent)
    in_hand.add(temporary)
    new_folders.extend(made)
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        yield temporary
        replace(temporary, path)
    except OSError as error:
        raise not_written(path, error) from error
    finally:
        with suppress(OSError):
            temporary.unlink(missing_ok=True)
        _remove_empty(made)
        in_hand.discard(temporary)


def replace(temporary: Path, path: Path) -> None:
    """Renames a finished file. Raises T2TwinError where the path is a folder or a device."""
    check_replaceable(path)
    temporary.replace(path)


def move_into(folder: Path, files: Sequence[Path]) -> None:
    """Moves finished files into a folder, over earlier ones of their names: all of them or none.

    Raises T2TwinError where a folder or a device has one of their names.
    """
    for file in files:
        check_replaceable(folder / file.name)
    for file in files:
        file.replace(folder / file.name)


def check_replaceable(path: Path) -> None:
    """Raises T2TwinError for a path that exists and is not a regular file.

    Renaming over a device, a pipe or a socket would remove it. Links are followed.
    """
    try:
        mode = path.stat().st_mode
    except (FileNotFoundError, NotADirectoryError):
        return
    except OSError as error:
        raise not_written(path, error) from error
    if not stat.S_ISREG(mode):
        kind = "a folder" if stat.S_ISDIR(mode) else "a device, a pipe or a socket"
        raise T2TwinError(f"{path} cannot be written: it is {kind}; expected a file")


def check_new_file(path: Path, force: bool) -> None:
    """Raises T2TwinError for a file of the user's that must not be replaced.

    force: whether a regular file may be replaced; nothing else ever is. Called before the work
    whose result is written there.
    """
    check_replaceable(path)
    if not force and os.path.lexists(path):
        raise T2TwinError(f"{path} already exists; name another file, or replace it with --force")


@contextmanager
def temporary_folder(place: Path, name: str) -> Iterator[Path]:
    """A new folder in place, which is there, to make files in before they are moved away.

    It is gone after the block. Raises T2TwinError where it cannot be made.
    """
    folder = place / f".{name}.{os.getpid()}.part"
    in_hand.add(folder)
    try:
        try:
            folder.mkdir()
        except OSError as error:
            raise not_written(place, error) from error
        yield folder
    finally:
        shutil.rmtree(folder, ignore_errors=True)
        in_hand.discard(folder)


@contextmanager
def made_folder(folder: Path) -> Iterator[None]:
    """A folder that is made where it is missing, with those above it.

    What of them is empty after the block and was made here is removed again. Raises T2TwinError
    where the path is a file, or it cannot be made.
    """
    made = _missing(folder)
    new_folders.extend(made)
    try:
        try:
            folder.mkdir(parents=True, exist_ok=True)
        except (FileExistsError, NotADirectoryError):
            raise T2TwinError(
                f"{folder} is a file, or lies below one; give a folder to write into"
            ) from None
        except OSError as error:
            raise not_written(folder, error) from error
        yield
    finally:
        _remove_empty(made)


def _remove_empty(folders: list[Path]) -> None:
    for folder in folders:
        with suppress(OSError):
            folder.rmdir()  # fails where something is in it
        with suppress(ValueError):
            new_folders.remove(folder)


def abandon() -> None:
    """Removes what is in hand and the folders made for it, of a process that ends at once."""
    for path in tuple(in_hand):
        _remove(path)
    _remove_empty(sorted(new_folders, key=lambda folder: len(folder.parts), reverse=True))


def _remove(path: Path) -> None:
    if path.is_dir() and not path.is_symlink():
        shutil.rmtree(path, ignore_errors=True)
        return
    with suppress(OSError):
        path.unlink(missing_ok=True)


def _missing(folder: Path) -> list[Path]:
    """The folder and those above it that are not there, the innermost first."""
    missing = []
    for path in (folder, *folder.parents):
        if os.path.lexists(path):
            break
        missing.append(path)
    return missing


def sweep(folder: Path, names: str = LEFT_OVERS) -> None:
    """Remove what processes of this machine that are no more were writing in a folder."""
    for left_over in folder.glob(names):
        writer = re.search(r"\.(\d+)\.part", left_over.name)
        if writer is None or _is_running(int(writer[1])):
            continue
        _remove(left_over)


def write_json(path: Path, content: Any) -> None:
    """Write content as JSON, indented by two. Raises T2TwinError where it cannot be written."""
    with whole_file(path) as temporary:
        temporary.write_text(json.dumps(content, indent=2) + "\n")


def not_written(path: Path, error: OSError) -> T2TwinError:
    """The sentence for what kept a file or a folder from being written."""
    reason = (error.strerror or str(error) or type(error).__name__).lower()
    if error.errno in FULL:
        return T2TwinError(f"there is no room for {path} ({reason}); make room and start again")
    return T2TwinError(f"{path} cannot be written ({reason}); a writable folder is needed")


def _is_running(process: int) -> bool:
    try:
        os.kill(process, 0)
    except ProcessLookupError:
        return False
    except (PermissionError, OverflowError):
        pass  # another user's, or a number that no process has
    return True


LOCK = ".t2twin.lock"
"""The lock's file in a folder. It goes with the lock; one that a killed process left behind locks
nothing."""


@contextmanager
def locked(folder: Path) -> Iterator[None]:
    """The folder is made where it is missing, and nobody else's to write into within the block.

    What killed processes left half-written in it is removed first; a folder that was made here and
    has nothing in it afterwards is removed too. Raises T2TwinError where another process holds the
    lock, where the path is a file, and where it cannot be written.
    """
    file = folder / LOCK
    with made_folder(folder):
        in_hand.add(file)
        try:
            lock = _acquired(folder)
            try:
                sweep(folder)
                yield
            finally:
                # While it is held: a lock's file that was removed is not taken for the lock.
                with suppress(OSError):
                    file.unlink(missing_ok=True)
                lock.release()
        finally:
            in_hand.discard(file)


def _acquired(folder: Path) -> FileLock:
    try:
        lock = FileLock(folder / LOCK, blocking=False)
        lock.acquire()
    except Timeout:
        raise T2TwinError(
            f"another t2twin is writing into {folder}; wait until it is done, or choose another "
            "folder"
        ) from None
    except OSError as error:
        raise not_written(folder, error) from error
    return lock


def is_empty(folder: Path) -> bool:
    """Whether nothing is in a folder but a lock and what is being written there."""
    return not any(path.name != LOCK and not path.match(LEFT_OVERS) for path in folder.iterdir())


MAX_TABLE_BYTES = 100_000_000
"""Largest table or description that is read, bytes (assumed: about 700,000 rows of 20 counts)."""


def read_file(path: Path, max_bytes: int = MAX_TABLE_BYTES, otherwise: str = "") -> bytes:
    """The content of a regular file of at most `max_bytes`; see `opened`."""
    with opened(path, max_bytes, otherwise) as file:
        return file.read()


@contextmanager
def opened(path: Path, max_bytes: int = MAX_TABLE_BYTES, otherwise: str = "") -> Iterator[BinaryIO]:
    """A regular file of at most `max_bytes`, open for reading in binary mode.

    otherwise: what is allowed in place of a file that does not exist, for the message.
    Opening never waits, as it would for the other end of a named pipe.
    Raises T2TwinError where there is no such file, it is a folder, a pipe, a socket or a device,
    it cannot be read, or it is larger.
    """
    file = None
    try:
        about = path.stat()
        if stat.S_ISREG(about.st_mode) and about.st_size <= max_bytes:
            file = path.open("rb")
    except FileNotFoundError as error:
        also = f"; {otherwise}" if otherwise else ""
        raise T2TwinError(f"there is no file {path}{also}") from error
    except (OSError, ValueError) as error:  # ValueError: a null character in the path
        reason = error.strerror if isinstance(error, OSError) else str(error)
        raise T2TwinError(f"{path} cannot be read ({reason}); give a readable file") from error
    if file is None:
        raise T2TwinError(_refusal(path, about.st_mode, about.st_size, max_bytes))
    with file:
        yield file


def _refusal(path: Path, mode: int, size: int, max_bytes: int) -> str:
    if stat.S_ISDIR(mode):
        return f"{path} is a folder; give a file in it"
    if not stat.S_ISREG(mode):
        return f"{path} is not a file but a pipe or a device; give a file"
    return f"{path} has {size / 1e6:,.0f} MB; at most {max_bytes / 1e6:,.0f} MB are allowed"
