"""Estimate of the irreducible error from presses with similar images and different counts.

    python -m benchmarks.networks.irreducible_error data/small [--split test]

If two presses have indistinguishable images, a translator predicts the same counts for both. Their
counts are two samples of the distribution given the image, so that their mean squared difference is
twice its variance. sqrt(mean squared difference / 2) is then the RMSE of the best predictor, the
conditional mean.

The estimate holds for images at FEATURE_SIZE, averaged over presses with a similar neighbor. It is
no bound for a network that uses finer detail, nor for presses without neighbors. Images at a
distance above that of noise can be distinguished, which makes the figure too high. It is therefore
extrapolated to the distance due to noise, by a line over the squared distance: the squared
difference of counts that depend smoothly on the image is linear in it. Neighbors in training show
another ambiguity: a shape of another kind with a similar image.

Shape letters: P presses, k neighbors, N taxels, K shapes.
"""

import argparse
import json
from collections.abc import Mapping
from dataclasses import dataclass
from itertools import islice
from pathlib import Path

import msgspec
import numpy as np
from PIL import Image

from t2twin.core.images import decode_png
from t2twin.sim.dataset.columns import IMAGE, column
from t2twin.sim.dataset.info import DatasetInfo
from t2twin.sim.dataset.store import iter_images, read_info, split_shards
from t2twin.translate.data.images import to_pixels
from t2twin.translate.data.pairs import Pairs, load_info, load_pairs
from t2twin.translate.evaluation.baselines import (
    FEATURE_SIZE,
    NEIGHBORS,
    Neighbors,
    neighbors,
    view_on,
)
from t2twin.translate.evaluation.metrics import interval, resample_weights
from t2twin.translate.evaluation.records import Interval

CLOSE = 2.0
"""Largest distance of close images, relative to the distance due to noise."""

FITTED_SHARE = 0.5
"""Share of the pairs, the nearest ones, that the line is fitted to."""

MAX_PRESSES = 5000
"""Maximum number of presses whose neighbors are searched (assumed: the error of a median is then
1 %)."""

NOISE_IMAGES = 64
"""Images for the measurement of the distance due to noise."""

SEED = 2
"""Seed of that noise, and of the selection among more than MAX_PRESSES presses."""


@dataclass(frozen=True)
class NeighborPairs:
    """Pairs of presses with similar images.

    distance_grey: median distance of the images. rmse_counts: root of half the mean squared
    difference of the counts. Both are None without pairs.
    """

    pairs: int
    distance_grey: float | None
    rmse_counts: float | None


@dataclass(frozen=True)
class IrreducibleErrorFloor:
    """The estimate from one set of neighbors.

    nearest: each press and its nearest neighbor. close: those within the noise.
    extrapolated_rmse_counts, with its interval over shapes: the difference at the noise's distance;
    parts: the same for each group of taxels.
    """

    nearest: NeighborPairs
    close: NeighborPairs
    extrapolated_rmse_counts: float | None
    interval: Interval | None
    parts: dict[str, float | None]


@dataclass(frozen=True)
class IrreducibleError:
    """Estimate of the irreducible error from nearest neighbors in the split and in training.

    noise_grey: distance of two images of one press. close_grey: largest distance of close images.
    split: from other shapes of the split; training: from training pairs; None without neighbors.
    """

    noise_grey: float
    close_grey: float
    split: IrreducibleErrorFloor | None
    training: IrreducibleErrorFloor | None


