"""Benchmarks: declared once, run in one way, kept with their provenance."""

import ast
import json
from dataclasses import replace

import pytest

from benchmarks import ROOT
from benchmarks import __main__ as command
from benchmarks.declared import BENCHMARKS, PHI, REGRESSION
from benchmarks.evidence import record, run
from benchmarks.evidence.provenance import processor, versions
from benchmarks.evidence.record import Argument, Benchmark, Figure
from benchmarks.evidence.results import read_results
from benchmarks.evidence.sources import SourceTree
from benchmarks.evidence.values import value, values
from t2twin.core.errors import T2TwinError


@pytest.fixture
def results(tmp_path, monkeypatch):
    """A results folder of its own."""
    folder = tmp_path / "results"
    monkeypatch.setattr(record, "RESULTS", folder)
    return folder


# Results files as they are


@pytest.mark.parametrize("path", sorted(record.RESULTS.glob("*.json")), ids=lambda path: path.stem)
def test_every_results_file_is_a_benchmark_s_and_has_provenance(path):
    assert path.stem in {benchmark.name for benchmark in BENCHMARKS}
    measured_on = read_results(path).measured_on
    assert len(measured_on.commit.rstrip("+")) == 12
    assert measured_on.date and f"benchmarks.{path.stem}" in measured_on.command


@pytest.mark.parametrize("benchmark", BENCHMARKS, ids=lambda benchmark: benchmark.name)
def test_every_figure_is_in_the_results(benchmark):
    if benchmark.results.is_file() and not benchmark.baseline:
        assert run.figures(benchmark, read_results(benchmark.results).content)


# Values


def test_values_are_found_by_their_paths():
    content = {"a": {"x": {"n": 1}, "y": {"n": [2, 3]}}, "none": None}
    assert value(content, "a.y.n.1") == 3
    assert values(content, "a.*.n") == {"a.x.n": 1, "a.y.n": [2, 3]}
    assert values(content, "none.n") == {}
    with pytest.raises(T2TwinError, match=r"nothing at a\.z"):
        values(content, "a.z.n")


# Running


SMALL = Benchmark(
    name="small",
    measures="Nothing.",
    minutes=0.0,
    figures=(Figure("time_ms", "ms", most=2.0), Figure("rows.*.ratio", least=1.5)),
    arguments=(Argument("--rows", "how many", int, 2, thins=True),),
)


def measured_as(monkeypatch, time_ms, ratio):
    content = {"time_ms": time_ms, "rows": {"a": {"ratio": 3.0}, "b": {"ratio": ratio}}}
    monkeypatch.setattr(Benchmark, "measure", lambda self, options: content)
    monkeypatch.setattr(SourceTree, "modules_of", lambda self, benchmark: {PHI.module})
    return content


def test_figures_are_printed_in_columns(results, monkeypatch, capsys):
    measured_as(monkeypatch, 1.25, 2.0)
    assert run.run(SMALL, []) == []
    lines = capsys.readouterr().out.splitlines()
    assert lines == [
        "small",
        "name          value     limit",
        "time_ms        1.25 ms  at most 2",
        "rows.a.ratio      3     at least 1.5",
        "rows.b.ratio      2     at least 1.5",
    ]


def test_results_are_written_with_their_provenance(results, monkeypatch):
    content = measured_as(monkeypatch, 1.0, 2.0)
    run.run(SMALL, [])
    kept = read_results(results / "small.json")
    assert kept.content == content
    origin = kept.measured_on
    assert origin.command == "python -m benchmarks.small"
    assert origin.versions == versions() and {"python", "numpy", "torch"} <= set(origin.versions)
    assert origin.processor == processor() and origin.cores and origin.load_average is not None
    assert origin.sources and PHI.module in origin.sources
    assert "t2twin.primitives_cad.primitive_parameters" in (origin.shapes or {})


@pytest.mark.parametrize("arguments", [["--rows", "1"], ["--keep-nothing"]])
def test_a_part_of_a_measurement_is_not_kept(results, monkeypatch, arguments):
    measured_as(monkeypatch, 1.0, 2.0)
    run.run(SMALL, arguments)
    assert not (results / "small.json").exists()


@pytest.mark.parametrize(
    "time_ms, ratio, sentence",
    [
        (2.5, 2.0, "small: time_ms is 2.5, at most 2"),
        (1.0, 1.2, "small: rows.b.ratio is 1.2, at least 1.5"),
        (float("nan"), 2.0, "small: time_ms is nan, at most 2"),
        (None, 2.0, "small: time_ms is none, at most 2"),
    ],
)
def test_a_missed_limit_fails(results, monkeypatch, time_ms, ratio, sentence):
    measured_as(monkeypatch, time_ms, ratio)
    assert run.run(SMALL, ["--keep-nothing"]) == [sentence]
    monkeypatch.setattr("sys.argv", ["small", "--keep-nothing"])
    with pytest.raises(SystemExit, match=sentence):
        run.main(SMALL)


def test_a_baseline_is_written_only_when_asked(results, monkeypatch):
    measured_as(monkeypatch, 1.0, 2.0)
    baseline = replace(SMALL, baseline=True)
    run.run(baseline, [])
    assert not (results / "small.json").exists()
    run.run(baseline, ["--write"])
    assert (results / "small.json").exists()


def test_a_benchmark_that_raises_does_not_stop_the_others(monkeypatch, capfd):
    called = []

    def call(arguments, check):
        called.append(arguments[-1])
        return type("Done", (), {"returncode": int(arguments[-1] == "benchmarks.press")})

    monkeypatch.setattr(run.subprocess, "run", call)
    with pytest.raises(SystemExit, match=r"failed or over a limit: press$"):
        command.main([])
    assert called == [b.module for b in BENCHMARKS if not b.needs_arguments]
    assert {"benchmarks.press", "benchmarks.kills", "benchmarks.gain"} <= set(called)
    assert not {"benchmarks.translation", "benchmarks.probes"} & set(called)


def test_a_benchmark_is_run_as_its_module(monkeypatch):
    measured_as(monkeypatch, 1.0, 2.0)
    for benchmark in BENCHMARKS:
        text = (ROOT / "benchmarks" / f"{benchmark.name}.py").read_text()
        assert f"    main({benchmark.name.upper()})\n" in text
        defined = {node.name for node in ast.parse(text).body if isinstance(node, ast.FunctionDef)}
        assert "measure" in defined
        assert ("outcome" in defined) == benchmark.confirmable


@pytest.mark.parametrize(
    "arguments, sentence",
    [
        (["nothing"], "no benchmark 'nothing'; there are press, dome"),
        (["translation"], "translation needs arguments"),
        (["--confirm", "latency"], "latency cannot be confirmed"),
    ],
)
def test_what_cannot_be_run_is_refused(arguments, sentence):
    with pytest.raises(SystemExit, match=sentence):
        command.main(arguments)


def test_the_list_names_every_benchmark(capsys):
    command.main(["--list"])
    said = capsys.readouterr().out
    assert all(benchmark.measures in said for benchmark in BENCHMARKS)
    assert "--report DIR" in said


def test_the_baseline_s_figures_are_the_committed_ones():
    content = json.loads(REGRESSION.results.read_text())
    assert content["rmse_percent"]["val"] == {
        "mean-array": 6.692,
        "nearest-neighbour": 2.84,
        "noise-floor": 0.013,
        "touch2touch": 2.531,
        "resnet18": 2.527,
    }
