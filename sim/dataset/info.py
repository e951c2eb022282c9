"""The record of a dataset's info.json."""

import zlib
from dataclasses import dataclass
from typing import Annotated, Any, Literal

import numpy as np
from msgspec import Meta

from t2twin.core.arguments import MAX_SEED
from t2twin.core.errors import T2TwinError
from t2twin.core.machine import installed_version
from t2twin.sim.sampling.recipe import PAPER, Recipe
from t2twin.sim.taxels.layout import PAD_DIAMETER_MM, Layout
from t2twin.sim.taxels.spec import MAX_BITS, CountsTable, Imperfections

FORMAT = 2  # of the dataset's folders, columns and info.json
SPLITS = ("train", "val", "test")
MAX_COUNTS = 65_535  # of a column of uint16

PACKAGES = ("t2twin", "mujoco", "numpy", "scipy", "numba", "cadquery", "pillow", "pyarrow")
"""Packages whose versions may change a shard's bytes."""

Count = Annotated[int, Meta(ge=0)]
Size = Annotated[int, Meta(ge=1, le=1_000_000)]
Positive = Annotated[float, Meta(gt=0)]
Sha256 = Annotated[str, Meta(pattern="^[0-9a-f]{64}$")]
ShardPath = Annotated[str, Meta(pattern=r"^(train|val|test)/[^/\0]+\.parquet$")]


@dataclass(frozen=True)
class Shard:
    """One shard: the sha256 of its bytes, and its number of pairs."""

    sha256: Sha256
    pairs: Count


@dataclass(frozen=True)
class SensorInfo:
    """A sensor of a dataset.

    name: of the sensor. value: of its readings, "image" or "counts". spec: content of its file, for
    a simulated sensor. elastomer: the layer that was pressed, with the fields of
    t2twin.sim.contact.elastomer.Elastomer; a radius is None for a flat surface, since JSON has no
    infinity. pitch_mm: of the contact's grid.

    Of a gel camera: image_shape, rows, columns and channels; view_mm, half of what an image shows
    along x and y. contact_grid: rows and columns of the contact maps. noise_grey: standard
    deviation of an image's noise. optics_sha256: of the optics file.
    Of a taxel array: layout, its name; x_mm, y_mm, pad_diameter_mm of the taxels;
    full_scale_counts; imperfections.
    tactile_image: rows, columns and px_per_mm. readings: averaged into the counts, at rate_hz.
    dense_x_mm, dense_y_mm: places of the dense counts. dense_pad_mm: diameter of their pads.
    dense_cell_mm2: area of the surface for each.

    Raises ValueError where a field of its kind is missing.
    """

    name: str
    value: Literal["image", "counts"]
    spec: dict[str, Any] | None = None
    elastomer: dict[str, Any] | None = None
    pitch_mm: Positive | None = None
    image_shape: tuple[Size, Size, Size] | None = None
    view_mm: tuple[Positive, Positive] | None = None
    contact_grid: tuple[Size, Size] | None = None
    noise_grey: Annotated[float, Meta(ge=0)] | None = None
    optics_sha256: str | None = None
    layout: str | None = None
    x_mm: tuple[float, ...] = ()
    y_mm: tuple[float, ...] = ()
    pad_diameter_mm: tuple[Positive, ...] | None = None
    full_scale_counts: Annotated[int, Meta(ge=1, le=MAX_COUNTS)] | None = None
    tactile_image: tuple[Size, Size, Positive] | None = None
    readings: Size | None = None
    rate_hz: Positive | None = None
    imperfections: Imperfections | None = None
    dense_pad_mm: Positive | None = None
    dense_cell_mm2: Positive | None = None
    dense_x_mm: tuple[float, ...] | None = None
    dense_y_mm: tuple[float, ...] | None = None

    def __post_init__(self) -> None:
        of_kind = ("image_shape",) if self.value == "image" else ("full_scale_counts", "layout")
        for name in of_kind:
            if getattr(self, name) is None:
                raise ValueError(f"{name} of {self.name} is missing")

    @property
    def reading(self) -> CountsTable:
        """How a simulated taxel array's counts are read; the gain is 1, as counts are given."""
        assert self.full_scale_counts is not None and self.rate_hz is not None
        return CountsTable(
            gain=1.0,
            full_scale=self.full_scale_counts,
            bits=MAX_BITS,
            rate_hz=self.rate_hz,
            readings=self.readings or 1,
        )

    @property
    def taxels(self) -> Layout:
        """The taxels, with default pads if theirs are unknown. Raises T2TwinError as Layout."""
        pads = self.pad_diameter_mm or (PAD_DIAMETER_MM,) * len(self.x_mm)
        return Layout(
            self.layout or self.name, np.array(self.x_mm), np.array(self.y_mm), np.array(pads)
        )


