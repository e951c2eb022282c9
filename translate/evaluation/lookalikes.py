"""What the picture does not say: presses that look nearly alike and do not feel alike.

Of two presses whose pictures cannot be told apart, a translator gives one answer. Taken as two
draws of what such a picture may mean, their counts differ in mean square by twice the variance that
is left once the picture is known; so sqrt(mean squared difference / 2) is the sqrt(L3) that the
best predictor, which answers with the mean of all of them, still makes.

It bounds what can be known from the picture at FEATURE_SIZE, averaged over presses that have a
look-alike. It does not bound a network that sees finer detail than that, nor speak of presses that
nothing resembles; and pictures that differ a little may be told apart, so that the figure at a
distance above the noise's is too high a floor. Hence the figure extrapolated to the noise's
distance, by a straight line in the squared distance, for the squared difference of the counts grows
so where they follow the picture smoothly. Neighbours among the training pairs add what a translator
cannot know in another way: a shape of another kind that looks the same.
"""

import io
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow.parquet as pq
from PIL import Image

from t2twin.sim.dataset.store import read_info
from t2twin.translate.data.images import to_pixels
from t2twin.translate.data.pairs import Pairs
from t2twin.translate.evaluation.baselines import FEATURE_SIZE, Neighbours, neighbours
from t2twin.translate.evaluation.bootstrap import draws, interval

NEIGHBOURS = 8
"""Nearest images of each press that the extrapolation is made from."""

CLOSE = 2.0
"""Two pictures are nearly the same within this many times the distance that noise makes."""

FITTED = 0.5
"""The part of the pairs, the nearest, that the line is fitted to."""

BINS = 12
"""Groups of as many pairs each, by distance, for the curve."""

NOISE_PICTURES = 64
"""Pictures that the noise's distance is measured on."""

SEED = 2
"""Seed of that noise."""

SPLIT, TRAINING = "split", "training"
"""Where the look-alikes are looked for."""


def lookalikes(
    data_dir: Path,
    split: str,
    pairs: Pairs,
    train: Pairs,
    of_train: Neighbours,
    parts: Mapping[str, np.ndarray],
) -> dict[str, Any] | None:
    """How far presses of a split differ in taxels from those that look like them.

    pairs: the split's, train: the training split's, images of both at FEATURE_SIZE in RGB.
    of_train: the pairs' NEIGHBOURS nearest of the training images. parts: (N,) bool by name, parts
    of the taxels that are looked at alone too.
    Returns "noise_grey" (distance of two pictures of one press), "close_grey" (CLOSE times that),
    and for the neighbours among other shapes of the "split" and among "training" pairs what
    `_floor` says. None for a dataset that does not name its pictures' noise.
    """
    noise = noise_distance_grey(data_dir, split)
    if noise is None:
        return None
    shapes = (pairs.shapes, pairs.shapes)
    of_split = neighbours(pairs.images, pairs.images, NEIGHBOURS, shapes, "look-alikes")
    return {
        "noise_grey": noise,
        "close_grey": CLOSE * noise,
        SPLIT: _floor(pairs, pairs, of_split, noise, parts),
        TRAINING: _floor(pairs, train, of_train, noise, parts),
    }


def noise_distance_grey(data_dir: Path, split: str) -> float | None:
    """Distance between two pictures of one press, grey levels, at FEATURE_SIZE; None if unknown.

    Measured: pictures of the split get the noise that the dataset was made with, twice each, and
    are made small as the stored ones are.
    """
    info = read_info(data_dir)
    sigma = info.get("parameters", {}).get("digit", {}).get("noise_grey")
    if sigma is None:
        return None
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


