"""The log of a training: log.jsonl, one record per epoch and line.

last.safetensors contains the same records as one JSON list, from which a training resumes.
"""

import json
import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Any

from msgspec import Meta

from t2twin.core.errors import T2TwinError
from t2twin.core.files import atomic_write
from t2twin.core.records import convert, decode_json
from t2twin.translate.runs.config import LOG

LOSS = "train_"
"""Prefix of the keys of losses in log.jsonl."""


GREY = "val_rmse_grey"
"""Key of a run that predicts images, in place of "val_rmse_counts"."""


@dataclass(frozen=True)
class EpochRecord:
    """One epoch.

    epoch: its number, from 1. train: the model's losses, averaged over the steps of the epoch.
    val_rmse_counts, val_rmse_percent: RMSE on the validation split, counts and percent of full
    scale. seconds: duration. val_rmse_grey: for a run that predicts images, the RMSE of their
    pixels, grey levels; val_rmse_counts is None then. val_shear_error: for a run that predicts the
    shear force, Translator.shear_error on the validation split; val_contact_error_mm: the same of
    Translator.contact_error.
    """

    epoch: Annotated[int, Meta(ge=1)]
    learning_rate: Annotated[float, Meta(ge=0)]
    train: dict[str, float]
    val_rmse_counts: Annotated[float, Meta(ge=0)] | None
    val_rmse_percent: Annotated[float, Meta(ge=0)]
    seconds: Annotated[float, Meta(ge=0)]
    val_rmse_grey: Annotated[float, Meta(ge=0)] | None = None
    val_shear_error: Annotated[float, Meta(ge=0)] | None = None
    val_contact_error_mm: Annotated[float, Meta(ge=0)] | None = None

    @property
    def error(self) -> float:
        """What the best epoch has the least of: the product of the errors there are."""
        others = (self.val_shear_error or 1.0) * (self.val_contact_error_mm or 1.0)
        return self.val_rmse_percent * others

    def __post_init__(self) -> None:
        if (self.val_rmse_counts is None) == (self.val_rmse_grey is None):
            raise ValueError("there must be one of val_rmse_counts and val_rmse_grey")


@dataclass(frozen=True)
class EpochPart:
    """The steps that were done of an epoch, in a state saved before its end.

    steps: their number. losses: the model's, summed over them. seconds: duration.
    """

    steps: Annotated[int, Meta(ge=0)] = 0
    losses: dict[str, float] = field(default_factory=dict)
    seconds: Annotated[float, Meta(ge=0)] = 0.0


def best_epoch(history: Sequence[EpochRecord]) -> EpochRecord:
    """The epoch with the lowest validation error, the first of equals. history: not empty."""
    return min(history, key=lambda record: record.error)


def read_log(run_dir: Path) -> list[EpochRecord]:
    """Reads a run's log.jsonl, which has at least one epoch.

    Raises T2TwinError if it is missing or empty, if a line is not the record of an epoch, and if
    the epochs are not consecutive.
    """
    path = run_dir / LOG
    if not path.is_file():
        raise T2TwinError(
            f"{run_dir} has no {LOG}: its first epoch is not finished; `t2twin train` finishes it"
        )
    try:
        lines = path.read_text().splitlines()
    except (OSError, UnicodeDecodeError) as error:
        raise T2TwinError(f"{path} cannot be read as text") from error
    if not lines:
        raise T2TwinError(f"{path} is empty; train again into another folder")
    sources = [f"{path}, line {number}" for number in range(1, len(lines) + 1)]
    contents = [
        decode_json(line, dict[str, Any], source)
        for line, source in zip(lines, sources, strict=True)
    ]
    return _history(contents, sources)


def write_log(run_dir: Path, history: Sequence[EpochRecord]) -> None:
    """Writes RUN/log.jsonl; replaces an earlier one."""
    with atomic_write(run_dir / LOG) as temporary:
        temporary.write_text("".join(json.dumps(to_json(record)) + "\n" for record in history))


def encode_history(history: Sequence[EpochRecord]) -> str:
    """The records as a JSON list, for a saved state."""
    return json.dumps([to_json(record) for record in history])


def decode_history(text: str, source: object) -> list[EpochRecord]:
    """Inverse of encode_history. source: name of the text in messages.

    Raises T2TwinError for other text.
    """
    contents = decode_json(text, list[dict[str, Any]], source)
    return _history(contents, [f"{source}, epoch {n}" for n in range(1, len(contents) + 1)])


def to_json(record: EpochRecord) -> dict[str, float]:
    """A record as in log.jsonl, with keys train_NAME for losses and without None.

    Raises T2TwinError for values that are not finite, which JSON cannot represent.
    """
    content = {
        "epoch": record.epoch,
        "learning_rate": record.learning_rate,
        **{f"{LOSS}{name}": value for name, value in record.train.items()},
        "val_rmse_counts": record.val_rmse_counts,
        "val_rmse_percent": record.val_rmse_percent,
        GREY: record.val_rmse_grey,
        "val_shear_error": record.val_shear_error,
        "val_contact_error_mm": record.val_contact_error_mm,
        "seconds": record.seconds,
    }
    known = {name: value for name, value in content.items() if value is not None}
    for name, value in known.items():
        if not math.isfinite(value):
            raise T2TwinError(
                f"{name} of epoch {record.epoch} is {value}; train again with a preset of a lower "
                "learning rate"
            )
    return known


def _history(contents: list[dict[str, Any]], sources: list[str]) -> list[EpochRecord]:
    history = []
    for content, source in zip(contents, sources, strict=True):
        losses = {k.removeprefix(LOSS): v for k, v in content.items() if k.startswith(LOSS)}
        whole = ({"val_rmse_counts": None} if GREY in content else {}) | content
        history.append(convert({**whole, "train": losses}, EpochRecord, source))
        if history[-1].epoch != len(history):
            raise T2TwinError(
                f"{source}: epoch is {history[-1].epoch}; it must be {len(history)}, as epochs "
                "are consecutive"
            )
    return history
