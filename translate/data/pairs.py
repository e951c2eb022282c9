"""The pairs of one dataset split: images in a cache of decoded files, counts in memory.

The cache is the folder `cache` of the dataset, with one uint8 .npy file per split, size and color.
One more has background frames, images without contact, and the index of each pair's frame. A
recipe with a fixed light has one frame. File names contain the first digits of the SHA-256 of
info.json, so that another dataset in the same folder has other files.

Shape letters: P pairs, B batch, U background frames, S image side, c channels, N taxels, F places
of the dense counts.
"""

import os
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, fields
from itertools import chain, groupby, islice, repeat
from pathlib import Path
from typing import Annotated, Any, BinaryIO

import numpy as np
import torch
from msgspec import UNSET, Meta, Struct, UnsetType
from msgspec import field as renamed
from numpy.lib import format as npy
from PIL import Image

from t2twin.core.cached_files import cached_file
from t2twin.core.errors import T2TwinError
from t2twin.core.images import decode_png
from t2twin.core.progress import Progress
from t2twin.sim.contact.elastomer import Elastomer, elastomer_of
from t2twin.sim.dataset.columns import (
    BACKGROUND,
    COUNTS,
    DENSE_COUNTS,
    IMAGE,
    PATH,
    POSE,
    column,
)
from t2twin.sim.dataset.format_1 import COVER, IMAGE_SHAPE, TACTILE_IMAGE, VIEW_MM
from t2twin.sim.dataset.info import MAX_COUNTS, DatasetInfo, is_sha256
from t2twin.sim.dataset.store import (
    INFO,
    iter_images,
    lists,
    read_info,
    read_split,
    sha256_of,
    split_shards,
)
from t2twin.sim.taxels.layout import PAD_DIAMETER_MM, Layout
from t2twin.sim.taxels.phi import Phi
from t2twin.translate.data.images import to_pixels

SAME_MM = 1e-3
"""Largest distance of corresponding taxels of equal layouts, mm (assumed: far below the tolerance
of a printed board)."""

CACHE = "cache"
SHEAR = ("shear_x_n", "shear_y_n")
"""Columns of the shear force on the gel camera after its role, of recipes with motion."""

BATCH_SIZE = 256
"""Images decoded together; bounds memory to 60 MB."""


@dataclass(frozen=True)
class ImageFile:
    """Images in an .npy file, read on access.

    places: index in the file of each image, which may repeat; None for all in their order.
    """

    path: Path
    places: np.ndarray | None = None

    def __len__(self) -> int:
        images = np.load(self.path, mmap_mode="r") if self.places is None else self.places
        return images.shape[0]

    def __getitem__(self, index: np.ndarray | slice) -> np.ndarray:
        """(b, S, S, c) uint8. The memory map is closed again, so that its pages are freed."""
        own = index if self.places is None else self.places[index]
        return np.array(np.load(self.path, mmap_mode="r")[own])

    def subset(self, places: np.ndarray) -> "ImageFile":
        """The images with these indices, (b,)."""
        return ImageFile(self.path, places if self.places is None else self.places[places])

    def mean(self) -> np.ndarray:
        """(S, S, c) float32, grey levels: the mean of all images in the file."""
        images = np.load(self.path, mmap_mode="r")
        total = np.zeros(images.shape[1:])
        for image in images:
            total += image
        return (total / len(images)).astype(np.float32)


@dataclass(frozen=True)
class InputImages:
    """Images, each followed by its background frame, (S, S, 3) uint8, if there are frames."""

    images: ImageFile
    backgrounds: ImageFile | np.ndarray | None = None

    def __len__(self) -> int:
        return len(self.images)

    def __getitem__(self, index: np.ndarray | slice) -> np.ndarray:
        """(b, S, S, c) uint8; c = 6 with background frames."""
        images = self.images[index]
        if self.backgrounds is None:
            return images
        return np.concatenate([images, self.backgrounds[index]], axis=-1)


