"""Benchmarks: their declaration, their runner, their results files with provenance, staleness."""

import argparse
import ast
import json
import os
import platform
import shlex
import subprocess
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from datetime import UTC, datetime
from importlib import import_module
from importlib.metadata import PackageNotFoundError, version
from inspect import getdoc
from math import isfinite
from operator import attrgetter
from pathlib import Path
from typing import Any

import msgspec

from benchmarks import ROOT
from t2twin.core.errors import T2TwinError
from t2twin.core.files import atomic_write
from t2twin.core.records import convert

RESULTS = ROOT / "benchmarks" / "results"
"""Folder of all results files, NAME.json."""

MEASURED_ON = "measured_on"
"""Key of the provenance in a results file; all other keys are the content's."""

PACKAGES = ("t2twin", "mujoco", "numpy", "scipy", "numba", "torch", "cadquery", "pillow", "pyarrow",
            "scikit-image", "onnxruntime")  # fmt: skip
"""Packages whose versions may change a figure."""

BASELINE = "0d1cde67c747"
"""Commit from which changes count. Results of earlier commits count as measured at it."""


@dataclass(frozen=True)
class Figure:
    """A value of the results that is printed, and its limits.

    path: keys and list indices joined by dots; a * matches every key. unit: of the value and the
    limits. most, least: the limits, None for no limit.
    """

    path: str
    unit: str = ""
    most: float | None = None
    least: float | None = None

    @property
    def limit(self) -> str:
        """The limit as text, empty without a limit."""
        if self.most is not None:
            return f"at most {self.most:g}"
        return f"at least {self.least:g}" if self.least is not None else ""

    def is_met_by(self, value: float | None) -> bool:
        """Whether a value is within the limits; None and NaN are within none."""
        if not self.limit:
            return True
        if value is None:
            return False
        high = self.most is None or value <= self.most
        return high and (self.least is None or value >= self.least)


@dataclass(frozen=True)
class Argument:
    """An argument of a benchmark's command; the fields are those of argparse.

    name: `--name`, or without dashes a positional argument. partial: a value other than the default
    measures only a part, so that no results are written.
    """

    name: str
    help: str
    kind: Callable[[str], Any] = str
    default: Any = None
    nargs: int | str | None = None
    choices: tuple[str, ...] | None = None
    metavar: str | tuple[str, ...] | None = None
    required: bool = False
    partial: bool = False

    @property
    def attribute(self) -> str:
        """Its name in the parsed arguments."""
        return self.name.removeprefix("--").replace("-", "_")

    @property
    def must_be_given(self) -> bool:
        return self.required or (not self.name.startswith("--") and self.nargs not in ("?", "*"))


@dataclass(frozen=True)
class Benchmark:
    """One benchmark, declared as `BENCHMARK` by its module.

    The module also defines `measure(options)`, which returns the content of the results.

    module: benchmarks.FOLDER.NAME, whose docstring begins with what is measured. minutes: duration
    on two cores. sources: folders and modules whose code determines the figures, relative to the
    repository, without general helpers such as t2twin/core. is_baseline: the results are a baseline
    for a test: they are written with --write only and never stale.
    """

    module: str
    minutes: float
    sources: tuple[str, ...] = ()
    figures: tuple[Figure, ...] = ()
    arguments: tuple[Argument, ...] = ()
    is_baseline: bool = False

    @property
    def name(self) -> str:
        """NAME, which the results file also has."""
        return self.module.rpartition(".")[2]

    @property
    def measures(self) -> str:
        """The first sentences of the module's docstring."""
        return " ".join((getdoc(import_module(self.module)) or "").partition("\n\n")[0].split())

    @property
    def results(self) -> Path:
        return RESULTS / f"{self.name}.json"

    @property
    def needs_arguments(self) -> bool:
        return any(argument.must_be_given for argument in self.arguments)

    def measure(self, options: argparse.Namespace) -> dict[str, Any]:
        """The content of the results file without its provenance."""
        return import_module(self.module).measure(options)

    def values(self, content: dict[str, Any]) -> list[tuple[str, float | None, Figure]]:
        """Path, value and figure of every figure of a content."""
        return [
            (path, value, figure)
            for figure in self.figures
            for path, value in values(content, figure.path).items()
        ]

    def missed(self, content: dict[str, Any]) -> list[str]:
        """One sentence per missed limit."""
        return [
            f"{self.name}: {path} is {_shown(value)}, expected {figure.limit}"
            for path, value, figure in self.values(content)
            if not figure.is_met_by(value)
        ]

    @property
    def parser(self) -> argparse.ArgumentParser:
        """The command line."""
        parser = argparse.ArgumentParser(prog=f"python -m benchmarks {self.name}")
        for argument in self.arguments:
            more: dict[str, Any] = {"type": argument.kind, "default": argument.default}
            for key in ("nargs", "choices", "metavar"):
                if (value := getattr(argument, key)) is not None:
                    more[key] = value
            if argument.name.startswith("--"):
                more["required"] = argument.required
            parser.add_argument(argument.name, help=argument.help, **more)
        keep = parser.add_mutually_exclusive_group()
        keep.add_argument("--keep-nothing", action="store_true", help="measure, write nothing")
        if self.is_baseline:
            keep.add_argument("--write", action="store_true", help="write a new baseline")
        return parser

    def is_kept(self, options: argparse.Namespace) -> bool:
        """Whether a measurement with these options is written to the results."""
        is_partial = any(
            argument.partial and getattr(options, argument.attribute) != argument.default
            for argument in self.arguments
        )
        is_wanted = options.write if self.is_baseline else not options.keep_nothing
        return is_wanted and not is_partial


