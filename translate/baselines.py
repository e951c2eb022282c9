"""What a translator must beat: two predictors that learn nothing.

Shape letters: P pairs, S image side, N taxels.
"""

import numpy as np

from translate.data import ImageFile, Pairs

FEATURE_SIZE = 32
"""Side of the RGB images that neighbours are searched among, pixels (assumed)."""

QUERIES_AT_ONCE = 256
"""Queries in one matrix product; bounds memory to 20 MB at 20,000 pairs."""


def mean_array(train: Pairs) -> np.ndarray:
    """The mean of the training set's arrays: (N,) float32, counts."""
    return train.counts.mean(axis=0, dtype=float).astype(np.float32)


def nearest_neighbour(train: Pairs, images: ImageFile) -> np.ndarray:
    """The array of the training pair whose image is nearest, in the Euclidean sense.

    train: its images at FEATURE_SIZE in RGB. images: the P queries, same size.
    Returns (P, N) float32, counts.
    """
    stored = _features(train.images, slice(None))
    squares = np.einsum("pf,pf->p", stored, stored)
    found = np.empty(len(images), dtype=int)
    for start in range(0, len(images), QUERIES_AT_ONCE):
        part = slice(start, start + QUERIES_AT_ONCE)
        # |q - s|^2 less |q|^2, which is the same for every s
        found[part] = np.argmin(squares - 2.0 * (_features(images, part) @ stored.T), axis=1)
    return train.counts[found]


def _features(images: ImageFile, part: slice) -> np.ndarray:
    """(P, S*S*3) float32 in [-0.5, 0.5]: about nought, where float32 is finest."""
    pixels = images[part].astype(np.float32)
    return pixels.reshape(pixels.shape[0], -1) / 255.0 - 0.5
