"""Estimate of the irreducible error from presses with similar images and different counts.

If two presses have indistinguishable images, a translator predicts the same counts for both. Their
counts are two samples of the distribution given the image, so that their mean squared difference is
twice its variance. sqrt(mean squared difference / 2) is then the RMSE of the best predictor, the
conditional mean.

The estimate holds for images at FEATURE_SIZE, averaged over presses with a similar neighbor. It is
no bound for a network that uses finer detail, nor for presses without neighbors. Images at a
distance above that of noise can be distinguished, which makes the figure too high. It is therefore
extrapolated to the distance due to noise, by a line over the squared distance: the squared
difference of counts that depend smoothly on the image is linear in it.

Shape letters: P presses, k neighbors, N taxels.
"""

from collections.abc import Mapping
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image

from t2twin.core.images import decode_png
from t2twin.sim.dataset.columns import IMAGE, column
from t2twin.sim.dataset.info import DatasetInfo
from t2twin.sim.dataset.store import iter_images, read_info, split_shards
from t2twin.translate.data.images import to_pixels
from t2twin.translate.data.pairs import Pairs, load_info, load_pairs
from t2twin.translate.evaluation.baselines import FEATURE_SIZE, NEIGHBORS, neighbors, view_on

FITTED_SHARE = 0.5
"""Share of the pairs, the nearest ones, that the line is fitted to."""

MAX_PRESSES = 5000
"""Maximum number of presses whose neighbors are searched (assumed: the error of a median is then
1 %)."""

NOISE_IMAGES = 64
"""Images for the measurement of the distance due to noise."""

SEED = 2
"""Seed of that noise, and of the selection among more than MAX_PRESSES presses."""


def estimate_irreducible_error(data_dir: Path, split: str) -> dict[str, Any] | None:
    """The irreducible error of a split, counts: of all taxels and, as `parts`, of groups of them.

    It follows from the nearest presses of other shapes. With more than MAX_PRESSES presses, a
    selection is compared with all others. Presses without contact, which are all equal, are
    excluded. Returns None if the image noise of the dataset is unknown, or without contact.
    """
    noise = noise_distance_grey(data_dir, split)
    pairs = load_pairs(data_dir, split, FEATURE_SIZE, False)
    chosen = np.flatnonzero(pairs.force_n != 0)
    if noise is None or not chosen.size:
        return None
    if chosen.size > MAX_PRESSES:
        chosen = np.sort(np.random.default_rng(SEED).permutation(chosen)[:MAX_PRESSES])
    queries = pairs.subset(chosen)
    shapes = (pairs.shapes, queries.shapes)
    near = neighbors(pairs.images, queries.images, NEIGHBORS, shapes, "irreducible error")
    info = load_info(data_dir)
    _, taxel_groups = view_on(info.array.x_mm, info.array.y_mm, info.camera.view_mm)
    split_floor = floor_of(queries, pairs, near, noise, taxel_groups)
    return {"noise_grey": noise, "split": split_floor}


def noise_distance_grey(data_dir: Path, split: str) -> float | None:
    """Distance between two images of one press, grey levels, at FEATURE_SIZE; None if unknown.

    The noise of the dataset is added twice to images of the split, which are then resized like the
    stored ones.
    """
    info = read_info(data_dir)
    sigma = info.camera.noise_grey
    if sigma is None:
        return None
    rng = np.random.default_rng(SEED)
    squares = [
        np.square(np.subtract(*(_noisy_features(image, sigma, rng) for _ in range(2)))).mean()
        for image in _sample_images(data_dir, info, split)
    ]
    return float(np.sqrt(np.mean(squares)))


def _noisy_features(image: np.ndarray, sigma: float, rng: np.random.Generator) -> np.ndarray:
    noisy = np.clip(np.rint(image + sigma * rng.standard_normal(image.shape)), 0, 255)
    rendered = Image.fromarray(noisy.astype(np.uint8))
    return to_pixels(rendered, FEATURE_SIZE, grey=False).astype(float)


def _sample_images(data_dir: Path, info: DatasetInfo, split: str) -> list[np.ndarray]:
    """Up to NOISE_IMAGES images, equal numbers of each shape, (h, w, 3) uint8."""
    shards = split_shards(info, split)
    each = -(-NOISE_IMAGES // len(shards))
    name = column(info.role_of(IMAGE), IMAGE)
    images = [
        decode_png(png)
        for shard in shards
        for png in islice(iter_images(data_dir, shard, name), each)
    ]
    return images[:NOISE_IMAGES]


def floor_of(
    pairs: Pairs,
    others: Pairs,
    near: tuple[np.ndarray, np.ndarray],
    noise_grey: float,
    taxel_groups: Mapping[str, np.ndarray],
) -> dict[str, Any] | None:
    """The estimate from the presses' `neighbors` among the others; None without any.

    noise_grey: the distance due to noise. The value is the root of the mean over presses of an
    extrapolation by shape. A line of half the squared difference over the squared distance is
    fitted to FITTED_SHARE of the shape's pairs, with a slope of at least 0. It is evaluated at the
    distance due to noise. The value is 0 for a negative mean, and None if no shape has two
    distances.
    """
    index, distance_grey = near
    known = np.isfinite(distance_grey[:, 0])
    if not known.any():
        return None
    half_squares = np.square(pairs.counts[:, None] - others.counts[index])[known] / 2

    def at_noise(taxels: np.ndarray | slice) -> float | None:
        half = half_squares[:, :, taxels].mean(axis=2, dtype=float)
        return _at_noise(pairs.shapes[known], distance_grey[known], half, noise_grey)

    parts = {name: at_noise(mask) for name, mask in taxel_groups.items() if mask.any()}
    return {"extrapolated_rmse_counts": at_noise(slice(None)), "parts": parts}


def _at_noise(
    shapes: np.ndarray, distance: np.ndarray, half: np.ndarray, noise_grey: float
) -> float | None:
    """Root of the mean extrapolation, counts; distance, grey levels, and half, counts^2: (P, k)."""
    presses = total = 0.0
    for name in np.unique(shapes):
        # Each shape has its own line, because shapes differ in the distances of images and counts.
        own = shapes == name
        known = np.isfinite(distance[own])
        fitted = known & (distance[own] <= np.quantile(distance[own][known], FITTED_SHARE))
        x, y = np.square(distance[own][fitted]), half[own][fitted]
        spread = np.square(x - x.mean()).sum()
        if spread > 0:
            slope = max(0.0, float(((x - x.mean()) * (y - y.mean())).sum() / spread))
            presses += own.sum()
            total += own.sum() * (y.mean() - slope * (x.mean() - noise_grey**2))
    return float(np.sqrt(max(0.0, total / presses))) if presses else None
