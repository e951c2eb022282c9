"""Results are stale if a source folder changed since the commit that they were measured at."""

import subprocess

import pytest

from benchmarks import __main__ as command
from benchmarks import evidence
from benchmarks.evidence import (
    BASELINE,
    Benchmark,
    Provenance,
    Results,
    changed_sources,
    write_results,
)
from t2twin.core.errors import T2TwinError

SMALL = Benchmark("benchmarks.small", "Nothing.", 0.0, sources=("sim/contact", "sim/optical"))


@pytest.fixture
def repository(tmp_path, monkeypatch):
    """A repository with three commits: old, baseline, and a change of sim/contact."""
    monkeypatch.setattr(evidence, "RESULTS", tmp_path / "results")
    root = tmp_path / "repository"
    for folder in SMALL.sources:
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


def measure_at(commit, benchmark=SMALL):
    write_results(benchmark.results, Results(Provenance(commit, "2026-01-01", "x", {}), {"a": 1}))


@pytest.mark.parametrize("measured", [0, 1, "+", "unknown", "0" * 12])
def test_a_change_since_the_baseline_is_named(repository, measured):
    root, commits = repository
    commit = commits[measured] if isinstance(measured, int) else measured
    measure_at(f"{commits[0]}+" if commit == "+" else commit)
    assert changed_sources(SMALL, root, commits[1]) == ["sim/contact"]


def test_results_of_the_present_commit_are_up_to_date(repository):
    root, commits = repository
    measure_at(commits[2])
    assert changed_sources(SMALL, root, commits[1]) == []
    (root / "sim/optical/a.py").write_text("uncommitted")
    assert changed_sources(SMALL, root, commits[1]) == ["sim/optical"]


@pytest.mark.parametrize(
    ("text", "changed"),
    [
        ('"""New."""\n\nA = 1  # new\n"""A value."""\n', []),
        ('"""Text."""\nA = 2\n', ["sim/optical"]),
        ('"""Text."""\nA = (\n', ["sim/optical"]),
        (None, ["sim/optical"]),
    ],
    ids=["text", "code", "broken", "deleted"],
)
def test_changes_of_comments_and_docstrings_do_not_count(repository, text, changed):
    root, commits = repository
    path = root / "sim/optical/a.py"
    path.write_text('"""Text."""\nA = 1\n')
    git(root, "-c", "user.name=x", "-c", "user.email=x@x", "commit", "-qam", "a")
    measure_at(git(root, "rev-parse", "--short=12", "HEAD"))
    if text is None:
        path.unlink()
    else:
        path.write_text(text)
    assert changed_sources(SMALL, root, commits[1]) == changed


def test_an_unmeasured_benchmark_and_a_baseline(repository):
    root, commits = repository
    assert changed_sources(SMALL, root, commits[1]) is None
    baseline = Benchmark("benchmarks.small", "Nothing.", 0.0, SMALL.sources, is_baseline=True)
    assert changed_sources(baseline, root, commits[1]) == []


def test_a_copy_without_history_is_refused(repository, tmp_path):
    _, commits = repository
    measure_at(commits[1])
    with pytest.raises(T2TwinError, match=f"no git history back to {BASELINE}; clone the whole"):
        changed_sources(SMALL, tmp_path)


def test_the_command_names_stale_results_with_status_one(repository, monkeypatch, capsys):
    root, commits = repository
    monkeypatch.setattr(command, "find_benchmarks", lambda: {"small": SMALL})
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
    SMALL.results.unlink()
    with pytest.raises(SystemExit, match=r"^stale: small$"):
        command.main(["--stale", "small"])
    assert "not measured" in capsys.readouterr().out