@dataclass(frozen=True)
class Pairs:
    """The pairs of one split.

    images: the P images, (S, S, c) each. counts: (P, N) float32.
    shapes, families: (P,) names. x_mm, y_mm, yaw_rad, force_n: (P,) the presses.
    dense_counts: (P, F) uint16, counts, and backgrounds, if they were loaded. shear_n: (P, 2), N,
    along x and y on the gel camera, and is_moving: (P,) bool, of recipes with motion.
    """

    images: ImageFile
    counts: np.ndarray
    shapes: np.ndarray
    families: np.ndarray
    x_mm: np.ndarray
    y_mm: np.ndarray
    yaw_rad: np.ndarray
    force_n: np.ndarray
    dense_counts: np.ndarray | None = None
    backgrounds: ImageFile | None = None
    shear_n: np.ndarray | None = None
    is_moving: np.ndarray | None = None

    def __len__(self) -> int:
        return self.counts.shape[0]

    @property
    def inputs(self) -> InputImages:
        """The inputs of a translator from images to counts."""
        return InputImages(self.images, self.backgrounds)

    def subset(self, places: np.ndarray) -> "Pairs":
        """The pairs with these indices, (b,)."""
        special = ("images", "backgrounds")
        arrays = {f.name: getattr(self, f.name) for f in fields(self) if f.name not in special}
        own: dict[str, Any] = {n: None if a is None else a[places] for n, a in arrays.items()}
        return Pairs(
            images=self.images.subset(places),
            backgrounds=None if self.backgrounds is None else self.backgrounds.subset(places),
            **own,
        )


class DataInfo(Struct, frozen=True):
    """Properties of a dataset, from its info.json, and the SHA-256 of that file.

    layout: name of the taxel layout. x_mm, y_mm: (N,) its positions. full_scale_counts: where the
    taxels saturate. recipe: name of the recipe, None for imported pairs. train_pairs: number of
    training pairs. dense_x_mm, dense_y_mm: (F,) places of the dense counts, None without dense
    counts. pad_diameter_mm: (N,) of the taxels, None if unknown. has_shear: whether the pairs
    contain the shear force; only present if true. image_shape: rows, columns and channels of the
    images. view_mm: half of what they show along x and y. tactile_image: rows, columns and px/mm.
    dense_pad_mm: diameter of the dense counts' pads. cover: the array's, as in elastomer_json.
    The part "data" of a run's config.json, in which some fields have other names. The defaults are
    those of runs that were trained on datasets of format 1.
    """

    sha256: str = renamed(name="info_sha256")
    layout: str
    x_mm: np.ndarray = renamed(name="layout_x_mm")
    y_mm: np.ndarray = renamed(name="layout_y_mm")
    full_scale_counts: Annotated[float, Meta(ge=1, le=MAX_COUNTS)]
    recipe: str | None = None
    train_pairs: Annotated[int, Meta(ge=0)] | None = None
    dense_x_mm: np.ndarray | None = None
    dense_y_mm: np.ndarray | None = None
    pad_diameter_mm: np.ndarray | None = None
    has_shear: bool | UnsetType = UNSET
    image_shape: tuple[int, int, int] = IMAGE_SHAPE
    view_mm: tuple[float, float] = VIEW_MM
    tactile_image: tuple[int, int, float] = TACTILE_IMAGE
    dense_pad_mm: float = PAD_DIAMETER_MM
    cover: dict[str, Any] = renamed(default_factory=lambda: dict(COVER))

    def check(self) -> None:
        """Raises ValueError for an invalid layout, places, cover or SHA-256."""
        _ = self.taxels, self.dense, self.elastomer
        if not is_sha256(self.sha256):
            raise ValueError("info_sha256 must be 64 hexadecimal digits")

    def same_layout(self, x_mm: np.ndarray, y_mm: np.ndarray) -> bool:
        """Whether positions equal those of the layout, in its order. x_mm, y_mm: (N,), mm."""
        own, other = np.stack([self.x_mm, self.y_mm]), np.stack([x_mm, y_mm])
        return own.shape == other.shape and bool(np.abs(own - other).max() < SAME_MM)

    def same_pads(self, other: Layout) -> bool:
        """Whether a layout of equal positions has pads of equal sizes."""
        own = self.taxels.pad_diameter_mm
        return bool(np.abs(own - other.pad_diameter_mm).max() < SAME_MM)

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

    @property
    def aspect(self) -> float:
        """Width over height of an image."""
        return self.image_shape[1] / self.image_shape[0]

    @property
    def recipe_shown(self) -> str:
        """Name of the recipe, or first digits of the dataset's SHA-256."""
        return self.recipe or f"dataset {self.sha256[:8]}"


