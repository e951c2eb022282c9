"""Out-of-distribution detection for DIGIT images.

A translator returns counts for any image. A run therefore stores statistics of its training images.
These are the mean and the standard deviation of each cell of a coarse grid, and the largest
distance of a training image from the mean. A second check compares an image with the background
frame of its DIGIT; it also works for worlds with many lights, where the training statistics are
wide.

Shape letters: B images, S image side, c channels, K = CELLS * CELLS * c values.
"""

from collections.abc import Callable
from enum import StrEnum
from typing import Annotated

import numpy as np
from msgspec import Meta, Struct, field

from t2twin.translate.data.images import WHITE_GREY
from t2twin.translate.data.pairs import ImageFile

CELLS = 8
"""Cells along each side of an image (assumed: a contact covers a few of them)."""

MIN_STD_GREY = 2.0
"""Lower bound of a cell's standard deviation, grey levels (assumed: a camera's drift)."""

MAX_DISTANCE_RATIO = 1.5
"""Distance above which an image is out of distribution, divided by the largest distance of a
training image (assumed). Measured at scale small: at most 0.9 for unseen shapes, at least 2.2 for a
real DIGIT with its own light, at least 4 for rotated images."""

DARKEST_GREY = 12.0
"""Mean grey level below which an image is black (assumed: DIGIT images have means of 70 to 135)."""

BRIGHT_GREY, BRIGHT_SHARE = 250, 0.3
"""An image is overexposed above this share of values of at least this grey level (assumed)."""

BACKGROUND_SHARE = 0.25
"""Share of the cells, those closest to the background frame, assumed to show no contact."""

MAX_BACKGROUND_GREY = 10.0
"""Largest difference of these cells from the background frame, grey levels (assumed). Measured: at
most 7.5 in 1,500 presses of 0.5 to 12 N, at least 10.8 for another DIGIT's frame."""

TRANSFORMED_SHARE = 0.5
"""An image is transformed if undoing the transform reduces that difference below this share of it
(assumed; measured on 1,500 presses: all transformed images but one, no others)."""

STORED_DECIMALS = 3
"""Decimals of the statistics, which a run stores as text."""

MIN_IMAGES = 100
"""Training images that the statistics need (assumed)."""

BATCH_SIZE = 1024
"""Images in one batch; bounds memory."""


class OODClass(StrEnum):
    """Result of the classification of one image."""

    IN_DISTRIBUTION = "in distribution"
    UPSIDE_DOWN = "upside down"
    MIRRORED = "mirrored"
    UPSIDE_DOWN_MIRRORED = "upside down and mirrored"
    ROTATED_LEFT = "on its side"
    ROTATED_RIGHT = "on its other side"
    BLACK = "black"
    OVEREXPOSED = "overexposed"
    OTHER = "of another light or sensor"


INVERSE_TRANSFORMS: dict[OODClass, Callable[[np.ndarray], np.ndarray]] = {
    OODClass.UPSIDE_DOWN: lambda pixels: pixels[:, ::-1, ::-1],
    OODClass.MIRRORED: lambda pixels: pixels[:, :, ::-1],
    OODClass.UPSIDE_DOWN_MIRRORED: lambda pixels: pixels[:, ::-1],
    OODClass.ROTATED_LEFT: lambda pixels: np.rot90(pixels, 1, (1, 2)),
    OODClass.ROTATED_RIGHT: lambda pixels: np.rot90(pixels, -1, (1, 2)),
}
"""Functions that undo each geometric transform, (B, S, S, c) -> (B, S, S, c)."""


