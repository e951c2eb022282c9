"""Runs cases in this process: each must end as expected and leave nothing behind."""

import os
import re
import socket
import sys
import traceback
import warnings
from contextlib import chdir
from functools import cache
from pathlib import Path

import pytest
from cases import REFUSED, Base, Case
from waiting import no_hang

from t2twin.cli import main
from t2twin.core.errors import T2TwinError, T2TwinWarning

EXCEPTION = re.compile(r"\b[A-Z]\w*[a-z](?:Error|Exception|Warning)\b")
"""Names of Python's exceptions, which no message may contain."""

PROGRESS = re.compile(r"\d+%\|| \[\d\d:\d\d|compiling numerical loops|, some seconds$")
"""Part of a line that reports progress."""

LOCAL: set[int] = set()
"""Ports of this machine that cases connect to."""

connections: list[str] = []
"""Other addresses that this process looked up or connected to, without local sockets."""


def attempt(case: Case, base: Base, box: Path, capfd: pytest.CaptureFixture) -> list[str]:
    """Runs a case in the new folder box. Returns its faults, and with any what it printed."""
    box.mkdir()
    case.make(box, base)
    before, known = _listing(box), len(connections)
    capfd.readouterr()
    status, faults = _run(case, base, box)
    out, err = capfd.readouterr()
    faults += _faults_of_end(case, status, out, err)
    faults += _faults_of_folder(case, before, _listing(box))
    faults += [f"connected to {address}" for address in connections[known:]]
    return [f"{case.name}: {fault}" for fault in faults] + [(out + err)[-300:]] * bool(faults)


@cache
def record_connections() -> None:
    """Records every later host lookup and connection of this process."""

    def hook(event: str, args: tuple) -> None:
        is_connection = event == "socket.connect" and args[0].family != socket.AF_UNIX
        if event == "socket.gethostbyname":
            connections.append(str(args[0]))
        elif is_connection and args[1][1] not in LOCAL:
            connections.append(str(args[1]))
        elif event == "socket.getaddrinfo" and args[1] not in LOCAL:
            connections.append(str(args[0]))

    sys.addaudithook(hook)


def _run(case: Case, base: Base, box: Path) -> tuple[int, list[str]]:
    """Exit status and faults."""
    faults: list[str] = []
    status = 0
    with chdir(box), no_hang(), warnings.catch_warnings():
        warnings.simplefilter("always")
        warnings.filterwarnings("ignore", ".*unlike all training images", T2TwinWarning)
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
        except BaseException:  # a fault of this case must not stop the next
            faults.append("traceback: " + traceback.format_exc().strip()[-600:])
    return status, faults


def _faults_of_end(case: Case, status: int, out: str, err: str) -> list[str]:
    faults = []
    if "Traceback" in err or "Traceback" in out:
        faults.append("a traceback was printed")
    elif EXCEPTION.search(err):
        faults.append("the name of an exception was printed")
    if case.fine:
        return faults + ([f"status {status} of valid input"] if status else [])
    if status not in case.statuses:
        faults.append(f"status {status}")
    lines = [line for line in re.split(r"[\r\n]+", err) if line and not PROGRESS.search(line)]
    if lines and lines[0].startswith("╭"):  # of the parser
        return faults
    if status == 1:
        lines = [line for line in out.splitlines() if line]
    elif len(lines) != 1 or not lines[0].startswith("t2twin: "):
        faults.append(f"not one sentence but {len(lines)} lines")
    if case.says.lower() not in " ".join(lines).lower():
        faults.append(f"the sentence lacks {case.says!r}")
    return faults


def _faults_of_folder(case: Case, before: dict[str, tuple], after: dict[str, tuple]) -> list[str]:
    # Decoded images of a dataset are cached for the next command, whatever the end of this one.
    new = sorted(name for name in set(after) - set(before) if "cache" not in Path(name).parts)
    faults = [f"left {name}" for name in new if ".part" in name or ".lock" in name]
    if not case.fine:
        changed = sorted(name for name in before if after.get(name) != before[name])
        faults += [f"changed {name}" for name in changed] + [f"left {name}" for name in new]
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
