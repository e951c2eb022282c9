"""Results that are older than what they measure are named; what still holds is confirmed."""

import shutil
from dataclasses import replace

import pytest

from benchmarks import ROOT
from benchmarks import __main__ as command
from benchmarks.declared import BENCHMARKS, DATASET, PHI, PRESS, TRANSLATION
from benchmarks.evidence import record, stale
from benchmarks.evidence.confirm import confirm, differences
from benchmarks.evidence.provenance import Provenance
from benchmarks.evidence.record import Benchmark
from benchmarks.evidence.results import Results, read_results, write_results
from benchmarks.evidence.small_case import rounded
from benchmarks.evidence.sources import SourceTree
from t2twin.core.errors import T2TwinError

SOURCES = ("benchmarks", "primitives_cad", "sim", "translate", "t2twin")
"""Folders of a copy in which code is changed."""


@pytest.fixture(scope="module")
def shared_copy(tmp_path_factory):
    """A copy of the sources, and what every benchmark depends on there."""
    root = tmp_path_factory.mktemp("copy")
    for name in SOURCES:
        ignore = shutil.ignore_patterns("__pycache__", "results")
        shutil.copytree(ROOT / name, root / name, symlinks=True, ignore=ignore)
    tree = SourceTree(root)
    return root, {benchmark.name: tree.sources_of(benchmark) for benchmark in BENCHMARKS}


@pytest.fixture
def copy(shared_copy, results):
    """The copy, on which all benchmarks have been measured."""
    root, sources = shared_copy
    for benchmark in BENCHMARKS:
        write_results(benchmark.results, measured(sources[benchmark.name]))
    return root


@pytest.fixture
def edit(copy):
    """Changes a file of the copy, until the end of the test."""
    before = {}

    def change(name, old, new):
        path = copy / name
        before.setdefault(path, path.read_bytes())
        assert old in path.read_text()
        path.write_text(path.read_text().replace(old, new, 1))

    yield change
    for path, content in before.items():
        path.write_bytes(content)


@pytest.fixture
def results(tmp_path, monkeypatch):
    """A results folder of its own."""
    folder = tmp_path / "results"
    monkeypatch.setattr(record, "RESULTS", folder)
    return folder


def measured(sources):
    """Results that were measured on these sources."""
    origin = Provenance("0" * 12, "2026-01-01", "python", {}, None, None, None)
    origin = replace(origin, sources=sources.code, shapes=sources.shapes, outcome={"a": 1.0})
    return Results(origin, {"figure": 1.0})


def stale_by_name(root):
    tree = SourceTree(root)
    reasons = {benchmark.name: stale.staleness(benchmark, tree) for benchmark in BENCHMARKS}
    return {name: words for name, words in reasons.items() if words}


def test_nothing_is_stale_right_after_the_measurement(copy):
    assert stale_by_name(copy) == {}


def test_a_changed_constant_of_the_shapes_makes_stale_what_presses_them(copy, edit):
    edit("primitives_cad/primitive_parameters.py", '{"side": 5.6}', '{"side": 5.7}')
    reasons = stale_by_name(copy)
    assert set(reasons) == {b.name for b in BENCHMARKS if b.shapes and not b.baseline}
    assert {"press", "dome", "dataset", "translation", "probes", "gain"} <= set(reasons)
    assert not {"phi", "latency", "training", "kills", "regression"} & set(reasons)
    said = ["the shapes' parameters (t2twin.primitives_cad.primitive_parameters)"]
    assert all(words == said for words in reasons.values())


@pytest.mark.exhaustive
def test_a_changed_tool_is_a_changed_shape(copy, edit):
    edit("primitives_cad/tools/wrench.py", "_MM = ", "_MM = 1e-9 + ")
    assert "primitives_cad.tools.wrench" in stale_by_name(copy)["press"][0]


def test_comments_docstrings_and_formatting_make_nothing_stale(copy, edit):
    families = "primitives_cad/primitive_parameters.py"
    edit(families, '"""Side of a primitive', '"""Length of a primitive')
    edit(families, "PLATE_SIDE_MM = 46.0", "# new\nPLATE_SIDE_MM = (\n    46.0\n)")
    edit(families, '"""Family of a primitive', '"""The family of a primitive')
    assert stale_by_name(copy) == {}


