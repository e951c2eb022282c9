"""Writes files completely or not at all, locks folders, and reads files named by the user.

Files are written under a temporary name and then renamed. A process that writes more than one file
into a folder holds the folder's lock. `pending_writes` lists what `t2twin.core.signals` has to
remove when the process is ended.
"""

import csv
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

NO_SPACE = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG)
"""Numbers of the errors of a write without enough space."""

TEMPORARY_NAMES = ".*.part*"
"""Pattern of the names of temporary files and folders."""

MAX_STEM_CHARACTERS = 40
"""Characters of a file's stem in its temporary name (assumed), which may have 255 bytes."""

MAX_TABLE_BYTES = 100_000_000
"""Size limit of tables and descriptions, bytes (assumed: about 700,000 rows of 20 counts)."""

LOCK = ".t2twin.lock"
"""Name of a folder's lock file. It is removed with the lock; a file without a process that holds it
locks nothing."""

pending_writes: set[Path] = set()
"""Temporary files and folders that this process is writing."""

created_folders: list[Path] = []
"""Folders that were created for pending writes."""


@contextmanager
def atomic_write(path: Path) -> Iterator[Path]:
    """A temporary path with the suffix of `path`, which is renamed to `path` after the block.

    Creates the folder. Raises T2TwinError where the file cannot be written, or the path is a folder
    or a device. After an error there is no new file, and an earlier one is unchanged.
    """
    check_replaceable(path)
    # Unique to the thread, as several threads may prepare the same shape.
    writer = f"{get_ident()}.{os.getpid()}"
    stem = path.stem[:MAX_STEM_CHARACTERS]
    temporary = path.with_name(f".{stem}.{writer}.part{path.suffix}")
    with created_folder(path.parent):
        pending_writes.add(temporary)
        try:
            yield temporary
            check_replaceable(path)
            temporary.replace(path)
        except OSError as error:
            raise write_error(path, error) from error
        finally:
            with suppress(OSError):
                temporary.unlink(missing_ok=True)
            pending_writes.discard(temporary)


def write_json(path: Path, content: Any) -> None:
    """Write content as JSON, indented by two. Raises T2TwinError where that fails."""
    with atomic_write(path) as temporary:
        temporary.write_text(json.dumps(content, indent=2) + "\n")


def write_csv(path: Path, names: Sequence[str], rows: Sequence[Sequence[Any]]) -> None:
    """Write a table to a new file in a temporary folder, numbers with six digits."""
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file)
        writer.writerow(names)
        writer.writerows([_csv_cell(value) for value in row] for row in rows)


def _csv_cell(value: Any) -> Any:
    if isinstance(value, bool):
        return str(value).lower()
    return f"{value:.6g}" if isinstance(value, float) else value


def move_into(folder: Path, files: Sequence[Path]) -> None:
    """Move finished files into a folder, replacing files of the same names: all of them or none.

    Raises T2TwinError where a folder or a device has one of the names.
    """
    for file in files:
        check_replaceable(folder / file.name)
    for file in files:
        file.replace(folder / file.name)


def check_replaceable(path: Path) -> None:
    """Raises T2TwinError for a path that exists and is not a regular file.

    Renaming over a device, a pipe or a socket would remove it. Follows links.
    """
    try:
        mode = path.stat().st_mode
    except (FileNotFoundError, NotADirectoryError):
        return
    except OSError as error:
        raise write_error(path, error) from error
    if not stat.S_ISREG(mode):
        kind = "a folder" if stat.S_ISDIR(mode) else "a device, a pipe or a socket"
        raise T2TwinError(f"{path} cannot be written: it is {kind}; expected a file")


def check_new_file(path: Path, force: bool) -> None:
    """Raises T2TwinError for an output file that must not be replaced.

    force: whether a regular file may be replaced; other paths never are. Call it before the work
    whose result is written there.
    """
    check_replaceable(path)
    if not force and os.path.lexists(path):
        raise T2TwinError(f"{path} already exists; name another file, or replace it with --force")


@contextmanager
def temporary_folder(place: Path, name: str) -> Iterator[Path]:
    """A new folder in an existing one, `place`, which is removed after the block.

    Raises T2TwinError where it cannot be created.
    """
    folder = place / f".{name}.{os.getpid()}.part"
    pending_writes.add(folder)
    try:
        try:
            folder.mkdir()
        except OSError as error:
            raise write_error(place, error) from error
        yield folder
    finally:
        shutil.rmtree(folder, ignore_errors=True)
        pending_writes.discard(folder)


@contextmanager
def new_folder(folder: Path) -> Iterator[Path]:
    """A temporary folder, which is renamed to `folder` after the block.

    Raises T2TwinError where the path is a file or a folder with content, or cannot be written.
    After an error there is no new folder.
    """
    _check_free(folder)
    with created_folder(folder.parent):
        remove_leftovers(folder.parent, f".{folder.name}.*.part")
        with temporary_folder(folder.parent, folder.name) as temporary:
            yield temporary
            try:
                temporary.replace(folder)
            except OSError as error:  # another process may have written to it meanwhile
                _check_free(folder)
                raise write_error(folder, error) from error


