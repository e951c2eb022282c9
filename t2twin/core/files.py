"""Writes files completely or not at all, locks folders, and reads files named by the user.

Files are written under a temporary name and then renamed. A process that writes more than one file
into a folder holds the folder's lock. Imports nothing slow: signals are handled from the start.
"""

import csv
import errno
import hashlib
import json
import os
import shutil
import signal
import sys
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from threading import get_ident
from types import FrameType
from typing import Any

from t2twin.core.errors import T2TwinError

NO_SPACE = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG)  # errors of a write without enough space
TEMPORARY_NAMES = ".*.part*"  # pattern of the names of temporary files and folders
MAX_STEM_CHARACTERS = 40  # of a file's stem in its temporary name (assumed: it may have 255 bytes)
MAX_TABLE_BYTES = 100_000_000  # of tables and descriptions (assumed: 700,000 rows of 20 counts)
LOCK = ".t2twin.lock"  # in a folder, removed with the lock; without its process it locks nothing
OWN = ".t2twin.json"  # in a folder of results: the SHA-256 of files by kind of result and name
# Ctrl-C, that of `kill`, service managers and containers, and that of a closed terminal
SIGNALS = tuple(
    getattr(signal, name) for name in ("SIGINT", "SIGTERM", "SIGHUP") if hasattr(signal, name)
)  # Windows has no SIGHUP
IMPORT_WAIT_S = 0.05  # until a signal during an import is handled again (assumed)
run_inputs: list[Path] = []  # of the running command, named by the user; no result replaces them
# Commands that continue an earlier call; the others start again and leave no files
RESUMING = ("adapt", "demo", "simdata", "train")


def install_handlers() -> None:
    """Let SIGNALS end the process. Signals that the parent process ignored stay ignored."""
    for number in SIGNALS:
        if signal.getsignal(number) is not signal.SIG_IGN:
            signal.signal(number, _stop)


def _stop(number: int, frame: FrameType | None) -> None:
    """End the process with its temporary files; a second signal ends it at once."""
    for each in SIGNALS:
        signal.signal(each, signal.SIG_DFL)
    while frame is not None and "<frozen importlib" not in frame.f_code.co_filename:
        frame = frame.f_back
    if frame is not None and hasattr(signal, "setitimer"):  # which Windows has not
        # A module that is being imported may catch every exception: wait until no import runs.
        signal.signal(signal.SIGALRM, lambda _, inner: _stop(number, inner))
        signal.setitimer(signal.ITIMER_REAL, IMPORT_WAIT_S)
        return
    resumes = len(sys.argv) > 1 and sys.argv[1] in RESUMING
    effect = "continues from its last saved state, if any" if resumes else "begins again"
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


@contextmanager
def result_folder(
    folder: Path, kind: str, names: Iterable[str] = (), inputs: Iterable[Path] = ()
) -> Iterator[Path]:
    """A temporary folder, whose files replace an earlier result of a kind in `folder` at the end.

    Unchanged files of that result are removed. All others stay: what `check_own` refuses raises
    T2TwinError, before the block for known `names`, and before any file is moved for the rest.
    """
    inputs = [*inputs, *run_inputs]
    with locked(folder), temporary_folder(folder, "result") as temporary:
        check_own(folder, names, kind, inputs)
        yield temporary
        paths = {
            path.relative_to(temporary).as_posix(): path
            for path in sorted(temporary.rglob("*"))
            if path.is_file()
        }
        earlier = check_own(folder, paths, kind, inputs)
        new = {name: [sha256_of(path)] for name, path in paths.items()}
        # Both during the moves, so that a killed process leaves no file unknown.
        record_own(folder, kind, {n: new.get(n, []) + earlier.get(n, []) for n in new | earlier})
        for name, path in paths.items():
            with created_folder((folder / name).parent):
                path.replace(folder / name)
        known = _identities(inputs)
        for name in earlier.keys() - new.keys():
            path = folder / name
            is_unchanged = path.is_file() and sha256_of(path) in earlier[name]
            if is_unchanged and not _identities([path]) & known:
                _remove(path)
                with suppress(OSError):
                    path.parent.rmdir()  # fails for a folder that is not empty
        record_own(folder, kind, new)


def check_own(
    folder: Path, names: Iterable[str], kind: str = "", inputs: Iterable[Path] = (),
    force: bool = False,
) -> dict[str, list[str]]:  # fmt: skip
    """The SHA-256 of the files of an earlier result in a folder, of the kind, by name.

    The one place that decides which files a command may replace: those of that result that nobody
    changed since, and others only with `force`. Raises T2TwinError for any other file of one of the
    `names`, for a folder or a device, and for a file of `inputs` or `run_inputs`.
    """
    earlier, known = _records(folder).get(kind, {}), _identities([*inputs, *run_inputs])
    for name in names:
        path = folder / name
        if not os.path.lexists(path):
            continue
        check_replaceable(path)
        if _identities([path]) & known:
            raise T2TwinError(f"{path} is an input and would be replaced; choose another place")
        is_own = path.is_file() and sha256_of(path) in earlier.get(name, ())
        if not force and not is_own:
            way = "name another file, or replace it with --force"
            if kind:
                way = f"it is not an unchanged file of an earlier {kind}; choose another place"
            raise T2TwinError(f"{path} exists; {way}")
    return earlier


def record_own(folder: Path, kind: str, digests: dict[str, list[str]]) -> None:
    """Record the SHA-256 of the files of a result, by name, for `check_own`."""
    records = {n: each for n, each in (_records(folder) | {kind: digests}).items() if each}
    write_json(folder / OWN, records) if records else _remove(folder / OWN)


def _records(folder: Path) -> dict[str, dict[str, list[str]]]:
    """The content of OWN; empty for a damaged file."""
    try:
        found = json.loads((folder / OWN).read_text(encoding="utf-8"))
        return {kind: {name: [*each] for name, each in of.items()} for kind, of in found.items()}
    except (OSError, ValueError, AttributeError, TypeError):
        return {}


def _identities(paths: Iterable[Path]) -> set[tuple[int, int]]:
    """Device and number of each file that exists, equal for all of its names."""
    found = set()
    for path in paths:
        with suppress(OSError):
            status = path.stat()
            found.add((status.st_dev, status.st_ino))
    return found


def sha256_of(path: Path) -> str:
    """A file's SHA-256 in hexadecimal digits."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


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
    except OSError as error:
        if error.errno in NO_SPACE:
            raise write_error(place, error) from error
        raise
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
    """Whether a folder contains nothing but a lock, a record of results and temporary files."""
    return all(path.name in (LOCK, OWN) or path.match(TEMPORARY_NAMES) for path in folder.iterdir())


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
