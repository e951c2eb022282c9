"""The pairs of one dataset split: images in a cache of decoded .npy files, counts in memory.

Source and target are those of a run, which may exchange those of the dataset. The cache is the
folder `cache` of the dataset; its file names contain the first digits of info.json's SHA-256.

Shape letters: P pairs, B batch, U background frames, S image side, c channels, N taxels, F places
of the dense counts, H side of the contact maps.
"""

import os
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, fields, replace
from functools import partial
from itertools import groupby, islice
from pathlib import Path
from typing import Annotated, Any, BinaryIO, cast

import numpy as np
import torch
from msgspec import UNSET, Meta, Struct, UnsetType
from msgspec import field as renamed
from numpy.lib.format import open_memmap
from PIL import Image
from torch.nn import functional

from t2twin.core.cache_dir import write_once
from t2twin.core.errors import T2TwinError
from t2twin.core.images import decode_png
from t2twin.core.progress import Progress
from t2twin.sim.dataset.columns import BACKGROUND, CONTACT_MAPS, DENSE_COUNTS, PATH, POSE, column
from t2twin.sim.dataset.info import (
    COUNTS,
    IMAGE,
    ArrayInfo,
    CameraInfo,
    DatasetInfo,
    SensorInfo,
    Sha256,
)
from t2twin.sim.dataset.store import (
    INFO,
    iter_images,
    iter_shards,
    lists,
    read_info,
    read_split,
    sha256_of,
    split_shards,
)
from t2twin.sim.sensors.defaults import ROLES
from t2twin.sim.taxels.phi import Phi
from t2twin.translate.data.images import COLORS, WHITE_GREY, to_pixels

CACHE = "cache"
# Columns of the shear force on the gel camera after its role, of recipes with motion
SHEAR = ("shear_x_n", "shear_y_n")
MAX_STILL = 0.5  # Largest share of still paths that teaches it (assumed; 0.93 does not, measured)
UNITS = np.array([1e-3, 0.1], np.float32)  # mm and kPa of the units of CONTACT_MAPS
BATCH_SIZE = 256  # Images decoded together; bounds memory to 60 MB


@dataclass(frozen=True)
class ImageFile:
    """Images in an .npy file, read on access, each followed by its background frame if given."""

    path: Path
    places: np.ndarray | None = None  # indices in the file, which may repeat; None for all
    backgrounds: "ImageFile | np.ndarray | None" = None  # one for each image, (S, S, 3) uint8

    def __len__(self) -> int:
        images = np.load(self.path, mmap_mode="r") if self.places is None else self.places
        return images.shape[0]

    def __getitem__(self, index: np.ndarray | slice) -> np.ndarray:
        """(b, S, S, c) uint8; c = 6 with background frames. The memory map is closed again, so that
        its pages are freed."""
        own = index if self.places is None else self.places[index]
        images = np.array(np.load(self.path, mmap_mode="r")[own])
        if self.backgrounds is None:
            return images
        return np.concatenate([images, self.backgrounds[index]], axis=-1)

    def subset(self, places: np.ndarray) -> "ImageFile":
        """The images with these indices, (b,), without background frames."""
        return ImageFile(self.path, places if self.places is None else self.places[places])

    def mean(self) -> np.ndarray:
        """(S, S, c) float32, grey levels: the mean of all images in the file."""
        images = np.load(self.path, mmap_mode="r")
        total = np.zeros(images.shape[1:])
        for image in images:
            total += image
        return (total / len(images)).astype(np.float32)


@dataclass(frozen=True)
class TactilePictures:
    """The pictures of counts, from 0 to 255 at full scale, made on access."""

    counts: np.ndarray  # (P, N)
    phi: Phi  # of their layout at the pictures' size
    full_scale: float
    channels: int  # of equal values

    @classmethod
    def of(cls, counts: np.ndarray, array: ArrayInfo, size: int, grey: bool) -> "TactilePictures":
        """The pictures of counts, (P, N), at size x size, grey or with three equal channels."""
        phi = array.phi.resized((size, size))
        return cls(counts, phi, array.full_scale, 1 if grey else COLORS)

    def __len__(self) -> int:
        return len(self.counts)

    def __getitem__(self, index: np.ndarray | slice) -> np.ndarray:
        """(b, S, S, c) float32."""
        images = self.phi(self.counts[index]) * np.float32(WHITE_GREY / self.full_scale)
        return np.repeat(images[..., None], self.channels, axis=-1)

    def subset(self, places: np.ndarray) -> "TactilePictures":
        """The pictures with these indices, (b,)."""
        return replace(self, counts=self.counts[places])


