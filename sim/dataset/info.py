"""The record of a dataset's info.json."""

from dataclasses import dataclass
from typing import Annotated, Any, ClassVar, Final, Literal, cast

import numpy as np
from msgspec import Meta, Struct, to_builtins

from t2twin.core.arguments import MAX_SEED
from t2twin.core.errors import T2TwinError
from t2twin.core.frame_order import FrameOrder
from t2twin.core.machine import installed_version
from t2twin.core.records import FORMAT
from t2twin.sim.contact.elastomer import Elastomer, elastomer_of
from t2twin.sim.sampling.recipe import Recipe
from t2twin.sim.taxels.layout import PAD_DIAMETER_MM, Layout
from t2twin.sim.taxels.phi import Phi
from t2twin.sim.taxels.spec import CountsTable, Imperfections

SPLITS = ("train", "val", "test")
# Columns of a camera's image and an array's counts after the role; also the kinds of readings
IMAGE: Final = "image"
COUNTS: Final = "counts"
MAX_COUNTS = 65_535  # of a column of uint16
SMALL_SHARE = 0.01  # of the full scale, below which all counts are suspicious (assumed)
FEW = 10  # fewer readings of whole counts than this may all be without contact (assumed)
# Largest distance of corresponding taxels of equal layouts, mm (assumed: far below the tolerance
# of a printed board)
SAME_MM = 1e-3

# Packages whose versions may change a shard's bytes
PACKAGES = (
    "t2twin", "mujoco", "numpy", "scipy", "numba", "cadquery", "pillow", "pyarrow", "zlib-ng",
)  # fmt: skip

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


class _SensorInfo(Struct, frozen=True, kw_only=True, omit_defaults=True, tag_field="value"):
    """What a dataset and a run store of a sensor of either kind."""

    name: str
    spec: dict[str, Any] | None = None  # content of its file, for a simulated sensor
    pitch_mm: Positive | None = None  # of the contact's grid

    @property
    def words(self) -> str:
        """Its readings in words."""
        return f"{'images' if isinstance(self, CameraInfo) else 'counts'} of {self.name}"

    def differences(self, other: Any) -> list[str]:
        """What two sensors of one kind both record and what differs, in words."""
        own, theirs = (
            {
                "name": each.name,
                "soft layer": each.elastomer and elastomer_of(each.elastomer | {"name": "_"}, ""),
                "view": np.round(getattr(each, "view_mm", 0.0), 3).tolist(),
                "full scale": each.full_scale,
                "gain": (each.spec or {}).get("counts", {}).get("gain"),
                "transducer": (each.spec or {}).get("transducer"),
            }
            for each in cast(Any, (self, other))
        )
        found = [n for n in own if None not in (own[n], theirs[n]) and own[n] != theirs[n]]
        if isinstance(self, ArrayInfo) and not self.same_pads(other.taxels):
            found.append("pads")
        return found

    def fits(self, other: Any) -> bool:
        """Whether a network of this sensor also takes or gives the readings of another."""
        return type(self) is type(other) and (
            not isinstance(self, ArrayInfo) or self.same_layout(other.x_mm, other.y_mm)
        )


class CameraInfo(_SensorInfo, frozen=True, kw_only=True, tag=IMAGE):
    """A gel camera of a dataset or a run."""

    value: ClassVar[Literal["image"]] = IMAGE  # of its readings
    full_scale: ClassVar[float] = 255.0

    elastomer: dict[str, Any] | None = None  # the gel, as in elastomer_json
    image_shape: tuple[Size, Size, Size]  # rows, columns and channels
    view_mm: tuple[Positive, Positive]  # half the width and half the height of an image's view
    contact_grid: tuple[Size, Size] | None = None  # rows and columns of the contact maps
    noise_grey: Annotated[float, Meta(ge=0)] | None = None  # standard deviation of an image's noise
    optics_sha256: str | None = None  # of the optics file


