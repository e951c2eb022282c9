"""What a benchmark declares of itself."""

from argparse import Namespace
from collections.abc import Callable
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any

from benchmarks import ROOT

if TYPE_CHECKING:
    from benchmarks.evidence.small_case import SmallCase

RESULTS = ROOT / "benchmarks" / "results"
"""Where every benchmark's results are kept, NAME.json."""


@dataclass(frozen=True)
class Figure:
    """A value of the results that is shown, and its limits.

    path: where it stands in the results: keys and places in lists, joined by dots; a * stands for
    every key. unit: of the value and the limits. most, least: the limits, None where there is none.
    """

    path: str
    unit: str = ""
    most: float | None = None
    least: float | None = None

    @property
    def limit(self) -> str:
        """The limit in words, empty where there is none."""
        if self.most is not None:
            return f"at most {self.most:g}"
        return f"at least {self.least:g}" if self.least is not None else ""

    def is_met_by(self, value: float | None) -> bool:
        """Whether a value keeps to the limits; no value, or NaN, keeps to none."""
        if self.most is None and self.least is None:
            return True
        if value is None:
            return False
        high = self.most is None or value <= self.most
        return high and (self.least is None or value >= self.least)


@dataclass(frozen=True)
class Argument:
    """An argument of a benchmark's command, by the names of argparse.

    name: `--name` or, without dashes, one that must be given. thins: whether another value than
    the default measures only a part; then nothing is kept.
    """

    name: str
    help: str
    kind: Callable[[str], Any] = str
    default: Any = None
    nargs: int | str | None = None
    choices: tuple[str, ...] | None = None
    metavar: str | tuple[str, ...] | None = None
    required: bool = False
    thins: bool = False

    @property
    def attribute(self) -> str:
        """Its name in what argparse returns."""
        return self.name.removeprefix("--").replace("-", "_")

    @property
    def must_be_given(self) -> bool:
        return self.required or (not self.name.startswith("--") and self.nargs not in ("?", "*"))


@dataclass(frozen=True)
class Benchmark:
    """One benchmark: what it measures, what its figures are held to, what they depend on.

    name: of its module benchmarks.NAME, which has `measure(options) -> content`, its results, and,
    where it is confirmable, `outcome(case) -> content`, what the measured code gives on a small
    fixed case; and of its results file.
    measures: in a sentence. minutes: about how many it takes, on two cores.
    entries: modules of t2twin whose code it measures without importing them itself, because it runs
    a command or reads what a command has made. It depends on these, on what it imports, and on
    all that they import.
    apart_from: modules, or packages, which it imports but which change none of its figures.
    shapes: whether its figures depend on the shapes' parameters.
    confirmable: whether its figures depend on the code alone, so that an equal outcome proves them.
    times: parts of a confirmable one's results, as paths, that are times, or depend on the machine
    otherwise: they stay those of the measurement.
    baseline: whether its results are a baseline that a test holds every run to: they are written
    only when asked, and never stale.
    """

    name: str
    measures: str
    minutes: float
    figures: tuple[Figure, ...] = ()
    arguments: tuple[Argument, ...] = ()
    entries: tuple[str, ...] = ()
    apart_from: tuple[str, ...] = ()
    shapes: bool = True
    confirmable: bool = False
    times: tuple[str, ...] = ()
    baseline: bool = False

    @property
    def module(self) -> str:
        return f"benchmarks.{self.name}"

    @property
    def results(self) -> Path:
        return RESULTS / f"{self.name}.json"

    @property
    def needs_arguments(self) -> bool:
        return any(argument.must_be_given for argument in self.arguments)

    def measure(self, options: Namespace) -> dict[str, Any]:
        """The content of its results file, but for its provenance."""
        return import_module(self.module).measure(options)

    def outcome(self, case: "SmallCase") -> dict[str, Any]:
        """What the measured code gives on the small case."""
        return import_module(self.module).outcome(case)
