"""Runs and lists the benchmarks, and names stale results.

    python -m benchmarks [NAME ...]      measure; without names all that need no argument
    python -m benchmarks --list          all benchmarks and their arguments
    python -m benchmarks --stale         results that are older than the code they measure
    python -m benchmarks --docs          write the results into the tables of the documents

Exits with 1 if a benchmark fails or misses a limit, and if results are stale.
"""

import argparse
import subprocess
import sys

from benchmarks.evidence import Benchmark, changed_sources, find_benchmarks
from t2twin.core.errors import T2TwinError


def main(arguments: list[str] | None = None) -> None:
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks",
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("names", nargs="*", metavar="NAME", help="all unless given")
    what = parser.add_mutually_exclusive_group()
    what.add_argument("--list", action="store_true", help="list the benchmarks")
    what.add_argument("--stale", action="store_true", help="name stale results")
    what.add_argument("--docs", action="store_true", help="write the documents' tables")
    options = parser.parse_args(arguments)
    try:
        failure = _run(options)
    except T2TwinError as error:
        sys.exit(str(error))
    if failure:
        sys.exit(failure)


def _run(options: argparse.Namespace) -> str:
    """Runs the command. Returns a sentence about failures, empty without any."""
    if options.docs:
        from benchmarks.documents.figures import write_documents  # imports translators, and torch

        for path in write_documents():
            print(path)
        return ""
    chosen = _chosen(options.names)
    if options.list:
        for benchmark in chosen:
            print(f"{benchmark.name:18}{benchmark.minutes:4g} min  {benchmark.measures}")
            print(f"{'':28}{_usage(benchmark)}")
        return ""
    if options.stale:
        return _stale(chosen)
    if options.names:
        for benchmark in chosen:
            if benchmark.needs_arguments:
                raise T2TwinError(f"{benchmark.name} needs arguments: {_usage(benchmark)}")
    failed = []
    for benchmark in chosen:
        if not benchmark.needs_arguments:
            done = subprocess.run([sys.executable, "-m", benchmark.module], check=False)
            if done.returncode:
                failed.append(benchmark.name)
    return f"failed, or missed a limit: {', '.join(failed)}" if failed else ""


def _chosen(names: list[str]) -> list[Benchmark]:
    benchmarks = find_benchmarks()
    for name in names:
        if name not in benchmarks:
            raise T2TwinError(f"there is no benchmark {name!r}; there are {', '.join(benchmarks)}")
    return [benchmarks[name] for name in names or benchmarks]


def _usage(benchmark: Benchmark) -> str:
    usage = benchmark.parser.format_usage().removeprefix("usage: ")
    return " ".join(usage.split())


def _stale(chosen: list[Benchmark]) -> str:
    stale = []
    for benchmark in chosen:
        changed = changed_sources(benchmark)
        text = "not measured" if changed is None else ", ".join(changed)
        print(f"{benchmark.name:18}{text or 'up to date'}", flush=True)
        if text:
            stale.append(benchmark.name)
    return f"stale: {', '.join(stale)}" if stale else ""


if __name__ == "__main__":
    main()
