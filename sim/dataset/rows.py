"""Rows of a dataset's shards."""

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from t2twin.sim.dataset.columns import FIELD, UNIT, UNTOUCHED
from t2twin.sim.world.plan import file_stem

if TYPE_CHECKING:  # the sensors take a second to import, and reading a dataset needs none
    from t2twin.sim.press.records import PressCommand
    from t2twin.sim.sensors import Sample


@dataclass(frozen=True)
class More:
    """What a pair of most worlds holds besides. unit: the number of its DIGIT in the part. field:
    (n,) uint16 or None. untouched: that DIGIT's picture untouched, PNG bytes, or None."""

    unit: int
    field: np.ndarray | None
    untouched: bytes | None


def row(
    sample: "Sample", picture: bytes, index: int, family: str, split: str, more: More | None
) -> dict[str, Any]:
    """A sample as a row of the table. picture: its image as PNG bytes."""
    felt = {}
    for sensor, contact in (("digit", sample.digit), ("cyskin", sample.cyskin)):
        felt |= {
            f"{sensor}_depth_mm": contact.depth_mm,
            f"{sensor}_force_n": contact.force_n,
            f"{sensor}_settled": contact.settled,
            f"{sensor}_bottomed": contact.bottomed,
        }
    return _row(sample.command, sample.counts, picture, index, family, split, more) | felt


def untouched_row(
    command: "PressCommand",
    counts: np.ndarray,
    picture: bytes,
    index: int,
    family: str,
    split: str,
    more: More | None,
) -> dict[str, Any]:
    """The row of a press in which nothing touched: at rest, without depth and force."""
    felt = {}
    for sensor in ("digit", "cyskin"):
        felt |= {f"{sensor}_depth_mm": 0.0, f"{sensor}_force_n": 0.0}
        felt |= {f"{sensor}_settled": True, f"{sensor}_bottomed": False}
    return _row(command, counts, picture, index, family, split, more) | felt


def _row(
    command: "PressCommand",
    counts: np.ndarray,
    picture: bytes,
    index: int,
    family: str,
    split: str,
    more: More | None,
) -> dict[str, Any]:
    stem = file_stem(command.shape)
    there = {
        "shape": command.shape,
        "family": family,
        "split": split,
        "index": index,
        "x_mm": command.x_mm,
        "y_mm": command.y_mm,
        "yaw_rad": command.yaw_rad,
        "force_n": command.force_n,
        "image": {"bytes": picture, "path": f"{stem}-{index}.png"},
        "taxels": counts,
    }
    if more is not None:
        there[UNIT] = more.unit
        if more.field is not None:
            there[FIELD] = more.field
        if more.untouched is not None:
            there[UNTOUCHED] = {"bytes": more.untouched, "path": f"untouched-{more.unit}.png"}
    return there
