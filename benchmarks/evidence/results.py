"""Results files: benchmarks/results/NAME.json, the content and where it comes from."""

import json
from dataclasses import dataclass
from math import isfinite
from pathlib import Path
from typing import Any

import msgspec

from benchmarks.evidence.provenance import Provenance
from t2twin.core.errors import T2TwinError
from t2twin.core.files import atomic_write
from t2twin.core.records import convert

MEASURED_ON = "measured_on"
"""The key of the provenance; all others are the content's."""


@dataclass(frozen=True)
class Results:
    """What a results file holds."""

    measured_on: Provenance
    content: dict[str, Any]


def read_results(path: Path) -> Results:
    """Raises T2TwinError where there is no file, or one without provenance."""
    if not path.is_file():
        raise T2TwinError(f"there is no {path.name}; python -m benchmarks.{path.stem} makes it")
    try:
        content = json.loads(path.read_bytes())
    except ValueError:
        raise T2TwinError(f"{path} is damaged: it is not JSON") from None
    measured_on = content.pop(MEASURED_ON, None)
    return Results(convert(measured_on, Provenance, f"{path}: {MEASURED_ON}"), content)


def write_results(path: Path, results: Results) -> None:
    """Whole or not at all. JSON has no NaN and no infinity: they become null."""
    whole = {MEASURED_ON: msgspec.to_builtins(results.measured_on), **results.content}
    with atomic_write(path) as temporary:
        temporary.write_text(json.dumps(_finite(whole), indent=1, allow_nan=False) + "\n")


def _finite(content: Any) -> Any:
    if isinstance(content, dict):
        return {key: _finite(part) for key, part in content.items()}
    if isinstance(content, list | tuple):
        return [_finite(part) for part in content]
    return None if isinstance(content, float) and not isfinite(content) else content
