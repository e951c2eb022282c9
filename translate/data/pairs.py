"""One split of a data set, ready to train on: images decoded once into a cache, counts in memory.

The cache lies in the data set's folder (`cache/`), one uint8 .npy a split, size and color, named
by the first digits of info.json's SHA-256: another data set in the same folder gets another cache.

Shape letters: P pairs, S image side, c channels, N taxels.

What one step of a training learns from.
"""

import os
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, fields
from itertools import chain, islice
from pathlib import Path
from typing import Protocol

import numpy as np
import torch
from numpy.lib import format as npy
from PIL import Image

from t2twin.core.cached_files import add_checksum, is_intact
from t2twin.core.errors import T2TwinError
from t2twin.core.files import atomic_write
from t2twin.core.images import decode_png
from t2twin.core.progress import Progress
from t2twin.sim.cyskin.layout import PAD_DIAMETER_MM, Layout
from t2twin.sim.dataset.columns import FIELD, POSE
from t2twin.sim.dataset.store import (
    INFO,
    field,
    iter_images,
    read_info,
    read_split,
    sha256_of,
    split_shards,
    taxels,
)
from t2twin.translate.data.background_frames import Untouched, has_untouched, load_untouched
from t2twin.translate.data.images import to_pixels

CACHE = "cache"
IMAGES_AT_ONCE = 256
"""Images decoded together; bounds the memory that building a cache takes, some 60 MB."""


@dataclass(frozen=True)
class ImageFile:
    """Images in an .npy file, read as they are asked for.

    places: of those images of the file that these are, None for all.
    """

    path: Path
    places: np.ndarray | None = None

    def __len__(self) -> int:
        there = np.load(self.path, mmap_mode="r") if self.places is None else self.places
        return there.shape[0]

    def __getitem__(self, index: np.ndarray | slice) -> np.ndarray:
        """(b, S, S, c) uint8. The map is closed again, so what was read does not stay resident."""
        own = index if self.places is None else self.places[index]
        return np.array(np.load(self.path, mmap_mode="r")[own])


class BackgroundFrames(Protocol):
    """Background frames, chosen by the numbers of pairs."""

    def __getitem__(self, index: np.ndarray | slice) -> np.ndarray: ...


@dataclass(frozen=True)
class Pictures:
    """DIGIT images, each with its DIGIT's background frame after it where there are frames.

    untouched: gives the frames of chosen pairs, (b, S, S, 3) uint8, or one for all, (S, S, 3).
    """

    images: ImageFile
    untouched: BackgroundFrames | None = None

    def __len__(self) -> int:
        return len(self.images)

    def __getitem__(self, index: np.ndarray | slice) -> np.ndarray:
        """(b, S, S, c) uint8, c being 6 with the frames."""
        pictures = self.images[index]
        if self.untouched is None:
            return pictures
        frames = np.broadcast_to(self.untouched[index], pictures.shape)
        return np.concatenate([pictures, frames], axis=-1)


@dataclass(frozen=True)
class Pairs:
    """One split of a data set.

    images: the P DIGIT images, (S, S, c) each. counts: (P, N) float32.
    shapes, families: (P,) names. x_mm, y_mm, yaw_rad, force_n: (P,) the presses.
    field: (P, F) uint16, counts, and untouched, the DIGITs' frames, where they were asked for.
    """

    images: ImageFile
    counts: np.ndarray
    shapes: np.ndarray
    families: np.ndarray
    x_mm: np.ndarray
    y_mm: np.ndarray
    yaw_rad: np.ndarray
    force_n: np.ndarray
    field: np.ndarray | None = None
    untouched: Untouched | None = None

    def __len__(self) -> int:
        return self.counts.shape[0]

    @property
    def pictures(self) -> Pictures:
        """What a translator looks at."""
        return Pictures(self.images, self.untouched)

    def some(self, places: np.ndarray) -> "Pairs":
        """Those at these places, (b,), of a split whose images are whole."""
        apart = ("images", "field", "untouched")
        rest = {f.name: getattr(self, f.name)[places] for f in fields(self) if f.name not in apart}
        return Pairs(
            images=ImageFile(self.images.path, places),
            field=None if self.field is None else self.field[places],
            untouched=None if self.untouched is None else self.untouched.some(places),
            **rest,
        )


@dataclass(frozen=True)
class DataInfo:
    """What info.json says of a data set, and its SHA-256.

    layout: the taxel layout's name. x_mm, y_mm: (N,) its positions. full_scale_counts: where the
    taxels saturate. world: what made the pairs (module origin), None of imported ones and where a
    run of an older version does not know. train_pairs: how many there are to train on. field_x_mm,
    field_y_mm: (F,) places of the field, None where the pairs hold none. pad_diameter_mm: (N,) of
    the taxels, None where it is not known.
    """

    sha256: str
    layout: str
    x_mm: np.ndarray
    y_mm: np.ndarray
    full_scale_counts: float
    world: str | None = None
    train_pairs: int | None = None
    field_x_mm: np.ndarray | None = None
    field_y_mm: np.ndarray | None = None
    pad_diameter_mm: np.ndarray | None = None

    @property
    def taxels(self) -> Layout:
        """The layout itself, its pads of the usual size where that is not known."""
        pads = self.pad_diameter_mm
        usual = np.full(self.x_mm.size, PAD_DIAMETER_MM)
        return Layout(self.layout, self.x_mm, self.y_mm, usual if pads is None else pads)

    @property
    def world_shown(self) -> str:
        """The world's name, or the first digits of the data set's where it has none."""
        return self.world or f"data set {self.sha256[:8]}"


