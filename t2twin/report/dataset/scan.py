"""Distances between the images of a dataset: to the nearest image, and to the median of the shape.

Shape letters: n pairs of a shape, B values of a coarse image.
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
"""Side of the blocks over which images are averaged, pixels: reduces the noise to an eighth."""

BATCH_SIZE = 256
"""Number of images compared at a time with all others of the shape; limits memory."""


@dataclass(frozen=True)
class Scan:
    """RMS differences of every pair, in the order of Dataset.column, (P,) each.

    nearest_grey: to the nearest coarse image of the same shape in the same shard, grey levels;
    infinite without another image. alike_counts: smallest difference of counts to another such pair
    whose image differs by less than the noise; infinite without one. residual_grey: to the median
    image of the shape.
    """

    nearest_grey: np.ndarray
    alike_counts: np.ndarray
    residual_grey: np.ndarray


def scan(dataset: Dataset, noise_grey: float) -> Scan:
    """Compares all images. noise_grey: standard deviation of the image noise."""
    shards = _indices_by_shard(dataset)
    shapes, counts = dataset.shapes, dataset.counts
    nearest_grey, alike_counts, residual_grey = np.zeros((3, len(shapes)))

    def scan_shard(path: str) -> None:
        coarse = _coarse_images(dataset, path)
        own = shapes[shards[path]]
        for name in np.unique(own):
            members = own == name
            at = shards[path][members]
            # Residuals are small, which preserves single precision.
            residual = coarse[members] - np.median(coarse[members], axis=0)
            near = nearest_others(residual, counts[at].astype(float), noise_grey)
            nearest_grey[at], alike_counts[at] = near
            residual_grey[at] = np.sqrt(np.square(residual).mean(axis=1))

    with ThreadPoolExecutor(cores()) as pool:
        done = pool.map(scan_shard, shards)
        for _ in Progress(done, total=len(shards), desc="images", unit="shard"):
            pass
    return Scan(nearest_grey, alike_counts, residual_grey)


def _indices_by_shard(dataset: Dataset) -> dict[str, np.ndarray]:
    """Indices of each shard's pairs in Dataset.column, by path, in the order of its rows."""
    paths = [path for split in dataset.tables for path in split_shards(dataset.info, split)]
    ends = np.cumsum([dataset.info.shards[path].pairs for path in paths])
    places = np.split(np.arange(ends[-1]), ends[:-1])
    return dict(zip(paths, places, strict=True))


def nearest_others(
    coarse: np.ndarray, counts: np.ndarray, noise_grey: float
) -> tuple[np.ndarray, np.ndarray]:
    """nearest_grey and alike_counts of Scan, (n,) each.

    coarse: (n, B) images. counts: (n, N).
    """
    nearest_grey, alike_counts = np.full((2, len(coarse)), np.inf)
    for start in range(0, len(coarse), BATCH_SIZE):
        rows = np.arange(start, min(start + BATCH_SIZE, len(coarse)))
        grey_distances, counts_distances = (_distances(of, rows) for of in (coarse, counts))
        grey_distances[np.arange(rows.size), rows] = np.inf
        nearest_grey[rows] = grey_distances.min(axis=1)
        alike = np.where(grey_distances < noise_grey, counts_distances, np.inf)
        alike_counts[rows] = alike.min(axis=1)
    return nearest_grey, alike_counts


def _distances(values: np.ndarray, rows: np.ndarray) -> np.ndarray:
    """RMS differences of some rows of (n, B) to all rows: (rows, n)."""
    squares = np.square(values).sum(axis=1)
    sums = squares[rows, None] + squares[None] - 2.0 * values[rows] @ values.T
    return np.sqrt(np.maximum(sums, 0.0) / values.shape[1])


def coarse_image(image: np.ndarray) -> np.ndarray:
    """An image, (rows, columns, 3) uint8, averaged over blocks of BLOCK_PX: (B,) float32.

    Incomplete blocks at the right and at the bottom are omitted.
    """
    rows, columns = (side // BLOCK_PX for side in image.shape[:2])
    whole = image[: rows * BLOCK_PX, : columns * BLOCK_PX].astype(np.float32)
    return whole.reshape(rows, BLOCK_PX, columns, BLOCK_PX, 3).mean(axis=(1, 3)).ravel()


def _coarse_images(dataset: Dataset, path: str) -> np.ndarray:
    """(n, B) float32, in the order of the shard's rows. path: of the shard."""
    return np.stack([coarse_image(decode_png(png)) for png in iter_images(dataset.data, path)])