def load_info(data_dir: Path) -> DataInfo:
    """Reads DIR/info.json. Raises T2TwinError if it is missing or invalid."""
    info = read_info(data_dir)
    array, camera = info.array, info.camera
    assert array.layout is not None and array.full_scale_counts is not None
    assert camera.image_shape is not None
    arrays = ("dense_x_mm", "dense_y_mm", "pad_diameter_mm")
    given: dict[str, Any] = {
        "view_mm": camera.view_mm,
        "tactile_image": array.tactile_image,
        "dense_pad_mm": array.dense_pad_mm,
        "cover": array.elastomer,
    } | {name: getattr(array, name) and np.array(getattr(array, name)) for name in arrays}
    return DataInfo(
        sha256=sha256_of(data_dir / INFO),
        layout=array.layout,
        x_mm=np.array(array.x_mm),
        y_mm=np.array(array.y_mm),
        full_scale_counts=float(array.full_scale_counts),
        recipe=info.recipe_name,
        train_pairs=info.pairs["train"],
        has_shear=True if info.recipe is not None and info.recipe.motion else UNSET,
        image_shape=camera.image_shape,
        **{name: value for name, value in given.items() if value is not None},
    )


def load_pairs(
    data_dir: Path,
    split: str,
    size: int,
    grey: bool,
    cache_dir: Path | None = None,
    with_dense_counts: bool = False,
) -> Pairs:
    """Loads one split with images at size x size, grey or RGB.

    cache_dir: folder of the decoded images, by default `cache` of the dataset. with_dense_counts:
    also load the dense counts, and the background frames if the pairs contain them.
    Raises T2TwinError for an unknown, missing or unfinished split, and with with_dense_counts for
    pairs without dense counts.
    """
    info, stored = load_info(data_dir), read_info(data_dir)
    if with_dense_counts and info.dense_x_mm is None:
        raise T2TwinError(
            f"the pairs in {data_dir} have no dense counts; make a dataset with them, such as "
            "`t2twin simdata --recipe union`"
        )
    camera, array = stored.role_of(IMAGE), stored.role_of(COUNTS)
    image, count, dense = column(camera, IMAGE), column(array, COUNTS), column(array, DENSE_COUNTS)
    shear = [column(camera, name) for name in SHEAR]
    optional = [dense] if with_dense_counts else []
    optional += ["index", PATH, *shear] if info.has_shear else []
    table = read_split(data_dir, split, ["shape", "family", *POSE, count, *optional])
    counts = lists(table, count).astype(np.float32)
    color, name = "grey" if grey else "rgb", info.sha256[:12]
    folder = cache_dir or data_dir / CACHE
    cache = folder / f"{split}-{size}-{color}-{name}.npy"
    shape = (table.num_rows, size, size, 1 if grey else 3)

    def decode(file: BinaryIO) -> None:
        shards = split_shards(stored, split)
        images = chain.from_iterable(iter_images(data_dir, shard, image) for shard in shards)
        _write_images(file, images, shape, info.image_shape, cache.stem)

    cached_file(cache, shape, decode)
    return Pairs(
        images=ImageFile(cache),
        counts=counts,
        shapes=np.array(table["shape"].to_pylist()),
        families=np.array(table["family"].to_pylist()),
        dense_counts=lists(table, dense) if with_dense_counts else None,
        backgrounds=load_backgrounds(data_dir, split, size, folder, name)
        if with_dense_counts and has_backgrounds(stored)
        else None,
        shear_n=np.column_stack([table[name].to_numpy() for name in shear])
        if info.has_shear
        else None,
        is_moving=table["index"].to_numpy() > table[PATH].to_numpy() if info.has_shear else None,
        **{name: table[name].to_numpy() for name in POSE},
    )


