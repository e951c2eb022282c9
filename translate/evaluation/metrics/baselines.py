"""What a translator must beat: two predictors that learn nothing, and the search of one of them.

Shape letters: P queries, M stored pairs, S image side, F numbers of an image, N taxels.

The results of Grella et al. 2023, on the real sensors, by split and model.
"""

from dataclasses import dataclass

import numpy as np

from t2twin.core.progress import Progress
from t2twin.translate.data.pairs import ImageFile, Pairs
from t2twin.translate.evaluation.records import PaperRow

MEAN_ARRAY, NEAREST_NEIGHBOR = "mean-array", "nearest-neighbour"
"""Their rows' names among the models."""

FEATURE_SIZE = 32
"""Side of the RGB images that neighbors are searched among, pixels (assumed)."""

BATCH_SIZE = 256
"""Images read or compared at a time; beside the stored ones, that bounds memory to 100 MB at 20,000
pairs."""


@dataclass(frozen=True)
class Neighbors:
    """The nearest stored images of each query, nearest first.

    index: (P, k) places among the stored. distance_grey: (P, k) root mean square difference of the
    images at FEATURE_SIZE, grey levels; infinite where there are not so many.
    """

    index: np.ndarray
    distance_grey: np.ndarray


def mean_array(train: Pairs) -> np.ndarray:
    """The mean of the training set's arrays: (N,) float32, counts."""
    return train.counts.mean(axis=0, dtype=float).astype(np.float32)


def nearest_neighbor(train: Pairs, images: ImageFile | np.ndarray) -> np.ndarray:
    """The array of the training pair whose image is nearest, in the Euclidean sense.

    train: its images at FEATURE_SIZE in RGB. images: the P queries, same size.
    Returns (P, N) float32, counts.
    """
    return train.counts[neighbors(train.images, images).index[:, 0]]


def neighbors(
    stored: ImageFile,
    queries: ImageFile | np.ndarray,
    k: int = 1,
    shapes: tuple[np.ndarray, np.ndarray] | None = None,
    progress: str | None = None,
) -> Neighbors:
    """The k nearest of the M stored images of each query, in the Euclidean sense.

    shapes: (M,) and (P,) names; a stored image of the query's own shape is passed over.
    progress: a name to show a bar under, or None.
    """
    middle = _middle(stored)
    features = np.empty((len(stored), middle.size), np.float32)
    for part in _parts(len(stored)):
        features[part] = _features(stored, part, middle)
    squares = np.einsum("mf,mf->m", features, features)
    k = min(k, len(stored))
    index = np.empty((len(queries), k), int)
    distance = np.empty((len(queries), k))
    for part in Progress(_parts(len(queries)), progress, unit="batch", disable=progress is None):
        asked = _features(queries, part, middle)
        # |q - s|^2 less |q|^2, which is the same for every s
        apart = squares - 2.0 * (asked @ features.T)
        if shapes is not None:
            apart[shapes[1][part][:, None] == shapes[0][None]] = np.inf
        near = np.argpartition(apart, k - 1, axis=1)[:, :k] if k > 1 else apart.argmin(1)[:, None]
        exact = np.sqrt(np.square(features[near] - asked[:, None]).mean(axis=2, dtype=float))
        exact[np.isinf(np.take_along_axis(apart, near, axis=1))] = np.inf
        order = np.argsort(exact, axis=1, kind="stable")
        index[part] = np.take_along_axis(near, order, axis=1)
        distance[part] = np.take_along_axis(exact, order, axis=1)
    return Neighbors(index, distance)


def _middle(images: ImageFile) -> np.ndarray:
    """The mean image, (F,) float32: distances are taken about it, where float32 is finest."""
    total = sum(_pixels(images, part).sum(axis=0, dtype=float) for part in _parts(len(images)))
    return np.asarray(total / len(images), dtype=np.float32)


def _features(images: ImageFile | np.ndarray, part: slice, middle: np.ndarray) -> np.ndarray:
    """(b, F) float32, grey levels about the middle."""
    return _pixels(images, part).astype(np.float32) - middle


def _pixels(images: ImageFile | np.ndarray, part: slice) -> np.ndarray:
    """(b, F) uint8."""
    pixels = images[part]
    return pixels.reshape(pixels.shape[0], -1)


def _parts(size: int) -> list[slice]:
    return [slice(start, start + BATCH_SIZE) for start in range(0, size, BATCH_SIZE)]


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
"""The paper gives the root of its L3 as the error, and one SSIM a model."""
