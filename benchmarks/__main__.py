"""Runs and lists the benchmarks, and names stale results.

    python -m benchmarks                        measure all that need no argument
    python -m benchmarks NAME [ARGUMENT ...]    measure one; --help lists its arguments
    python -m benchmarks --list [NAME ...]      all benchmarks and their arguments
    python -m benchmarks --stale [NAME ...]     results that are older than the code they measure
    python -m benchmarks --docs                 write the results into the tables of the documents

Exits with 1 if a benchmark fails or misses a limit, and if results are stale.
"""

import argparse
import subprocess
import sys

from benchmarks.evidence import Benchmark, changed_sources, find_benchmarks, run
from t2twin.core.errors import T2TwinError


def main(arguments: list[str] | None = None) -> None:
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks",
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("words", nargs=argparse.REMAINDER, metavar="NAME [ARGUMENT ...]")
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
    if options.list:
        for benchmark in _chosen(options.words):
            print(f"{benchmark.name:18}{benchmark.minutes:4g} min  {benchmark.measures}")
            usage = benchmark.parser.format_usage().removeprefix("usage: ")
            print(f"{'':28}{' '.join(usage.split())}")
        return ""
    if options.stale:
        return _stale(_chosen(options.words))
    if options.words:
        name, *arguments = options.words
        return "\n".join(run(_chosen([name])[0], arguments))
    failed = []
    for benchmark in _chosen([]):
        if not benchmark.needs_arguments:
            command = [sys.executable, "-m", "benchmarks", benchmark.name]
            if subprocess.run(command, check=False).returncode:
                failed.append(benchmark.name)
    return f"failed, or missed a limit: {', '.join(failed)}" if failed else ""


def _chosen(names: list[str]) -> list[Benchmark]:
    benchmarks = find_benchmarks()
    for name in names:
        if name not in benchmarks:
            raise T2TwinError(f"there is no benchmark {name!r}; there are {', '.join(benchmarks)}")
    return [benchmarks[name] for name in names or benchmarks]


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
