"""LeRobot's features of a dataset, and their values in a row.

observation.images.digit    the image
observation.images.digit_background    the DIGIT unit's background frame, if any
observation.taxels          the CySkin's counts
observation.field           the field's counts, if any
observation.cover_pressure_kpa, ...    pressure and shear on the cover at the field's places, if any
observation.digit_contact, observation.cyskin_contact    depth and force, with motion also friction,
                            shear forces, torque and share of slip
action                      the commanded pose and force
digit_settled, ...          flags of the contact solver
press_index, unit, markers  columns index, unit and markers

Features of columns without a value in every row are left out.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
import pyarrow as pa

from t2twin.sim.dataset.columns import (
    BACKGROUND,
    FIELD,
    IMAGE_TYPE,
    MARKERS,
    MOTION,
    POSE,
    SENSORS,
    TRACTIONS,
    UNIT,
)
from t2twin.sim.dataset.info import DatasetInfo

IMAGE = "image"
"""dtype of LeRobot's features of images."""

BACKGROUND_FEATURE = "observation.images.digit_background"

_TYPES = {"float32": pa.float32(), "int64": pa.int64(), "bool": pa.bool_()}


@dataclass(frozen=True)
class Feature:
    """A feature of LeRobot.

    dtype: "image", "float32", "int64" or "bool". shape: (rows, columns, 3) of an image, else
    (components,). names: of the axes of an image or of the components, if they have names. columns:
    the dataset's, either one image or list, or one scalar per component; none for the indices.
    """

    name: str
    dtype: str
    shape: tuple[int, ...]
    names: tuple[str, ...] | None
    columns: tuple[str, ...] = ()

    @property
    def arrow_type(self) -> pa.DataType:
        """The type of its column."""
        if self.dtype == IMAGE:
            return IMAGE_TYPE
        kind = _TYPES[self.dtype]
        return kind if self.shape == (1,) else pa.list_(kind, *self.shape)

    def value(self, row: dict[str, Any]) -> Any:
        """Its value in a dataset's row: {bytes, path}, (components,) float32, or a scalar."""
        first = row[self.columns[0]]
        if self.dtype == IMAGE:
            return first
        values = first if isinstance(first, list) else [row[name] for name in self.columns]
        return values[0] if self.shape == (1,) else np.array(values, self.dtype)

    def description(self) -> dict[str, Any]:
        """Its entry in meta/info.json."""
        names = None if self.names is None else list(self.names)
        return {"dtype": self.dtype, "shape": list(self.shape), "names": names}


INDICES = (
    Feature("timestamp", "float32", (1,), None),
    *(
        Feature(name, "int64", (1,), None)
        for name in ("frame_index", "episode_index", "index", "task_index")
    ),
)
"""Features that LeRobot requires."""


def features_of(
    info: DatasetInfo, image_shape: tuple[int, ...], present: set[str]
) -> list[Feature]:
    """The features of a dataset.

    image_shape: (rows, columns, 3). present: names of the columns with a value in every row.
    """
    taxels = tuple(f"taxel_{number}" for number in range(len(info.layout_x_mm)))
    places = (len(info.field_x_mm or ()),)
    axes = ("height", "width", "channels")
    wanted = [
        Feature("observation.images.digit", IMAGE, image_shape, axes, ("image",)),
        Feature(BACKGROUND_FEATURE, IMAGE, image_shape, axes, (BACKGROUND,)),
        Feature("observation.taxels", "float32", (len(taxels),), taxels, ("taxels",)),
        *(
            Feature(f"observation.{name}", "float32", places, None, (name,))
            for name in (FIELD, *TRACTIONS)
        ),
    ]
    for sensor in SENSORS:
        names = [name for name in ("depth_mm", "force_n", *MOTION) if f"{sensor}_{name}" in present]
        columns = tuple(f"{sensor}_{name}" for name in names)
        wanted.append(
            Feature(
                f"observation.{sensor}_contact", "float32", (len(names),), tuple(names), columns
            )
        )
    wanted.append(Feature("action", "float32", (len(POSE),), POSE, POSE))
    flags = [f"{sensor}_{flag}" for sensor in SENSORS for flag in ("settled", "bottomed")]
    wanted += [Feature(name, "bool", (1,), None, (name,)) for name in (*flags, MARKERS)]
    wanted += [
        Feature(name, "int64", (1,), None, (column,))
        for name, column in (("press_index", "index"), (UNIT, UNIT))
    ]
    return [each for each in wanted if each.columns and present.issuperset(each.columns)]