def test_changed_code_makes_stale_what_measures_it_and_is_named(copy, edit):
    edit("sim/cyskin/phi.py", "import numpy as np", "import numpy as np\n\nNEW = 1")
    reasons = stale_by_name(copy)
    assert reasons["phi"] == ["t2twin.sim.cyskin.phi"]
    assert reasons["translation"] == ["t2twin.sim.cyskin.phi"]
    assert not {"press", "dome", "digit_render"} & set(reasons)


@pytest.mark.exhaustive
def test_a_benchmark_s_own_code_its_references_and_the_calibration_count(copy, edit):
    edit("benchmarks/oracle.py", "ALIASES = 4", "ALIASES = 5")
    assert stale_by_name(copy) == {"press": ["benchmarks.oracle"]}
    calibration = copy / "sim" / "digit" / "default_calibration.npz"
    content = calibration.read_bytes()
    calibration.write_bytes(b"")
    reasons = stale_by_name(copy)
    calibration.write_bytes(content)
    assert reasons["digit_render"] == ["t2twin/sim/digit/default_calibration.npz"]


def test_moved_code_is_named_as_new_and_gone():
    before, now = {"a": "1", "b": "2", "c": "3"}, {"a": "1", "b": "9", "d": "3"}
    assert stale.changes(before, now) == ["b", "c (gone)", "d (new)"]


def test_stale_results_are_named_with_status_one(results, capsys):
    write_results(PHI.results, measured(SourceTree().sources_of(PHI)))
    command.main(["--stale", "phi"])
    assert capsys.readouterr().out == "phi           up to date\n"
    PHI.results.unlink()
    with pytest.raises(SystemExit, match=r"^stale: phi$"):
        command.main(["--stale", "phi"])
    assert "never measured" in capsys.readouterr().out


def test_imports_inside_functions_are_followed_and_those_for_types_are_not():
    modules = SourceTree().modules_of(PRESS)
    assert "t2twin.primitives_cad.mesh_io.read" in modules
    assert "t2twin.sim.contact.mujoco_pins" in modules
    assert not any(name.startswith("t2twin.report") for name in modules)
    assert "t2twin.translate.training.train" in SourceTree().modules_of(TRANSLATION)
    assert "t2twin.report.dataset.forces" not in SourceTree().modules_of(DATASET)


# Confirming


@pytest.fixture
def outcome(edit, monkeypatch):
    """What the code gives since it was changed; the same as before unless a test changes it."""
    edit("sim/contact/elastomer.py", "import numpy as np", "import numpy as np\n\nNEW = 1")
    content = {"a": 1.0}
    monkeypatch.setattr(Benchmark, "outcome", lambda self, case: content)
    return content


@pytest.mark.exhaustive
def test_the_same_outcome_confirms_results(outcome, copy):
    before = read_results(DATASET.results)
    assert "elastomer" in stale_by_name(copy)["dataset"][0]
    said = confirm(DATASET, case=None, tree=SourceTree(copy))  # pyright: ignore[reportArgumentType]
    assert "times are of then: run, rates" in said
    after = read_results(DATASET.results)
    assert "dataset" not in stale_by_name(copy)
    assert after.content == before.content
    assert after.measured_on.commit == before.measured_on.commit
    assert after.measured_on.date == before.measured_on.date
    assert after.measured_on.confirmed is not None


def test_another_outcome_does_not(outcome, copy):
    outcome["a"] = 1.1
    before = DATASET.results.read_bytes()
    with pytest.raises(T2TwinError, match="a differ; measure it anew"):
        confirm(DATASET, case=None, tree=SourceTree(copy))  # pyright: ignore[reportArgumentType]
    assert DATASET.results.read_bytes() == before


def test_results_without_an_outcome_cannot_be_confirmed(outcome, copy):
    results = read_results(DATASET.results)
    without = replace(results.measured_on, outcome=None)
    write_results(DATASET.results, Results(without, results.content))
    with pytest.raises(T2TwinError, match="kept no outcome"):
        confirm(DATASET, case=None, tree=SourceTree(copy))  # pyright: ignore[reportArgumentType]


def test_differences_are_named_by_their_paths():
    assert differences({"a": {"b": 1, "c": 2}}, {"a": {"b": 1, "c": 3}, "d": 4}) == ["a.c", "d"]
    assert rounded({"x": [1.23456789, 1]}) == {"x": [1.23457, 1]}
