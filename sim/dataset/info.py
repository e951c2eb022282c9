"""The record of a dataset's info.json, validated when it is constructed."""

import zlib
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import PurePosixPath
from typing import Annotated

import numpy as np
from msgspec import Meta

from t2twin.core.arguments import MAX_SEED
from t2twin.core.errors import T2TwinError
from t2twin.core.machine import installed_version
from t2twin.sim.sampling.recipe import PAPER, Recipe
from t2twin.sim.taxels.layout import MAX_TAXELS, PAD_DIAMETER_MM, Layout
from t2twin.sim.taxels.reading import Imperfections

FORMAT = 1
"""Version of the dataset's folders, columns and info.json."""

SPLITS = ("train", "val", "test")

MAX_COUNTS = 65_535
"""Largest count of a column of uint16."""

PACKAGES = ("t2twin", "mujoco", "numpy", "scipy", "numba", "cadquery", "pillow", "pyarrow")
"""Packages whose versions may change a shard's bytes."""

SHA256_DIGITS = 64

Count = Annotated[int, Meta(ge=0)]
Size = Annotated[int, Meta(ge=1, le=1_000_000)]
Positive = Annotated[float, Meta(gt=0)]


@dataclass(frozen=True)
class Shard:
    """One shard: the hexadecimal sha256 of its bytes, and its number of pairs."""

    sha256: str
    pairs: Count

    def __post_init__(self) -> None:
        if not is_sha256(self.sha256):
            raise ValueError(f"sha256 must be {SHA256_DIGITS} hexadecimal digits")


@dataclass(frozen=True)
class ElastomerParameters:
    """A sensor's elastomer, with the fields of t2twin.sim.contact.elastomer.Elastomer.

    A radius is None for a flat surface, since JSON has no infinity. pitch_mm: of the contact grid.
    """

    name: str
    thickness_mm: Positive
    young_mpa: Positive
    poisson: float
    width_mm: Positive
    length_mm: Positive
    dome_width_radius_mm: Positive | None
    dome_length_radius_mm: Positive | None
    dome_flat_mm: float
    law: str
    pitch_mm: Positive


@dataclass(frozen=True)
class DigitParameters(ElastomerParameters):
    """The DIGIT.

    noise_grey: standard deviation of an image's noise, grey levels. optics_sha256: of the
    optics file.
    """

    noise_grey: Annotated[float, Meta(ge=0)]
    optics_sha256: str


@dataclass(frozen=True)
class CySkinParameters(ElastomerParameters):
    """The CySkin.

    gain_counts: counts per doubling of a taxel's capacitance. pad_diameter_mm: of every taxel.
    readings: number of averaged readings. imperfections: their errors.
    """

    gain_counts: Positive
    pad_diameter_mm: tuple[Positive, ...]
    readings: Size
    imperfections: Imperfections


@dataclass(frozen=True)
class Parameters:
    """Parameters of a simulation. shapes: indices of each shape's presses on the grid, by name."""

    digit: DigitParameters
    cyskin: CySkinParameters
    shapes: dict[str, tuple[Count, ...]]


