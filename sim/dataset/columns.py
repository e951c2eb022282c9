"""Columns of a dataset's shards, as Arrow and as Hugging Face's `datasets` read them."""

from typing import Any

import pyarrow as pa

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
