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
    command: "PressCommand",
    sample: "Sample | None",
    counts: np.ndarray,
    picture: bytes,
    index: int,
    family: str,
    split: str,
    more: More | None,
) -> dict[str, Any]:
    """A press as a row of the table. sample: None where nothing touched, at rest, without depth and
    force. counts: (n,) uint16. picture: the image as PNG bytes."""
    there = {
        "shape": command.shape,
        "family": family,
        "split": split,
        "index": index,
        "x_mm": command.x_mm,
        "y_mm": command.y_mm,
        "yaw_rad": command.yaw_rad,
        "force_n": command.force_n,
        "image": {"bytes": picture, "path": f"{file_stem(command.shape)}-{index}.png"},
        "taxels": counts,
    }
    contacts = (None, None) if sample is None else (sample.digit, sample.cyskin)
    for sensor, contact in zip(("digit", "cyskin"), contacts, strict=True):
        there |= {
            f"{sensor}_depth_mm": 0.0 if contact is None else contact.depth_mm,
            f"{sensor}_force_n": 0.0 if contact is None else contact.force_n,
            f"{sensor}_settled": contact is None or contact.settled,
            f"{sensor}_bottomed": contact is not None and contact.bottomed,
        }
    if more is not None:
        there[UNIT] = more.unit
        if more.field is not None:
            there[FIELD] = more.field
        if more.untouched is not None:
            there[UNTOUCHED] = {"bytes": more.untouched, "path": f"untouched-{more.unit}.png"}
    return there