def load_info(data_dir: Path) -> DataInfo:
    """Reads DIR/info.json. Raises T2TwinError where it is missing or wrong."""
    info = read_info(data_dir)
    pads = info.parameters.cyskin.pad_diameter_mm if info.parameters else info.pad_diameter_mm
    return DataInfo(
        sha256=sha256_of(data_dir / INFO),
        layout=info.layout,
        x_mm=np.array(info.layout_x_mm),
        y_mm=np.array(info.layout_y_mm),
        full_scale_counts=float(info.full_scale_counts),
        world=info.world_name,
        train_pairs=info.pairs["train"],
        field_x_mm=known(info.field_x_mm),
        field_y_mm=known(info.field_y_mm),
        pad_diameter_mm=known(pads),
    )


def known(values: tuple[float, ...] | None) -> np.ndarray | None:
    """An array, or None of None."""
    return None if values is None else np.array(values)


def load_pairs(
    data_dir: Path,
    split: str,
    size: int,
    grey: bool,
    cache_dir: Path | None = None,
    with_field: bool = False,
) -> Pairs:
    """One split with its images at size x size, grey or RGB.

    cache_dir: where decoded images are kept, by default the data set's `cache`. with_field: also
    the field's counts, and the DIGITs' untouched frames where the pairs hold them.
    Raises T2TwinError for an unknown, missing or unfinished split, and for pairs without a field
    where it is asked for.
    """
    info, stored = load_info(data_dir), read_info(data_dir)
    if with_field and info.field_x_mm is None:
        raise T2TwinError(
            f"the pairs in {data_dir} hold no field; make a world that has it, such as "
            "`t2twin simdata --world union`"
        )
    more = [FIELD] if with_field else []
    table = read_split(data_dir, split, ["shape", "family", *POSE, "taxels", *more])
    counts = taxels(table)
    color, name = "grey" if grey else "rgb", info.sha256[:12]
    folder = cache_dir or data_dir / CACHE
    cache = folder / f"{split}-{size}-{color}-{name}.npy"
    shape = (table.num_rows, size, size, 1 if grey else 3)
    if not _is_whole(cache, shape):
        shards = split_shards(stored, split)
        images = chain.from_iterable(iter_images(data_dir, shard) for shard in shards)
        _write_cache(cache, images, shape, stored.image_shape)
    return Pairs(
        images=ImageFile(cache),
        counts=counts,
        shapes=np.array(table["shape"].to_pylist()),
        families=np.array(table["family"].to_pylist()),
        field=field(table) if with_field else None,
        untouched=load_untouched(data_dir, split, size, folder, name)
        if with_field and has_untouched(stored)
        else None,
        **{name: table[name].to_numpy() for name in POSE},
    )


def usable_cache(data_dir: Path, out_dir: Path) -> Path:
    """The data set's cache folder, or one in out_dir where the data set is read-only."""
    return (data_dir if os.access(data_dir, os.W_OK) else out_dir) / CACHE


def _is_whole(path: Path, shape: tuple[int, int, int, int]) -> bool:
    """Whether images of this shape are there; what is damaged is decoded anew."""
    if not is_intact(path):
        return False
    try:
        images = np.load(path, mmap_mode="r")
    except Exception:  # what a damaged head raises is of many kinds
        return False
    return images.shape == shape and images.dtype == np.uint8


def _write_cache(
    path: Path,
    images: Iterator[bytes],
    shape: tuple[int, int, int, int],
    stored: tuple[int, int, int] | None,
) -> None:
    """Decodes every image once, batch after batch, in parallel threads, to an .npy file.

    images: PNG bytes of so many rows, in the order of read_split. stored: the shape that all of
    them have, where info.json says it.
    """
    rows, size, _, channels = shape
    header = {
        "descr": npy.dtype_to_descr(np.dtype(np.uint8)),
        "fortran_order": False,
        "shape": shape,
    }
    with (
        atomic_write(path) as temporary,
        temporary.open("w+b") as file,
        ThreadPoolExecutor() as pool,
        Progress(
            total=rows, desc=f"decoding {path.stem}", unit="image", disable=rows < 1000
        ) as bar,
    ):
        npy.write_array_header_1_0(file, header)
        while encoded := list(islice(images, IMAGES_AT_ONCE)):
            for pixels in pool.map(lambda png: _decode(png, stored, size, channels == 1), encoded):
                file.write(pixels.tobytes())
            bar.update(len(encoded))
        add_checksum(file, path.name)


def _decode(png: bytes, stored: tuple[int, int, int] | None, size: int, grey: bool) -> np.ndarray:
    pixels = decode_png(png)
    if pixels.shape != (stored or pixels.shape):
        raise T2TwinError(
            f"a stored picture is {pixels.shape} and info.json says {stored}; `t2twin simdata "
            "--verify` names its shard"
        )
    return to_pixels(Image.fromarray(pixels), size, grey)


@dataclass(frozen=True)
class Examples:
    """B pairs. images: as `images.to_input` makes them, (B, c, S, S). counts: (B, N) float32.

    field: (B, F) float32, counts, for a translator that learns it. force_n: (B,) float32, 0 where
    nothing touches.
    """

    images: torch.Tensor
    counts: torch.Tensor
    field: torch.Tensor | None = None
    force_n: torch.Tensor | None = None
