"""Estimate of the irreducible error from presses with similar images and different counts.

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

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import islice
from pathlib import Path

import numpy as np
from PIL import Image

from t2twin.core.images import decode_png
from t2twin.sim.dataset.info import DatasetInfo
from t2twin.sim.dataset.store import iter_images, read_info, split_shards
from t2twin.translate.data.images import to_pixels
from t2twin.translate.data.pairs import Pairs
from t2twin.translate.evaluation.metrics.baselines import (
    FEATURE_SIZE,
    Neighbors,
    neighbors,
)
from t2twin.translate.evaluation.metrics.bootstrap import interval, resample_weights
from t2twin.translate.evaluation.records import (
    Interval,
    IrreducibleError,
    IrreducibleErrorFloor,
    NeighborPairs,
    ShapeFloor,
)

NEIGHBORS = 8
"""Nearest images of each press for the extrapolation."""

CLOSE = 2.0
"""Largest distance of close images, relative to the distance due to noise."""

FITTED_SHARE = 0.5
"""Share of the pairs, the nearest ones, that the line is fitted to."""

BINS = 12
"""Groups of equal numbers of pairs, by distance, for the curve."""

MAX_PRESSES = 5000
"""Maximum number of presses whose neighbors are searched (assumed: the error of a median is then
1 %)."""

MAX_SHAPES = 200
"""Maximum number of shapes with figures of their own (assumed: more are not read)."""

NOISE_IMAGES = 64
"""Images for the measurement of the distance due to noise."""

SEED = 2
"""Seed of that noise, and of the selection among more than MAX_PRESSES presses."""


@dataclass(frozen=True)
class Comparison:
    """Presses and their neighbors.

    shapes: (P,) the presses' shapes. distance_grey: (P, k) distances of the images, infinite if
    there are fewer than k. half_squares: (P, k, N) half the squared difference of the counts,
    counts^2.
    """

    shapes: np.ndarray
    distance_grey: np.ndarray
    half_squares: np.ndarray


@dataclass(frozen=True)
class AtNoise:
    """Extrapolations of the shapes to the distance due to noise.

    presses: (K,) presses of each shape, 0 without extrapolation. half_squares: (K,) counts^2.
    """

    presses: np.ndarray
    half_squares: np.ndarray


def estimate_irreducible_error(
    data_dir: Path,
    split: str,
    pairs: Pairs,
    train: Pairs,
    of_train: Neighbors,
    taxel_groups: Mapping[str, np.ndarray],
) -> IrreducibleError | None:
    """The irreducible error of a split, estimated from neighbors in the split and in training.

    pairs: of the split, train: of training, both with images at FEATURE_SIZE in RGB. of_train: the
    NEIGHBORS nearest training images of the pairs. taxel_groups: (N,) bool by name, for estimates
    by group. With more than MAX_PRESSES presses, a selection is compared with all others. Presses
    without contact, which are all equal, are excluded. Returns None if the image noise of the
    dataset is unknown.
    """
    noise = noise_distance_grey(data_dir, split)
    if noise is None:
        return None
    queries, chosen = pairs, np.flatnonzero(pairs.force_n != 0)
    if not chosen.size:
        return None
    if chosen.size > MAX_PRESSES:
        chosen = np.sort(np.random.default_rng(SEED).permutation(chosen)[:MAX_PRESSES])
    if chosen.size < len(pairs):
        queries = pairs.subset(chosen)
        of_train = Neighbors(of_train.index[chosen], of_train.distance_grey[chosen])
    shapes = (pairs.shapes, queries.shapes)
    of_split = neighbors(pairs.images, queries.images, NEIGHBORS, shapes, "irreducible error")
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
    if info.parameters is None:
        return None
    sigma = info.parameters.digit.noise_grey
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
    images = [
        decode_png(png) for shard in shards for png in islice(iter_images(data_dir, shard), each)
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

    - curve has BINS groups of all k neighbors by distance.
    - extrapolated_rmse_counts is the root of the mean over presses of an extrapolation by shape. A
      line of half the squared difference over the squared distance is fitted to FITTED_SHARE of the
      shape's pairs, with a slope of at least 0. It is evaluated at the distance due to noise. The
      value is 0 for a negative mean, and None if no shape has two distances.
    - interval is over resampled shapes.
    - parts are the extrapolations of groups of taxels.
    """
    known = np.isfinite(near.distance_grey[:, 0])
    if not known.any():
        return None
    compared = Comparison(
        shapes=pairs.shapes,
        distance_grey=near.distance_grey,
        half_squares=np.square(pairs.counts[:, None] - others.counts[near.index]) / 2,
    )
    names = np.unique(pairs.shapes[known])
    whole = _at_noise(compared, names, noise_grey)
    close = near.distance_grey[:, 0] <= CLOSE * noise_grey
    return IrreducibleErrorFloor(
        nearest=_nearest(compared, known),
        close=_nearest(compared, known & close),
        curve=_curve(compared),
        extrapolated_rmse_counts=_root_of_mean(whole),
        interval=_interval(whole),
        parts={
            name: _root_of_mean(_at_noise(compared, names, noise_grey, mask))
            for name, mask in taxel_groups.items()
            if mask.any()
        },
        by_shape={
            str(name): ShapeFloor(
                nearest=_nearest(compared, known & (pairs.shapes == name)),
                extrapolated_rmse_counts=_root_of_mean(
                    AtNoise(whole.presses[[place]], whole.half_squares[[place]])
                ),
            )
            for place, name in enumerate(names)
            if names.size <= MAX_SHAPES
        },
    )