def find_benchmarks() -> dict[str, Benchmark]:
    """The benchmarks of all modules of the package that declare one, by name."""
    found = []
    for path in (ROOT / "benchmarks").glob("*/*.py"):
        if "\nBENCHMARK = " in path.read_text(encoding="utf-8"):
            found.append(import_module(f"benchmarks.{path.parent.name}.{path.stem}").BENCHMARK)
    return {benchmark.name: benchmark for benchmark in sorted(found, key=attrgetter("name"))}


# Results files


@dataclass(frozen=True)
class Provenance:
    """Where and how results were measured.

    commit: of the repository; a + at the end marks uncommitted changes. date: with time zone.
    versions: of Python and PACKAGES. load_average: over the minute before the start. None: not
    recorded.
    """

    commit: str
    date: str
    command: str
    versions: dict[str, str]
    processor: str | None = None
    cores: int | None = None
    load_average: float | None = None


@dataclass(frozen=True)
class Results:
    """The content of a results file."""

    measured_on: Provenance
    content: dict[str, Any]


def provenance(name: str, arguments: list[str]) -> Provenance:
    """The provenance of a measurement that starts now: `python -m benchmarks name arguments`."""
    commit = git("rev-parse", "--short=12", "HEAD") or "unknown"
    changed = git("status", "--porcelain", "--untracked-files=no")
    return Provenance(
        commit=f"{commit}+" if changed else commit,
        date=datetime.now(UTC).isoformat(timespec="seconds"),
        command=shlex.join(["python", "-m", "benchmarks", name, *arguments]),
        versions=versions(),
        processor=processor(),
        cores=os.cpu_count(),
        load_average=round(os.getloadavg()[0], 2),
    )


def read_results(path: Path) -> Results:
    """Raises T2TwinError if there is no file, or if it has no provenance."""
    if not path.is_file():
        raise T2TwinError(f"there is no {path.name}; python -m benchmarks {path.stem} writes it")
    content = json.loads(path.read_bytes())
    measured_on = content.pop(MEASURED_ON, None)
    return Results(convert(measured_on, Provenance, f"{path}: {MEASURED_ON}"), content)


def write_results(path: Path, results: Results) -> None:
    """Writes a results file atomically. NaN and infinity, which JSON lacks, become null."""
    whole = {MEASURED_ON: msgspec.to_builtins(results.measured_on), **results.content}
    with atomic_write(path) as temporary:
        temporary.write_text(json.dumps(_finite(whole), indent=1, allow_nan=False) + "\n")


def git(*arguments: str, root: Path = ROOT) -> str | None:
    """The output of a git command; None if it fails."""
    try:
        done = subprocess.run(
            ["git", *arguments], cwd=root, capture_output=True, text=True, check=True
        )
    except (OSError, subprocess.CalledProcessError):
        return None
    return done.stdout.strip()


def versions() -> dict[str, str]:
    """Versions of Python and of the installed PACKAGES."""
    installed = {"python": platform.python_version()}
    for name in PACKAGES:
        try:
            installed[name] = version(name)
        except PackageNotFoundError:
            continue
    return installed


