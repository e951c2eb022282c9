"""One look at every picture of a dataset: how near to its likes it is, and how far from its shape.

Shape letters: n pairs of a shape, B numbers of a coarse picture.
"""

from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

import numpy as np

from t2twin.core.images import decode_png
from t2twin.core.machine import cores
from t2twin.core.progress import Progress
from t2twin.report.dataset.tables import Dataset
from t2twin.sim.dataset.store import iter_images, split_shards

BLOCK_PX = 8
"""Side of the squares that pictures are averaged over, pixels: noise falls to an eighth."""

ROWS_COMPARED = 256
"""Pictures compared at a time with all others of the shape; bounds the memory."""


@dataclass(frozen=True)
class Scan:
    """Of every pair, in the order of Dataset.column.

    nearest_grey: (P,) root mean square difference between its coarse picture and the nearest other
    one of its shape in the same shard, grey levels; infinite where there is no other.
    alike_counts: (P,) least root mean square difference of its taxels from those of another such
    pair whose picture is within the noise; infinite where there is none. off_grey: (P,) difference
    of its picture from the shape's median picture.
    """

    nearest_grey: np.ndarray
    alike_counts: np.ndarray
    off_grey: np.ndarray


def scan(dataset: Dataset, noise_grey: float) -> Scan:
    """Decodes every picture once. noise_grey: standard deviation of a picture's noise."""
    shards = _places_of_shards(dataset)
    shapes, counts = dataset.shapes, dataset.counts
    nearest_grey, alike_counts, off_grey = np.zeros((3, len(shapes)))

    def look(path: str) -> None:
        coarse = _coarse_pictures(dataset, path)
        own = shapes[shards[path]]
        for name in np.unique(own):
            mine = own == name
            here = shards[path][mine]
            off = coarse[mine] - np.median(coarse[mine], axis=0)  # nearer to zero: single precision
            near = nearest_others(off, counts[here].astype(float), noise_grey)
            nearest_grey[here], alike_counts[here] = near
            off_grey[here] = np.sqrt(np.square(off).mean(axis=1))

    with ThreadPoolExecutor(cores()) as pool:
        looks = pool.map(look, shards)
        for _ in Progress(looks, total=len(shards), desc="pictures", unit="shard"):
            pass
    return Scan(nearest_grey, alike_counts, off_grey)


def _places_of_shards(dataset: Dataset) -> dict[str, np.ndarray]:
    """The places of each shard's pairs in Dataset.column, in the order of its rows, by path."""
    paths = [path for split in dataset.tables for path in split_shards(dataset.info, split)]
    ends = np.cumsum([dataset.info.shards[path].pairs for path in paths])
    places = np.split(np.arange(ends[-1]), ends[:-1])
    return dict(zip(paths, places, strict=True))


def nearest_others(
    coarse: np.ndarray, counts: np.ndarray, noise_grey: float
) -> tuple[np.ndarray, np.ndarray]:
    """How near the others come to each row: nearest_grey and alike_counts of Scan, (n,) each.

    coarse: (n, B) pictures. counts: (n, N) taxels.
    """
    nearest_grey, alike_counts = np.full((2, len(coarse)), np.inf)
    for start in range(0, len(coarse), ROWS_COMPARED):
        rows = np.arange(start, min(start + ROWS_COMPARED, len(coarse)))
        apart_grey, apart_counts = (_apart(of, rows) for of in (coarse, counts))
        apart_grey[np.arange(rows.size), rows] = np.inf
        nearest_grey[rows] = apart_grey.min(axis=1)
        alike_counts[rows] = np.where(apart_grey < noise_grey, apart_counts, np.inf).min(axis=1)
    return nearest_grey, alike_counts


def _apart(values: np.ndarray, rows: np.ndarray) -> np.ndarray:
    """Root mean square difference of some rows of (n, B) from all: (rows, n)."""
    squares = np.square(values).sum(axis=1)
    apart = squares[rows, None] + squares[None] - 2.0 * values[rows] @ values.T
    return np.sqrt(np.maximum(apart, 0.0) / values.shape[1])


def coarse_picture(picture: np.ndarray) -> np.ndarray:
    """A picture, (rows, columns, 3) uint8, averaged over squares of BLOCK_PX: (B,) float32.

    What does not fill a square, at the right and below, is left out.
    """
    rows, columns = (side // BLOCK_PX for side in picture.shape[:2])
    whole = picture[: rows * BLOCK_PX, : columns * BLOCK_PX].astype(np.float32)
    return whole.reshape(rows, BLOCK_PX, columns, BLOCK_PX, 3).mean(axis=(1, 3)).ravel()


def _coarse_pictures(dataset: Dataset, path: str) -> np.ndarray:
    """(n, B) float32, in the order of the shard's rows. path: the shard's."""
    pictures = iter_images(dataset.data, path)
    return np.stack([coarse_picture(decode_png(png)) for png in pictures])
