"""Trying cases, one after another in this process: each must end well, and leave nothing behind."""

import io
import os
import re
import signal
import socket
import sys
import tempfile
import time
import traceback
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cache
from pathlib import Path

from benchmarks.inputs.case import REFUSED, Base, Case
from t2twin.cli import main
from t2twin.core.errors import T2TwinError

PATIENCE_SECONDS = 120
"""Longest that a case may take, s; longer is a hang. Other processes may share the cores."""

CLASS_NAME = re.compile(r"\b[A-Z]\w*[a-z](?:Error|Exception|Warning)\b")
"""Names of Python's exceptions, which are no words for a user."""

PROGRESS = re.compile(r"\d+%\|| \[\d\d:\d\d")
"""What a progress bar's line holds."""

connections: list[str] = []
"""Addresses that anything in this process looked up or connected to, besides local sockets."""


class _HangError(BaseException):
    """A case ran out of time."""


@dataclass(frozen=True)
class Tried:
    """How a case ended. faults: what was not well, none where it is clean."""

    case: Case
    seconds: float
    status: int
    said: str
    faults: tuple[str, ...]


def try_case(case: Case, base: Base, box: Path) -> Tried:
    """Runs a case in its own new folder."""
    box.mkdir()
    case.make(box, base)
    before, known = _listing(box), len(connections)
    start = time.monotonic()
    status, out, err, faults = _run(case, base, box)
    seconds = time.monotonic() - start
    faults += _of_end(case, status, out, err)
    faults += _of_folder(case, before, _listing(box))
    faults += [f"connected to {address}" for address in connections[known:]]
    return Tried(case, seconds, status, (out + err)[-2000:], tuple(faults))


@cache
def guard_connections() -> None:
    """From here on every look-up of a host and every connection to one is written down."""

    def hook(event: str, args: tuple) -> None:
        if event == "socket.getaddrinfo" or event == "socket.gethostbyname":
            connections.append(str(args[0]))
        elif event == "socket.connect" and args[0].family != socket.AF_UNIX:
            connections.append(str(args[1]))

    sys.addaudithook(hook)


def _run(case: Case, base: Base, box: Path) -> tuple[int, str, str, list[str]]:
    """Exit status, standard output, standard error, and what was not well."""
    faults: list[str] = []
    status = 0
    with _inside(box), _captured() as texts, _time_limit(), warnings.catch_warnings():
        warnings.simplefilter("always")
        try:
            if case.call is None:
                main(case.words(base))
            else:
                case.call(box, base)
        except T2TwinError as error:
            print(f"t2twin: {error}", file=sys.stderr)
            status = REFUSED
        except SystemExit as stop:
            status = stop.code if isinstance(stop.code, int) else int(stop.code is not None)
        except _HangError:
            faults.append(f"took more than {PATIENCE_SECONDS} s")
        except BaseException:  # whatever got out, the next case is tried
            faults.append("traceback: " + traceback.format_exc().strip()[-600:])
    return status, texts[0], texts[1], faults


def _of_end(case: Case, status: int, out: str, err: str) -> list[str]:
    faults = []
    if "Traceback" in err or "Traceback" in out:
        faults.append("a traceback was printed")
    elif CLASS_NAME.search(err):
        faults.append("the name of an exception was printed")
    if case.fine:
        return faults + ([f"status {status} though it is fine"] if status else [])
    if status not in case.statuses:
        faults.append(f"status {status}")
    lines = [line for line in re.split(r"[\r\n]+", err) if line and not PROGRESS.search(line)]
    if status == 1:
        lines = [line for line in out.splitlines() if line]
    elif len(lines) != 1 or not lines[0].startswith("t2twin: "):
        faults.append(f"not one sentence but {len(lines)} lines")
    if case.says.lower() not in " ".join(lines).lower():
        faults.append(f"does not say {case.says!r}")
    return faults


def _of_folder(case: Case, before: dict[str, tuple], after: dict[str, tuple]) -> list[str]:
    changed = sorted(name for name in before if after.get(name) != before[name])
    # A dataset's decoded pictures are kept for the next command, whatever comes of this one.
    new = sorted(name for name in set(after) - set(before) if "cache" not in Path(name).parts)
    faults = [f"changed {name}" for name in changed if not case.fine]
    if not case.fine:
        faults += [f"left {name}" for name in new]
    faults += [f"left {name}" for name in new if ".part" in name or ".lock" in name]
    return faults


def _listing(box: Path) -> dict[str, tuple]:
    """Every file and folder below the box, with size and time of change."""
    listing = {}
    for path in sorted(box.rglob("*")):
        about = path.lstat()
        is_folder = path.is_dir() and not path.is_symlink()
        listing[os.fsencode(path.relative_to(box)).decode(errors="backslashreplace")] = (
            () if is_folder else (about.st_size, about.st_mtime_ns)
        )
    return listing


@contextmanager
def _inside(box: Path) -> Iterator[None]:
    before = Path.cwd()
    os.chdir(box)
    try:
        yield
    finally:
        os.chdir(before)


@contextmanager
def _captured() -> Iterator[list[str]]:
    """What is printed within the block, by Python or by a library's C code: two texts."""
    texts = ["", ""]
    own = sys.stdout, sys.stderr
    for stream in own:
        stream.flush()
    with tempfile.TemporaryFile() as out, tempfile.TemporaryFile() as err:
        kept = [os.dup(1), os.dup(2)]
        os.dup2(out.fileno(), 1)
        os.dup2(err.fileno(), 2)
        sys.stdout, sys.stderr = (
            io.TextIOWrapper(io.FileIO(fd, "w", closefd=False), write_through=True,
                             errors="backslashreplace")
            for fd in (1, 2)
        )  # fmt: skip
        try:
            yield texts
        finally:
            sys.stdout, sys.stderr = own
            for number, (file, old) in enumerate(zip((out, err), kept, strict=True), start=1):
                os.dup2(old, number)
                os.close(old)
                file.seek(0)
                texts[number - 1] = file.read().decode(errors="backslashreplace")


@contextmanager
def _time_limit() -> Iterator[None]:
    def hang(number: int, frame: object) -> None:
        raise _HangError

    before = signal.signal(signal.SIGALRM, hang)
    signal.alarm(PATIENCE_SECONDS)
    try:
        yield
    finally:
        signal.alarm(0)
        signal.signal(signal.SIGALRM, before)
