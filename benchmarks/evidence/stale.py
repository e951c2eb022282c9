"""Which results are older than the code that they measure, and what has changed since."""

from benchmarks.evidence.record import Benchmark
from benchmarks.evidence.results import read_results
from benchmarks.evidence.sources import SourceTree

SHAPES_CHANGED = "the shapes' parameters"


def staleness(benchmark: Benchmark, tree: SourceTree) -> list[str]:
    """What makes a benchmark's results stale, in words; empty where nothing does.

    tree: the sources of now. A baseline is never stale: a test holds every run to it.
    Raises T2TwinError for results without provenance.
    """
    if benchmark.baseline:
        return []
    if not benchmark.results.is_file():
        return ["it was never measured"]
    measured_on = read_results(benchmark.results).measured_on
    if measured_on.sources is None or measured_on.shapes is None:
        return [f"the sources it was measured on, at {measured_on.commit}, were not kept"]
    now = tree.sources_of(benchmark)
    shapes = changes(measured_on.shapes, now.shapes)
    return [
        *changes(measured_on.sources, now.code),
        *([f"{SHAPES_CHANGED} ({', '.join(shapes)})"] if shapes else []),
    ]


def changes(before: dict[str, str], now: dict[str, str]) -> list[str]:
    """The names whose digests differ, with what is new or gone said so."""
    words = []
    for name in sorted({*before, *now}):
        if name not in now:
            words.append(f"{name} (gone)")
        elif name not in before:
            words.append(f"{name} (new)")
        elif before[name] != now[name]:
            words.append(name)
    return words
