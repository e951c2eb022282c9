"""One split of a data set, ready to train on: images decoded once into a cache, counts in memory.

The cache lies in the data set's folder (`cache/`), one uint8 .npy a split, size and colour, named
by the first digits of info.json's SHA-256: another data set in the same folder gets another cache.

Shape letters: P pairs, S image side, c channels, N taxels.
"""

import hashlib
import io
import os
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow.parquet as pq
from numpy.lib import format as npy
from PIL import Image
from tqdm import tqdm

from t2twin.primitives_cad.errors import T2TwinError
from t2twin.primitives_cad.writing import whole_file
from t2twin.sim.dataset.store import INFO, read_info, read_split, taxels
from t2twin.translate.data.images import to_pixels

CACHE = "cache"
PRESS = ("x_mm", "y_mm", "yaw_rad", "force_n")
ROWS_AT_ONCE = 256
"""Images decoded together; bounds the memory that building a cache takes, some 60 MB."""


@dataclass(frozen=True)
class ImageFile:
    """Images in an .npy file, read as they are asked for."""

    path: Path

    def __len__(self) -> int:
        return np.load(self.path, mmap_mode="r").shape[0]

    def __getitem__(self, index: np.ndarray | slice) -> np.ndarray:
        """(b, S, S, c) uint8. The map is closed again, so what was read does not stay resident."""
        return np.array(np.load(self.path, mmap_mode="r")[index])


@dataclass(frozen=True)
class Pairs:
    """One split of a data set.

    images: the P DIGIT images, (S, S, c) each. counts: (P, N) float32.
    shapes, families: (P,) names. x_mm, y_mm, yaw_rad, force_n: (P,) the presses.
    """

    images: ImageFile
    counts: np.ndarray
    shapes: np.ndarray
    families: np.ndarray
    x_mm: np.ndarray
    y_mm: np.ndarray
    yaw_rad: np.ndarray
    force_n: np.ndarray

    def __len__(self) -> int:
        return self.counts.shape[0]


@dataclass(frozen=True)
class DataInfo:
    """What info.json says of a data set, and its SHA-256.

    layout: the taxel layout's name. x_mm, y_mm: (N,) its positions. full_scale_counts: where the
    taxels saturate.
    """

    sha256: str
    layout: str
    x_mm: np.ndarray
    y_mm: np.ndarray
    full_scale_counts: float

    def as_json(self) -> dict[str, Any]:
        """For a run's config."""
        return {
            "info_sha256": self.sha256,
            "layout": self.layout,
            "layout_x_mm": self.x_mm.tolist(),
            "layout_y_mm": self.y_mm.tolist(),
            "full_scale_counts": self.full_scale_counts,
        }

    @classmethod
    def from_json(cls, content: dict[str, Any]) -> "DataInfo":
        return cls(
            sha256=content["info_sha256"],
            layout=content["layout"],
            x_mm=np.asarray(content["layout_x_mm"], dtype=float),
            y_mm=np.asarray(content["layout_y_mm"], dtype=float),
            full_scale_counts=float(content["full_scale_counts"]),
        )


def load_info(data_dir: Path) -> DataInfo:
    """Reads DIR/info.json. Raises T2TwinError where it is missing or lacks what is needed."""
    content = read_info(data_dir)
    sha256 = hashlib.sha256((data_dir / INFO).read_bytes()).hexdigest()
    try:
        return DataInfo.from_json({**content, "info_sha256": sha256})
    except (ValueError, KeyError, TypeError):
        raise T2TwinError(
            f"{data_dir / INFO} does not name its taxel layout; make the data set anew"
        ) from None


def load_pairs(
    data_dir: Path, split: str, size: int, grey: bool, cache_dir: Path | None = None
) -> Pairs:
    """One split with its images at size x size, grey or RGB.

    cache_dir: where decoded images are kept, by default the data set's `cache`.
    Raises T2TwinError for an unknown, missing or unfinished split.
    """
    info = load_info(data_dir)
    table = read_split(data_dir, split, ["shape", "family", *PRESS, "taxels"])
    counts = taxels(table)
    if counts.shape[1] != info.x_mm.size:
        raise T2TwinError(
            f"the taxels of {data_dir / split} do not fit the layout's {info.x_mm.size} positions"
        )
    colour = "grey" if grey else "rgb"
    cache = (cache_dir or data_dir / CACHE) / f"{split}-{size}-{colour}-{info.sha256[:12]}.npy"
    if not cache.is_file():
        _write_cache(cache, _shards(data_dir, split), table.num_rows, size, grey)
    return Pairs(
        images=ImageFile(cache),
        counts=counts,
        shapes=np.array(table["shape"].to_pylist()),
        families=np.array(table["family"].to_pylist()),
        **{name: table[name].to_numpy() for name in PRESS},
    )


def usable_cache(data_dir: Path, out_dir: Path) -> Path:
    """The data set's cache folder, or one in out_dir where the data set is read-only."""
    return (data_dir if os.access(data_dir, os.W_OK) else out_dir) / CACHE


def _shards(data_dir: Path, split: str) -> list[Path]:
    """In the order in which read_split puts their rows together."""
    named = sorted(path for path in read_info(data_dir)["shards"] if path.startswith(f"{split}/"))
    return [data_dir / path for path in named]


def _write_cache(path: Path, shards: list[Path], rows: int, size: int, grey: bool) -> None:
    """Decodes every image once, batch after batch, in parallel threads, to an .npy file."""
    header = {
        "descr": npy.dtype_to_descr(np.dtype(np.uint8)),
        "fortran_order": False,
        "shape": (rows, size, size, 1 if grey else 3),
    }
    with (
        whole_file(path) as temporary,
        temporary.open("wb") as file,
        ThreadPoolExecutor() as pool,
        tqdm(total=rows, desc=f"decoding {path.stem}", unit="image", disable=rows < 1000) as bar,
    ):
        npy.write_array_header_1_0(file, header)
        for encoded in _encoded_images(shards):
            for pixels in pool.map(lambda png: _decode(png, size, grey), encoded):
                file.write(pixels.tobytes())
            bar.update(len(encoded))


def _encoded_images(shards: list[Path]) -> Iterator[list[bytes]]:
    for shard in shards:
        with pq.ParquetFile(shard) as file:
            for batch in file.iter_batches(batch_size=ROWS_AT_ONCE, columns=["image"]):
                yield [image["bytes"] for image in batch.column(0).to_pylist()]


def _decode(png: bytes, size: int, grey: bool) -> np.ndarray:
    with Image.open(io.BytesIO(png)) as image:
        return to_pixels(image, size, grey)
