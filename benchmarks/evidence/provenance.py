"""Where the figures of a results file come from: which code, which machine, when, how."""

import os
import platform
import shlex
import subprocess
from dataclasses import dataclass, field
from datetime import UTC, datetime
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

from benchmarks import ROOT
from benchmarks.evidence.record import Benchmark
from benchmarks.evidence.sources import SourceTree

PACKAGES = (
    "t2twin",
    "mujoco",
    "numpy",
    "scipy",
    "numba",
    "torch",
    "cadquery",
    "pillow",
    "pyarrow",
    "scikit-image",
    "onnxruntime",
)
"""Those whose versions may change a figure."""

CPUINFO = Path("/proc/cpuinfo")
UNKNOWN = "unknown"


@dataclass(frozen=True)
class Confirmation:
    """When the same outcome proved that other sources change nothing. commit as in Provenance."""

    commit: str
    date: str


@dataclass(frozen=True)
class Provenance:
    """How a results file came about.

    commit: of the repository; a + behind it where sources that count were changed since. date: with
    time zone. versions: of Python and packages. load_average: over the last minute, at the start.
    sources, shapes: digests of the code and of the shapes' parameters that the figures depend on,
    None where they were not kept. outcome: what the code gave on the small case, None where the
    benchmark has none. confirmed: None where the sources are those of the measurement.
    What was not kept of the machine is None.
    """

    commit: str
    date: str
    command: str
    versions: dict[str, str]
    processor: str | None = None
    cores: int | None = None
    load_average: float | None = None
    sources: dict[str, str] | None = None
    shapes: dict[str, str] | None = None
    outcome: dict[str, Any] | None = None
    confirmed: Confirmation | None = None


@dataclass(frozen=True)
class Moment:
    """The code and the machine at the start of a measurement."""

    commit: str
    load_average: float
    date: str = field(default_factory=lambda: now())


def moment(benchmark: Benchmark, tree: SourceTree) -> Moment:
    """Taken before measuring, which itself loads the machine and takes time."""
    return Moment(commit_of(benchmark, tree), round(os.getloadavg()[0], 2))


def provenance(
    benchmark: Benchmark,
    tree: SourceTree,
    start: Moment,
    arguments: list[str],
    outcome: dict[str, Any] | None,
) -> Provenance:
    """Of a measurement that is done. arguments: those of its command."""
    sources = tree.sources_of(benchmark)
    return Provenance(
        commit=start.commit,
        date=start.date,
        command=shlex.join(["python", "-m", benchmark.module, *arguments]),
        versions=versions(),
        processor=processor(),
        cores=os.cpu_count(),
        load_average=start.load_average,
        sources=sources.code,
        shapes=sources.shapes,
        outcome=outcome,
    )


def now() -> str:
    return datetime.now(UTC).isoformat(timespec="seconds")


def commit_of(benchmark: Benchmark, tree: SourceTree) -> str:
    """The present commit, with a + where a file that the benchmark depends on differs from it."""
    commit = _git("rev-parse", "--short=12", "HEAD")
    if commit is None:
        return UNKNOWN
    # Git knows the real files, not the links of the package.
    files = [str(path.resolve()) for path in tree.files_of(benchmark)]
    return f"{commit}+" if _git("status", "--porcelain", "--", *files) else commit


def versions() -> dict[str, str]:
    """Of Python and of PACKAGES, those that are installed."""
    installed = {"python": platform.python_version()}
    for name in PACKAGES:
        try:
            installed[name] = version(name)
        except PackageNotFoundError:
            continue
    return installed


def processor() -> str:
    """The processor's name as the system gives it."""
    lines = CPUINFO.read_text().splitlines() if CPUINFO.is_file() else []
    names = (line.partition(":")[2].strip() for line in lines if line.startswith("model name"))
    return next(names, platform.processor() or platform.machine())


def _git(*arguments: str) -> str | None:
    """What a git command says, None where there is no repository."""
    try:
        done = subprocess.run(
            ["git", *arguments], cwd=ROOT, capture_output=True, text=True, check=True
        )
    except (OSError, subprocess.CalledProcessError):
        return None
    return done.stdout.strip()
