"""Every bad input ends with one plain sentence and leaves nothing; odd ones that are fine work."""

import sys
from collections.abc import Iterator
from functools import cache

import pytest

from benchmarks import bad_inputs
from benchmarks.inputs.case import Base, Case, replaced
from benchmarks.inputs.tried import guard_connections, try_case
from t2twin.core.errors import T2TwinError

FEWEST = 1600

PART = 20
"""Cases of one test, at most: few enough that the workers end together."""


@cache
def cases_of(kind: str) -> tuple[Case, ...]:
    return tuple(bad_inputs.KINDS[kind]())


def parts() -> Iterator:
    """Every part of every kind. A part takes each n-th case, so that the first of the n parts
    samples its kind; the others are exhaustive."""
    for kind in bad_inputs.KINDS:
        count = -(-len(cases_of(kind)) // PART)
        for part in range(count):
            marks = (pytest.mark.exhaustive,) if part else ()
            yield pytest.param(kind, slice(part, None, count), id=f"{kind}-{part}", marks=marks)


@pytest.fixture(scope="session")
def base(small_dataset, trained, products) -> Base:
    from t2twin.translate.evaluation.evaluate import evaluate_both

    touch2touch, resnet18 = (
        trained(model, small_dataset, 1) for model in ("touch2touch", "resnet18")
    )
    evaluation = products.make(
        "evaluation", lambda folder: evaluate_both([touch2touch, resnet18], small_dataset, folder)
    )
    return Base(small_dataset, touch2touch, resnet18, evaluation)


@pytest.mark.parametrize("kind, part", list(parts()))
def test_no_input_surprises(kind, part, base, tmp_path):
    guard_connections()
    tried = [
        try_case(case, base, tmp_path / str(number))
        for number, case in enumerate(cases_of(kind)[part])
    ]
    unclean = [each for each in tried if each.faults]
    told = [f"{each.case.name}: {'; '.join(each.faults)}\n{each.said[-300:]}" for each in unclean]
    assert not unclean, "\n".join(told)


def test_there_are_enough_of_them():
    cases = [case for kind in bad_inputs.KINDS for case in cases_of(kind)]
    assert len(cases) >= FEWEST
    assert sum(case.fine for case in cases) >= FEWEST // 10


def _says_more(box, base):
    print("a warning of another library", file=sys.stderr)
    raise T2TwinError("it is wrong")


@pytest.mark.parametrize(
    "case, fault",
    [
        (Case("fine after all", ("shapes",)), "status 0"),
        (Case("not fine", ("press", "nothing"), fine=True), "status 2"),
        (Case("another sentence", ("press", "nothing"), says="teapot"), "does not say 'teapot'"),
        (Case("two lines", (), call=_says_more), "not one sentence but 2 lines"),
        (Case("leaves", ("press", "circle-1", "--out", "out")), "left out"),
        pytest.param(
            Case("a connection", ("simdata", "--scale", "smoke", "--scheduler", "tcp://localhost:1",
                                  "--out", "out")),
            "connected to", marks=pytest.mark.exhaustive,  # Dask tries for 20 s
        ),
    ],
)  # fmt: skip
def test_what_is_unclean_is_seen(case, fault, base, tmp_path):
    guard_connections()
    assert any(fault in each for each in try_case(case, base, tmp_path / "box").faults)


def test_a_traceback_is_seen(base, tmp_path, monkeypatch):
    def broken(*arguments, **options):
        raise KeyError("x")

    monkeypatch.setattr("t2twin.primitives_cad.catalogue.load", broken)
    tried = try_case(Case("broken", ("press", "circle-1")), base, tmp_path / "box")
    assert any("KeyError" in each for each in tried.faults)


def test_a_copy_is_replaced_and_the_base_stays(base, tmp_path):
    before = (base.data / "info.json").read_bytes()
    (tmp_path / "info.json").hardlink_to(base.data / "info.json")
    replaced(tmp_path / "info.json", "{}")
    assert (base.data / "info.json").read_bytes() == before
