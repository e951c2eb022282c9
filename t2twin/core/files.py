"""Writes files completely or not at all, locks folders, and reads files named by the user.

Files are written under a temporary name and then renamed. A process that writes more than one file
into a folder holds the folder's lock. Imports nothing slow: signals are handled from the start.
"""

import csv
import errno
import json
import os
import shutil
import signal
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from threading import get_ident
from typing import Any, NoReturn

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
"""Name of a folder's lock file, removed with the lock; without its process it locks nothing."""

SIGNALS = (signal.SIGINT, signal.SIGTERM)
"""Ctrl-C, and the signal of `kill`, service managers and containers."""

RESUMING = ("adapt", "demo", "simdata", "train")
"""Commands that continue an earlier call; the others start again and leave no files."""


def install_handlers() -> None:
    """Let SIGNALS end the process. Signals that the parent process ignored stay ignored."""
    for number in SIGNALS:
        if signal.getsignal(number) is not signal.SIG_IGN:
            signal.signal(number, _stop)


def _stop(number: int, _: object) -> NoReturn:
    """End the process with its temporary files; a second signal ends it at once."""
    for each in SIGNALS:
        signal.signal(each, signal.SIG_DFL)
    resumes = len(sys.argv) > 1 and sys.argv[1] in RESUMING
    effect = "continues from its last saved state" if resumes else "begins again"
    with suppress(OSError):  # standard error is closed
        os.write(2, f"t2twin: stopped; the same command {effect}\n".encode())
    raise SystemExit(128 + number)


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
        try:
            yield temporary
            temporary.replace(path)
        except OSError as error:
            raise write_error(path, error) from error
        finally:
            _remove(temporary)


def write_json(path: Path, content: Any) -> None:
    """Write content as JSON, indented by two. Raises T2TwinError where that fails."""
    with atomic_write(path) as temporary:
        temporary.write_text(json.dumps(content, indent=2) + "\n")


def write_csv(path: Path, names: Sequence[str], rows: Sequence[Sequence[Any]]) -> None:
    """Write a table to a new file in a temporary folder, numbers with six digits."""

    def cell(value: Any) -> Any:
        if isinstance(value, bool):
            return str(value).lower()
        return f"{value:.6g}" if isinstance(value, float) else value

    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file)
        writer.writerow(names)
        writer.writerows([cell(value) for value in row] for row in rows)


def move_into(folder: Path, files: Sequence[Path]) -> None:
    """Move finished files into a folder, replacing files of the same names.

    Raises T2TwinError, before any is moved, where a folder or a device has one of the names.
    """
    for file in files:
        check_replaceable(folder / file.name)
    for file in files:
        file.replace(folder / file.name)


def check_replaceable(path: Path) -> None:
    """Raises T2TwinError for a path that is no file: renaming over a device would remove it."""
    try:
        if path.exists() and not path.is_file():
            raise T2TwinError(f"{path} cannot be written: it is a folder or a device")
    except OSError as error:
        raise write_error(path, error) from error


@contextmanager
def temporary_folder(place: Path, name: str) -> Iterator[Path]:
    """A new folder in an existing one, `place`, which is removed after the block.

    Raises T2TwinError where it cannot be created.
    """
    folder = place / f".{name}.{os.getpid()}.part"
    try:
        folder.mkdir()
    except OSError as error:
        raise write_error(place, error) from error
    try:
        yield folder
    finally:
        _remove(folder)


@contextmanager
def new_folder(folder: Path) -> Iterator[Path]:
    """A temporary folder, whose content is moved into `folder` after the block.

    Raises T2TwinError where the path is a file or a folder with content, or cannot be written.
    After an error there is no new folder.
    """
    with locked(folder):
        if not is_empty(folder):
            raise T2TwinError(f"{folder} is not empty; choose another folder")
        with temporary_folder(folder, "new") as temporary:
            yield temporary
            move_into(folder, list(temporary.iterdir()))


@contextmanager
def created_folder(folder: Path) -> Iterator[None]:
    """Create a folder and its parents if they are missing; remove those that stay empty.

    Raises T2TwinError where the path is a file, or the folder cannot be created.
    """
    missing = [path for path in (folder, *folder.parents) if not os.path.lexists(path)]
    try:
        try:
            folder.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise write_error(folder, error) from error
        yield
    finally:
        for path in missing:
            with suppress(OSError):
                path.rmdir()  # fails for a folder that is not empty


@contextmanager
def locked(folder: Path) -> Iterator[None]:
    """Create a folder if it is missing, and lock it against other processes within the block.

    First removes the temporary files of processes that were killed. Removes a folder that was
    created here and is empty afterwards. Raises T2TwinError where another process holds the lock,
    the path is a file, or the folder cannot be written.
    """
    from filelock import FileLock, Timeout

    with created_folder(folder):
        lock = FileLock(folder / LOCK, blocking=False)
        try:
            lock.acquire()
        except Timeout:
            raise T2TwinError(
                f"another t2twin is writing into {folder}; wait until it is done, or choose "
                "another folder"
            ) from None
        except OSError as error:
            raise write_error(folder, error) from error
        try:
            for leftover in folder.glob(TEMPORARY_NAMES):
                _remove(leftover)
            yield
        finally:
            _remove(folder / LOCK)  # before the release: no other process can then hold it
            lock.release()


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


def write_error(path: Path, error: OSError) -> T2TwinError:
    """The exception for a file or a folder that cannot be written."""
    reason = (error.strerror or str(error) or type(error).__name__).lower()
    if error.errno in NO_SPACE:
        return T2TwinError(f"there is no room for {path} ({reason}); make room and start again")
    return T2TwinError(f"{path} cannot be written ({reason})")


def read_file(path: Path, max_bytes: int = MAX_TABLE_BYTES, otherwise: str = "") -> bytes:
    """The content of a regular file of at most `max_bytes`; reading a named pipe would block.

    otherwise: alternative to a file that does not exist, for the message. Raises T2TwinError for
    anything else, and where it cannot be read.
    """
    try:
        size = path.stat().st_size
        if not path.is_file():
            raise T2TwinError(f"{path} is a folder or a device; give a file")
        if size > max_bytes:
            found = f"{size / 1e6:,.0f} MB; at most {max_bytes / 1e6:,.0f} MB"
            raise T2TwinError(f"{path} has {found} are allowed")
        return path.read_bytes()
    except FileNotFoundError as error:
        also = f"; {otherwise}" if otherwise else ""
        raise T2TwinError(f"there is no file {path}{also}") from error
    except OSError as error:
        raise T2TwinError(f"{path} cannot be read ({error.strerror})") from error


def _remove(path: Path) -> None:
    if path.is_dir() and not path.is_symlink():
        shutil.rmtree(path, ignore_errors=True)
        return
    with suppress(OSError):
        path.unlink(missing_ok=True)
