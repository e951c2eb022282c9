"""Near-duplicates and outliers, from the distances between the images of a dataset.

Shape letters: n pairs of a shape, B values of a coarse image.
"""

from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from t2twin.core.images import decode_png
from t2twin.core.machine import cores
from t2twin.core.progress import Progress
from t2twin.report.dataset.tables import Dataset
from t2twin.report.html.figures import draw_digit_grid, figure
from t2twin.report.html.labels import shape_name
from t2twin.sim.dataset.store import iter_images, split_shards

BLOCK_PX = 8
"""Side of the blocks over which images are averaged, pixels: reduces the noise to an eighth."""

BATCH_SIZE = 256
"""Number of images compared at a time with all others of the shape; limits memory."""

NOISE_GREY = 0.5
"""Noise of images of imported datasets, grey levels: that of simulated ones."""

DUPLICATE_SHARE = 0.0005
"""Difference of the counts of two equal pairs, relative to full scale (assumed: 20 of 40,000
counts, four times the difference of two readings of one press)."""

MAX_LISTED = 5
"""Number of listed shapes."""

BINS = 60
WIDTH_IN, HEIGHT_IN = 9.0, 2.6
"""Bins and size of the histogram, inches."""

OUTLIERS = 12
"""Number of shown outliers."""

MAX_SHAPES = 200
"""Maximum number of shapes for comparison within a shape (assumed: with more shapes, each has too
few presses for a median). Otherwise pairs are compared within their family."""

MIN_N = 0.01
"""Smallest commanded force, N (sim.contact)."""

MAD_TO_SIGMA = 1.4826
"""Ratio of standard deviation and median absolute deviation of a normal distribution."""

MIN_SCALE = 0.02
"""Minimum standard deviation, relative to the median (assumed)."""

PANELS, PANEL_IN, LINE_IN = 6, 1.5, 2.3
"""Panels per row, their width and the height of a row, inches."""


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
    paths = [path for split in dataset.tables for path in split_shards(dataset.info, split)]
    ends = np.cumsum([dataset.info.shards[path].pairs for path in paths])
    shards = dict(zip(paths, np.split(np.arange(ends[-1]), ends[:-1]), strict=True))
    shapes, counts = dataset.shapes, dataset.counts
    nearest_grey, alike_counts, residual_grey = np.zeros((3, len(shapes)))

    def scan_shard(path: str) -> None:
        images = iter_images(dataset.data, path)
        coarse = np.stack([coarse_image(decode_png(png)) for png in images])
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


def duplicates(dataset: Dataset, scan: Scan) -> dict[str, Any]:
    """Near-duplicates, and ambiguous pairs: images that are alike, with different counts."""
    noise, near = noise_grey(dataset), near_duplicates(dataset, scan)
    ambiguous = np.isfinite(scan.alike_counts) & ~near
    return {
        "noise_grey": noise,
        "block_px": BLOCK_PX,
        "same_counts": same_counts(dataset),
        "duplicates": near,
        "ambiguous": ambiguous,
        "most_frequent": lambda which: _most_frequent(dataset, which),
        "chart": figure("svg", WIDTH_IN, HEIGHT_IN, lambda page: _histogram(page, scan, noise)),
    }


def noise_grey(dataset: Dataset) -> float:
    """Standard deviation of the image noise, grey levels."""
    parameters = dataset.info.parameters
    return NOISE_GREY if parameters is None else parameters.digit.noise_grey


def near_duplicates(dataset: Dataset, scan: Scan) -> np.ndarray:
    """(P,) bool: near-duplicates of another pair."""
    return scan.alike_counts < same_counts(dataset)


def same_counts(dataset: Dataset) -> float:
    """RMS difference of the counts below which pairs are equal."""
    return DUPLICATE_SHARE * dataset.layout.full_scale_counts


def _most_frequent(dataset: Dataset, which: np.ndarray) -> list[tuple[str, int]]:
    """The most frequent shapes of the pairs `which`, (P,) bool, with their numbers."""
    names, numbers = np.unique(dataset.shapes[which], return_counts=True)
    order = np.argsort(-numbers, kind="stable")[:MAX_LISTED]
    return [(str(names[i]), int(numbers[i])) for i in order]


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


def outlier_images(dataset: Dataset, scan: Scan) -> dict[str, Any]:
    """Images of the pairs with the largest deviations."""
    found = outliers(dataset, scan)
    images, titles = [], []
    for pair, quantity, deviation in found:
        split, number = dataset.places[pair]
        row = dataset.row(split, number)
        images.append(dataset.image(split, number))
        titles.append(f"{shape_name(row['shape'])}, {row['index']}\n{quantity} {deviation:.1f}")
    height = LINE_IN * -(-len(found) // PANELS)
    return {
        "group": "family" if np.unique(dataset.shapes).size > MAX_SHAPES else "shape",
        "images": figure(
            "png",
            PANEL_IN * PANELS,
            height,
            lambda page: draw_digit_grid(page, images, titles, PANELS, font_size=7.5),
        ),
    }


def outliers(dataset: Dataset, scan: Scan) -> list[tuple[int, str, float]]:
    """Index of each pair, the deviating quantity, and its deviation."""
    quantities = {"counts": dataset.counts.sum(axis=1), "image": scan.residual_grey}
    if dataset.info.is_simulated:
        for sensor in ("digit", "cyskin"):
            quantities[f"{sensor} depth"] = dataset.column(f"{sensor}_depth_mm")
    groups = _groups(dataset)
    names = list(quantities)
    table = np.stack([deviations(values, groups) for values in quantities.values()])
    which, largest = table.argmax(axis=0), table.max(axis=0)
    order = np.argsort(-largest, kind="stable")[:OUTLIERS]
    return [(int(pair), names[which[pair]], float(largest[pair])) for pair in order]


def _groups(dataset: Dataset) -> np.ndarray:
    """(P,) group in which each pair is compared: its shape, or its family if there are many shapes.

    With several forces, the group includes the force, rounded down to a power of two.
    """
    few = np.unique(dataset.shapes).size <= MAX_SHAPES
    groups = dataset.shapes if few else dataset.families
    if dataset.forces_n.size < 2:
        return groups
    force_n = np.nan_to_num(dataset.column("force_n").astype(float))
    doubling = np.where(force_n > 0, np.floor(np.log2(np.maximum(force_n, MIN_N))), np.nan)
    return np.char.add(np.char.add(groups, " "), doubling.astype(str))


def deviations(values: np.ndarray, groups: np.ndarray) -> np.ndarray:
    """(P,) deviation of each value from its group's median, in robust standard deviations.

    The standard deviation is at least MIN_SCALE times the median.
    """
    result = np.zeros(values.size)
    in_order = np.argsort(groups, kind="stable")
    starts = np.unique(groups[in_order], return_index=True)[1]
    for members in np.split(in_order, starts[1:]):
        residual = np.abs(values[members] - np.median(values[members]))
        min_scale = MIN_SCALE * abs(np.median(values[members]))
        scale = max(MAD_TO_SIGMA * float(np.median(residual)), min_scale)
        result[members] = residual / scale if scale > 0 else 0.0
    return result
