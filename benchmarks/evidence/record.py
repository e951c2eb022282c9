"""What a benchmark declares, and how the declarations are found."""

from argparse import Namespace
from collections.abc import Callable
from dataclasses import dataclass
from importlib import import_module
from operator import attrgetter
from pathlib import Path
from typing import Any

from benchmarks import ROOT

RESULTS = ROOT / "benchmarks" / "results"
"""Folder of all results files, NAME.json."""


DECLARATION = "\nBENCHMARK = "
"""Start of the line with which a module declares a benchmark."""


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
        if self.most is None and self.least is None:
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

    module: benchmarks.FOLDER.NAME. measures: one sentence. minutes: duration on two cores. sources:
    folders and modules whose code determines the figures, relative to the repository, without
    general helpers such as t2twin/core. is_baseline: the results are a baseline for a test: they
    are written with --write only and never stale.
    """

    module: str
    measures: str
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
    def results(self) -> Path:
        return RESULTS / f"{self.name}.json"

    @property
    def needs_arguments(self) -> bool:
        return any(argument.must_be_given for argument in self.arguments)

    def measure(self, options: Namespace) -> dict[str, Any]:
        """The content of the results file without its provenance."""
        return import_module(self.module).measure(options)


def find_benchmarks() -> dict[str, Benchmark]:
    """The benchmarks of all modules of the package that declare one, by name."""
    found = []
    for path in (ROOT / "benchmarks").glob("*/*.py"):
        if DECLARATION in path.read_text(encoding="utf-8"):
            found.append(import_module(f"benchmarks.{path.parent.name}.{path.stem}").BENCHMARK)
    return {benchmark.name: benchmark for benchmark in sorted(found, key=attrgetter("name"))}
