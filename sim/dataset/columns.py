"""Columns and rows of a dataset's shards."""

import json
from typing import TYPE_CHECKING, Any

import pyarrow as pa

from t2twin.sim.sampling.plan import file_stem
from t2twin.sim.sampling.recipe import Recipe

if TYPE_CHECKING:  # the sensors take a second to import, and reading a dataset needs none
    from t2twin.sim.touch import Touch

SENSORS = ("digit", "cyskin")

POSE = ("x_mm", "y_mm", "yaw_rad", "force_n")
"""Columns of the press: fields of PressCommand."""

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
"""Columns of every dataset."""

UNIT, DENSE_COUNTS, BACKGROUND = "unit", "dense_counts", "background"
"""Further columns of most recipes: the number of the DIGIT unit in its part, the dense counts,
and the unit's background frame."""

PATH = "path"
"""Column of recipes with motion: index of the press that a path started with. Rows of one shape
with the same are touches of one path, in their order."""

MARKERS = "markers"
"""Column of recipes with motion: whether the DIGIT unit has markers."""

MOTION = ("friction", "shear_x_n", "shear_y_n", "torque_nmm", "slip_share")
"""Further columns of recipes with motion, of each sensor: its name, "_" and one of these."""

TRACTIONS = ("cover_pressure_kpa", "cover_shear_x_kpa", "cover_shear_y_kpa")
"""Further columns of recipes with motion and dense counts:
t2twin.sim.taxels.dense.dense_tractions."""


def schema_of(recipe: Recipe | None) -> pa.Schema:
    """The columns of a recipe's shards, without a recipe those of every dataset."""
    schema = SCHEMA
    if recipe is not None and recipe.has_more:
        schema = schema.append(pa.field(UNIT, pa.int64()))
        if recipe.dense_counts:
            schema = schema.append(pa.field(DENSE_COUNTS, pa.list_(pa.uint16())))
        if recipe.background_frames:
            schema = schema.append(pa.field(BACKGROUND, IMAGE_TYPE))
        if recipe.motion:
            schema = schema.append(pa.field(MARKERS, pa.bool_()))
            schema = schema.append(pa.field(PATH, pa.int32()))
            for name in (f"{sensor}_{each}" for sensor in SENSORS for each in MOTION):
                schema = schema.append(pa.field(name, pa.float64()))
            for name in TRACTIONS if recipe.dense_counts else ():
                schema = schema.append(pa.field(name, pa.list_(pa.float32())))
    return with_features(schema)


def with_features(schema: pa.Schema) -> pa.Schema:
    """The schema with metadata from which Hugging Face's `datasets` reads the column types."""
    # images and lists first, as in earlier versions, so that shards keep their bytes
    names = sorted(schema.names, key=lambda name: not pa.types.is_nested(schema.field(name).type))
    features = {name: _feature(schema.field(name).type) for name in names}
    return schema.with_metadata({"huggingface": json.dumps({"info": {"features": features}})})


def _feature(kind: pa.DataType) -> dict[str, Any]:
    """A column type of Hugging Face's `datasets`. Versions 3 to 5 read "Sequence"; "List" needs
    4."""
    if kind == IMAGE_TYPE:
        return {"_type": "Image"}
    if pa.types.is_fixed_size_list(kind):
        return {
            "feature": _feature(kind.value_type),
            "length": kind.list_size,
            "_type": "Sequence",
        }
    if pa.types.is_list(kind):
        return {"feature": _feature(kind.value_type), "_type": "Sequence"}
    return {"dtype": type_name(kind), "_type": "Value"}


def type_name(kind: pa.DataType) -> str:
    """The name of a scalar type, as in NumPy."""
    return {"double": "float64", "float": "float32"}.get(str(kind), str(kind))


def row(touch: "Touch", index: int, split: str, image: bytes) -> dict[str, Any]:
    """The columns of SCHEMA of one press. image: PNG.

    A press of 0 N has no contacts: depths and carried forces are 0, and it counts as settled.
    """
    command, contacts = touch.command, touch.contacts
    columns: dict[str, Any] = {
        "shape": command.shape,
        "family": family_of(command.shape),
        "split": split,
        "index": index,
        "x_mm": command.x_mm,
        "y_mm": command.y_mm,
        "yaw_rad": command.yaw_rad,
        "force_n": command.force_n,
        "image": {"bytes": image, "path": f"{file_stem(command.shape)}-{index}.png"},
        "taxels": touch.counts,
    }
    for sensor in SENSORS:
        contact = contacts.get(sensor)
        columns |= {
            f"{sensor}_depth_mm": 0.0 if contact is None else contact.depth_mm,
            f"{sensor}_force_n": 0.0 if contact is None else contact.force_n,
            f"{sensor}_settled": contact is None or contact.settled,
            f"{sensor}_bottomed": contact is not None and contact.bottomed,
        }
    return columns


def motion_row(
    touch: "Touch", path: int, friction: dict[str, float], with_dense_counts: bool
) -> dict[str, Any]:
    """The columns of motion of one touch, zero without contact.

    path: index of the first touch of its path. friction: by sensor. with_dense_counts: adds
    TRACTIONS.
    """
    columns: dict[str, Any] = {PATH: path}
    for sensor in SENSORS:
        contact = touch.contacts.get(sensor)
        values = [friction[sensor]] + [0.0] * (len(MOTION) - 1)
        if contact is not None:
            values[1:] = *contact.shear_n.tolist(), contact.torque_nmm, contact.slip_share
        columns |= {f"{sensor}_{n}": value for n, value in zip(MOTION, values, strict=True)}
    return columns | (
        dict(zip(TRACTIONS, touch.tractions, strict=True)) if with_dense_counts else {}
    )


RANDOM_FAMILY = "random"
"""Family of random shapes."""


def family_of(shape: str) -> str:
    """The tool of `pliers/teeth`, the primitive family of `square-2`, `random` of `random-17`."""
    return shape.split("/")[0] if "/" in shape else shape.rpartition("-")[0] or shape
