"""Benchmarks: declared by their modules, run by one runner, results with provenance."""

import ast
import subprocess
import sys
from dataclasses import replace

import pytest

from benchmarks import ROOT, evidence
from benchmarks import __main__ as command
from benchmarks.evidence import (
    Argument,
    Benchmark,
    Figure,
    find_benchmarks,
    processor,
    read_results,
    run,
    value,
    values,
    versions,
)
from t2twin.core.errors import T2TwinError

BENCHMARKS = find_benchmarks()


@pytest.fixture
def results(tmp_path, monkeypatch):
    """An empty results folder in the place of the repository's."""
    folder = tmp_path / "results"
    monkeypatch.setattr(evidence, "RESULTS", folder)
    return folder


# Declarations and results files


@pytest.mark.parametrize(
    "path", sorted(evidence.RESULTS.glob("*.json")), ids=lambda path: path.stem
)
def test_a_results_file_belongs_to_a_benchmark_and_has_provenance(path):
    assert path.stem in BENCHMARKS
    measured_on = read_results(path).measured_on
    assert len(measured_on.commit.rstrip("+")) == 12
    assert measured_on.date and f".{path.stem}" in measured_on.command


@pytest.mark.parametrize("benchmark", BENCHMARKS.values(), ids=lambda benchmark: benchmark.name)
def test_every_figure_is_in_the_results(benchmark):
    if benchmark.results.is_file() and not benchmark.is_baseline:
        assert benchmark.values(read_results(benchmark.results).content)


@pytest.mark.parametrize("benchmark", BENCHMARKS.values(), ids=lambda benchmark: benchmark.name)
def test_a_module_declares_a_benchmark_of_its_own_name(benchmark):
    path = ROOT / f"{benchmark.module.replace('.', '/')}.py"
    text = path.read_text()
    assert "    main(BENCHMARK)\n" in text
    assert any(isinstance(n, ast.FunctionDef) and n.name == "measure" for n in ast.parse(text).body)
    assert benchmark.sources
    for source in benchmark.sources:
        path = ROOT / source
        is_module = path.is_file() and path.suffix == ".py"
        assert (path.is_dir() or is_module) and not path.is_symlink()


def test_listing_the_benchmarks_imports_no_heavy_package():
    code = (
        "import sys; from benchmarks.evidence import find_benchmarks; find_benchmarks();"
        "print(sorted({'torch', 'cadquery', 'viser', 'matplotlib.figure'} & set(sys.modules)))"
    )
    done = subprocess.run(
        [sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, check=True
    )
    assert done.stdout == "[]\n"


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
    module="benchmarks.small",
    measures="Nothing.",
    minutes=0.0,
    figures=(Figure("time_ms", "ms", most=2.0), Figure("rows.*.ratio", least=1.5)),
    arguments=(Argument("--rows", "how many", int, 2, partial=True),),
)


def measured_as(monkeypatch, time_ms, ratio):
    content = {"time_ms": time_ms, "rows": {"a": {"ratio": 3.0}, "b": {"ratio": ratio}}}
    monkeypatch.setattr(Benchmark, "measure", lambda self, options: content)
    return content


def test_results_are_written_with_their_provenance(results, monkeypatch):
    content = measured_as(monkeypatch, 1.0, 2.0)
    run(SMALL, [])
    kept = read_results(results / "small.json")
    assert kept.content == content
    origin = kept.measured_on
    assert origin.command == "python -m benchmarks.small"
    assert origin.versions == versions() and {"python", "numpy", "torch"} <= set(origin.versions)
    assert origin.processor == processor() and origin.cores and origin.load_average is not None


@pytest.mark.parametrize("arguments", [["--rows", "1"], ["--keep-nothing"]])
def test_a_partial_measurement_is_not_written(results, monkeypatch, arguments):
    measured_as(monkeypatch, 1.0, 2.0)
    run(SMALL, arguments)
    assert not (results / "small.json").exists()


@pytest.mark.parametrize(
    "time_ms, ratio, sentence",
    [
        (2.5, 2.0, "small: time_ms is 2.5, expected at most 2"),
        (1.0, 1.2, "small: rows.b.ratio is 1.2, expected at least 1.5"),
        (float("nan"), 2.0, "small: time_ms is nan, expected at most 2"),
        (None, 2.0, "small: time_ms is none, expected at most 2"),
    ],
)
def test_a_missed_limit_fails(results, monkeypatch, time_ms, ratio, sentence):
    measured_as(monkeypatch, time_ms, ratio)
    assert run(SMALL, ["--keep-nothing"]) == [sentence]
    monkeypatch.setattr("sys.argv", ["small", "--keep-nothing"])
    with pytest.raises(SystemExit, match=sentence):
        evidence.main(SMALL)


def test_a_baseline_is_written_with_its_option_only(results, monkeypatch):
    measured_as(monkeypatch, 1.0, 2.0)
    baseline = replace(SMALL, is_baseline=True)
    run(baseline, [])
    assert not (results / "small.json").exists()
    run(baseline, ["--write"])
    assert (results / "small.json").exists()


def test_a_failed_benchmark_does_not_stop_the_others(monkeypatch):
    called = []

    def call(arguments, check):
        called.append(arguments[-1])
        return type("Done", (), {"returncode": int(arguments[-1] == "benchmarks.contact.press")})

    monkeypatch.setattr(command.subprocess, "run", call)
    with pytest.raises(SystemExit, match=r"failed, or missed a limit: press$"):
        command.main([])
    assert called == [b.module for b in BENCHMARKS.values() if not b.needs_arguments]
    assert {"benchmarks.contact.press", "benchmarks.taxels.gain"} <= set(called)
    assert "benchmarks.networks.translation" not in called


@pytest.mark.parametrize(
    "arguments, sentence",
    [
        (["nothing"], r"no benchmark 'nothing'; there are .*, press, "),
        (["translation"], "translation needs arguments: python -m benchmarks.networks.translation"),
    ],
)
def test_an_impossible_request_is_refused(arguments, sentence):
    with pytest.raises(SystemExit, match=sentence):
        command.main(arguments)