def processor() -> str:
    """The processor's name from the operating system."""
    path = Path("/proc/cpuinfo")
    lines = path.read_text().splitlines() if path.is_file() else []
    names = (line.partition(":")[2].strip() for line in lines if line.startswith("model name"))
    return next(names, platform.processor() or platform.machine())


def _finite(content: Any) -> Any:
    """The content with None for NaN and infinity."""
    if isinstance(content, dict):
        return {key: _finite(part) for key, part in content.items()}
    if isinstance(content, list | tuple):
        return [_finite(part) for part in content]
    return None if isinstance(content, float) and not isfinite(content) else content


def values(content: Any, path: str) -> dict[str, Any]:
    """The values at a dotted path, by their full paths. A * in the path matches every key.

    A path through null has no value. Raises T2TwinError for a path that does not exist.
    """
    return dict(_walk(content, path.split("."), []))


def value(content: Any, path: str) -> Any:
    """The value at a path without *. Raises T2TwinError if there is none."""
    at_path = values(content, path)
    if path not in at_path:
        raise T2TwinError(f"the results have nothing at {path}")
    return at_path[path]


def _walk(content: Any, keys: list[str], before: list[str]) -> Iterator[tuple[str, Any]]:
    """Paths and values below a content."""
    if not keys:
        yield ".".join(before), content
        return
    if content is None:
        return
    key, *rest = keys
    if isinstance(content, list):
        content = {str(number): each for number, each in enumerate(content)}
    if not isinstance(content, dict) or (key != "*" and key not in content):
        raise T2TwinError(f"the results have nothing at {'.'.join([*before, key])}")
    for each in content if key == "*" else [key]:
        yield from _walk(content[each], rest, [*before, each])


# Running


def run(benchmark: Benchmark, arguments: list[str]) -> list[str]:
    """Measures, writes the results and prints every figure. Returns one sentence per missed limit.

    Nothing is written with --keep-nothing, with a partial argument, or for a baseline without
    --write.
    """
    options = benchmark.parser.parse_args(arguments)
    start = provenance(benchmark.name, arguments)  # before the measurement loads the machine
    content = benchmark.measure(options)
    if benchmark.is_kept(options):
        write_results(benchmark.results, Results(start, content))
    print("\n".join(_columns(benchmark, content)), flush=True)
    return benchmark.missed(content)


def _columns(benchmark: Benchmark, content: dict[str, Any]) -> list[str]:
    """One line per figure: name, value, unit, limit."""
    rows = [
        (path, _shown(value), figure.unit, figure.limit)
        for path, value, figure in benchmark.values(content)
    ]
    table = [("name", "value", "", "limit"), *rows]
    widths = [max(len(row[column]) for row in table) for column in range(len(table[0]))]
    lines = (
        f"{name:{widths[0]}}  {value:>{widths[1]}} {unit:{widths[2]}}  {limit}".rstrip()
        for name, value, unit, limit in table
    )
    return [benchmark.name, *lines]


def _shown(value: float | None) -> str:
    """A value with four digits."""
    return "none" if value is None else f"{value:.4g}"


# Staleness


def changed_sources(
    benchmark: Benchmark, root: Path = ROOT, baseline: str = BASELINE
) -> list[str] | None:
    """The sources that differ from the measured commit.

    Uncommitted changes of tracked files count; changes of comments and docstrings do not. None if
    there are no results. A baseline benchmark is never stale.

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
    return [source for source in benchmark.sources if _has_changed(source, since, root)]


def _has_changed(source: str, commit: str, root: Path) -> bool:
    paths = git("diff", "--name-only", "--no-renames", commit, "--", source, root=root) or ""
    return any(_code_differs(path, commit, root) for path in paths.splitlines())


def _code_differs(path: str, commit: str, root: Path) -> bool:
    """Whether a file that changed since a commit differs in more than comments and docstrings."""
    before, now = git("show", f"{commit}:{path}", root=root), root / path
    if before is None or not now.is_file() or now.suffix != ".py":
        return True
    try:
        return _code(before) != _code(now.read_text("utf-8"))
    except SyntaxError:
        return True


def _code(text: str) -> str:
    """The syntax tree of a module, without docstrings."""
    return ast.dump(_WithoutDocstrings().visit(ast.parse(text)))


class _WithoutDocstrings(ast.NodeTransformer):
    """Removes the strings that stand alone as statements."""

    def visit_Expr(self, node: ast.Expr) -> ast.Expr | None:
        value = node.value
        is_string = isinstance(value, ast.Constant) and isinstance(value.value, str)
        return None if is_string else node
