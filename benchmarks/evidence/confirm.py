"""Results that stay valid though the code has changed, because it still does the same.

Where the code gives on the small case exactly what it gave when the figures were measured, the
results get the digests of the present sources. The figures, and where and when they were measured,
stay as they are, times too.
"""

from dataclasses import replace
from typing import Any

from benchmarks.evidence.provenance import Confirmation, commit_of, now
from benchmarks.evidence.record import Benchmark
from benchmarks.evidence.results import Results, read_results, write_results
from benchmarks.evidence.small_case import SmallCase, rounded
from benchmarks.evidence.sources import SourceTree
from t2twin.core.errors import T2TwinError


def confirm(benchmark: Benchmark, case: SmallCase, tree: SourceTree) -> str:
    """Writes the present sources to a benchmark's results; what was confirmed, in words.

    Raises T2TwinError where its outcome differs from the one that was kept, or there is none.
    """
    check_confirmable(benchmark)
    results = read_results(benchmark.results)
    expected = results.measured_on.outcome
    if expected is None:
        raise T2TwinError(
            f"{benchmark.name} has kept no outcome to compare with; measure it anew with "
            f"python -m {benchmark.module}"
        )
    commit = commit_of(benchmark, tree)
    different = differences(expected, rounded(benchmark.outcome(case)))
    if different:
        raise T2TwinError(
            f"{benchmark.name} does not give what it gave: {', '.join(different[:5])} differ; "
            f"measure it anew with python -m {benchmark.module}"
        )
    sources = tree.sources_of(benchmark)
    measured_on = replace(
        results.measured_on,
        sources=sources.code,
        shapes=sources.shapes,
        confirmed=Confirmation(commit, now()),
    )
    write_results(benchmark.results, Results(measured_on, results.content))
    measured = f"measured at {measured_on.commit} on {measured_on.date}"
    times = f"; times are of then: {', '.join(benchmark.times)}" if benchmark.times else ""
    return f"confirmed, {measured}{times}"


def check_confirmable(benchmark: Benchmark) -> None:
    """Raises T2TwinError for a benchmark that can only be measured."""
    if not benchmark.confirmable:
        raise T2TwinError(
            f"{benchmark.name} cannot be confirmed, its figures are not the code's alone; measure "
            f"it anew with python -m {benchmark.module}"
        )


def differences(before: Any, after: Any, path: str = "") -> list[str]:
    """Paths at which two contents differ."""
    if isinstance(before, dict) and isinstance(after, dict):
        return [
            name
            for key in sorted({*before, *after})
            for name in differences(before.get(key), after.get(key), f"{path}.{key}".lstrip("."))
        ]
    return [] if before == after else [path]