def load_backgrounds(data_dir: Path, split: str, size: int, cache: Path, name: str) -> ImageFile:
    """The background frames of a split's pairs at size x size.

    cache: folder of the decoded frames. name: of the dataset, for their file names. Raises
    T2TwinError if a shard cannot be read.
    """
    info = read_info(data_dir)
    frames = cache / f"{split}-background-{size}-rgb-{name}.npy"
    index = cache / f"{split}-background-{name}.npy"

    def write_index(file: BinaryIO) -> None:
        lengths = [sum(1 for _ in pairs) for _, pairs in groupby(_frames(data_dir, split, info))]
        np.save(file, np.repeat(np.arange(len(lengths)), lengths))

    def write_frames(file: BinaryIO) -> None:
        distinct = (png for png, _ in groupby(_frames(data_dir, split, info)))
        np.save(file, np.stack([_decode(png, None, size, grey=False) for png in distinct]))

    cached_file(index, (info.pairs[split],), write_index)
    frame_of_pair = np.load(index)
    cached_file(frames, (frame_of_pair.max() + 1, size, size, 3), write_frames)
    return ImageFile(frames, frame_of_pair)


def has_backgrounds(info: DatasetInfo) -> bool:
    """Whether the pairs of a dataset contain background frames."""
    return info.recipe is not None and info.recipe.has_more and info.recipe.background_frames


def _frames(data_dir: Path, split: str, info: DatasetInfo) -> Iterator[bytes]:
    """PNG bytes of each pair's frame in the order of read_split. With a fixed light, all have the
    first."""
    shards, pairs = split_shards(info, split), info.pairs[split]
    assert info.recipe is not None
    name = column(info.role_of(IMAGE), BACKGROUND)
    if info.recipe.light.kind == "fixed":
        yield from repeat(next(iter_images(data_dir, shards[0], name)), pairs)
        return
    frames = chain.from_iterable(iter_images(data_dir, shard, name) for shard in shards)
    title = f"background frames of {split}"
    yield from Progress(frames, total=pairs, desc=title, unit="pair", disable=pairs < 1000)


def usable_cache(data_dir: Path, out_dir: Path) -> Path:
    """The cache folder of the dataset, or of out_dir if the dataset is read-only."""
    return (data_dir if os.access(data_dir, os.W_OK) else out_dir) / CACHE


def _write_images(
    file: BinaryIO,
    images: Iterator[bytes],
    shape: tuple[int, int, int, int],
    stored: tuple[int, int, int] | None,
    name: str,
) -> None:
    """Decodes all images in parallel threads into an .npy file.

    images: PNG bytes in the order of read_split. stored: the shape of all images, if info.json
    contains it. name: of the file, for the progress bar.
    """
    rows, size, _, channels = shape
    header = {
        "descr": npy.dtype_to_descr(np.dtype(np.uint8)),
        "fortran_order": False,
        "shape": shape,
    }
    with (
        ThreadPoolExecutor() as pool,
        Progress(total=rows, desc=f"decoding {name}", unit="image", disable=rows < 1000) as bar,
    ):
        npy.write_array_header_1_0(file, header)
        while encoded := list(islice(images, BATCH_SIZE)):
            for pixels in pool.map(lambda png: _decode(png, stored, size, channels == 1), encoded):
                file.write(pixels.tobytes())
            bar.update(len(encoded))


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
    """A batch of B pairs for one training step.

    images: as `images.to_input` returns them, (B, c, S, S). counts: (B, N) float32. dense_counts:
    (B, F) float32, counts, for translators that learn it. force_n: (B,) float32, 0 without contact.
    shear_n: (B, 2) float32, of recipes with motion.
    """

    images: torch.Tensor
    counts: torch.Tensor
    dense_counts: torch.Tensor | None = None
    force_n: torch.Tensor | None = None
    shear_n: torch.Tensor | None = None
