"""What a dataset's info.json says of it: a record, checked when it is made."""

import zlib
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import PurePosixPath
from typing import Annotated

import numpy as np
from msgspec import Meta

from t2twin.core.arguments import MAX_SEED
from t2twin.core.errors import T2TwinError
from t2twin.sim.cyskin.layout import MAX_TAXELS, PAD_DIAMETER_MM, Layout
from t2twin.sim.cyskin.reading import Imperfections
from t2twin.sim.world.recipe import PAPER, Recipe

FORMAT = 1
"""Version of the dataset's layout of folders and columns, and of info.json."""

SPLITS = ("train", "val", "test")

MAX_COUNTS = 65_535
"""The largest count that a shard's column of uint16 holds."""

PACKAGES = ("t2twin", "mujoco", "numpy", "scipy", "numba", "cadquery", "pillow", "pyarrow")
"""Those whose versions may change a shard's bytes."""

SHA256_DIGITS = 64

Count = Annotated[int, Meta(ge=0)]
Size = Annotated[int, Meta(ge=1, le=1_000_000)]
Positive = Annotated[float, Meta(gt=0)]


@dataclass(frozen=True)
class Shard:
    """One shard: the sha256 of its bytes, hexadecimal, and how many pairs it holds."""

    sha256: str
    pairs: Count

    def __post_init__(self) -> None:
        if not is_sha256(self.sha256):
            raise ValueError(f"sha256 must be {SHA256_DIGITS} hexadecimal digits")


@dataclass(frozen=True)
class ElastomerParameters:
    """A sensor's elastomer as t2twin.sim.contact.elastomer.Elastomer has it.

    A radius is None where the surface is flat: JSON has no infinity. pitch_mm: of the grid on
    which contacts are solved.
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
    """The DIGIT that took the pictures.

    noise_grey: standard deviation of a picture's noise, grey levels. calibration_sha256: of the
    file with its optics.
    """

    noise_grey: Annotated[float, Meta(ge=0)]
    calibration_sha256: str


@dataclass(frozen=True)
class CySkinParameters(ElastomerParameters):
    """The CySkin that counted.

    gain_counts: counts per doubling of a taxel's capacitance. pad_diameter_mm: of every taxel.
    readings: how many were averaged into a sample. imperfections: what was added to them.
    """

    gain_counts: Positive
    pad_diameter_mm: tuple[Positive, ...]
    readings: Size
    imperfections: Imperfections


@dataclass(frozen=True)
class Parameters:
    """What a dataset was simulated with. shapes: the indices of each shape's presses, by name."""

    digit: DigitParameters
    cyskin: CySkinParameters
    shapes: dict[str, tuple[Count, ...]]


@dataclass(frozen=True)
class DatasetInfo:
    """info.json; attributes are named as its keys.

    complete: whether all shards are made. pairs: how many each split has in the end. layout: the
    taxel layout's name, with each taxel's position, mm. full_scale_counts: where taxels saturate.
    versions: of everything that may change a shard's bytes. shards: those that are made, by path
    below the dataset's folder.

    The rest is None where the file lacks it. image_shape: rows, columns and channels of a picture.
    scale, seed, parameters: of a simulated dataset. origin, pad_diameter_mm: of one that was
    imported. shape_code: digest of the code and libraries that made the shapes' surfaces; older
    simulated datasets have none. world: the recipe of a simulated one; older ones are all of the
    protocol and have none. field_x_mm, field_y_mm: places of the field, where pairs hold one.
    files: sha256 of the users' solids that it presses, by path.

    Raises ValueError where two of these do not fit each other.
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
    image_shape: tuple[Size, Size, Size] | None = None
    scale: str | None = None
    seed: Annotated[int, Meta(ge=0, le=MAX_SEED)] | None = None
    origin: str | None = None
    parameters: Parameters | None = None
    pad_diameter_mm: tuple[Positive, ...] | None = None
    shape_code: str | None = None
    world: Recipe | None = None
    field_x_mm: tuple[float, ...] | None = None
    field_y_mm: tuple[float, ...] | None = None
    files: dict[str, str] | None = None

    def __post_init__(self) -> None:
        if set(self.pairs) != set(SPLITS):
            raise ValueError(f"pairs must name the splits {', '.join(SPLITS)} and no others")
        check_layout(self.layout_x_mm, self.layout_y_mm)
        field = len(self.field_x_mm or ())
        if field != len(self.field_y_mm or ()) or field > MAX_TAXELS:
            raise ValueError("field_x_mm and field_y_mm must be one of each for each place")
        pads = self.parameters.cyskin.pad_diameter_mm if self.parameters else self.pad_diameter_mm
        if pads is not None and len(pads) != len(self.layout_x_mm):
            raise ValueError(
                f"pad_diameter_mm has {len(pads)} taxels and the layout {len(self.layout_x_mm)}"
            )
        for path in self.shards:
            if not _is_shard_path(path):
                raise ValueError(
                    f"the shard {path!r} lies in no split's folder; allowed are paths like "
                    f"{SPLITS[0]}/NAME.parquet"
                )
        self._check_pairs()

    def _check_pairs(self) -> None:
        for split, wanted in self.pairs.items():
            there = sum(s.pairs for path, s in self.shards.items() if path.startswith(f"{split}/"))
            if there > wanted or (self.complete and there < wanted):
                raise ValueError(
                    f"pairs says {wanted} of {split}, and the shards named have {there}"
                )

    @property
    def is_simulated(self) -> bool:
        """Whether `t2twin simdata` made it; imported pairs have no scale."""
        return self.scale is not None or self.world is not None

    @property
    def is_protocol(self) -> bool:
        """Whether it was made by the protocol of Grella et al. 2023, whole or thinned.

        Its training and validation hold versions of the paper's primitives, its test hand tools,
        all pressed with one force. Only such a dataset is put beside the paper's figures.
        """
        return self.is_simulated and (self.world is None or self.world.name == PAPER)

    @property
    def world_name(self) -> str | None:
        """The name of what made it: the protocol's scale, or a world's; None of imported pairs."""
        if not self.is_simulated:
            return None
        return self.scale or (PAPER if self.world is None else self.world.name)


def check_layout(x_mm: tuple[float, ...], y_mm: tuple[float, ...]) -> None:
    """Raises ValueError where these are no layout's, or not one x and one y for each taxel."""
    if not x_mm or len(x_mm) != len(y_mm):
        raise ValueError(
            f"layout_x_mm has {len(x_mm)} and layout_y_mm {len(y_mm)} positions; each taxel needs "
            "one of both"
        )
    try:
        Layout("of these", np.array(x_mm), np.array(y_mm), np.full(len(x_mm), PAD_DIAMETER_MM))
    except T2TwinError as error:
        raise ValueError(str(error)) from None


def is_sha256(digits: str) -> bool:
    """Whether these are a sha256's hexadecimal digits, in lower case."""
    return len(digits) == SHA256_DIGITS and set(digits) <= set("0123456789abcdef")


def versions() -> dict[str, str]:
    """Of everything that may change a shard's bytes, on this machine."""
    return {name: version(name) for name in PACKAGES} | {"zlib": zlib.ZLIB_RUNTIME_VERSION}


def _is_shard_path(path: str) -> bool:
    split, _, name = path.partition("/")
    is_file = "/" not in name and "\0" not in name and PurePosixPath(name).suffix == ".parquet"
    return split in SPLITS and is_file
