"""What the picture does not say: presses that look nearly alike and do not feel alike.

Of two presses whose pictures cannot be told apart, a translator gives one answer. Taken as two
draws of what such a picture may mean, their counts differ in mean square by twice the variance that
is left once the picture is known; so sqrt(mean squared difference / 2) is the RMSE that the best
predictor, which answers with the mean of all of them, still makes.

It bounds what can be known from the picture at FEATURE_SIZE, averaged over presses that have a
look-alike. It does not bound a network that sees finer detail than that, nor speak of presses that
nothing resembles; and pictures that differ a little may be told apart, so that the figure at a
distance above the noise's is too high a floor. Hence the figure extrapolated to the noise's
distance, by a straight line in the squared distance, for the squared difference of the counts grows
so where they follow the picture smoothly. Neighbors among the training pairs add what a translator
cannot know in another way: a shape of another kind that looks the same.
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
from t2twin.translate.evaluation.metrics.bootstrap import draws, interval
from t2twin.translate.evaluation.records import (
    AlikePairs,
    Interval,
    IrreducibleError,
    IrreducibleErrorFloor,
    ShapeFloor,
)

NEIGHBORS = 8
"""Nearest images of each press that the extrapolation is made from."""

CLOSE = 2.0
"""Two pictures are nearly the same within this many times the distance that noise makes."""

FITTED = 0.5
"""The part of the pairs, the nearest, that the line is fitted to."""

BINS = 12
"""Groups of as many pairs each, by distance, for the curve."""

MAX_PRESSES = 5000
"""Presses that look-alikes are looked up for (assumed: a median of so many is known to a
hundredth)."""

MAX_SHAPES = 200
"""Shapes that are given one by one (assumed: nobody reads more)."""

NOISE_PICTURES = 64
"""Pictures that the noise's distance is measured on."""

SEED = 2
"""Seed of that noise, and of which presses are looked up where there are too many."""


@dataclass(frozen=True)
class Comparison:
    """Presses beside those that look like them.

    shapes: (P,) the presses' shapes. distance_grey: (P, k) distance of the pictures, infinite where
    there are not so many. half_squares: (P, k, N) half the squared difference of the counts,
    counts^2.
    """

    shapes: np.ndarray
    distance_grey: np.ndarray
    half_squares: np.ndarray


@dataclass(frozen=True)
class AtNoise:
    """Each shape's line read at the noise's distance.

    presses: (K,) presses of each shape, 0 where it has no line. half_squares: (K,) counts^2.
    """

    presses: np.ndarray
    half_squares: np.ndarray


def lookalikes(
    data_dir: Path,
    split: str,
    pairs: Pairs,
    train: Pairs,
    of_train: Neighbors,
    taxel_groups: Mapping[str, np.ndarray],
) -> IrreducibleError | None:
    """How far presses of a split differ in taxels from those that look like them.

    pairs: the split's, train: the training split's, images of both at FEATURE_SIZE in RGB.
    of_train: the pairs' NEIGHBORS nearest of the training images. taxel_groups: (N,) bool by name,
    groups of the taxels that are looked at alone too. Of more than MAX_PRESSES presses so many are
    compared with all others; those that touch nothing, which look and feel alike, are not asked of.
    None for a dataset that does not name its pictures' noise.
    """
    noise = noise_distance_grey(data_dir, split)
    if noise is None:
        return None
    asked, some = pairs, np.flatnonzero(pairs.force_n != 0)
    if not some.size:
        return None
    if some.size > MAX_PRESSES:
        some = np.sort(np.random.default_rng(SEED).permutation(some)[:MAX_PRESSES])
    if some.size < len(pairs):
        asked = pairs.some(some)
        of_train = Neighbors(of_train.index[some], of_train.distance_grey[some])
    shapes = (pairs.shapes, asked.shapes)
    of_split = neighbors(pairs.images, asked.images, NEIGHBORS, shapes, "look-alikes")
    return IrreducibleError(
        noise_grey=noise,
        close_grey=CLOSE * noise,
        split=floor_of(asked, pairs, of_split, noise, taxel_groups),
        training=floor_of(asked, train, of_train, noise, taxel_groups),
    )


def noise_distance_grey(data_dir: Path, split: str) -> float | None:
    """Distance between two pictures of one press, grey levels, at FEATURE_SIZE; None if unknown.

    Measured: pictures of the split get the noise that the dataset was made with, twice each, and
    are made small as the stored ones are.
    """
    info = read_info(data_dir)
    if info.parameters is None:
        return None
    sigma = info.parameters.digit.noise_grey
    rng = np.random.default_rng(SEED)
    squares = [
        np.square(np.subtract(*(_small(picture, sigma, rng) for _ in range(2)))).mean()
        for picture in _some_pictures(data_dir, info, split)
    ]
    return float(np.sqrt(np.mean(squares)))


