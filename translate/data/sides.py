"""The two sides of a dataset: the sensor whose readings a network gets, and the one it predicts.

The readings of a side are images or counts. Networks work on the picture of a reading, (S, S, c),
from 0 to 255: of a gel camera its image, grey or RGB; of a taxel array its tactile image, from zero
to full scale. A new kind of target is one more class here, with its networks in `runs.checkpoint`,
its figures in `evaluation` and its predictor in `inference`.

Shape letters: P pairs, N taxels, F places of the dense counts, S side and c channels of a picture.
"""

from dataclasses import dataclass
from typing import Annotated, Any, ClassVar

import numpy as np
from msgspec import Meta, Struct
from msgspec import field as renamed

from t2twin.core.errors import T2TwinError
from t2twin.sim.contact.elastomer import Elastomer, elastomer_of
from t2twin.sim.dataset.columns import COUNTS, IMAGE
from t2twin.sim.dataset.info import MAX_COUNTS, SensorInfo
from t2twin.sim.taxels.layout import PAD_DIAMETER_MM, Layout
from t2twin.sim.taxels.phi import Phi
from t2twin.translate.data.images import COLORS, WHITE_GREY

# Largest distance of corresponding taxels of equal layouts, mm (assumed: far below the tolerance
# of a printed board)
SAME_MM = 1e-3

IMAGE_SHAPE, VIEW_MM = (320, 240, 3), (6.25, 25 / 3)
TACTILE_IMAGE = (396, 240, 8.8)
# Values of the DIGIT and the CySkin, for runs that do not record them
COVER = {
    "name": "cyskin", "thickness_mm": 2.5, "young_mpa": 0.1, "poisson": 0.47, "width_mm": 28.0,
    "length_mm": 46.0,
}  # fmt: skip


class CameraSide(Struct, frozen=True, tag_field="value", tag=IMAGE):
    """A gel camera of a run. The defaults are a DIGIT's.

    sensor: its name, None if unknown. image_shape: rows, columns and channels of its images.
    view_mm: half of what they show along x and y.
    """

    value: ClassVar[str] = IMAGE
    unit: ClassVar[str] = "grey levels"
    full_scale: ClassVar[float] = WHITE_GREY

    sensor: str | None = None
    image_shape: tuple[int, int, int] = IMAGE_SHAPE
    view_mm: tuple[float, float] = VIEW_MM

    def check(self) -> None:
        """Nothing in it can be invalid."""

    @property
    def aspect(self) -> float:
        """Width over height of an image."""
        return self.image_shape[1] / self.image_shape[0]

    @property
    def words(self) -> str:
        """Its readings in words."""
        return f"images of {self.sensor or 'a gel camera'}"

    def fits(self, other: "Side") -> bool:
        """Whether a network of this side also takes or gives the readings of another."""
        return isinstance(other, CameraSide)


