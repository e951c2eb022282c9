"""Benchmarks: declared by their modules, run by one runner; results with provenance, which are
stale if a source folder changed since the commit that they were measured at."""

import ast
import subprocess
from dataclasses import replace

import pytest

from benchmarks import ROOT, evidence
from benchmarks import __main__ as command
from benchmarks.evidence import (
    BASELINE,
    Argument,
    Benchmark,
    Figure,
    Provenance,
    Results,
    changed_sources,
    find_benchmarks,
    processor,
    read_results,
    run,
    versions,
    write_results,
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
    assert measured_on.date and path.stem in measured_on.command


@pytest.mark.parametrize("benchmark", BENCHMARKS.values(), ids=lambda benchmark: benchmark.name)
def test_every_figure_is_in_the_results(benchmark):
    if benchmark.results.is_file() and not benchmark.is_baseline:
        assert benchmark.values(read_results(benchmark.results).content)


@pytest.mark.parametrize("benchmark", BENCHMARKS.values(), ids=lambda benchmark: benchmark.name)
def test_a_module_declares_a_benchmark_of_its_own_name(benchmark):
    path = ROOT / f"{benchmark.module.replace('.', '/')}.py"
    tree = ast.parse(path.read_text())
    assert any(isinstance(n, ast.FunctionDef) and n.name == "measure" for n in tree.body)
    assert benchmark.sources
    for source in benchmark.sources:
        path = ROOT / source
        is_module = path.is_file() and path.suffix == ".py"
        assert (path.is_dir() or is_module) and not path.is_symlink()


# Running


SMALL = Benchmark(
    module="benchmarks.small",
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
    assert origin.command == "python -m benchmarks small"
    assert origin.versions == versions() and {"python", "numpy", "torch"} <= set(origin.versions)
    assert origin.processor == processor() and origin.cores and origin.load_average is not None


def test_a_partial_measurement_or_baseline_is_written_with_its_option_only(results, monkeypatch):
    measured_as(monkeypatch, 1.0, 2.0)
    baseline = replace(SMALL, is_baseline=True)
    for what, arguments in ((SMALL, ["--rows", "1"]), (SMALL, ["--keep-nothing"]), (baseline, [])):
        run(what, arguments)
        assert not (results / "small.json").exists()
    run(baseline, ["--write"])
    assert (results / "small.json").exists()


@pytest.mark.parametrize(
    "time_ms, ratio, sentence",
    [
        (2.5, 2.0, "small: time_ms is 2.5, expected at most 2"),
        (1.0, 1.2, "small: rows.b.ratio is 1.2, expected at least 1.5"),
        (None, 2.0, "small: time_ms is none, expected at most 2"),
    ],
)
def test_a_missed_limit_fails(results, monkeypatch, time_ms, ratio, sentence):
    measured_as(monkeypatch, time_ms, ratio)
    assert run(SMALL, ["--keep-nothing"]) == [sentence]
    monkeypatch.setattr(command, "find_benchmarks", lambda: {"small": SMALL})
    with pytest.raises(SystemExit, match=sentence):
        command.main(["small", "--keep-nothing"])


# Stale results


SOURCES = Benchmark("benchmarks.small", 0.0, sources=("sim/contact", "sim/optical"))


@pytest.fixture
def repository(tmp_path, monkeypatch):
    """A repository with three commits: old, baseline, and a change of sim/contact."""
    monkeypatch.setattr(evidence, "RESULTS", tmp_path / "results")
    root = tmp_path / "repository"
    for folder in SOURCES.sources:
        (root / folder).mkdir(parents=True)
    git(root, "init", "-q")
    commits = []
    for number, name in enumerate(("sim/optical/a.py", "sim/optical/b.py", "sim/contact/c.py")):
        (root / name).write_text(str(number))
        git(root, "add", ".")
        git(root, "-c", "user.name=x", "-c", "user.email=x@x", "commit", "-q", "-m", name)
        commits.append(git(root, "rev-parse", "--short=12", "HEAD"))
    return root, commits


def git(root, *arguments):
    done = subprocess.run(["git", *arguments], cwd=root, capture_output=True, text=True, check=True)
    return done.stdout.strip()


def measure_at(commit, benchmark=SOURCES):
    write_results(benchmark.results, Results(Provenance(commit, "2026-01-01", "x", {}), {"a": 1}))


def test_a_change_since_the_baseline_is_named(repository):
    root, commits = repository
    assert changed_sources(SOURCES, root, commits[1]) is None
    baseline = Benchmark("benchmarks.small", 0.0, SOURCES.sources, is_baseline=True)
    assert changed_sources(baseline, root, commits[1]) == []
    for commit in (commits[0], commits[1], f"{commits[0]}+", "unknown", "0" * 12):
        measure_at(commit)
        assert changed_sources(SOURCES, root, commits[1]) == ["sim/contact"]
    measure_at(commits[2])
    assert changed_sources(SOURCES, root, commits[1]) == []
    (root / "sim/optical/a.py").write_text("uncommitted")
    assert changed_sources(SOURCES, root, commits[1]) == ["sim/optical"]


def test_changes_of_comments_and_docstrings_do_not_count(repository):
    root, commits = repository
    path = root / "sim/optical/a.py"
    path.write_text('"""Text."""\nA = 1\n')
    git(root, "-c", "user.name=x", "-c", "user.email=x@x", "commit", "-qam", "a")
    measure_at(git(root, "rev-parse", "--short=12", "HEAD"))
    for text, changed in (
        ('"""New."""\n\nA = 1  # new\n"""A value."""\n', []),
        ('"""Text."""\nA = 2\n', ["sim/optical"]),
        ('"""Text."""\nA = (\n', ["sim/optical"]),
    ):
        path.write_text(text)
        assert changed_sources(SOURCES, root, commits[1]) == changed
    path.unlink()
    assert changed_sources(SOURCES, root, commits[1]) == ["sim/optical"]


def test_a_copy_without_history_is_refused(repository, tmp_path):
    _, commits = repository
    measure_at(commits[1])
    with pytest.raises(T2TwinError, match=f"no git history back to {BASELINE}; clone the whole"):
        changed_sources(SOURCES, tmp_path)


def test_the_command_names_stale_results_with_status_one(repository, monkeypatch, capsys):
    root, commits = repository
    monkeypatch.setattr(command, "find_benchmarks", lambda: {"small": SOURCES})
    monkeypatch.setattr(
        command, "changed_sources", lambda benchmark: changed_sources(benchmark, root, commits[1])
    )
    measure_at(commits[2])
    command.main(["--stale"])
    assert capsys.readouterr().out == "small             up to date\n"
    measure_at(commits[1])
    with pytest.raises(SystemExit, match=r"^stale: small$"):
        command.main(["--stale", "small"])
    assert capsys.readouterr().out == "small             sim/contact\n"
    SOURCES.results.unlink()
    with pytest.raises(SystemExit, match=r"^stale: small$"):
        command.main(["--stale", "small"])
    assert "not measured" in capsys.readouterr().out