def _small(picture: np.ndarray, sigma: float, rng: np.random.Generator) -> np.ndarray:
    noisy = np.clip(np.rint(picture + sigma * rng.standard_normal(picture.shape)), 0, 255)
    image = Image.fromarray(noisy.astype(np.uint8))
    return to_pixels(image, FEATURE_SIZE, grey=False).astype(float)


def _some_pictures(data_dir: Path, info: DatasetInfo, split: str) -> list[np.ndarray]:
    """NOISE_PICTURES or fewer, as many of each shape, (h, w, 3) uint8."""
    shards = split_shards(info, split)
    each = -(-NOISE_PICTURES // len(shards))
    pictures = [
        decode_png(png) for shard in shards for png in islice(iter_images(data_dir, shard), each)
    ]
    return pictures[:NOISE_PICTURES]


def floor_of(
    pairs: Pairs,
    others: Pairs,
    near: Neighbors,
    noise_grey: float,
    taxel_groups: Mapping[str, np.ndarray],
) -> IrreducibleErrorFloor | None:
    """What a set of neighbors says, None where there are none.

    near: the presses' k nearest of the others. noise_grey: the noise's distance. Of the record,

    - curve: BINS groups of all k neighbors by distance;
    - extrapolated_rmse_counts: for every shape a straight line of half the squared difference over
      the squared distance, through the FITTED nearest of its pairs, not falling, read at the
      noise's distance; the root of the mean over presses, 0 where that is negative, None where no
      shape has two distances;
    - interval: of that, over resampled shapes;
    - parts: that of each group of taxels.
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


def _nearest(compared: Comparison, which: np.ndarray) -> AlikePairs:
    """The presses `which` ((P,) bool) and the nearest of each."""
    return _alike_pairs(
        compared.distance_grey[which, 0],
        compared.half_squares[which, 0].mean(axis=-1, dtype=float),
    )


def _curve(compared: Comparison) -> tuple[AlikePairs, ...]:
    known = np.isfinite(compared.distance_grey)
    distance = compared.distance_grey[known]
    half = compared.half_squares.mean(axis=2, dtype=float)[known]
    in_order = np.argsort(distance, kind="stable")
    return tuple(
        _alike_pairs(distance[part], half[part])
        for part in np.array_split(in_order, BINS)
        if part.size
    )


def _alike_pairs(distance: np.ndarray, half: np.ndarray) -> AlikePairs:
    """distance: grey levels, half: half the squared difference, counts^2; a number a pair each."""
    if not distance.size:
        return AlikePairs(0, None, None)
    return AlikePairs(distance.size, float(np.median(distance)), float(np.sqrt(half.mean())))


def _at_noise(
    compared: Comparison, names: np.ndarray, noise_grey: float, taxels: np.ndarray | None = None
) -> AtNoise:
    """names: (K,) the shapes. taxels: (N,) bool, those that are looked at, by default all.

    Shapes are fitted apart, because those whose pictures are near to others are not those whose
    counts are.
    """
    squares = compared.half_squares if taxels is None else compared.half_squares[:, :, taxels]
    half, distance = squares.mean(axis=2, dtype=float), compared.distance_grey
    presses, at_noise = np.zeros((2, names.size))
    for place, members in enumerate(_members(compared.shapes, names)):
        off, counted = distance[members], half[members]
        mine = np.isfinite(off)
        fitted = mine & (off <= np.quantile(off[mine], FITTED))
        x, y = np.square(off[fitted]), counted[fitted]
        spread = np.square(x - x.mean()).sum()
        if spread > 0:
            slope = max(0.0, float(((x - x.mean()) * (y - y.mean())).sum() / spread))
            presses[place] = mine[:, 0].sum()
            at_noise[place] = y.mean() - slope * (x.mean() - noise_grey**2)
    return AtNoise(presses, at_noise)


def _members(shapes: np.ndarray, names: np.ndarray) -> list[np.ndarray]:
    """The places of each name's presses, in their order. names: (K,) in order, as in shapes."""
    in_order = np.argsort(shapes, kind="stable")
    ends = [np.searchsorted(shapes[in_order], names, side) for side in ("left", "right")]
    return [in_order[start:end] for start, end in zip(*ends, strict=True)]


def _root_of_mean(of_shapes: AtNoise) -> float | None:
    """Over presses, counts; None where no shape has a line."""
    presses, values = of_shapes.presses, of_shapes.half_squares
    if not presses.any():
        return None
    return float(np.sqrt(max(0.0, (presses * values).sum() / presses.sum())))


def _interval(of_shapes: AtNoise) -> Interval | None:
    known = of_shapes.presses > 0
    presses, values = of_shapes.presses[known], of_shapes.half_squares[known]
    if presses.size < 2:
        return None
    drawn = draws(presses.size)
    means = (drawn @ (presses * values)) / (drawn @ presses)
    return interval(np.sqrt(np.maximum(means, 0.0)))
