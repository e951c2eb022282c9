"""Runs benchmarks, prints their figures in columns, and writes their results."""

import argparse
import subprocess
import sys
from collections.abc import Iterable
from typing import Any

from benchmarks.evidence.record import Benchmark, Figure
from benchmarks.evidence.results import Results, provenance, write_results
from benchmarks.evidence.values import values
from t2twin.core.errors import T2TwinError

KEEP_NOTHING = "--keep-nothing"


def run(benchmark: Benchmark, arguments: list[str]) -> list[str]:
    """Measures, writes the results and prints every figure. Returns one sentence per missed limit.

    Nothing is written with --keep-nothing, with a partial argument, or for a baseline without
    --write.
    """
    options = parser_of(benchmark).parse_args(arguments)
    start = provenance(benchmark.module, arguments)  # before the measurement loads the machine
    content = benchmark.measure(options)
    if is_kept(benchmark, options):
        write_results(benchmark.results, Results(start, content))
    print("\n".join(columns(benchmark, content)), flush=True)
    return missed(benchmark, content)


def parser_of(benchmark: Benchmark) -> argparse.ArgumentParser:
    """The command line of one benchmark."""
    parser = argparse.ArgumentParser(
        prog=f"python -m {benchmark.module}", description=benchmark.measures
    )
    for argument in benchmark.arguments:
        more: dict[str, Any] = {"type": argument.kind, "default": argument.default}
        for key in ("nargs", "choices", "metavar"):
            if (value := getattr(argument, key)) is not None:
                more[key] = value
        if argument.name.startswith("--"):
            more["required"] = argument.required
        parser.add_argument(argument.name, help=argument.help, **more)
    keep = parser.add_mutually_exclusive_group()
    keep.add_argument(KEEP_NOTHING, action="store_true", help="measure and print, write nothing")
    if benchmark.is_baseline:
        keep.add_argument("--write", action="store_true", help="write a new baseline")
    return parser


def is_kept(benchmark: Benchmark, options: argparse.Namespace) -> bool:
    """Whether a measurement with these options is written to the results."""
    is_partial = any(
        argument.partial and getattr(options, argument.attribute) != argument.default
        for argument in benchmark.arguments
    )
    is_wanted = options.write if benchmark.is_baseline else not options.keep_nothing
    return is_wanted and not is_partial


def columns(benchmark: Benchmark, content: dict[str, Any]) -> list[str]:
    """One line per figure: name, value, unit, limit."""
    rows = [
        (path, "none" if value is None else f"{value:.4g}", figure.unit, figure.limit)
        for path, value, figure in figures(benchmark, content)
    ]
    table = [("name", "value", "", "limit"), *rows]
    widths = [max(len(row[column]) for row in table) for column in range(len(table[0]))]
    lines = (
        f"{name:{widths[0]}}  {value:>{widths[1]}} {unit:{widths[2]}}  {limit}".rstrip()
        for name, value, unit, limit in table
    )
    return [benchmark.name, *lines]


def missed(benchmark: Benchmark, content: dict[str, Any]) -> list[str]:
    """One sentence per missed limit."""
    return [
        f"{benchmark.name}: {path} is {'none' if value is None else f'{value:.4g}'}, "
        f"expected {figure.limit}"
        for path, value, figure in figures(benchmark, content)
        if not figure.is_met_by(value)
    ]


def figures(benchmark: Benchmark, content: dict[str, Any]) -> list[tuple[str, Any, Figure]]:
    """Path, value and declaration of every figure in the content."""
    return [
        (path, value, figure)
        for figure in benchmark.figures
        for path, value in values(content, figure.path).items()
    ]


def main(benchmark: Benchmark) -> None:
    """The command `python -m benchmarks.FOLDER.NAME`. Exits with 1 if a limit is missed."""
    try:
        sentences = run(benchmark, sys.argv[1:])
    except T2TwinError as error:
        sentences = [f"{benchmark.name}: {error}"]
    if sentences:
        sys.exit("\n".join(sentences))


def run_each(benchmarks: Iterable[Benchmark]) -> list[str]:
    """Runs benchmarks without arguments, each in its own process. Returns the names of those that
    fail or miss a limit."""
    failed = []
    for benchmark in benchmarks:
        done = subprocess.run([sys.executable, "-m", benchmark.module], check=False)
        if done.returncode:
            failed.append(benchmark.name)
    return failed
