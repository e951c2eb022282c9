"""Near-duplicates, from the distances between the images of a dataset and between its counts.

Shape letters: n pairs of a shape, B values of a coarse image.
"""

from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from t2twin.core.draw import figure
from t2twin.core.images import decode_png
from t2twin.core.machine import cores
from t2twin.core.progress import Progress
from t2twin.report.data import Dataset
from t2twin.sim.dataset.columns import IMAGE, column
from t2twin.sim.dataset.store import iter_images, split_shards
from t2twin.sim.taxels.reading import expected_reading

BLOCK_PX = 8
"""Side of the blocks over which images are averaged, pixels: reduces the noise to an eighth."""

BATCH_SIZE = 256
"""Number of images compared at a time with all others of the shape; limits memory."""

NOISE_GREY = 0.5
"""Noise of images of imported datasets, grey levels: that of simulated ones."""

SAME_READINGS = 1.5
"""Largest difference of two readings of one press, relative to its RMS (assumed: three standard
deviations of the RMS over 20 taxels)."""

SAME_SHARE = 0.0005
"""Difference of the counts of two equal pairs with less noise, or with unknown noise, relative to
full scale (assumed)."""

BINS = 60
WIDTH_IN, HEIGHT_IN = 9.0, 2.6
"""Bins and size of the histogram, inches."""


@dataclass(frozen=True)
class Scan:
    """RMS differences of every pair, in the order of Dataset.column, (P,) each.

    nearest_grey: to the nearest coarse image of the same shape in the same shard, grey levels;
    infinite without another image. alike_counts: smallest difference of counts to another such pair
    whose image differs by less than the noise; infinite without one.
    """

    nearest_grey: np.ndarray
    alike_counts: np.ndarray


def scan(dataset: Dataset) -> Scan:
    """Compares all images. Raises T2TwinError for a dataset without images or without counts."""
    images_of = column(dataset.info.role_of(IMAGE), IMAGE)
    paths = [path for split in dataset.tables for path in split_shards(dataset.info, split)]
    ends = np.cumsum([dataset.info.shards[path].pairs for path in paths])
    shards = dict(zip(paths, np.split(np.arange(ends[-1]), ends[:-1]), strict=True))
    shapes, counts, noise = dataset.column("shape"), dataset.array.counts, noise_grey(dataset)
    nearest_grey, alike_counts = np.zeros((2, len(shapes)))

    def scan_shard(path: str) -> None:
        images = iter_images(dataset.data, path, images_of)
        coarse = np.stack([coarse_image(decode_png(png)) for png in images])
        own = shapes[shards[path]]
        for name in np.unique(own):
            members = own == name
            at = shards[path][members]
            # Residuals are small, which preserves single precision.
            residual = coarse[members] - np.median(coarse[members], axis=0)
            near = nearest_others(residual, counts[at].astype(float), noise)
            nearest_grey[at], alike_counts[at] = near

    with ThreadPoolExecutor(cores()) as pool:
        done = pool.map(scan_shard, shards)
        for _ in Progress(done, total=len(shards), desc="images", unit="shard"):
            pass
    return Scan(nearest_grey, alike_counts)


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

    Incomplete blocks at the right and at the bottom are omitted. Blocks of a smaller image are as
    large as its smaller side.
    """
    block = min(BLOCK_PX, *image.shape[:2])
    rows, columns = (side // block for side in image.shape[:2])
    whole = image[: rows * block, : columns * block].astype(np.float32)
    return whole.reshape(rows, block, columns, block, 3).mean(axis=(1, 3)).ravel()


def duplicates(dataset: Dataset, scan: Scan) -> dict[str, Any]:
    """Near-duplicates, and ambiguous pairs: images that are alike, with different counts."""
    noise, near = noise_grey(dataset), near_duplicates(dataset, scan)
    ambiguous = np.isfinite(scan.alike_counts) & ~near
    return {
        "noise_grey": noise,
        "block_px": BLOCK_PX,
        "same_counts": float(np.median(same_counts(dataset))),
        "duplicates": near,
        "ambiguous": ambiguous,
        "chart": figure("svg", WIDTH_IN, HEIGHT_IN, lambda page: _histogram(page, scan, noise)),
    }


def noise_grey(dataset: Dataset) -> float:
    """Standard deviation of the image noise, grey levels."""
    known = dataset.info.camera.noise_grey
    return NOISE_GREY if known is None else known


def near_duplicates(dataset: Dataset, scan: Scan) -> np.ndarray:
    """(P,) bool: near-duplicates of another pair."""
    return scan.alike_counts < same_counts(dataset)


def same_counts(dataset: Dataset) -> np.ndarray:
    """Threshold of each pair, (P,): with a smaller RMS difference of counts, another is equal."""
    array = dataset.array
    least = np.full(len(array.counts), SAME_SHARE * array.full_scale)
    flaws = array.info.imperfections
    if flaws is None:  # imported
        return least
    _, noise = expected_reading(flaws, array.info.reading, array.counts)
    return np.maximum(least, SAME_READINGS * np.sqrt(2.0 * np.square(noise).mean(axis=1)))


def _histogram(page: Figure, scan: Scan, noise: float) -> None:
    axes = page.subplots()
    values = scan.nearest_grey[np.isfinite(scan.nearest_grey)]
    if values.size:
        low = max(float(values.min()), 1e-2)
        bins = np.geomspace(min(low, noise) / 1.2, max(float(values.max()), noise) * 1.2, BINS)
        axes.hist(np.maximum(values, low), bins.tolist(), color="#0072b2")
    axes.axvline(noise, color="#d55e00", linewidth=1.0)
    difference = "difference from the nearest image of the same shape, grey levels"
    axes.set(xlabel=f"{difference}; line: noise of one image", ylabel="pairs", xscale="log")