Readings = ImageFile | np.ndarray  # Images, or counts, (P, N) float32
Pictures = ImageFile | TactilePictures  # The pictures of the source's readings


@dataclass(frozen=True)
class Pairs:
    """The pairs of one split. What was not loaded, or is not in the dataset, is None."""

    source: Readings  # P images, (S, S, c) each, or counts
    target: Readings
    shapes: np.ndarray  # (P,) names
    families: np.ndarray
    x_mm: np.ndarray  # (P,), of the presses
    y_mm: np.ndarray
    yaw_rad: np.ndarray
    force_n: np.ndarray
    dense_counts: np.ndarray | None = None  # (P, F) uint16, of the target
    backgrounds: ImageFile | None = None  # background frames of the source
    shear_n: np.ndarray | None = None  # (P, 2), along x and y on the gel camera
    is_moving: np.ndarray | None = None  # (P,) bool, of recipes with motion
    contact: ImageFile | None = None  # (P, 2, H, H) float16, mm and kPa, on the source's view
    pictures: TactilePictures | None = None  # of the counts of a source that is a taxel array

    def __len__(self) -> int:
        return len(self.target)

    @property
    def images(self) -> ImageFile:
        """The images, of two gel cameras those of the source."""
        found = self.source if isinstance(self.source, ImageFile) else self.target
        assert isinstance(found, ImageFile)
        return found

    @property
    def counts(self) -> np.ndarray:
        """The counts, of two taxel arrays those of the target."""
        found = self.source if isinstance(self.target, ImageFile) else self.target
        assert isinstance(found, np.ndarray)
        return found

    @property
    def inputs(self) -> Pictures:
        """The inputs of a translator."""
        if self.pictures is not None:
            return self.pictures
        return replace(self.images, backgrounds=self.backgrounds)

    def subset(self, places: np.ndarray) -> "Pairs":
        """The pairs with these indices, (b,)."""
        own: dict[str, Any] = {}
        for each in fields(self):
            value = getattr(self, each.name)
            if isinstance(value, ImageFile | TactilePictures):
                value = value.subset(places)
            own[each.name] = value[places] if isinstance(value, np.ndarray) else value
        return Pairs(**own)


class DataInfo(Struct, frozen=True):
    """What a run has of its dataset: the part "data" of its config.json."""

    sha256: Sha256 = renamed(name="info_sha256")  # of info.json
    source: SensorInfo
    target: SensorInfo
    recipe: str | None = None  # its name, None for imported pairs
    train_pairs: Annotated[int, Meta(ge=0)] | None = None
    # smallest and largest force of the presses; absent for imported pairs
    force_n: tuple[float, float] | UnsetType = UNSET
    has_shear: bool | UnsetType = UNSET  # whether the pairs teach the shear force,
    has_contact: bool | UnsetType = UNSET  # and the contact maps of the source; absent if not

    @property
    def direction(self) -> str:
        """What is predicted from what, as "image-to-counts"."""
        return f"{self.source.value}-to-{self.target.value}"

    @property
    def array(self) -> ArrayInfo:
        """The taxel array, the target's first. Raises T2TwinError without one."""
        for sensor in (self.target, self.source):
            if sensor.value == COUNTS:
                return sensor
        raise T2TwinError(f"{self.source.words} and {self.target.words} contain no counts")

    @property
    def camera(self) -> CameraInfo:
        """The gel camera, the source's first. Raises T2TwinError without one."""
        for sensor in (self.source, self.target):
            if sensor.value == IMAGE:
                return sensor
        raise T2TwinError(f"{self.source.words} and {self.target.words} contain no image")


def load_info(data_dir: Path, reverse: bool = False) -> DataInfo:
    """Reads DIR/info.json. reverse: exchange source and target.

    Raises T2TwinError if it is missing or invalid.
    """
    info = read_info(data_dir)
    source, target = (info.sensors[role] for role in _roles(reverse))
    motion = info.recipe.motion if info.recipe and source.value == IMAGE else None
    return DataInfo(
        sha256_of(data_dir / INFO),
        source,
        target,
        recipe=info.recipe_name,
        train_pairs=info.pairs["train"],
        force_n=UNSET if info.recipe is None else info.recipe.force_range_n,
        has_shear=True if motion and motion.still <= MAX_STILL else UNSET,
        has_contact=True if source.value == IMAGE and source.contact_grid else UNSET,
    )