class OODDetector(Struct, frozen=True):
    """Statistics of a run's training images.

    mean, std: (K,), grey levels, of the cells; mean_grey and std_grey in a run's config.json.
    max_distance: the largest of their `distances`.
    """

    mean: np.ndarray = field(name="mean_grey")
    std: np.ndarray = field(name="std_grey")
    max_distance: Annotated[float, Meta(ge=0)]

    def check(self, channels: int) -> None:
        """Raises ValueError for statistics that are not those of images with these channels."""
        values = CELLS * CELLS * channels
        if not self.mean.size == self.std.size == values:
            raise ValueError(f"ood_detector must have {values} values in mean_grey and in std_grey")
        grey = np.concatenate([self.mean, self.std])
        if grey.min() < 0 or self.std.min() == 0 or grey.max() > WHITE_GREY:
            raise ValueError(
                f"ood_detector: mean_grey must be from 0 to {WHITE_GREY:g}, and std_grey above 0"
            )

    def distances(self, pixels: np.ndarray) -> np.ndarray:
        """(B,) root mean square over the cells of their standardized differences from the mean.

        pixels: (B, S, S, c) uint8.
        """
        return _distances(_cell_means(pixels), self.mean, self.std)

    def in_distribution(self, pixels: np.ndarray) -> np.ndarray:
        """(B,) bool: whether each image lies within MAX_DISTANCE_RATIO of the training images."""
        return self.distances(pixels) <= MAX_DISTANCE_RATIO * self.max_distance

    def classify(self, pixels: np.ndarray) -> list[OODClass]:
        """(B,) classes of images, (B, S, S, c) uint8.

        An image is in a class of INVERSE_TRANSFORMS if undoing that transform makes it
        in-distribution; if several do, the one with the smallest distance.
        """
        inside = self.in_distribution(pixels)
        classes = [OODClass.IN_DISTRIBUTION if each else OODClass.OTHER for each in inside]
        for number, image in enumerate(pixels[:, None]):
            exposure = _exposure_class(image)
            if exposure is not None:
                classes[number] = exposure
            elif not inside[number]:
                distances = {
                    name: self.distances(undo(image))[0]
                    for name, undo in INVERSE_TRANSFORMS.items()
                }
                nearest = min(distances, key=lambda name: distances[name])
                if distances[nearest] <= MAX_DISTANCE_RATIO * self.max_distance:
                    classes[number] = nearest
        return classes


def _exposure_class(image: np.ndarray) -> OODClass | None:
    """BLACK, OVEREXPOSED or None, for an image of any shape."""
    if image.mean() < DARKEST_GREY:
        return OODClass.BLACK
    overexposed = (image >= BRIGHT_GREY).mean() > BRIGHT_SHARE
    return OODClass.OVEREXPOSED if overexposed else None


def compare_with_background(pixels: np.ndarray, frames: np.ndarray) -> list[OODClass]:
    """(B,) classes of images by their difference from their own background frames.

    pixels, frames: (B, S, S, c) uint8.
    """
    classes = []
    for image, frame in zip(pixels[:, None], _cell_means(frames), strict=True):
        difference = _background_difference(image, frame)
        undone = {
            name: _background_difference(undo(image), frame)
            for name, undo in INVERSE_TRANSFORMS.items()
        }
        nearest = min(undone, key=lambda name: undone[name])
        if undone[nearest] < TRANSFORMED_SHARE * difference:
            classes.append(nearest)
        elif difference <= MAX_BACKGROUND_GREY:
            classes.append(OODClass.IN_DISTRIBUTION)
        else:
            classes.append(OODClass.OTHER)
    return classes


def fit_ood_detector(images: ImageFile | np.ndarray) -> OODDetector | None:
    """Statistics of images, (B, S, S, c) uint8; None for fewer than MIN_IMAGES."""
    if len(images) < MIN_IMAGES:
        return None
    parts = [slice(start, start + BATCH_SIZE) for start in range(0, len(images), BATCH_SIZE)]
    cells = np.concatenate([_cell_means(images[part]) for part in parts])
    mean = cells.mean(axis=0).round(STORED_DECIMALS)
    std = np.maximum(cells.std(axis=0), MIN_STD_GREY).round(STORED_DECIMALS)
    return OODDetector(mean, std, float(_distances(cells, mean, std).max()))


def _distances(cells: np.ndarray, mean: np.ndarray, std: np.ndarray) -> np.ndarray:
    """(B,), see OODDetector.distances. cells: (B, K)."""
    return np.sqrt(np.square((cells - mean) / std).mean(axis=1))


def _background_difference(image: np.ndarray, frame: np.ndarray) -> float:
    """Quantile BACKGROUND_SHARE of the cells' absolute differences, grey levels.

    image: (1, S, S, c). frame: (K,) cell means.
    """
    difference = np.abs(_cell_means(image) - frame).reshape(-1, image.shape[-1]).mean(axis=1)
    return float(np.quantile(difference, BACKGROUND_SHARE))


def _cell_means(pixels: np.ndarray) -> np.ndarray:
    """(B, K): means over a grid of cells."""
    ends = np.linspace(0, pixels.shape[1], CELLS + 1).astype(int)
    sums = np.add.reduceat(pixels.astype(np.float64), ends[:-1], axis=1)
    sums = np.add.reduceat(sums, ends[:-1], axis=2)
    sizes = np.diff(ends)
    means = sums / (sizes[:, None, None] * sizes[None, :, None])
    return means.reshape(len(pixels), -1)