@dataclass(frozen=True)
class DatasetInfo:
    """info.json; the attributes have the names of its keys.

    complete: whether all shards exist. pairs: their number in each split when complete. source,
    target: the sensors. versions: of everything that may change a shard's bytes. shards: the
    existing ones, by path below the dataset's folder.

    The others are optional. seed, recipe, shapes, shape_code: of a simulated dataset. shapes:
    the indices of each shape's presses on the grid. only: the primitives and tools to which it is
    restricted. shape_code: a digest of the code and libraries of the shapes' surfaces. scale: of a
    dataset of the protocol. files: sha256 of users' solids, by path.
    """

    format: Literal[2]
    complete: bool
    pairs: dict[Literal["train", "val", "test"], Count]
    source: SensorInfo
    target: SensorInfo
    versions: dict[str, str]
    shards: dict[ShardPath, Shard]
    scale: str | None = None
    seed: Annotated[int, Meta(ge=0, le=MAX_SEED)] | None = None
    recipe: Recipe | None = None
    shapes: dict[str, tuple[Count, ...]] | None = None
    only: tuple[str, ...] | None = None
    shape_code: str | None = None
    files: dict[str, str] | None = None

    @property
    def sensors(self) -> dict[str, SensorInfo]:
        """The sensors by role."""
        return {"source": self.source, "target": self.target}

    @property
    def values(self) -> dict[str, str]:
        """The value of each role, "image" or "counts"."""
        return {role: sensor.value for role, sensor in self.sensors.items()}

    def role_of(self, value: str) -> str:
        """The role of the first sensor of "image" or "counts", for "counts" the target first.

        Raises T2TwinError for a dataset without one.
        """
        roles = list(self.sensors) if value == "image" else list(self.sensors)[::-1]
        for role in roles:
            if self.values[role] == value:
                return role
        names = f"{self.source.name} and {self.target.name}"
        raise T2TwinError(f"the dataset is of {names}; it has no {value}")

    @property
    def camera(self) -> SensorInfo:
        """The first gel camera. Raises T2TwinError for a dataset without one."""
        return self.sensors[self.role_of("image")]

    @property
    def array(self) -> SensorInfo:
        """The taxel array, the target's first. Raises T2TwinError for a dataset without one."""
        return self.sensors[self.role_of("counts")]

    @property
    def is_simulated(self) -> bool:
        """Whether it is simulated; an imported dataset has no recipe."""
        return self.recipe is not None

    @property
    def is_protocol(self) -> bool:
        """Whether it follows the protocol of Grella et al. 2023: its results are comparable."""
        return self.recipe is not None and self.recipe.name == PAPER

    @property
    def recipe_name(self) -> str | None:
        """The protocol's scale, or the recipe's name; None for an imported dataset."""
        return self.scale or (None if self.recipe is None else self.recipe.name)


def versions() -> dict[str, str]:
    """Versions on this machine of everything that may change a shard's bytes."""
    installed = {name: installed_version(name) for name in PACKAGES}
    return installed | {"zlib": zlib.ZLIB_RUNTIME_VERSION}