def _roles(reverse: bool) -> tuple[str, ...]:
    """The dataset's roles of a run's source and target."""
    return ROLES[::-1] if reverse else ROLES


def load_pairs(
    data_dir: Path,
    split: str,
    size: int,
    grey: bool,
    cache_dir: Path | None = None,
    with_dense_counts: bool = False,
    reverse: bool = False,
    contact_side: int | None = None,
) -> Pairs:
    """Loads one split with pictures at size x size, grey or RGB.

    cache_dir: folder of the decoded images, by default `cache` of the dataset. with_dense_counts:
    also load the dense counts of the target, and background frames if there are any. reverse:
    exchange source and target. contact_side: H of the contact maps to load, if there are any.
    Raises T2TwinError for an unknown, missing or unfinished split, and without dense counts.
    """
    info, stored, roles = load_info(data_dir, reverse), read_info(data_dir), _roles(reverse)
    moves = bool(stored.recipe and stored.recipe.motion) and info.source.value == IMAGE
    if with_dense_counts and (info.target.value == IMAGE or info.target.dense_x_mm is None):
        more = "make a dataset with them, such as `t2twin simdata --recipe union`"
        raise T2TwinError(f"the pairs in {data_dir} have no dense counts; {more}")
    counts = [column(role, stored.values[role]) for role in ROLES if stored.values[role] != IMAGE]
    dense, shear = column(roles[1], DENSE_COUNTS), [column(roles[0], name) for name in SHEAR]
    optional = [dense] if with_dense_counts else []
    optional += ["index", PATH, *shear] if moves else []
    table = read_split(data_dir, split, ["shape", "family", *POSE, *counts, *optional])
    name, folder = info.sha256[:12], cache_dir or data_dir / CACHE

    def readings(role: str, sensor: SensorInfo) -> Readings:
        if sensor.value == COUNTS:
            return lists(table, column(role, COUNTS)).astype(np.float32)
        second = role == ROLES[1] and info.source.value == info.target.value
        color, part = "grey" if grey else "rgb", f"{split}-target" if second else split
        cache = folder / f"{part}-{size}-{color}-{name}.npy"
        shape = (table.num_rows, size, size, 1 if grey else 3)
        images = _pngs(data_dir, stored, split, column(role, IMAGE))
        write = partial(_write_images, images=images, shape=shape, stored=sensor.image_shape)
        write_once(cache, partial(write, name=cache.stem))
        return ImageFile(cache)

    source, backgrounds, pictures = readings(roles[0], info.source), None, None
    if with_dense_counts and has_backgrounds(stored):
        backgrounds = load_backgrounds(data_dir, split, size, folder, name)
    if info.source.value == COUNTS and isinstance(source, np.ndarray):
        pictures = TactilePictures.of(source, info.source, size, grey)
    return Pairs(
        source=source,
        target=readings(roles[1], info.target),
        shapes=np.array(table["shape"].to_pylist()),
        families=np.array(table["family"].to_pylist()),
        dense_counts=lists(table, dense) if with_dense_counts else None,
        backgrounds=backgrounds,
        shear_n=np.column_stack([table[name].to_numpy() for name in shear]) if moves else None,
        is_moving=table["index"].to_numpy() > table[PATH].to_numpy() if moves else None,
        contact=load_contact(data_dir, split, roles[0], contact_side, folder),
        pictures=pictures,
        **{name: table[name].to_numpy() for name in POSE},
    )


def _pngs(data_dir: Path, info: DatasetInfo, split: str, name: str) -> Iterator[bytes]:
    """PNG bytes of a column of images, in the order of read_split."""
    for shard in split_shards(info, split):
        yield from iter_images(data_dir, shard, name)