@dataclass(frozen=True)
class DatasetInfo:
    """info.json; the attributes have the names of its keys.

    complete: whether all shards exist. pairs: their number in each split when complete. layout: the
    taxel layout's name, with the taxels' positions, mm. full_scale_counts: counts at saturation.
    versions: of everything that may change a shard's bytes. shards: the existing ones, by path
    below the dataset's folder. image_shape: rows, columns and channels.

    The others are optional. seed, parameters, recipe, shape_code: of a simulated dataset; recipe is
    its recipe, shape_code a digest of the code and libraries of the shapes' surfaces. scale: of a
    dataset of the protocol. origin, pad_diameter_mm: of an imported one. dense_x_mm, dense_y_mm:
    places of the dense counts. files: sha256 of the users' solids, by path.

    Raises ValueError for fields that contradict each other.
    """

    format: int
    complete: bool
    pairs: dict[str, Count]
    layout: str
    layout_x_mm: tuple[float, ...]
    layout_y_mm: tuple[float, ...]
    full_scale_counts: Annotated[int, Meta(ge=1, le=MAX_COUNTS)]
    versions: dict[str, str]
    shards: dict[str, Shard]
    image_shape: tuple[Size, Size, Size]
    scale: str | None = None
    seed: Annotated[int, Meta(ge=0, le=MAX_SEED)] | None = None
    origin: str | None = None
    parameters: Parameters | None = None
    pad_diameter_mm: tuple[Positive, ...] | None = None
    shape_code: str | None = None
    recipe: Recipe | None = None
    dense_x_mm: tuple[float, ...] | None = None
    dense_y_mm: tuple[float, ...] | None = None
    files: dict[str, str] | None = None

    def __post_init__(self) -> None:
        if set(self.pairs) != set(SPLITS):
            raise ValueError(f"pairs must name the splits {', '.join(SPLITS)} and no others")
        check_layout(self.layout_x_mm, self.layout_y_mm)
        field = len(self.dense_x_mm or ())
        if field != len(self.dense_y_mm or ()) or field > MAX_TAXELS:
            raise ValueError("dense_x_mm and dense_y_mm must be one of each for each place")
        pads = self.parameters.cyskin.pad_diameter_mm if self.parameters else self.pad_diameter_mm
        if pads is not None and len(pads) != len(self.layout_x_mm):
            raise ValueError(
                f"pad_diameter_mm has {len(pads)} taxels and the layout {len(self.layout_x_mm)}"
            )
        if self.recipe is None and (self.scale is not None or self.parameters is not None):
            raise ValueError("recipe is missing, the recipe of a simulated dataset")
        for path in self.shards:
            if not _is_shard_path(path):
                raise ValueError(
                    f"the shard {path!r} is not in a split's folder; allowed are paths like "
                    f"{SPLITS[0]}/NAME.parquet"
                )
        self._check_pairs()

    def _check_pairs(self) -> None:
        for split, expected in self.pairs.items():
            present = sum(
                s.pairs for path, s in self.shards.items() if path.startswith(f"{split}/")
            )
            if present > expected or (self.complete and present < expected):
                raise ValueError(f"pairs of {split} is {expected}, and its shards have {present}")

    @property
    def is_simulated(self) -> bool:
        """Whether it is simulated; an imported dataset has no recipe."""
        return self.recipe is not None

    @property
    def is_protocol(self) -> bool:
        """Whether it follows the protocol of Grella et al. 2023, at any scale.

        Training and validation then contain versions of the paper's primitives, the test hand
        tools, all pressed with one force. Only such results are compared with the paper's.
        """
        return self.recipe is not None and self.recipe.name == PAPER

    @property
    def recipe_name(self) -> str | None:
        """The protocol's scale, or the recipe's name; None for an imported dataset."""
        return self.scale or (None if self.recipe is None else self.recipe.name)


def check_layout(x_mm: Sequence[float] | np.ndarray, y_mm: Sequence[float] | np.ndarray) -> None:
    """Raises ValueError for an invalid layout."""
    if len(x_mm) == 0 or len(x_mm) != len(y_mm):
        raise ValueError(
            f"layout_x_mm has {len(x_mm)} and layout_y_mm {len(y_mm)} positions; each taxel needs "
            "one of both"
        )
    try:
        Layout("of these", np.array(x_mm), np.array(y_mm), np.full(len(x_mm), PAD_DIAMETER_MM))
    except T2TwinError as error:
        raise ValueError(str(error)) from None


def is_sha256(digits: str) -> bool:
    """Whether this is a sha256 in lower-case hexadecimal digits."""
    return len(digits) == SHA256_DIGITS and set(digits) <= set("0123456789abcdef")


def versions() -> dict[str, str]:
    """Versions on this machine of everything that may change a shard's bytes."""
    installed = {name: installed_version(name) for name in PACKAGES}
    return installed | {"zlib": zlib.ZLIB_RUNTIME_VERSION}


def _is_shard_path(path: str) -> bool:
    split, _, name = path.partition("/")
    is_file = "/" not in name and "\0" not in name and PurePosixPath(name).suffix == ".parquet"
    return split in SPLITS and is_file