def _nearest(compared: Comparison, which: np.ndarray) -> NeighborPairs:
    """The presses `which`, (P,) bool, with their nearest neighbors."""
    return _neighbor_pairs(
        compared.distance_grey[which, 0],
        compared.half_squares[which, 0].mean(axis=-1, dtype=float),
    )


def _curve(compared: Comparison) -> tuple[NeighborPairs, ...]:
    known = np.isfinite(compared.distance_grey)
    distance = compared.distance_grey[known]
    half = compared.half_squares.mean(axis=2, dtype=float)[known]
    in_order = np.argsort(distance, kind="stable")
    return tuple(
        _neighbor_pairs(distance[part], half[part])
        for part in np.array_split(in_order, BINS)
        if part.size
    )


def _neighbor_pairs(distance: np.ndarray, half: np.ndarray) -> NeighborPairs:
    """distance: grey levels. half: half the squared difference, counts^2. One number per pair."""
    if not distance.size:
        return NeighborPairs(0, None, None)
    return NeighborPairs(distance.size, float(np.median(distance)), float(np.sqrt(half.mean())))


def _at_noise(
    compared: Comparison, names: np.ndarray, noise_grey: float, taxels: np.ndarray | None = None
) -> AtNoise:
    """Extrapolations by shape. names: (K,) shapes. taxels: (N,) bool, by default all.

    Each shape has its own line, because shapes differ in the distances of their images and counts.
    """
    squares = compared.half_squares if taxels is None else compared.half_squares[:, :, taxels]
    half, distance = squares.mean(axis=2, dtype=float), compared.distance_grey
    presses, at_noise = np.zeros((2, names.size))
    for place, members in enumerate(_members(compared.shapes, names)):
        distances, values = distance[members], half[members]
        known = np.isfinite(distances)
        fitted = known & (distances <= np.quantile(distances[known], FITTED_SHARE))
        x, y = np.square(distances[fitted]), values[fitted]
        spread = np.square(x - x.mean()).sum()
        if spread > 0:
            slope = max(0.0, float(((x - x.mean()) * (y - y.mean())).sum() / spread))
            presses[place] = known[:, 0].sum()
            at_noise[place] = y.mean() - slope * (x.mean() - noise_grey**2)
    return AtNoise(presses, at_noise)


def _members(shapes: np.ndarray, names: np.ndarray) -> list[np.ndarray]:
    """Indices of the presses of each name, in ascending order. names: (K,), sorted."""
    in_order = np.argsort(shapes, kind="stable")
    ends = [np.searchsorted(shapes[in_order], names, side) for side in ("left", "right")]
    return [in_order[start:end] for start, end in zip(*ends, strict=True)]


def _root_of_mean(of_shapes: AtNoise) -> float | None:
    """Over presses, counts; None if no shape has an extrapolation."""
    presses, values = of_shapes.presses, of_shapes.half_squares
    if not presses.any():
        return None
    return float(np.sqrt(max(0.0, (presses * values).sum() / presses.sum())))


def _interval(of_shapes: AtNoise) -> Interval | None:
    known = of_shapes.presses > 0
    presses, values = of_shapes.presses[known], of_shapes.half_squares[known]
    if presses.size < 2:
        return None
    weights = resample_weights(presses.size)
    means = (weights @ (presses * values)) / (weights @ presses)
    return interval(np.sqrt(np.maximum(means, 0.0)))