def load_backgrounds(data_dir: Path, split: str, size: int, cache: Path, name: str) -> ImageFile:
    """The background frames of a split's pairs at size x size, each distinct one stored once.

    cache, name: folder of the decoded frames, and of the dataset in their file names.
    """
    info = read_info(data_dir)
    index = cache / f"{split}-background-{size}-index-{name}.npy"

    def write(file: BinaryIO) -> None:
        pngs = _pngs(data_dir, info, split, column(info.role_of(IMAGE), BACKGROUND))
        pairs, title = info.pairs[cast(Any, split)], f"background frames of {split}"
        bar = Progress(pngs, total=pairs, desc=title, unit="pair", disable=pairs < 1000)
        frames, lengths = [], []
        for png, same in groupby(bar):
            frames.append(_decode(png, None, size, grey=False))
            lengths.append(sum(1 for _ in same))
        with index.open("wb") as places:
            np.save(places, np.repeat(np.arange(len(lengths)), lengths))
        np.save(file, np.stack(frames))

    frames = cache / f"{split}-background-{size}-rgb-{name}.npy"
    if not index.exists():
        frames.unlink(missing_ok=True)
    write_once(frames, write)
    return ImageFile(frames, np.load(index))


def load_contact(
    data_dir: Path, split: str, role: str, side: int | None, cache: Path
) -> ImageFile | None:
    """The contact maps of a split's pairs, (P, 2, side, side) float16: depth, mm, pressure, kPa.

    None without a side, and for pairs without contact maps. cache: of the resampled maps.
    """
    info, names = read_info(data_dir), [column(role, name) for name in CONTACT_MAPS]
    sensor, pairs = info.sensors[role], info.pairs[cast(Any, split)]
    if side is None or sensor.value != IMAGE or (grid := sensor.contact_grid) is None:
        return None

    def write(file: BinaryIO) -> None:
        written, done = open_memmap(file.name, "w+", np.float16, (pairs, 2, side, side)), 0
        for table in iter_shards(data_dir, split, names):
            maps = np.stack([lists(table, name).astype(np.float32) for name in names], axis=1)
            maps = maps.reshape(-1, 2, *grid) * UNITS[:, None, None]
            resampled = functional.interpolate(
                torch.from_numpy(maps), (side, side), mode="bilinear", antialias=True
            )
            written[done : done + len(maps)] = resampled.numpy()
            done += len(maps)
        written.flush()

    path = cache / f"{split}-contact-{role}-{side}-{sha256_of(data_dir / INFO)[:12]}.npy"
    write_once(path, write)
    return ImageFile(path)


def has_backgrounds(info: DatasetInfo) -> bool:
    """Whether the pairs of a dataset contain background frames."""
    return info.recipe is not None and bool(info.recipe.background_frames)


def usable_cache(data_dir: Path, out_dir: Path) -> Path:
    """The cache folder of the dataset, or of out_dir if the dataset is read-only."""
    return (data_dir if os.access(data_dir, os.W_OK) else out_dir) / CACHE


def _write_images(
    file: BinaryIO,
    images: Iterator[bytes],
    shape: tuple[int, int, int, int],
    stored: tuple[int, int, int],
    name: str,
) -> None:
    """Decodes PNG files of a stored shape in parallel threads into an .npy file."""
    rows, size, _, channels = shape
    with (
        ThreadPoolExecutor() as pool,
        Progress(total=rows, desc=f"decoding {name}", unit="image", disable=rows < 1000) as bar,
    ):
        decoded, done = open_memmap(file.name, "w+", np.uint8, shape), 0
        while encoded := list(islice(images, BATCH_SIZE)):
            found = pool.map(lambda png: _decode(png, stored, size, channels == 1), encoded)
            decoded[done : done + len(encoded)] = list(found)
            done += len(encoded)
            bar.update(len(encoded))
        decoded.flush()


def _decode(png: bytes, stored: tuple[int, int, int] | None, size: int, grey: bool) -> np.ndarray:
    pixels = decode_png(png)
    if stored is not None and pixels.shape != stored:
        raise T2TwinError(
            f"a stored image has shape {pixels.shape}, info.json has {stored}; `t2twin simdata "
            "--verify` names the shard"
        )
    return to_pixels(Image.fromarray(pixels), size, grey)


@dataclass(frozen=True)
class Examples:
    """A batch of B pairs for one training step."""

    images: torch.Tensor  # (B, c, S, S), pictures of the source as `Translator.to_input` returns
    targets: torch.Tensor  # (B, N) float32 counts, or images, (B, S, S, c) in grey levels
    dense_counts: torch.Tensor | None = None  # (B, F) float32, for translators that learn it
    force_n: torch.Tensor | None = None  # (B,) float32, 0 without contact
    shear_n: torch.Tensor | None = None  # (B, 2) float32, of recipes with motion
    contact: torch.Tensor | None = None  # (B, 2, H, H) float32, contact maps
