"""LeRobot's features of a dataset, their values in a row, and their statistics.

observation.images.ROLE             the image of a gel camera; ROLE is source or target
observation.images.ROLE_background  the background frame of its unit, if any
observation.ROLE_counts             the counts of a taxel array
observation.ROLE_dense_counts       the dense counts, if any
observation.ROLE_pressure_kpa, ...  pressure and shear on the cover at their places, if any
observation.ROLE_contact            depth and force, with motion also friction, shear forces, torque
                                    and share of slip
action                              the commanded pose and force
ROLE_settled, ...                   flags of the contact solver
press_index, ROLE_unit, ...         columns index, unit and markers

Features of columns without a value in every row are left out.
"""

from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np
import pyarrow as pa

from t2twin.core.images import decode_png
from t2twin.sim.dataset.columns import (
    BACKGROUND,
    COUNTS,
    DENSE_COUNTS,
    IMAGE_TYPE,
    MARKERS,
    MOTION,
    POSE,
    TRACTIONS,
    UNIT,
    column,
)
from t2twin.sim.dataset.columns import IMAGE as IMAGE_COLUMN
from t2twin.sim.dataset.info import DatasetInfo, SensorInfo
from t2twin.sim.sensors.defaults import ROLES

IMAGE = "image"
"""dtype of LeRobot's features of images."""

QUANTILES = {"q01": 0.01, "q10": 0.1, "q50": 0.5, "q90": 0.9, "q99": 0.99}
"""Quantiles of LeRobot's statistics, by name."""

LEVELS = 256
"""Gray levels of an image."""

Statistics = dict[str, Any]
"""min, max, mean, std and QUANTILES as nested lists; count as a list of one number."""

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


def features_of(info: DatasetInfo, present: set[str]) -> list[Feature]:
    """The features of a dataset. present: names of the columns with a value in every row."""
    wanted = [feature for role, sensor in info.sensors.items() for feature in _values(role, sensor)]
    for role in ROLES:
        names = ["depth_mm", "force_n", *MOTION]
        names = [name for name in names if column(role, name) in present]
        columns = tuple(column(role, name) for name in names)
        size = (len(names),)
        wanted.append(
            Feature(f"observation.{role}_contact", "float32", size, tuple(names), columns)
        )
    wanted.append(Feature("action", "float32", (len(POSE),), POSE, POSE))
    flags = [column(role, flag) for role in ROLES for flag in ("settled", "bottomed", MARKERS)]
    wanted += [Feature(name, "bool", (1,), None, (name,)) for name in flags]
    wanted.append(Feature("press_index", "int64", (1,), None, ("index",)))
    units = [column(role, UNIT) for role in ROLES]
    wanted += [Feature(name, "int64", (1,), None, (name,)) for name in units]
    return [each for each in wanted if each.columns and present.issuperset(each.columns)]


def _values(role: str, sensor: SensorInfo) -> list[Feature]:
    """The features of a sensor's values."""
    shape = sensor.image_shape
    if shape is not None:
        axes, names = ("height", "width", "channels"), (IMAGE_COLUMN, BACKGROUND)
        features = {role: column(role, names[0]), column(role, names[1]): column(role, names[1])}
        return [
            Feature(f"observation.images.{feature}", IMAGE, shape, axes, (name,))
            for feature, name in features.items()
        ]
    taxels = tuple(f"taxel_{number}" for number in range(len(sensor.x_mm)))
    places, counts = (len(sensor.dense_x_mm or ()),), column(role, COUNTS)
    dense = [column(role, name) for name in (DENSE_COUNTS, *TRACTIONS)]
    return [
        Feature(f"observation.{counts}", "float32", (len(taxels),), taxels, (counts,)),
        *(Feature(f"observation.{name}", "float32", places, None, (name,)) for name in dense),
    ]


def vector_statistics(values: np.ndarray) -> Statistics:
    """Statistics over the frames. values: (frames, components)."""
    values = values.astype(np.float64)
    found = {
        "min": values.min(0),
        "max": values.max(0),
        "mean": values.mean(0),
        "std": values.std(0),
        **dict(zip(QUANTILES, np.quantile(values, list(QUANTILES.values()), axis=0), strict=True)),
    }
    return {name: value.tolist() for name, value in found.items()} | {"count": [len(values)]}


def image_statistics(histogram: np.ndarray, frames: int) -> Statistics:
    """Statistics of all pixels of some images, for gray levels from 0 to 1.

    histogram: (3, LEVELS) pixels of each channel and level. A quantile is the lowest level that so
    large a share of the pixels does not exceed.
    """
    levels = np.arange(LEVELS) / (LEVELS - 1)
    shares = histogram / histogram.sum(1, keepdims=True)
    mean = shares @ levels
    present = histogram > 0
    found = {
        "min": levels[present.argmax(1)],
        "max": levels[LEVELS - 1 - present[:, ::-1].argmax(1)],
        "mean": mean,
        "std": np.sqrt((shares * (levels - mean[:, None]) ** 2).sum(1)),
    }
    below = np.cumsum(histogram, axis=1)
    for name, share in QUANTILES.items():
        found[name] = levels[(below >= share * below[:, -1:]).argmax(1)]
    return {name: value.reshape(3, 1, 1).tolist() for name, value in found.items()} | {
        "count": [frames]
    }


@lru_cache(maxsize=2)  # the rows of an episode repeat their background frame
def histogram_of(png: bytes) -> np.ndarray:
    """(3, LEVELS) int64: pixels of a PNG image by channel and level.

    Raises T2TwinError as decode_png does.
    """
    pixels = decode_png(png).reshape(-1, 3)
    return np.stack([np.bincount(channel, minlength=LEVELS) for channel in pixels.T])


class FeatureStatistics:
    """Collects the statistics of a feature, episode by episode."""

    def __init__(self, feature: Feature) -> None:
        self._is_image = feature.dtype == IMAGE
        self._values: list[np.ndarray] = []  # of the episodes, (frames, components) float32
        self._histogram = np.zeros((3, LEVELS), np.int64)
        self._frames = 0

    def add(self, values: list[Any]) -> Statistics:
        """Add an episode; returns its own statistics. values: one of each frame."""
        if self._is_image:
            histogram = sum(histogram_of(value["bytes"]) for value in values)
            self._histogram += histogram
            self._frames += len(values)
            return image_statistics(np.asarray(histogram), len(values))
        self._values.append(np.array(values, np.float32).reshape(len(values), -1))
        return vector_statistics(self._values[-1])

    def total(self) -> Statistics:
        """The statistics of all frames."""
        if self._is_image:
            return image_statistics(self._histogram, self._frames)
        return vector_statistics(np.concatenate(self._values))

    def types(self) -> dict[str, pa.DataType]:
        """Column types of an episode's statistics."""
        numbers = pa.list_(pa.float32())
        kind = pa.list_(pa.list_(numbers)) if self._is_image else numbers
        return dict.fromkeys(("min", "max", "mean", "std", *QUANTILES), kind) | {
            "count": pa.list_(pa.int64())
        }
