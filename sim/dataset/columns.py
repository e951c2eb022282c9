"""The columns of a dataset: TABLE. Those of a sensor start with its role and an underscore."""

import json
import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from math import prod
from typing import TYPE_CHECKING, Any

import numpy as np
import pyarrow as pa

from t2twin.core.images import encode_png
from t2twin.sim.dataset.info import COUNTS, IMAGE, ArrayInfo, CameraInfo
from t2twin.sim.sampling.plan import file_stem
from t2twin.sim.sampling.recipe import Recipe
from t2twin.sim.sensors.defaults import ROLES

if TYPE_CHECKING:  # the sensors take a second to import, and reading a dataset needs none
    from t2twin.sim.touch import Touch

IMAGE_TYPE = pa.struct([("bytes", pa.binary()), ("path", pa.string())])
COUNTS_TYPE = pa.list_(pa.uint16())

POSE = ("x_mm", "y_mm", "yaw_rad", "force_n")  # of the press: fields of PressCommand

# Columns of a sensor's contact, with their values in a press of 0 N, which has no contacts
CONTACT = {"depth_mm": 0.0, "force_n": 0.0, "settled": True, "bottomed": False}
UNIT, BACKGROUND, MARKERS = "unit", "background", "markers"
DENSE_COUNTS = "dense_counts"
CONTACT_MAPS = ("depth_map_um", "pressure_map_hpa")
TRACTIONS = ("pressure_kpa", "shear_x_kpa", "shear_y_kpa")
MOTION = ("friction", "shear_x_n", "shear_y_n", "torque_nmm", "slip_share")
PATH = "path"
RANDOM_FAMILY = "random"  # of random shapes
Values = Mapping[str, str]  # of each role, IMAGE or COUNTS


@dataclass(frozen=True)
class Sample:
    """What the columns of a row are computed from."""

    touch: "Touch"
    index: int  # of the touch among the shape's
    split: str
    path: int  # index of the first touch of its path
    friction: Mapping[str, float]  # by the sensors' names
    units: Mapping[str, Mapping[str, Any]]  # by role, the columns of the gel cameras' units

    def reading(self, role: str) -> Any:
        """The reading of the sensor of a role."""
        return [*self.touch.readings.values()][ROLES.index(role)]


@dataclass(frozen=True)
class Column:
    """A column."""

    name: str  # after the role, for a sensor's
    type: pa.DataType
    unit: str
    about: str
    value: Callable[[Sample, str], Any]  # of a sample and a role
    # of the sensors that have it; "press" without a role, "sensor" for both kinds
    kind: str = "press"
    when: Callable[[Recipe], object] | None = None  # whether a recipe's pairs have it; None for all
    size: Callable[[Any], int] | None = None  # values in a list of a sensor
    role: str = ""  # of the sensor, in a dataset; "" in TABLE and for a column of the press

    @property
    def full_name(self) -> str:
        """The name in a dataset."""
        return column(self.role, self.name) if self.role else self.name


def _pose(name: str, unit: str, about: str, when: Any = None) -> Column:
    return Column(
        name, pa.float64(), unit, about, lambda s, _: getattr(s.touch.command, name), when=when
    )


def _contact(name: str, unit: str, about: str, of: Any = None) -> Column:
    """A column of the contact; of: the value, of recipes with motion, None for the attribute."""
    kind = pa.bool_() if isinstance(CONTACT.get(name), bool) else pa.float64()

    def value(sample: Sample, role: str) -> Any:
        contact = sample.reading(role).contact
        if contact is None:
            return CONTACT.get(name, 0.0)
        return of(contact) if of else getattr(contact, name)

    return Column(name, kind, unit, about, value, "sensor", (lambda r: r.motion) if of else None)


def _unit(name: str, kind: pa.DataType, unit: str, about: str, when: Any) -> Column:
    return Column(name, kind, unit, about, lambda s, role: s.units[role][name], IMAGE, when)


def _traction(number: int, about: str) -> Column:
    return Column(
        TRACTIONS[number], pa.list_(pa.float32()), "kPa", about,
        lambda s, role: s.reading(role).tractions[number], COUNTS,
        lambda recipe: recipe.motion and recipe.dense_counts, _places,
    )  # fmt: skip


def _places(sensor: ArrayInfo) -> int:
    return 0 if sensor.dense_x_mm is None else sensor.dense_x_mm.size


def _cells(sensor: CameraInfo) -> int:
    return prod(sensor.contact_grid or (0,))


def _image(sample: Sample, role: str) -> dict[str, Any]:
    name = f"{file_stem(sample.touch.command.shape)}-{sample.index}-{role}.png"
    return {"bytes": encode_png(sample.reading(role).image), "path": name}