class ArraySide(Struct, frozen=True, tag_field="value", tag=COUNTS):
    """A taxel array of a run.

    layout: name of the taxel layout. x_mm, y_mm: (N,) its positions. full_scale_counts: where the
    taxels saturate. dense_x_mm, dense_y_mm: (F,) places of the dense counts, None without dense
    counts. pad_diameter_mm: (N,) of the taxels, None if unknown. tactile_image: rows, columns and
    px/mm. dense_pad_mm: diameter of the dense counts' pads. cover: as in elastomer_json. sensor:
    its name, None if unknown. Some fields have other names in a run's config.json. The defaults
    are a CySkin's.
    """

    value: ClassVar[str] = COUNTS
    unit: ClassVar[str] = "counts"

    layout: str
    x_mm: np.ndarray = renamed(name="layout_x_mm")
    y_mm: np.ndarray = renamed(name="layout_y_mm")
    full_scale_counts: Annotated[float, Meta(ge=1, le=MAX_COUNTS)]
    dense_x_mm: np.ndarray | None = None
    dense_y_mm: np.ndarray | None = None
    pad_diameter_mm: np.ndarray | None = None
    tactile_image: tuple[int, int, float] = TACTILE_IMAGE
    dense_pad_mm: float = PAD_DIAMETER_MM
    cover: dict[str, Any] = renamed(default_factory=lambda: dict(COVER))
    sensor: str | None = None

    def check(self) -> None:
        """Raises ValueError for an invalid layout, places or cover."""
        _ = self.taxels, self.dense, self.elastomer

    @property
    def full_scale(self) -> float:
        """Full scale of the readings, counts."""
        return self.full_scale_counts

    @property
    def words(self) -> str:
        """Its readings in words."""
        return f"counts of {self.sensor or self.layout}"

    def fits(self, other: "Side") -> bool:
        """Whether a network of this side also takes or gives the readings of another."""
        return isinstance(other, ArraySide) and self.same_layout(other.x_mm, other.y_mm)

    def same_layout(self, x_mm: np.ndarray, y_mm: np.ndarray) -> bool:
        """Whether positions equal those of the layout, in its order. x_mm, y_mm: (N,), mm."""
        own, other = np.stack([self.x_mm, self.y_mm]), np.stack([x_mm, y_mm])
        return own.shape == other.shape and bool(np.abs(own - other).max() < SAME_MM)

    def same_pads(self, other: Layout) -> bool:
        """Whether a layout of equal positions has pads of equal sizes."""
        own = self.taxels.pad_diameter_mm
        return bool(np.abs(own - other.pad_diameter_mm).max() < SAME_MM)

    def same_dense(self, other: "ArraySide") -> bool:
        """Whether both have the same places of dense counts."""
        pairs = ((self.dense_x_mm, other.dense_x_mm), (self.dense_y_mm, other.dense_y_mm))
        return all(
            one is not None and two is not None and np.array_equal(one, two) for one, two in pairs
        )

    @property
    def taxels(self) -> Layout:
        """The layout, with default pad diameters if they are unknown."""
        pads = self.pad_diameter_mm
        default = np.full(self.x_mm.size, PAD_DIAMETER_MM)
        return Layout(self.layout, self.x_mm, self.y_mm, default if pads is None else pads)

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
    def elastomer(self) -> Elastomer:
        """The cover of the array."""
        return elastomer_of(self.cover, "the cover")

    def phi_of(self, x_mm: np.ndarray, y_mm: np.ndarray) -> Phi:
        """phi of taxels, in the size and scale of the tactile image. Raises T2TwinError as Phi."""
        rows, columns, px_per_mm = self.tactile_image
        return Phi(x_mm, y_mm, (rows, columns), px_per_mm)

    @property
    def phi(self) -> Phi:
        """phi of the layout."""
        return self.phi_of(self.x_mm, self.y_mm)

    def pictures(self, counts: np.ndarray, size: int, grey: bool) -> "TactilePictures":
        """The pictures of counts, (P, N), grey or with three equal channels."""
        phi = self.phi.resized((size, size))
        return TactilePictures(counts, phi, self.full_scale, 1 if grey else COLORS)


Side = CameraSide | ArraySide


def side_of(sensor: SensorInfo) -> Side:
    """The side of a sensor of a dataset."""
    given: dict[str, Any]
    if sensor.value == IMAGE:
        assert sensor.image_shape is not None
        given = {} if sensor.view_mm is None else {"view_mm": sensor.view_mm}
        return CameraSide(sensor.name, sensor.image_shape, **given)
    assert sensor.layout is not None and sensor.full_scale_counts is not None
    arrays = ("dense_x_mm", "dense_y_mm", "pad_diameter_mm")
    given = {
        "tactile_image": sensor.tactile_image,
        "dense_pad_mm": sensor.dense_pad_mm,
        "cover": sensor.elastomer,
    } | {name: getattr(sensor, name) and np.array(getattr(sensor, name)) for name in arrays}
    return ArraySide(
        sensor.layout,
        np.array(sensor.x_mm),
        np.array(sensor.y_mm),
        float(sensor.full_scale_counts),
        sensor=sensor.name,
        **{name: value for name, value in given.items() if value is not None},
    )


@dataclass(frozen=True)
class TactilePictures:
    """The pictures of counts, made on access.

    counts: (P, N). phi: of their layout at the pictures' size. channels: of equal values.
    """

    counts: np.ndarray
    phi: Phi
    full_scale: float
    channels: int

    def __len__(self) -> int:
        return len(self.counts)

    def __getitem__(self, index: np.ndarray | slice) -> np.ndarray:
        """(b, S, S, c) float32, from 0 to 255 at full scale."""
        images = self.phi(self.counts[index]) * np.float32(WHITE_GREY / self.full_scale)
        return np.repeat(images[..., None], self.channels, axis=-1)

    def subset(self, places: np.ndarray) -> "TactilePictures":
        """The pictures with these indices, (b,)."""
        return TactilePictures(self.counts[places], self.phi, self.full_scale, self.channels)