class ArrayInfo(_SensorInfo, frozen=True, kw_only=True, tag=COUNTS):
    """A taxel array of a dataset or a run.

    Raises T2TwinError for an invalid layout, places or cover.
    """

    value: ClassVar[Literal["counts"]] = COUNTS  # of its readings

    elastomer: dict[str, Any]  # the cover, as in elastomer_json
    layout: str  # its name
    x_mm: np.ndarray  # (N,), of the taxels, as y_mm and pad_diameter_mm
    y_mm: np.ndarray
    pad_diameter_mm: np.ndarray
    full_scale_counts: Annotated[int, Meta(ge=1, le=MAX_COUNTS)]
    tactile_image: tuple[Size, Size, Positive]  # rows, columns and px/mm
    readings: Size | None = None  # averaged into the counts
    rate_hz: Positive | None = None  # of the readings
    imperfections: Imperfections | None = None
    dense_x_mm: np.ndarray | None = None  # (F,), places of the dense counts, as dense_y_mm
    dense_y_mm: np.ndarray | None = None
    dense_pad_mm: Positive = PAD_DIAMETER_MM  # diameter of their pads
    dense_cell_mm2: Positive | None = None  # area of the surface for each

    def __post_init__(self) -> None:
        _ = self.taxels, self.dense, self.cover

    def __eq__(self, other: object) -> bool:
        return isinstance(other, ArrayInfo) and plain(self) == plain(other)

    @property
    def full_scale(self) -> float:
        """Full scale of the readings, counts."""
        return float(self.full_scale_counts)

    @property
    def reading(self) -> CountsTable:
        """How a simulated taxel array's counts are read; the gain is 1, as counts are given."""
        return CountsTable(1.0, self.full_scale_counts, self.readings or 1, self.rate_hz)

    @property
    def taxels(self) -> Layout:
        """The layout."""
        return Layout(self.layout, self.x_mm, self.y_mm, self.pad_diameter_mm)

    @property
    def dense(self) -> Layout | None:
        """The places of the dense counts, None without dense counts."""
        x_mm, y_mm = self.dense_x_mm, self.dense_y_mm
        if x_mm is None and y_mm is None:
            return None
        if x_mm is None or y_mm is None:
            raise T2TwinError("dense_x_mm or dense_y_mm is missing; expected both or none")
        return Layout("dense", x_mm, y_mm, np.full(x_mm.size, self.dense_pad_mm))

    @property
    def cover(self) -> Elastomer:
        """The soft layer of the array."""
        return elastomer_of(self.elastomer, "the cover")

    @property
    def phi(self) -> Phi:
        """phi of the layout, in the size of the tactile image. Raises T2TwinError as Phi."""
        rows, columns, px_per_mm = self.tactile_image
        return Phi(self.x_mm, self.y_mm, (rows, columns), px_per_mm)

    def same_layout(self, x_mm: np.ndarray, y_mm: np.ndarray) -> bool:
        """Whether positions equal those of the layout, in its order. x_mm, y_mm: (N,), mm."""
        own, other = np.stack([self.x_mm, self.y_mm]), np.stack([x_mm, y_mm])
        return own.shape == other.shape and bool(np.abs(own - other).max() < SAME_MM)

    def same_pads(self, other: Layout) -> bool:
        """Whether each pad of a layout is as large as the nearest one of this array."""
        nearest = other.distances_mm(self.taxels).argmin(axis=1)
        return bool(np.abs(self.pad_diameter_mm[nearest] - other.pad_diameter_mm).max() < SAME_MM)

    def incomparable(self, other: "SensorInfo") -> list[str]:
        """The differences for which one pressure has other counts, also on an equal pad."""
        return [each for each in self.differences(other) if each not in ("name", "pads")]


SensorInfo = CameraInfo | ArrayInfo


def normalized(counts: np.ndarray, full_scale: float) -> str | None:
    """A clause about counts that are parts or percent of the full scale instead; None for others.
    counts: (N,) or (B, N)."""
    most, is_whole = counts.max(initial=0.0), not (counts % 1.0).any()
    limit = max(SMALL_SHARE * full_scale, 0.0 if is_whole else 1.0)
    may_be_still = is_whole and counts.size < FEW * counts.shape[-1]
    if full_scale <= 1.0 or not counts.size or most > limit or may_be_still:
        return None
    return f"all counts lie between 0 and {most:.4g}; expected counts from 0 to {full_scale:,.0f}"


def plain(record: Any) -> Any:
    """A record as JSON stores it: dicts, lists and numbers."""
    return to_builtins(record, enc_hook=np.ndarray.tolist)


@dataclass(frozen=True)
class DatasetInfo:
    """info.json. Optional fields are of a simulated dataset."""

    complete: bool  # whether all shards exist
    pairs: dict[Literal["train", "val", "test"], Count]  # in each split when complete
    source: SensorInfo
    target: SensorInfo
    versions: dict[str, str]  # of everything that may change a shard's bytes
    shards: dict[ShardPath, Shard]  # the existing ones, by path below the dataset's folder
    scale: str | None = None  # of a dataset of the protocol of Grella et al. 2023
    seed: Annotated[int, Meta(ge=0, le=MAX_SEED)] | None = None
    recipe: Recipe | None = None  # None for imported pairs
    shapes: dict[str, tuple[Count, ...]] | None = None  # indices of the presses on the grid
    only: tuple[str, ...] | None = None  # the primitives and tools to which it is restricted
    shape_code: str | None = None  # digest of the code and libraries of the shapes' surfaces
    files: dict[str, str] | None = None  # sha256 of users' solids, by path
    order: FrameOrder | None = None  # of imported images before they were stored upright
    format: str = FORMAT

    @property
    def sensors(self) -> dict[str, SensorInfo]:
        """The sensors by role."""
        return {"source": self.source, "target": self.target}

    @property
    def values(self) -> dict[str, str]:
        """The value of each role, "image" or "counts"."""
        return {role: sensor.value for role, sensor in self.sensors.items()}

    def role_of(self, value: str) -> str:
        """The role of the first sensor of "image" or "counts", for "counts" the target first."""
        roles = list(self.sensors) if value == IMAGE else list(self.sensors)[::-1]
        for role in roles:
            if self.values[role] == value:
                return role
        names = f"{self.source.name} and {self.target.name}"
        raise T2TwinError(f"the dataset is of {names}; it has no {value}")

    @property
    def camera(self) -> CameraInfo:
        """The first gel camera. Raises T2TwinError for a dataset without one."""
        return cast(CameraInfo, self.sensors[self.role_of(IMAGE)])

    @property
    def array(self) -> ArrayInfo:
        """The taxel array, the target's first. Raises T2TwinError for a dataset without one."""
        return cast(ArrayInfo, self.sensors[self.role_of(COUNTS)])

    @property
    def recipe_name(self) -> str | None:
        """The protocol's scale, or the recipe's name; None for an imported dataset."""
        return self.scale or (None if self.recipe is None else self.recipe.name)


def versions() -> dict[str, str]:
    """Versions on this machine of everything that may change a shard's bytes."""
    return {name: installed_version(name) for name in PACKAGES}