def estimate_irreducible_error(data_dir: Path, split: str) -> IrreducibleError | None:
    """The irreducible error of a split, estimated from neighbors in the split and in training.

    With more than MAX_PRESSES presses, a selection is compared with all others. Presses without
    contact, which are all equal, are excluded. Returns None if the image noise of the dataset is
    unknown.
    """
    noise = noise_distance_grey(data_dir, split)
    if noise is None:
        return None
    pairs, train = (load_pairs(data_dir, s, FEATURE_SIZE, False) for s in (split, "train"))
    chosen = np.flatnonzero(pairs.force_n != 0)
    if not chosen.size:
        return None
    if chosen.size > MAX_PRESSES:
        chosen = np.sort(np.random.default_rng(SEED).permutation(chosen)[:MAX_PRESSES])
    queries = pairs.subset(chosen)
    shapes = (pairs.shapes, queries.shapes)
    of_split = neighbors(pairs.images, queries.images, NEIGHBORS, shapes, "irreducible error")
    of_train = neighbors(train.images, queries.images, NEIGHBORS)
    info = load_info(data_dir)
    _, taxel_groups = view_on(info.array.x_mm, info.array.y_mm, info.camera.view_mm)
    return IrreducibleError(
        noise_grey=noise,
        close_grey=CLOSE * noise,
        split=floor_of(queries, pairs, of_split, noise, taxel_groups),
        training=floor_of(queries, train, of_train, noise, taxel_groups),
    )


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
    near: Neighbors,
    noise_grey: float,
    taxel_groups: Mapping[str, np.ndarray],
) -> IrreducibleErrorFloor | None:
    """The estimate from one set of neighbors, None without neighbors.

    near: the presses' k nearest of the others. noise_grey: the distance due to noise. The record's

    - extrapolated_rmse_counts is the root of the mean over presses of an extrapolation by shape. A
      line of half the squared difference over the squared distance is fitted to FITTED_SHARE of the
      shape's pairs, with a slope of at least 0. It is evaluated at the distance due to noise. The
      value is 0 for a negative mean, and None if no shape has two distances.
    - interval is over resampled shapes.
    - parts are the extrapolations of groups of taxels.
    """
    distance = near.distance_grey
    known = np.isfinite(distance[:, 0])
    if not known.any():
        return None
    half_squares = np.square(pairs.counts[:, None] - others.counts[near.index]) / 2

    def at_noise(taxels: np.ndarray | slice) -> tuple[np.ndarray, np.ndarray]:
        half = half_squares[:, :, taxels].mean(axis=2, dtype=float)
        return _at_noise(pairs.shapes[known], distance[known], half[known], noise_grey)

    def nearest(which: np.ndarray) -> NeighborPairs:
        half = half_squares[which, 0].mean(axis=-1, dtype=float)
        if not half.size:
            return NeighborPairs(0, None, None)
        median = float(np.median(distance[which, 0]))
        return NeighborPairs(half.size, median, float(np.sqrt(half.mean())))

    whole = at_noise(slice(None))
    return IrreducibleErrorFloor(
        nearest=nearest(known),
        close=nearest(known & (distance[:, 0] <= CLOSE * noise_grey)),
        extrapolated_rmse_counts=_root_of_mean(*whole),
        interval=_interval(*whole),
        parts={
            name: _root_of_mean(*at_noise(mask))
            for name, mask in taxel_groups.items()
            if mask.any()
        },
    )


def _at_noise(
    shapes: np.ndarray, distance: np.ndarray, half: np.ndarray, noise_grey: float
) -> tuple[np.ndarray, np.ndarray]:
    """Extrapolations of the K shapes: their presses, 0 without one, and values, counts^2, (K,).

    shapes: (P,). distance, half: (P, k) grey levels and half the squared differences, counts^2.
    Each shape has its own line, because shapes differ in the distances of their images and counts.
    """
    names = np.unique(shapes)
    presses, values = np.zeros((2, names.size))
    for place, name in enumerate(names):
        own = shapes == name
        known = np.isfinite(distance[own])
        fitted = known & (distance[own] <= np.quantile(distance[own][known], FITTED_SHARE))
        x, y = np.square(distance[own][fitted]), half[own][fitted]
        spread = np.square(x - x.mean()).sum()
        if spread > 0:
            slope = max(0.0, float(((x - x.mean()) * (y - y.mean())).sum() / spread))
            presses[place] = own.sum()
            values[place] = y.mean() - slope * (x.mean() - noise_grey**2)
    return presses, values


def _root_of_mean(presses: np.ndarray, values: np.ndarray) -> float | None:
    """Over presses, counts; None if no shape has an extrapolation."""
    if not presses.any():
        return None
    return float(np.sqrt(max(0.0, (presses * values).sum() / presses.sum())))


def _interval(presses: np.ndarray, values: np.ndarray) -> Interval | None:
    presses, values = presses[presses > 0], values[presses > 0]
    if presses.size < 2:
        return None
    weights = resample_weights(presses.size)
    means = (weights @ (presses * values)) / (weights @ presses)
    return interval(np.sqrt(np.maximum(means, 0.0)))


def main() -> None:
    parser = argparse.ArgumentParser(prog="python -m benchmarks.networks.irreducible_error")
    parser.add_argument("data", type=Path, help="the dataset")
    parser.add_argument("--split", choices=("val", "test"), default="val")
    options = parser.parse_args()
    found = estimate_irreducible_error(options.data, options.split)
    print(json.dumps(msgspec.to_builtins(found), indent=1))


if __name__ == "__main__":
    main()
