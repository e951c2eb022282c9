"""What a training says of its epochs: log.jsonl, one record a line, read and written here.

The same records are kept in last.safetensors, as one JSON list, for the training to go on from.
"""

import json
import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

from msgspec import Meta

from t2twin.core.errors import T2TwinError
from t2twin.core.files import atomic_write
from t2twin.core.records import convert, decode_json
from t2twin.translate.runs.config import LOG

LOSS = "train_"
"""What a loss's key begins with in log.jsonl."""


GREY = "val_rmse_grey"
"""The key of a run that draws pictures, which has none for counts."""


@dataclass(frozen=True)
class EpochRecord:
    """One epoch.

    epoch: its number, from 1. train: each of the model's losses, averaged over the epoch's steps.
    val_rmse_counts, val_rmse_percent: the RMSE on the validation split, in counts and in percent of
    full scale. seconds: that the epoch took. val_rmse_grey: in place of the counts, which are then
    None, of a run that draws DIGIT pictures: the RMSE of their pixels, grey levels.
    """

    epoch: Annotated[int, Meta(ge=1)]
    learning_rate: Annotated[float, Meta(ge=0)]
    train: dict[str, float]
    val_rmse_counts: Annotated[float, Meta(ge=0)] | None
    val_rmse_percent: Annotated[float, Meta(ge=0)]
    seconds: Annotated[float, Meta(ge=0)]
    val_rmse_grey: Annotated[float, Meta(ge=0)] | None = None

    def __post_init__(self) -> None:
        if (self.val_rmse_counts is None) == (self.val_rmse_grey is None):
            raise ValueError("there must be one of val_rmse_counts and val_rmse_grey")


def best_epoch(history: Sequence[EpochRecord]) -> EpochRecord:
    """The one with the lowest validation RMSE, the first of equals. history: not empty."""
    return min(history, key=lambda record: record.val_rmse_percent)


def read_log(run_dir: Path) -> list[EpochRecord]:
    """A run's log.jsonl, at least one epoch.

    Raises T2TwinError where it is missing or empty, and where a line is no epoch's record, or
    not of the epoch after that of the line before.
    """
    path = run_dir / LOG
    if not path.is_file():
        raise T2TwinError(
            f"{run_dir} holds no {LOG}: its first epoch is not finished; `t2twin train` finishes it"
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
    """Writes RUN/log.jsonl, over an earlier one."""
    with atomic_write(run_dir / LOG) as temporary:
        temporary.write_text("".join(json.dumps(to_json(record)) + "\n" for record in history))


def encode_history(history: Sequence[EpochRecord]) -> str:
    """The records as one JSON list, for a saved state."""
    return json.dumps([to_json(record) for record in history])


def decode_history(text: str, source: object) -> list[EpochRecord]:
    """The records of encode_history. source: where the text is from, for messages.

    Raises T2TwinError for any other text.
    """
    contents = decode_json(text, list[dict[str, Any]], source)
    return _history(contents, [f"{source}, epoch {n}" for n in range(1, len(contents) + 1)])


def to_json(record: EpochRecord) -> dict[str, float]:
    """A record as log.jsonl has it, each loss under a key of its own: train_NAME. What is None is
    left out.

    Raises T2TwinError for a value that is infinite or no number, which JSON does not have.
    """
    content = {
        "epoch": record.epoch,
        "learning_rate": record.learning_rate,
        **{f"{LOSS}{name}": value for name, value in record.train.items()},
        "val_rmse_counts": record.val_rmse_counts,
        "val_rmse_percent": record.val_rmse_percent,
        GREY: record.val_rmse_grey,
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
                "follow each other"
            )
    return history