TABLE: tuple[tuple[Column, ...], ...] = (
    (
        Column("shape", pa.string(), "", "primitive (`square-2`), tool at a keypoint "
               "(`pliers/teeth`), random shape or file", lambda s, _: s.touch.command.shape),
        Column("family", pa.string(), "", "family of the shape, or tool",
               lambda s, _: re.sub("/.*|-[^-/]*$", "", s.touch.command.shape)),
        Column("split", pa.string(), "", "`train`, `val` or `test`", lambda s, _: s.split),
        Column("index", pa.int32(), "", "number among the shape's presses", lambda s, _: s.index),
        _pose("x_mm", "mm", "position of the shape's origin, to the right in the image"),
        _pose("y_mm", "mm", "position of the shape's origin, down in the image"),
        _pose("yaw_rad", "rad", "rotation about the press axis, clockwise in the image"),
        _pose("force_n", "N", "commanded force"),
        _pose("tilt_x_rad", "rad", "tilt about the shape's origin before the yaw; a positive one "
              "lowers the side that is up in the image at yaw 0", lambda r: r.has_tilt),
        _pose("tilt_y_rad", "rad", "the same; lowers the side that is right",
              lambda r: r.has_tilt),
    ),
    (
        Column(IMAGE, IMAGE_TYPE, "grey levels", "image, PNG", _image, IMAGE),
        Column(COUNTS, COUNTS_TYPE, "counts", "counts, saturated at `full_scale_counts`",
               lambda s, role: s.reading(role).counts, COUNTS, size=lambda s: s.x_mm.size),
    ),
    (
        _contact("depth_mm", "mm", "depth from first contact"),
        _contact("force_n", "N", "force carried by the contact pressure"),
        _contact("settled", "", "whether the contact solver converged"),
        _contact("bottomed", "", "whether the shape's base plate touched"),
    ),
    (
        _unit(UNIT, pa.int64(), "", "number of the unit in its part of the recipe",
              lambda r: r.dense_counts or r.background_frames or r.motion or r.contact_maps),
        _unit(BACKGROUND, IMAGE_TYPE, "grey levels", "background frame of the unit, PNG",
              lambda r: r.background_frames),
        _unit(MARKERS, pa.bool_(), "", "whether the unit has markers", lambda r: r.motion),
        Column(CONTACT_MAPS[0], pa.list_(pa.int16()), "um", "depth of the gel in the cells of "
               "`contact_grid`, row by row",
               lambda s, role: _whole(1e3 * s.reading(role).depth_map_mm, np.int16),
               IMAGE, lambda r: r.contact_maps, _cells),
        Column(CONTACT_MAPS[1], pa.list_(pa.uint32()), "0.1 kPa", "normal pressure there: force on "
               "the gel that a cell shows, over its share of the view; `view_mm` is half the width "
               "and half the height of the view",
               lambda s, role: _whole(10.0 * s.reading(role).pressure_map_kpa, np.uint32),
               IMAGE, lambda r: r.contact_maps, _cells),
        Column(DENSE_COUNTS, COUNTS_TYPE, "counts", "noiseless counts of pads at `dense_x_mm`, "
               "`dense_y_mm`", lambda s, role: s.reading(role).dense_counts,
               COUNTS, lambda r: r.dense_counts, _places),
        _traction(0, "pressure on the cover: force on the surface nearest to a place of the dense "
                     "counts, over `dense_cell_mm2`"),
        _traction(1, "shear there along x"),
        _traction(2, "shear there along y"),
    ),
    (
        Column(PATH, pa.int32(), "", "`index` of the press that a path started with; rows of one "
               "shape with the same are its touches in order", lambda s, _: s.path,
               when=lambda r: r.motion),
    ),
    (
        Column(MOTION[0], pa.float64(), "", "coefficient of friction",
               lambda s, role: [*s.friction.values()][ROLES.index(role)], "sensor",
               lambda r: r.motion),
        _contact(MOTION[1], "N", "tangential force along x", lambda c: float(c.shear_n[0])),
        _contact(MOTION[2], "N", "tangential force along y", lambda c: float(c.shear_n[1])),
        _contact(MOTION[3], "N mm", "torque about the shape's origin, clockwise",
                 lambda c: c.torque_nmm),
        _contact(MOTION[4], "", "share of the area in contact that slips", lambda c: c.slip_share),
    ),
)  # fmt: skip
"""All columns in their order. The columns of a group come for the source, then for the target."""


def columns_of(values: Values, recipe: Recipe | None) -> list[Column]:
    """The columns of a recipe's shards, without a recipe those of every dataset."""
    found = []
    for group in TABLE:
        own = [each for each in group if not each.when or (recipe and each.when(recipe))]
        found += [each for each in own if each.kind == "press"]
        for role in ROLES:
            kinds = "sensor", values[role]
            found += [replace(each, role=role) for each in own if each.kind in kinds]
    return found


def column(role: str, name: str) -> str:
    """The column of a sensor."""
    return f"{role}_{name}"


def schema_of(values: Values, recipe: Recipe | None) -> pa.Schema:
    """The schema of a recipe's shards, without a recipe that of every dataset."""
    fields = [(each.full_name, each.type) for each in columns_of(values, recipe)]
    return with_features(pa.schema(fields))


def _whole(values: np.ndarray, kind: type) -> np.ndarray:
    return np.rint(values.ravel()).astype(kind)


def with_features(schema: pa.Schema) -> pa.Schema:
    """The schema with metadata from which Hugging Face's `datasets` reads the column types."""
    features = {field.name: _feature(field.type) for field in schema}
    return schema.with_metadata({"huggingface": json.dumps({"info": {"features": features}})})


def _feature(kind: pa.DataType) -> dict[str, Any]:
    """A column type of Hugging Face's `datasets`. Its version 3 reads "Sequence", not "List"."""
    if kind == IMAGE_TYPE:
        return {"_type": "Image"}
    if pa.types.is_fixed_size_list(kind):
        own = {"feature": _feature(kind.value_type), "length": kind.list_size}
        return {**own, "_type": "Sequence"}
    if pa.types.is_list(kind):
        return {"feature": _feature(kind.value_type), "_type": "Sequence"}
    return {"dtype": type_name(kind), "_type": "Value"}


def type_name(kind: pa.DataType) -> str:
    """The name of a scalar type, as in NumPy."""
    return {"double": "float64", "float": "float32"}.get(str(kind), str(kind))
