"""One look at every picture of a dataset: how near to its likes it is, and how far from its shape.

Shape letters: n pairs of a shape, B numbers of a coarse picture.
"""

import os
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

import numpy as np
import pyarrow.parquet as pq
from tqdm import tqdm

from sim.dataset import ROWS_AT_ONCE, shard_path
from sim.png import decode_png
from translate.report.material import Dataset

BLOCK_PX = 8
"""Side of the squares that pictures are averaged over, pixels: noise falls to an eighth."""

ROWS_COMPARED = 256
"""Pictures compared at a time with all others of the shape; bounds the memory."""


@dataclass(frozen=True)
class Scan:
    """Of every pair, in the order of Dataset.column.

    nearest_grey: (P,) root mean square difference between its coarse picture and the nearest other
    one of its shape, grey levels; infinite where the shape has no other. nearest: (P,) that other
    pair's place in the same order, or its own. off_grey: (P,) the same difference from the shape's
    median picture.
    """

    nearest_grey: np.ndarray
    nearest: np.ndarray
    off_grey: np.ndarray


def scan(dataset: Dataset) -> Scan:
    """Decodes every picture once."""
    found = {}
    of_shape: dict[tuple[str, str], list[int]] = {}
    for place, (split, row) in enumerate(dataset.places):
        of_shape.setdefault((split, dataset.tables[split]["shape"][row].as_py()), []).append(place)
    pairs = len(dataset.places)
    nearest_grey, nearest, off_grey = np.zeros(pairs), np.arange(pairs), np.zeros(pairs)

    def look(key: tuple[str, str]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        coarse = _coarse_pictures(dataset, *key)
        median = np.median(coarse, axis=0)
        coarse -= median  # nearer to nought, so that single precision does
        return *nearest_others(coarse), np.sqrt(np.square(coarse).mean(axis=1))

    with ThreadPoolExecutor(os.cpu_count()) as pool:
        looks = pool.map(look, of_shape)
        for places, found in zip(
            of_shape.values(),
            tqdm(looks, total=len(of_shape), desc="pictures", unit="shape"),
            strict=True,
        ):
            here = np.array(places)
            nearest_grey[here], nearest[here], off_grey[here] = found[0], here[found[1]], found[2]
    return Scan(nearest_grey, nearest, off_grey)


def nearest_others(coarse: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The nearest other row of each: root mean square difference (n,) and its index (n,).

    coarse: (n, B). The difference is infinite, and the index its own, where there is no other.
    """
    squares = np.square(coarse).sum(axis=1)
    least, where = np.full(len(coarse), np.inf), np.arange(len(coarse))
    if len(coarse) == 1:
        return least, where
    for start in range(0, len(coarse), ROWS_COMPARED):
        rows = np.arange(start, min(start + ROWS_COMPARED, len(coarse)))
        apart = squares[rows, None] + squares[None] - 2.0 * coarse[rows] @ coarse.T
        apart[np.arange(rows.size), rows] = np.inf
        where[rows] = apart.argmin(axis=1)
        least[rows] = apart.min(axis=1)
    return np.sqrt(np.maximum(least, 0.0) / coarse.shape[1]), where


def coarse_picture(picture: np.ndarray) -> np.ndarray:
    """A picture, (rows, columns, 3) uint8, averaged over squares of BLOCK_PX: (B,) float32.

    What does not fill a square, at the right and below, is left out.
    """
    rows, columns = (side // BLOCK_PX for side in picture.shape[:2])
    whole = picture[: rows * BLOCK_PX, : columns * BLOCK_PX].astype(np.float32)
    return whole.reshape(rows, BLOCK_PX, columns, BLOCK_PX, 3).mean(axis=(1, 3)).ravel()


def _coarse_pictures(dataset: Dataset, split: str, shape: str) -> np.ndarray:
    """(n, B) float32, in the order of the shard's rows."""
    with pq.ParquetFile(dataset.data / shard_path(split, shape)) as shard:
        return np.stack(
            [
                coarse_picture(decode_png(image["bytes"]))
                for batch in shard.iter_batches(ROWS_AT_ONCE, columns=["image"])
                for image in batch.column(0).to_pylist()
            ]
        )
