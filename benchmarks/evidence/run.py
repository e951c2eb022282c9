"""Running benchmarks: measured, shown in columns, kept; one that fails does not stop the others."""

import argparse
import subprocess
import sys
import tempfile
from collections.abc import Iterable
from pathlib import Path
from typing import Any

from benchmarks.evidence.provenance import moment, provenance
from benchmarks.evidence.record import Benchmark, Figure
from benchmarks.evidence.results import Results, write_results
from benchmarks.evidence.small_case import SmallCase, rounded
from benchmarks.evidence.sources import SourceTree
from benchmarks.evidence.values import values
from t2twin.core.errors import T2TwinError

KEEP_NOTHING = "--keep-nothing"


def run(benchmark: Benchmark, arguments: list[str]) -> list[str]:
    """Measures, writes the results, and prints every figure; the limits missed, a sentence each.

    Nothing is written with --keep-nothing, or where an argument thins what is measured, or for a
    baseline unless --write is given.
    """
    options = parser_of(benchmark).parse_args(arguments)
    tree = SourceTree()
    start = moment(benchmark, tree)
    outcome = None
    if benchmark.confirmable and is_kept(benchmark, options):
        with tempfile.TemporaryDirectory() as folder:
            outcome = rounded(benchmark.outcome(SmallCase(Path(folder))))
    content = benchmark.measure(options)
    if is_kept(benchmark, options):
        measured_on = provenance(benchmark, tree, start, arguments, outcome)
        write_results(benchmark.results, Results(measured_on, content))
    print("\n".join(columns(benchmark, content)), flush=True)
    return missed(benchmark, content)


def parser_of(benchmark: Benchmark) -> argparse.ArgumentParser:
    """The command line of one benchmark."""
    parser = argparse.ArgumentParser(
        prog=f"python -m {benchmark.module}", description=benchmark.measures
    )
    for argument in benchmark.arguments:
        more: dict[str, Any] = {"type": argument.kind, "default": argument.default}
        if argument.nargs is not None:
            more["nargs"] = argument.nargs
        if argument.choices is not None:
            more["choices"] = argument.choices
        if argument.metavar is not None:
            more["metavar"] = argument.metavar
        if argument.name.startswith("--"):
            more["required"] = argument.required
        parser.add_argument(argument.name, help=argument.help, **more)
    keep = parser.add_mutually_exclusive_group()
    keep.add_argument(KEEP_NOTHING, action="store_true", help="measure and print, write nothing")
    if benchmark.baseline:
        keep.add_argument("--write", action="store_true", help="write the baseline anew")
    return parser


def is_kept(benchmark: Benchmark, options: argparse.Namespace) -> bool:
    """Whether a measurement with these options is written to the results."""
    thinned = any(
        argument.thins and getattr(options, argument.attribute) != argument.default
        for argument in benchmark.arguments
    )
    asked = options.write if benchmark.baseline else not options.keep_nothing
    return asked and not thinned


def columns(benchmark: Benchmark, content: dict[str, Any]) -> list[str]:
    """Every figure as a line: name, value, unit, limit."""
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
    """The limits that are missed, a sentence each."""
    return [
        f"{benchmark.name}: {path} is {'none' if value is None else f'{value:.4g}'}, {figure.limit}"
        for path, value, figure in figures(benchmark, content)
        if not figure.is_met_by(value)
    ]


def figures(benchmark: Benchmark, content: dict[str, Any]) -> list[tuple[str, Any, Figure]]:
    """Path, value and declaration of every figure that the content holds."""
    return [
        (path, value, figure)
        for figure in benchmark.figures
        for path, value in values(content, figure.path).items()
    ]


def main(benchmark: Benchmark) -> None:
    """The command `python -m benchmarks.NAME`: exits with 1 where a limit is missed."""
    try:
        sentences = run(benchmark, sys.argv[1:])
    except T2TwinError as error:
        sentences = [f"{benchmark.name}: {error}"]
    if sentences:
        sys.exit("\n".join(sentences))


def run_apart(benchmarks: Iterable[Benchmark]) -> list[str]:
    """Runs benchmarks without arguments one after another, each in its own process, so that none
    leaves threads or memory to the next or takes it down; the names of those that failed."""
    failed = []
    for benchmark in benchmarks:
        done = subprocess.run([sys.executable, "-m", benchmark.module], check=False)
        if done.returncode:
            failed.append(benchmark.name)
    return failed
