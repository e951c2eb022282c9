"""The log of a training: log.jsonl, one record per epoch and line.

last.safetensors contains the same records as one JSON list, from which a training resumes.
"""

from collections.abc import Sequence
from pathlib import Path
from typing import Annotated

import msgspec
from msgspec import Meta, Struct

from t2twin.core.errors import T2TwinError
from t2twin.core.files import atomic_write, read_file
from t2twin.core.records import decode_json
from t2twin.translate.runs.config import LOG

NotNegative = Annotated[float, Meta(ge=0)]


class EpochRecord(Struct, frozen=True, omit_defaults=True):
    """One epoch.

    epoch: its number, from 1. train: the model's losses, averaged over the steps of the epoch.
    val_rmse_percent: RMSE on the validation split, percent of full scale; val_rmse_counts, or
    val_rmse_grey of a run that predicts images: the same in counts or grey levels. seconds:
    duration. val_shear_error, val_contact_error_mm: of a run that predicts the shear force or the
    contact, FieldTranslator.further_errors on the validation split.
    """

    epoch: Annotated[int, Meta(ge=1)]
    learning_rate: NotNegative
    train: dict[str, float]
    val_rmse_percent: NotNegative
    seconds: NotNegative
    val_rmse_counts: NotNegative | None = None
    val_rmse_grey: NotNegative | None = None
    val_shear_error: NotNegative | None = None
    val_contact_error_mm: NotNegative | None = None

    @property
    def error(self) -> float:
        """What the best epoch has the least of: the product of the errors there are."""
        others = (self.val_shear_error or 1.0) * (self.val_contact_error_mm or 1.0)
        return self.val_rmse_percent * others

    @property
    def numbers(self) -> dict[str, float]:
        """All numbers by name, with train_NAME for losses."""
        found = msgspec.structs.asdict(self)
        losses = {f"train_{name}": value for name, value in found.pop("train").items()}
        return losses | {name: value for name, value in found.items() if value is not None}


class EpochPart(Struct, frozen=True):
    """The steps that were done of an epoch, in a state saved before its end.

    steps: their number. losses: the model's, summed over them. seconds: duration.
    """

    steps: Annotated[int, Meta(ge=0)] = 0
    losses: dict[str, float] = {}
    seconds: NotNegative = 0.0


def best_epoch(history: Sequence[EpochRecord]) -> EpochRecord:
    """The epoch with the lowest validation error, the first of equals. history: not empty."""
    return min(history, key=lambda record: record.error)


def read_log(run_dir: Path) -> list[EpochRecord]:
    """Reads a run's log.jsonl, which has at least one epoch.

    Raises T2TwinError if it is missing or empty, or if a line is not the record of an epoch.
    """
    path = run_dir / LOG
    lines = read_file(path).splitlines() if path.is_file() else []
    if not lines:
        raise T2TwinError(
            f"{run_dir} has no epoch in {LOG}: the first is not finished; `t2twin train` does it"
        )
    return [
        decode_json(line, EpochRecord, f"{path}, line {number}")
        for number, line in enumerate(lines, 1)
    ]


def write_log(run_dir: Path, history: Sequence[EpochRecord]) -> None:
    """Writes RUN/log.jsonl; replaces an earlier one."""
    with atomic_write(run_dir / LOG) as temporary:
        temporary.write_bytes(b"".join(msgspec.json.encode(each) + b"\n" for each in history))
