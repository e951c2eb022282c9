"""A bad input gives one sentence and leaves nothing behind; an odd but valid input is accepted."""

import subprocess
import sys
from collections.abc import Iterator
from functools import cache
from importlib import import_module

import pytest
from attempt import attempt, record_connections
from cases import REFUSED, Base, Case

from t2twin.core.errors import T2TwinError

KINDS = {"command_lines.refused": 1, "command_lines.cases": 10, "pictures.cases": 3,
         "readers.cases": 20, "solids.cases": 3, "places.cases": 4}  # fmt: skip
"""Modules and functions that give cases, imported by their tests, and the number of these tests:
about 20 cases each, so that the workers end at about the same time, but for the quickest."""

MAX_MEMORY_GIB = 1.0
"""Memory in which `t2twin translate` must refuse eight images of 1.4 GB (assumed)."""


@cache
def cases_of(kind: str) -> tuple[Case, ...]:
    module, _, function = kind.partition(".")
    return tuple(getattr(import_module(module), function)())


def parts() -> Iterator:
    """Every part of every kind. A part has each n-th case, so that the first of n parts samples
    its kind; the others are exhaustive."""
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


@pytest.mark.parametrize("kind, part", list(parts()))
def test_bad_inputs_are_refused_and_odd_ones_accepted(kind, part, base, tmp_path, capfd):
    record_connections()
    faults: list[str] = []
    for number, case in enumerate(cases_of(kind)[part]):
        faults += attempt(case, base, tmp_path / str(number), capfd)
    assert not faults, "\n".join(faults)


def _warn(box, base):
    print("a warning of another library", file=sys.stderr)
    raise T2TwinError("it is wrong")


@pytest.mark.parametrize(
    "case, fault",
    [
        (Case("valid", "shapes"), "status 0"),
        (Case("invalid", "press nothing", fine=True), "status 2"),
        (Case("another sentence", "press nothing", says="teapot"), "lacks 'teapot'"),
        (Case("two lines", call=_warn), "not one sentence but 2 lines"),
        (Case("leaves a folder", "press circle-1 --out out"), "left out"),
        (Case("a traceback", call=lambda box, base: {}["x"]), "KeyError"),
        pytest.param(
            Case("a connection", "simdata --scale smoke --scheduler tcp://localhost:1 --out out"),
            "connected to", marks=pytest.mark.exhaustive,  # Dask tries for 20 s
        ),
    ],
)  # fmt: skip
def test_a_fault_is_found(case, fault, base, tmp_path, capfd):
    record_connections()
    assert any(fault in each for each in attempt(case, base, tmp_path / "box", capfd))


@pytest.mark.exhaustive
def test_large_images_are_refused_without_decoding_them(base, tmp_path):
    from pictures import bomb

    (tmp_path / "bombs").mkdir()
    for number in range(8):
        (tmp_path / f"bombs/{number}.png").write_bytes(bomb())
    limit = int(MAX_MEMORY_GIB * 2**30)
    code = (
        "import resource, subprocess, sys; code = subprocess.run(sys.argv[1:]).returncode;"
        "print(code, resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss)"
    )
    words = ("translate", "--run", base.resnet18, "bombs", "--out", "none")
    done = subprocess.run(
        [sys.executable, "-c", code, sys.executable, "-m", "t2twin", *map(str, words)],
        capture_output=True, text=True, check=True,
    )  # fmt: skip
    status, kibibytes = map(int, done.stdout.split())
    assert status == REFUSED and kibibytes * 1024 < limit
