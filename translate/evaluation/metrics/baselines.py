"""Trivial predictors, mean array and nearest neighbor, and the results of the paper.

Shape letters: P queries, M stored pairs, S image side, F values of an image, N taxels.
"""

from dataclasses import dataclass

import numpy as np

from t2twin.core.progress import Progress
from t2twin.translate.data.pairs import ImageFile, Pairs
from t2twin.translate.evaluation.records import PaperRow

MEAN_ARRAY, NEAREST_NEIGHBOR = "mean-array", "nearest-neighbour"
"""Names of their rows."""

FEATURE_SIZE = 32
"""Side of the RGB images for the search of neighbors, pixels (assumed)."""

BATCH_SIZE = 256
"""Images read or compared together; bounds memory to 100 MB with 20,000 pairs, besides the stored
images."""

PAPER: dict[str, dict[str, PaperRow]] = {
    "val": {
        "touch2touch": PaperRow(rmse_counts=4007, rmse_percent=10.01, ssim=0.96),
        "resnet18": PaperRow(rmse_counts=3931, rmse_percent=9.83, ssim=0.95),
    },
    "test": {
        "touch2touch": PaperRow(rmse_counts=6072, rmse_percent=15.18),
        "resnet18": PaperRow(rmse_counts=4867, rmse_percent=12.17),
    },
}
"""Results of Grella et al. 2023 by split and model: root of L3, and one SSIM per model."""


@dataclass(frozen=True)
class Neighbors:
    """The nearest stored images of each query, in ascending order of distance.

    index: (P, k) indices of stored images. distance_grey: (P, k) root mean square difference of the
    images at FEATURE_SIZE, grey levels; infinite if there are fewer than k.
    """

    index: np.ndarray
    distance_grey: np.ndarray


def mean_array(train: Pairs) -> np.ndarray:
    """Mean counts of the training pairs: (N,) float32."""
    return train.counts.mean(axis=0, dtype=float).astype(np.float32)


def neighbors(
    stored: ImageFile,
    queries: ImageFile | np.ndarray,
    k: int = 1,
    shapes: tuple[np.ndarray, np.ndarray] | None = None,
    progress: str | None = None,
) -> Neighbors:
    """The k stored images nearest to each query in Euclidean distance.

    shapes: (M,) and (P,) names; stored images of the query's own shape are excluded. progress:
    title of a progress bar, or None.
    """
    # The mean image, (F,); subtracting it reduces rounding errors of distances.
    total = sum(_pixels(stored, part).sum(axis=0, dtype=float) for part in _parts(len(stored)))
    mean = np.asarray(total / len(stored), dtype=np.float32)
    features = np.empty((len(stored), mean.size), np.float32)
    for part in _parts(len(stored)):
        features[part] = _features(stored, part, mean)
    squares = np.einsum("mf,mf->m", features, features)
    k = min(k, len(stored))
    index = np.empty((len(queries), k), int)
    distance = np.empty((len(queries), k))
    for part in Progress(_parts(len(queries)), progress, unit="batch", disable=progress is None):
        batch = _features(queries, part, mean)
        # |q - s|^2 - |q|^2; the second term does not depend on s.
        distances = squares - 2.0 * (batch @ features.T)
        if shapes is not None:
            distances[shapes[1][part][:, None] == shapes[0][None]] = np.inf
        if k > 1:
            near = np.argpartition(distances, k - 1, axis=1)[:, :k]
        else:
            near = distances.argmin(1)[:, None]
        exact = np.sqrt(np.square(features[near] - batch[:, None]).mean(axis=2, dtype=float))
        exact[np.isinf(np.take_along_axis(distances, near, axis=1))] = np.inf
        order = np.argsort(exact, axis=1, kind="stable")
        index[part] = np.take_along_axis(near, order, axis=1)
        distance[part] = np.take_along_axis(exact, order, axis=1)
    return Neighbors(index, distance)


def _features(images: ImageFile | np.ndarray, part: slice, mean: np.ndarray) -> np.ndarray:
    """(b, F) float32, grey levels relative to the mean image."""
    return _pixels(images, part).astype(np.float32) - mean


def _pixels(images: ImageFile | np.ndarray, part: slice) -> np.ndarray:
    """(b, F) uint8."""
    pixels = images[part]
    return pixels.reshape(pixels.shape[0], -1)


def _parts(size: int) -> list[slice]:
    return [slice(start, start + BATCH_SIZE) for start in range(0, size, BATCH_SIZE)]
