"""A bad input gives a message and leaves nothing behind; an odd but valid input is accepted."""

import os
import socket
import sys
import traceback
import warnings
from collections.abc import Iterator
from contextlib import chdir
from functools import cache
from importlib import import_module
from pathlib import Path

import pytest
from cases import Base, Case
from waiting import no_hang

from t2twin.cli import main
from t2twin.core.errors import T2TwinWarning

KINDS = {"command_lines.cases": 8, "readers.cases": 12, "readers.places": 3}
"""Modules and functions that give cases, imported by their tests, and the number of these tests."""

connections: list[str] = []
"""Addresses that this process connected to."""


@cache
def cases_of(kind: str) -> tuple[Case, ...]:
    module, _, function = kind.partition(".")
    return tuple(getattr(import_module(module), function)())


def parts() -> Iterator:
    """A part has each n-th case of a kind; all parts but the first are exhaustive."""
    for kind, count in KINDS.items():
        for part in range(count):
            marks = (pytest.mark.exhaustive,) if part else ()
            yield pytest.param(kind, slice(part, None, count), id=f"{kind}-{part}", marks=marks)


@pytest.fixture(scope="session")
def base(small_dataset, trained, products) -> Base:
    from t2twin.translate.evaluation.evaluate import evaluate_splits

    runs = touch2touch, resnet18 = [
        trained(model, small_dataset, 1) for model in ("touch2touch", "resnet18")
    ]
    evaluation = products.make(
        "evaluation", lambda to: evaluate_splits(runs, small_dataset, "both", to)
    )
    return Base(small_dataset, touch2touch, resnet18, evaluation)


@cache
def record_connections() -> None:
    """Records every later connection of this process, without local sockets."""

    def hook(event: str, args: tuple) -> None:
        if event == "socket.connect" and args[0].family != socket.AF_UNIX:
            connections.append(str(args[1]))

    sys.addaudithook(hook)


@pytest.mark.parametrize("kind, part", list(parts()))
def test_bad_inputs_are_refused_and_odd_ones_accepted(kind, part, base, tmp_path, capfd):
    record_connections()
    faults: list[str] = []
    for number, case in enumerate(cases_of(kind)[part]):
        box = tmp_path / str(number)
        box.mkdir()
        case.make(box, base)
        before, known = listing(box), len(connections)
        capfd.readouterr()
        status = run(case, base, box)
        out, err = capfd.readouterr()
        faults += [f"{case.name}: {each}: {(out + err)[-400:]}" for each in faults_of(
            case, status, out, err, before, listing(box), connections[known:])]  # fmt: skip
    assert not faults, "\n".join(faults)


def run(case: Case, base: Base, box: Path) -> int | str:
    """The exit status, or the traceback of an exception."""
    with chdir(box), no_hang(), warnings.catch_warnings():
        warnings.simplefilter("always")
        warnings.filterwarnings("ignore", ".*unlike all training images", T2TwinWarning)
        try:
            main(case.words(base))
        except SystemExit as stop:
            return int(stop.code or 0)
        except BaseException:  # a fault of this case must not stop the next
            return traceback.format_exc()[-600:]
    return 0


def faults_of(case, status, out, err, before, after, connected) -> Iterator[str]:
    if case.fine:
        if status != 0:
            yield f"status {status} of valid input"
    elif status not in (1, 2):
        yield f"status {status} of invalid input"
    elif case.says.lower() not in " ".join((out + err).split()).lower():
        yield f"the message lacks {case.says!r}"
    if "Traceback" in out + err:
        yield "a traceback was printed"
    # Decoded images of a dataset are cached for the next command, whatever the end of this one.
    new = [name for name in after.keys() - before.keys() if "cache" not in Path(name).parts]
    changed = [name for name in before if after.get(name) != before[name]]
    left = [name for name in new if ".part" in name or ".lock" in name]
    if found := left if case.fine else new + changed:
        yield f"left or changed {found}"
    if connected and "127.0.0.1" not in case.command:
        yield f"connected to {connected}"


def listing(box: Path) -> dict[str, tuple]:
    """Every file and folder below the box, with size and time of change."""
    found = {}
    for path in sorted(box.rglob("*")):
        about = path.lstat()
        is_folder = path.is_dir() and not path.is_symlink()
        name = os.fsencode(path.relative_to(box)).decode(errors="backslashreplace")
        found[name] = () if is_folder else (about.st_size, about.st_mtime_ns)
    return found