def _some_pictures(data_dir: Path, info: dict[str, Any], split: str) -> list[np.ndarray]:
    """NOISE_PICTURES or fewer, as many of each shape, (h, w, 3) uint8."""
    shards = sorted(path for path in info["shards"] if path.startswith(f"{split}/"))
    each = -(-NOISE_PICTURES // len(shards))
    pictures = []
    for shard in shards:
        with pq.ParquetFile(data_dir / shard) as file:
            rows = next(file.iter_batches(each, columns=["image"])).column(0).to_pylist()
        for row in rows:
            with Image.open(io.BytesIO(row["bytes"])) as image:
                pictures.append(np.asarray(image.convert("RGB")))
    return pictures[:NOISE_PICTURES]


def _floor(
    pairs: Pairs,
    others: Pairs,
    near: Neighbours,
    noise: float,
    parts: Mapping[str, np.ndarray],
) -> dict[str, Any] | None:
    """What a set of neighbours says, None where there are none.

    Returns
    - "nearest": pairs of each press and its nearest, with their median distance, and their error;
    - "close": the same of those within CLOSE times the noise's distance;
    - "curve": BINS groups of all k neighbours by distance, each with its mean distance;
    - "extrapolated_rmse_counts" with its "interval", over resampled shapes: for every shape a
      straight line of half the squared difference over the squared distance, through the FITTED
      nearest of its pairs, not falling, read at the noise's distance; the root of the mean over
      presses, 0 where that is negative, None where no shape has two distances;
    - "parts": the extrapolated figure of each part of the taxels;
    - "by_shape": "nearest" and the extrapolated figure of each shape.

    Errors are sqrt(mean squared difference / 2), counts.
    """
    known = np.isfinite(near.distance_grey)
    if not known.any():
        return None
    each = np.square(pairs.counts[:, None] - others.counts[near.index]) / 2  # (P, k, N)
    halves = each.mean(axis=2, dtype=float)
    first = known[:, 0]
    close = first & (near.distance_grey[:, 0] <= CLOSE * noise)
    names = np.unique(pairs.shapes[first])
    whole = _at_noise(pairs.shapes, near.distance_grey, halves, names, noise)
    in_order = np.argsort(near.distance_grey[known], kind="stable")
    return {
        "nearest": _group(near.distance_grey[first, 0], halves[first, 0]),
        "close": _group(near.distance_grey[close, 0], halves[close, 0]),
        "curve": [
            _group(near.distance_grey[known][part], halves[known][part])
            for part in np.array_split(in_order, BINS)
            if part.size
        ],
        "extrapolated_rmse_counts": _root_of_mean(whole),
        "interval": _interval(whole),
        "parts": {
            name: _root_of_mean(
                _at_noise(
                    pairs.shapes,
                    near.distance_grey,
                    each[:, :, part].mean(axis=2, dtype=float),
                    names,
                    noise,
                )
            )
            for name, part in parts.items()
            if part.any()
        },
        "by_shape": {
            str(name): {
                "nearest": _group(
                    near.distance_grey[first & (pairs.shapes == name), 0],
                    halves[first & (pairs.shapes == name), 0],
                ),
                "extrapolated_rmse_counts": _root_of_mean(whole[:, [column]]),
            }
            for column, name in enumerate(names)
        },
    }


def _group(distance: np.ndarray, half: np.ndarray) -> dict[str, Any]:
    return {
        "pairs": int(distance.size),
        "distance_grey": float(np.median(distance)) if distance.size else None,
        "rmse_counts": float(np.sqrt(half.mean())) if distance.size else None,
    }


def _at_noise(
    shapes: np.ndarray, distance: np.ndarray, half: np.ndarray, names: np.ndarray, noise: float
) -> np.ndarray:
    """Each shape's line at the noise's distance: (2, K), its presses and counts^2.

    shapes: (P,). distance, half: (P, k). Shapes are fitted apart, because those whose pictures are
    near to others are not those whose counts are.
    """
    found = np.zeros((2, names.size))
    for column, name in enumerate(names):
        mine = np.isfinite(distance) & (shapes == name)[:, None]
        fitted = mine & (distance <= np.quantile(distance[mine], FITTED))
        x, y = np.square(distance[fitted]), half[fitted]
        spread = np.square(x - x.mean()).sum()
        if spread > 0:
            slope = max(0.0, float(((x - x.mean()) * (y - y.mean())).sum() / spread))
            found[:, column] = mine[:, 0].sum(), y.mean() - slope * (x.mean() - noise**2)
    return found


def _root_of_mean(of_shapes: np.ndarray) -> float | None:
    """Of (2, K) presses and counts^2."""
    presses, values = of_shapes
    if not presses.any():
        return None
    return float(np.sqrt(max(0.0, (presses * values).sum() / presses.sum())))


def _interval(of_shapes: np.ndarray) -> list[float] | None:
    presses, values = of_shapes[:, of_shapes[0] > 0]
    if presses.size < 2:
        return None
    drawn = draws(presses.size)
    means = (drawn @ (presses * values)) / (drawn @ presses)
    return interval(np.sqrt(np.maximum(means, 0.0)))
