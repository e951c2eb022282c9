"""Staleness: which source folders of a benchmark changed since its results were measured."""

from pathlib import Path

from benchmarks import ROOT
from benchmarks.evidence.record import Benchmark
from benchmarks.evidence.results import git, read_results
from t2twin.core.errors import T2TwinError

BASELINE = "0d1cde67c747"
"""Commit from which changes count. Results of earlier commits count as measured at it."""


def changed_sources(
    benchmark: Benchmark, root: Path = ROOT, baseline: str = BASELINE
) -> list[str] | None:
    """The source folders that differ from the measured commit.

    Uncommitted changes of tracked files count. None if there are no results. A baseline benchmark
    is never stale.

    Raises T2TwinError if the repository at root lacks the history.
    """
    if benchmark.is_baseline:
        return []
    if not benchmark.results.is_file():
        return None
    measured = read_results(benchmark.results).measured_on.commit.removesuffix("+")
    if git("cat-file", "-e", f"{baseline}^{{commit}}", root=root) is None:
        raise T2TwinError(
            f"{root} has no git history back to {baseline}; clone the whole repository to find "
            "stale results"
        )
    is_later = git("merge-base", "--is-ancestor", baseline, measured, root=root) is not None
    since = measured if is_later else baseline
    return [
        source
        for source in benchmark.sources
        if git("diff", "--name-only", since, "--", source, root=root)
    ]
