"""All benchmarks: what they are, running them, and whether their results still hold.

    python -m benchmarks [NAME ...]           measure; without names all that need no argument
    python -m benchmarks --list               what there is, and what its arguments are
    python -m benchmarks --stale              results that are older than what they measure
    python -m benchmarks --confirm NAME ...   keep results where the code provably does the same
    python -m benchmarks --docs               write the results' figures into README.md and docs/

Exits with 1 where a benchmark fails or misses a limit, and where a result is stale.
"""

import argparse
import sys
import tempfile
from collections.abc import Iterable
from pathlib import Path

from benchmarks.declared import BENCHMARKS
from benchmarks.documents.markers import write_documents
from benchmarks.evidence.confirm import check_confirmable, confirm
from benchmarks.evidence.record import Benchmark
from benchmarks.evidence.run import parser_of, run_apart
from benchmarks.evidence.small_case import SmallCase
from benchmarks.evidence.sources import SourceTree
from benchmarks.evidence.stale import staleness
from t2twin.core.errors import T2TwinError


def main(arguments: list[str] | None = None) -> None:
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks",
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("names", nargs="*", metavar="NAME", help="all unless given")
    what = parser.add_mutually_exclusive_group()
    for flag, text in (
        ("--list", "name every benchmark"),
        ("--stale", "name the results that are older than what they measure"),
        ("--confirm", "keep the results where the outcome is the same"),
        ("--docs", "write figures into README.md and docs/"),
    ):
        what.add_argument(flag, action="store_true", help=text)
    options = parser.parse_args(arguments)
    try:
        failed = _do(options)
    except T2TwinError as error:
        sys.exit(str(error))
    if failed:
        sys.exit("\n".join(failed))


def _do(options: argparse.Namespace) -> list[str]:
    """What failed, a sentence each."""
    chosen = _chosen(options.names)
    if options.list:
        _list(chosen)
        return []
    if options.stale:
        return _stale(chosen)
    if options.confirm:
        return _confirm(chosen if options.names else [b for b in chosen if b.confirmable])
    if options.docs:
        for path in write_documents():
            print(path)
        return []
    failed = run_apart(_runnable(chosen, all_of_them=not options.names))
    return [f"failed or over a limit: {', '.join(failed)}"] if failed else []


def _chosen(names: list[str]) -> list[Benchmark]:
    known = {benchmark.name: benchmark for benchmark in BENCHMARKS}
    for name in names:
        if name not in known:
            raise T2TwinError(f"there is no benchmark {name!r}; there are {', '.join(known)}")
    return [known[name] for name in names] if names else list(BENCHMARKS)


def _runnable(chosen: Iterable[Benchmark], all_of_them: bool) -> list[Benchmark]:
    """Those that need no argument; others are left out of all of them, and refused by name."""
    for benchmark in chosen:
        if benchmark.needs_arguments and not all_of_them:
            raise T2TwinError(f"{benchmark.name} needs arguments:\n{_usage(benchmark)}")
    return [benchmark for benchmark in chosen if not benchmark.needs_arguments]


def _list(chosen: Iterable[Benchmark]) -> None:
    for benchmark in chosen:
        print(f"{benchmark.name:14}{benchmark.minutes:4g} min  {benchmark.measures}")
        print(f"{'':24}{_usage(benchmark)}")


def _usage(benchmark: Benchmark) -> str:
    usage = parser_of(benchmark).format_usage().removeprefix("usage: ")
    return " ".join(usage.split())


def _stale(chosen: list[Benchmark]) -> list[str]:
    tree = SourceTree()
    reasons = {benchmark.name: staleness(benchmark, tree) for benchmark in chosen}
    for benchmark in chosen:
        well = "a baseline, never stale" if benchmark.baseline else "up to date"
        print(f"{benchmark.name:14}{', '.join(reasons[benchmark.name]) or well}", flush=True)
    stale = [name for name, changed in reasons.items() if changed]
    return [f"stale: {', '.join(stale)}"] if stale else []


def _confirm(chosen: list[Benchmark]) -> list[str]:
    for benchmark in chosen:
        check_confirmable(benchmark)
    refused = []
    with tempfile.TemporaryDirectory() as folder:
        case, tree = SmallCase(Path(folder)), SourceTree()
        for benchmark in chosen:
            try:
                print(f"{benchmark.name:14}{confirm(benchmark, case, tree)}", flush=True)
            except T2TwinError as error:
                refused.append(str(error))
    return refused


if __name__ == "__main__":
    main()
