"""Columns of a dataset's shards, as Arrow and as Hugging Face's `datasets` read them.

Rows of a dataset's shards.
"""

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
import pyarrow as pa

from t2twin.sim.world.plan import file_stem
from t2twin.sim.world.recipe import Recipe

POSE = ("x_mm", "y_mm", "yaw_rad", "force_n")
"""Columns that say where and how hard was pressed: those of a PressCommand."""

IMAGE_TYPE = pa.struct([("bytes", pa.binary()), ("path", pa.string())])

SCHEMA = pa.schema(
    [
        ("shape", pa.string()),
        ("family", pa.string()),
        ("split", pa.string()),
        ("index", pa.int32()),
        ("x_mm", pa.float64()),
        ("y_mm", pa.float64()),
        ("yaw_rad", pa.float64()),
        ("force_n", pa.float64()),
        ("image", IMAGE_TYPE),
        ("taxels", pa.list_(pa.uint16())),
        ("digit_depth_mm", pa.float64()),
        ("digit_force_n", pa.float64()),
        ("digit_settled", pa.bool_()),
        ("digit_bottomed", pa.bool_()),
        ("cyskin_depth_mm", pa.float64()),
        ("cyskin_force_n", pa.float64()),
        ("cyskin_settled", pa.bool_()),
        ("cyskin_bottomed", pa.bool_()),
    ]
)
"""What every pair holds."""

UNIT, FIELD, UNTOUCHED = "unit", "field", "untouched"
"""What the pairs of most worlds hold besides: which DIGIT took the picture, the field's counts, and
that DIGIT's picture untouched."""

_HUGGING_FACE = {
    IMAGE_TYPE: {"_type": "Image"},
    pa.list_(pa.uint16()): {"feature": {"dtype": "uint16", "_type": "Value"}, "_type": "Sequence"},
}
"""Versions 3 to 5 of `datasets` know "Sequence"; "List" is known from 4 on only."""


def schema_of(recipe: Recipe | None) -> pa.Schema:
    """The columns of a world's shards; without one those of every pair."""
    schema = SCHEMA
    if recipe is not None and recipe.has_more:
        schema = schema.append(pa.field(UNIT, pa.int64()))
        if recipe.field:
            schema = schema.append(pa.field(FIELD, pa.list_(pa.uint16())))
        if recipe.untouched_frames:
            schema = schema.append(pa.field(UNTOUCHED, IMAGE_TYPE))
    return schema


def hugging_face(schema: pa.Schema) -> dict[str, Any]:
    """Column types as Hugging Face's `datasets` reads them from a Parquet file's metadata."""
    special = {
        field.name: _HUGGING_FACE[field.type] for field in schema if field.type in _HUGGING_FACE
    }
    plain = {
        field.name: {"dtype": str(field.type).replace("double", "float64"), "_type": "Value"}
        for field in schema
        if field.name not in special
    }
    return {"info": {"features": special | plain}}


if TYPE_CHECKING:  # the sensors take a second to import, and reading a dataset needs none
    from t2twin.sim.contact.types import PressCommand
    from t2twin.sim.sensors import Sample


@dataclass(frozen=True)
class ExtraColumns:
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
    more: ExtraColumns | None,
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
