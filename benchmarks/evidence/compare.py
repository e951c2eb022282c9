"""Compares measured results with the committed ones."""

import json
from dataclasses import dataclass
from pathlib import Path

from benchmarks import ROOT
from benchmarks.evidence.record import Benchmark, Figure
from benchmarks.evidence.results import MEASURED_ON, git, read_results
from benchmarks.evidence.run import figures
from t2twin.core.errors import T2TwinError

MIN_CHANGE = 0.1
"""Smallest relative change that is listed (assumed: more than the noise of most figures)."""


@dataclass(frozen=True)
class Change:
    """A figure that differs from the committed one.

    is_worse: whether the change is toward the figure's limit; None for a figure without a limit.
    """

    path: str
    before: float | None
    after: float | None
    unit: str
    is_worse: bool | None

    def __str__(self) -> str:
        before, after = (f"{v:.4g}" if v is not None else "none" for v in (self.before, self.after))
        rating = {True: "  REGRESSION", False: "  better", None: ""}[self.is_worse]
        return f"  {self.path}: {before} -> {after} {self.unit}".rstrip() + rating


def changes(benchmark: Benchmark, root: Path = ROOT) -> tuple[list[Change], str]:
    """The figures whose results changed by more than MIN_CHANGE since the checked-out commit, and
    the processor of the committed results if it is another one, else an empty string.

    Both are empty without committed results or without new ones. Raises T2TwinError for results
    that cannot be read.
    """
    place = benchmark.results.relative_to(root)
    text = git("show", f"HEAD:{place.as_posix()}", root=root)
    if text is None or not benchmark.results.is_file():
        return [], ""
    new, old = read_results(benchmark.results), json.loads(text)
    processor = old.pop(MEASURED_ON).get("processor") or ""
    try:
        before = {path: value for path, value, _ in figures(benchmark, old)}
    except T2TwinError:  # the committed results are of another layout
        return [], ""
    found = [
        Change(path, before[path], value, figure.unit, _is_worse(before[path], value, figure))
        for path, value, figure in figures(benchmark, new.content)
        if path in before and _differs(before[path], value)
    ]
    return found, "" if processor == new.measured_on.processor else processor


def _differs(before: float | None, after: float | None) -> bool:
    if before is None or after is None:
        return before is not after
    return abs(after - before) > MIN_CHANGE * abs(before)


def _is_worse(before: float | None, after: float | None, figure: Figure) -> bool | None:
    if figure.most is None and figure.least is None:
        return None
    if before is None or after is None:
        return after is None
    return after > before if figure.most is not None else after < before