def _check_free(folder: Path) -> None:
    if folder.exists() and (not folder.is_dir() or any(folder.iterdir())):
        raise T2TwinError(f"{folder} is not empty; choose another folder")


@contextmanager
def created_folder(folder: Path) -> Iterator[None]:
    """Create a folder and its parents if they are missing.

    Those created here that are empty after the block are removed. Raises T2TwinError where the path
    is a file, or the folder cannot be created.
    """
    created = _missing(folder)
    created_folders.extend(created)
    try:
        try:
            folder.mkdir(parents=True, exist_ok=True)
        except (FileExistsError, NotADirectoryError):
            raise T2TwinError(
                f"{folder} is a file, or lies below one; give a folder to write into"
            ) from None
        except OSError as error:
            raise write_error(folder, error) from error
        yield
    finally:
        _remove_empty(created)


@contextmanager
def locked(folder: Path) -> Iterator[None]:
    """Create a folder if it is missing, and lock it against other processes within the block.

    First removes the temporary files of processes that were killed. Removes a folder that was
    created here and is empty afterwards. Raises T2TwinError where another process holds the lock,
    the path is a file, or the folder cannot be written.
    """
    file = folder / LOCK
    with created_folder(folder):
        pending_writes.add(file)
        try:
            lock = _acquired(folder)
            try:
                remove_leftovers(folder)
                yield
            finally:
                # Before the release: no other process can then hold the file that is removed.
                with suppress(OSError):
                    file.unlink(missing_ok=True)
                lock.release()
        finally:
            pending_writes.discard(file)


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
        raise write_error(folder, error) from error
    return lock


def is_empty(folder: Path) -> bool:
    """Whether a folder contains nothing but a lock and temporary files."""
    return not any(
        path.name != LOCK and not path.match(TEMPORARY_NAMES) for path in folder.iterdir()
    )


def check_own(folder: Path, file: str, kind: str) -> None:
    """Raises T2TwinError for a folder with content other than an earlier result of the same kind.

    file: the name of one that each such result has. kind: of the result, such as "press".
    """
    if not is_empty(folder) and not (folder / file).is_file():
        raise T2TwinError(
            f"{folder} is not empty, and its files are not of a {kind}; expected a new or empty "
            f"folder, or one of an earlier {kind}"
        )


def remove_leftovers(folder: Path, names: str = TEMPORARY_NAMES) -> None:
    """Remove the temporary files and folders of processes that no longer run."""
    for leftover in folder.glob(names):
        writer = re.search(r"\.(\d+)\.part", leftover.name)
        if writer is not None and not _is_running(int(writer[1])):
            _remove(leftover)


def remove_pending() -> None:
    """Remove pending writes and the folders created for them, before the process ends at once."""
    for path in tuple(pending_writes):
        _remove(path)
    _remove_empty(sorted(created_folders, key=lambda folder: len(folder.parts), reverse=True))


def write_error(path: Path, error: OSError) -> T2TwinError:
    """The exception for a file or a folder that cannot be written."""
    reason = (error.strerror or str(error) or type(error).__name__).lower()
    if error.errno in NO_SPACE:
        return T2TwinError(f"there is no room for {path} ({reason}); make room and start again")
    return T2TwinError(f"{path} cannot be written ({reason}); a writable folder is needed")


def read_file(path: Path, max_bytes: int = MAX_TABLE_BYTES, otherwise: str = "") -> bytes:
    """The content of a regular file of at most `max_bytes`; see `open_regular`."""
    with open_regular(path, max_bytes, otherwise) as file:
        return file.read()


@contextmanager
def open_regular(
    path: Path, max_bytes: int = MAX_TABLE_BYTES, otherwise: str = ""
) -> Iterator[BinaryIO]:
    """A regular file of at most `max_bytes`, open for reading in binary mode.

    otherwise: alternative to a file that does not exist, for the message. Never blocks, as opening
    a named pipe would.
    Raises T2TwinError where the file does not exist, is a folder, a pipe, a socket or a device,
    cannot be read, or is larger.
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


def _remove(path: Path) -> None:
    if path.is_dir() and not path.is_symlink():
        shutil.rmtree(path, ignore_errors=True)
        return
    with suppress(OSError):
        path.unlink(missing_ok=True)


def _remove_empty(folders: list[Path]) -> None:
    for folder in folders:
        with suppress(OSError):
            folder.rmdir()  # fails for a folder that is not empty
        with suppress(ValueError):
            created_folders.remove(folder)


def _missing(folder: Path) -> list[Path]:
    """The folder and its parents that do not exist, the innermost first."""
    missing = []
    for path in (folder, *folder.parents):
        if os.path.lexists(path):
            break
        missing.append(path)
    return missing


def _is_running(process: int) -> bool:
    try:
        os.kill(process, 0)
    except ProcessLookupError:
        return False
    except (PermissionError, OverflowError):
        pass  # another user's process, or a number beyond the largest
    return True


def _refusal(path: Path, mode: int, size: int, max_bytes: int) -> str:
    if stat.S_ISDIR(mode):
        return f"{path} is a folder; give a file in it"
    if not stat.S_ISREG(mode):
        return f"{path} is not a file but a pipe or a device; give a file"
    return f"{path} has {size / 1e6:,.0f} MB; at most {max_bytes / 1e6:,.0f} MB are allowed"
