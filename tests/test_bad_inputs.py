"""Every bad input ends with one plain sentence and leaves nothing; odd ones that are fine work."""

import pytest

from benchmarks import bad_inputs
from benchmarks.inputs.case import Case, replaced
from benchmarks.inputs.tried import try_case

FEWEST = 700


@pytest.fixture(scope="module")
def base(tmp_path_factory):
    return bad_inputs.make_base(tmp_path_factory.mktemp("base"))


@pytest.mark.parametrize("kind", bad_inputs.KINDS)
def test_no_input_surprises(kind, base, tmp_path):
    unclean = [each for each in bad_inputs.try_kind(kind, base, tmp_path) if each.faults]
    told = [f"{each.case.name}: {'; '.join(each.faults)}\n{each.said[-300:]}" for each in unclean]
    assert not unclean, "\n".join(told)


def test_there_are_enough_of_them():
    cases = [case for kind in bad_inputs.KINDS.values() for case in kind()]
    assert len(cases) >= FEWEST
    assert sum(case.fine for case in cases) >= FEWEST // 10


@pytest.mark.parametrize(
    "case, fault",
    [
        (Case("fine after all", ("shapes",)), "status 0"),
        (Case("not fine", ("press", "nothing"), fine=True), "status 2"),
        (Case("another sentence", ("press", "nothing"), says="teapot"), "does not say 'teapot'"),
        (Case("not refused by the parser", ("shapes", "--x")), "not one sentence"),
        (Case("leaves", ("press", "circle-1", "--out", "out")), "left out"),
        (Case("a connection", ("simdata", "--scale", "smoke", "--scheduler", "tcp://localhost:1",
                               "--out", "out")), "connected to"),
    ],
)  # fmt: skip
def test_what_is_unclean_is_seen(case, fault, base, tmp_path):
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
