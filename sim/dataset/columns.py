"""Columns and rows of a dataset's shards.

Columns of a sensor start with its role, "source_" or "target_".
"""

import json
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import pyarrow as pa

from t2twin.sim.contact.types import TILT
from t2twin.sim.sampling.plan import file_stem
from t2twin.sim.sampling.recipe import Recipe
from t2twin.sim.sensors.defaults import ROLES

if TYPE_CHECKING:  # the sensors take a second to import, and reading a dataset needs none
    from t2twin.sim.touch import Touch

POSE = ("x_mm", "y_mm", "yaw_rad", "force_n")
"""Columns of the press: fields of PressCommand."""

TILTED_POSE = (*POSE, *TILT)
"""Those of recipes that sample a tilt."""

IMAGE_TYPE = pa.struct([("bytes", pa.binary()), ("path", pa.string())])

IMAGE, COUNTS = "image", "counts"
"""Columns of a gel camera's image and of a taxel array's counts, after the role."""

VALUES = {IMAGE: IMAGE_TYPE, COUNTS: pa.list_(pa.uint16())}
"""Types of the columns of a sensor's value."""

CONTACT = {
    "depth_mm": pa.float64(),
    "force_n": pa.float64(),
    "settled": pa.bool_(),
    "bottomed": pa.bool_(),
}
"""Columns of a sensor's contact."""

NO_CONTACT = {"depth_mm": 0.0, "force_n": 0.0, "settled": True, "bottomed": False}
"""Their values in a press of 0 N, which has no contacts."""

PRESS = {
    "shape": pa.string(),
    "family": pa.string(),
    "split": pa.string(),
    "index": pa.int32(),
    **dict.fromkeys(POSE, pa.float64()),
}
"""Columns of a press, without a role."""

UNIT, BACKGROUND, MARKERS = "unit", "background", "markers"
"""Further columns of gel cameras in most recipes: the number of the unit in its part, its
background frame, and with motion whether it has markers."""

CONTACT_MAPS = {"depth_map_um": pa.int16(), "pressure_map_hpa": pa.uint32()}
"""Further columns of gel cameras in recipes with contact maps (t2twin.sim.optical.gel_camera),
micrometers and hectopascals, row by row of the cells."""

DENSE_COUNTS = "dense_counts"
"""Further column of taxel arrays in most recipes: the dense counts."""

PATH = "path"
"""Column of recipes with motion: index of the press that a path started with. Rows of one shape
with the same are touches of one path, in their order."""

MOTION = ("friction", "shear_x_n", "shear_y_n", "torque_nmm", "slip_share")
"""Further columns of each sensor in recipes with motion."""

TRACTIONS = ("pressure_kpa", "shear_x_kpa", "shear_y_kpa")
"""Further columns of taxel arrays in recipes with motion and dense counts: pressure and shear on
the cover (t2twin.sim.taxels.pads.DenseGrid.tractions)."""

Values = Mapping[str, str]
"""The value of each role: IMAGE or COUNTS."""


def column(role: str, name: str) -> str:
    """The column of a sensor."""
    return f"{role}_{name}"


def schema_of(values: Values, recipe: Recipe | None) -> pa.Schema:
    """The columns of a recipe's shards, without a recipe those of every dataset."""
    columns = dict(PRESS) | dict.fromkeys(pose_of(recipe), pa.float64())
    columns |= {column(role, values[role]): VALUES[values[role]] for role in ROLES}
    columns |= {column(role, name): kind for role in ROLES for name, kind in CONTACT.items()}
    if recipe is not None and recipe.has_more:
        for role in ROLES:
            own = {}
            if values[role] == IMAGE:
                own[UNIT] = pa.int64()
                own |= {BACKGROUND: IMAGE_TYPE} if recipe.background_frames else {}
                own |= {MARKERS: pa.bool_()} if recipe.motion else {}
                if recipe.contact_maps:
                    own |= {name: pa.list_(kind) for name, kind in CONTACT_MAPS.items()}
            elif recipe.dense_counts:
                own[DENSE_COUNTS] = pa.list_(pa.uint16())
                own |= dict.fromkeys(TRACTIONS if recipe.motion else (), pa.list_(pa.float32()))
            columns |= {column(role, name): kind for name, kind in own.items()}
        if recipe.motion:
            columns[PATH] = pa.int32()
            columns |= {column(role, name): pa.float64() for role in ROLES for name in MOTION}
    return with_features(pa.schema(list(columns.items())))


def pose_of(recipe: Recipe | None) -> tuple[str, ...]:
    """The columns of the press in a recipe's shards, without a recipe those of every dataset."""
    return TILTED_POSE if recipe is not None and recipe.has_tilt else POSE


def with_features(schema: pa.Schema) -> pa.Schema:
    """The schema with metadata from which Hugging Face's `datasets` reads the column types."""
    features = {field.name: _feature(field.type) for field in schema}
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


def row(touch: "Touch", roles: Mapping[str, str], index: int, split: str) -> dict[str, Any]:
    """The columns of the base schema of one press. roles: of the sensors by their names."""
    shape, command = touch.command.shape, vars(touch.command)
    columns = {**command, "family": family_of(shape), "split": split, "index": index}
    for name, role in roles.items():
        reading = touch.readings[name]
        own = reading.row(f"{file_stem(shape)}-{index}-{role}.png")
        for key in CONTACT:
            found = reading.contact is not None
            own[key] = getattr(reading.contact, key) if found else NO_CONTACT[key]
        columns |= {column(role, key): value for key, value in own.items()}
    return columns


def dense_row(touch: "Touch", roles: Mapping[str, str], with_tractions: bool) -> dict[str, Any]:
    """The columns of the dense counts of one touch."""
    columns = {}
    for name, role in roles.items():
        own = touch.readings[name].dense_row(with_tractions)
        columns |= {column(role, key): value for key, value in own.items()}
    return columns


def contact_row(touch: "Touch", roles: Mapping[str, str]) -> dict[str, Any]:
    """The columns of the contact maps of one touch."""
    columns = {}
    for name, role in roles.items():
        own = touch.readings[name].contact_row()
        columns |= {column(role, key): value for key, value in own.items()}
    return columns


def motion_row(
    touch: "Touch", roles: Mapping[str, str], path: int, friction: Mapping[str, float]
) -> dict[str, Any]:
    """The columns of motion of one touch, zero without contact.

    path: index of the first touch of its path. friction: by the sensors' names.
    """
    columns: dict[str, Any] = {PATH: path}
    for name, role in roles.items():
        contact = touch.contacts.get(name)
        values = [friction[name]] + [0.0] * (len(MOTION) - 1)
        if contact is not None:
            values[1:] = *contact.shear_n.tolist(), contact.torque_nmm, contact.slip_share
        columns |= {column(role, n): value for n, value in zip(MOTION, values, strict=True)}
    return columns


RANDOM_FAMILY = "random"
"""Family of random shapes."""


def family_of(shape: str) -> str:
    """The tool of `pliers/teeth`, the primitive family of `square-2`, `random` of `random-17`."""
    return shape.split("/")[0] if "/" in shape else shape.rpartition("-")[0] or shape
