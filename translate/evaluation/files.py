"""The files of an evaluation: metrics.json, findings.json and results.md.

    DIR/metrics.json      the result of `evaluate` on one split: an Evaluation
    DIR/findings.json     the findings of both splits, and the gap between the two
    DIR/results.md        both splits in one table

Keys of the JSON files are the attributes of the records.
"""

from collections.abc import Mapping
from dataclasses import MISSING, fields, is_dataclass
from pathlib import Path
from typing import Any

from t2twin.core.errors import T2TwinError
from t2twin.core.files import write_json
from t2twin.core.records import read_json
from t2twin.translate.evaluation.records import FORMAT, Evaluation, Finding

METRICS = "metrics.json"
FINDINGS = "findings.json"
TABLE = "results.md"


def read_evaluation(folder: Path) -> Evaluation:
    """Reads the evaluation of one split from a folder.

    Raises T2TwinError if metrics.json is missing, damaged or of another version of t2twin.
    """
    path = folder / METRICS
    if not path.is_file():
        raise T2TwinError(
            f"{folder} contains no evaluation (no {METRICS}); make one with `evaluate`"
        )
    return read_json(path, Evaluation, FORMAT)


def write_evaluation(folder: Path, evaluation: Evaluation) -> None:
    """Writes folder/metrics.json."""
    write_json(folder / METRICS, as_json(evaluation))


def write_findings(
    folder: Path, evaluations: Mapping[str, Evaluation], gap: Mapping[str, Finding]
) -> None:
    """Writes folder/findings.json: the findings of each split by name, and the "gap".

    evaluations: by split.
    """
    findings = {split: evaluation.findings for split, evaluation in evaluations.items()}
    write_json(folder / FINDINGS, as_json(findings | {"gap": gap}))


def as_json(value: Any) -> Any:
    """A record, or a dict of them, as JSON content. Fields that are None by default are omitted."""
    if is_dataclass(value):
        content = {field.name: getattr(value, field.name) for field in fields(value)}
        optional = {field.name for field in fields(value) if field.default is not MISSING}
        return {
            name: as_json(part)
            for name, part in content.items()
            if not (part is None and name in optional)
        }
    if isinstance(value, Mapping):
        return {name: as_json(part) for name, part in value.items()}
    if isinstance(value, (tuple, list)):
        return [as_json(part) for part in value]
    return value
