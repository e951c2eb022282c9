"""Results files: benchmarks/results/NAME.json, the content and its provenance."""

import json
import os
import platform
import shlex
import subprocess
from dataclasses import dataclass
from datetime import UTC, datetime
from importlib.metadata import PackageNotFoundError, version
from math import isfinite
from pathlib import Path
from typing import Any

import msgspec

from benchmarks import ROOT
from t2twin.core.errors import T2TwinError
from t2twin.core.files import atomic_write
from t2twin.core.records import convert

MEASURED_ON = "measured_on"
"""Key of the provenance; all other keys are the content's."""

PACKAGES = ("t2twin", "mujoco", "numpy", "scipy", "numba", "torch", "cadquery", "pillow", "pyarrow",
            "scikit-image", "onnxruntime")  # fmt: skip
"""Packages whose versions may change a figure."""

CPUINFO = Path("/proc/cpuinfo")


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


def provenance(module: str, arguments: list[str]) -> Provenance:
    """The provenance of a measurement that starts now: `python -m module arguments`."""
    return Provenance(
        commit=_current_commit(),
        date=_now(),
        command=shlex.join(["python", "-m", module, *arguments]),
        versions=versions(),
        processor=processor(),
        cores=os.cpu_count(),
        load_average=round(os.getloadavg()[0], 2),
    )


def read_results(path: Path) -> Results:
    """Raises T2TwinError if there is no file, or if it has no provenance."""
    if not path.is_file():
        raise T2TwinError(f"there is no {path.name}; python -m benchmarks.{path.stem} writes it")
    try:
        content = json.loads(path.read_bytes())
    except ValueError:
        raise T2TwinError(f"{path} is damaged: it is not JSON") from None
    measured_on = content.pop(MEASURED_ON, None)
    return Results(convert(measured_on, Provenance, f"{path}: {MEASURED_ON}"), content)


def write_results(path: Path, results: Results) -> None:
    """Writes a results file atomically. NaN and infinity, which JSON lacks, become null."""
    whole = {MEASURED_ON: msgspec.to_builtins(results.measured_on), **results.content}
    with atomic_write(path) as temporary:
        temporary.write_text(json.dumps(_finite(whole), indent=1, allow_nan=False) + "\n")


def _now() -> str:
    return datetime.now(UTC).isoformat(timespec="seconds")


def _current_commit() -> str:
    """The checked-out commit, with a + for uncommitted changes; "unknown" without git history."""
    commit = git("rev-parse", "--short=12", "HEAD")
    if commit is None:
        return "unknown"
    return f"{commit}+" if git("status", "--porcelain", "--untracked-files=no") else commit


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
    lines = CPUINFO.read_text().splitlines() if CPUINFO.is_file() else []
    names = (line.partition(":")[2].strip() for line in lines if line.startswith("model name"))
    return next(names, platform.processor() or platform.machine())


def _finite(content: Any) -> Any:
    if isinstance(content, dict):
        return {key: _finite(part) for key, part in content.items()}
    if isinstance(content, list | tuple):
        return [_finite(part) for part in content]
    return None if isinstance(content, float) and not isfinite(content) else content
