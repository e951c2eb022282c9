"""Whether a picture is like those that a run was trained on.

A translator gives counts for whatever it is shown, a face or a landscape too. So a run keeps what
its training pictures look like from afar: their means over a coarse grid of cells, with the spread
of each, and how far the farthest of them lies from the mean. A run of a world of many lights knows
little by that; but away from what presses, a picture is like the frame of the same DIGIT untouched,
where that is given.

Shape letters: B images, S the run's image side, c channels, K = CELLS * CELLS * c values.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from t2twin.translate.data.pairs import ImageFile

CELLS = 8
"""Cells along either side of a picture (assumed: a contact covers a few of them)."""

MIN_SPREAD_GREY = 2.0
"""Least spread of a cell, grey levels (assumed: a camera's own drift)."""

FAR = 1.5
"""How many times as far as the farthest training picture an unfamiliar one lies (assumed; measured
at scale small: pictures of shapes that were never trained on within 0.9, those of a real DIGIT in
its own light from 2.2, upside down or turned from 4)."""

DARKEST_GREY, WHITEST_GREY, WHITE_SHARE = 12.0, 250, 0.3
"""Mean grey level below which a picture is black, and the share of values this bright from which it
is overexposed (assumed: a DIGIT's pictures have means of 70 to 135)."""

LIKE, UNLIKE = "", "of another light or sensor"
TURNED: dict[str, Callable[[np.ndarray], np.ndarray]] = {
    "upside down": lambda pixels: pixels[:, ::-1, ::-1],
    "mirrored": lambda pixels: pixels[:, :, ::-1],
    "upside down and mirrored": lambda pixels: pixels[:, ::-1],
    "on its side": lambda pixels: np.rot90(pixels, 1, (1, 2)),
    "on its other side": lambda pixels: np.rot90(pixels, -1, (1, 2)),
}
"""What is wrong with pictures that these put right."""

NEAREST_SHARE = 0.25
"""Share of the cells, the nearest to the untouched frame, that nothing need touch (assumed)."""

APART_GREY = 10.0
"""How far those may lie off it, grey levels (assumed; measured: at most 7.5 in 1,500 presses of 0.5
to 12 N, at least 10.8 off another DIGIT's frame)."""

LEFT = 0.5
"""What may be left of that once a picture is turned the right way (assumed; measured: less in all
of 1,500 presses that were turned, but one, and in none that were not)."""

FEWEST = 100
"""Training pictures that say enough (assumed)."""

BATCH_SIZE = 1024
"""Pictures that are looked at together; bounds memory."""


@dataclass(frozen=True)
class OODDetector:
    """What training pictures look like. mean, spread: (K,), grey levels. farthest: the largest
    `distances` among them."""

    mean: np.ndarray
    spread: np.ndarray
    farthest: float

    def distances(self, pixels: np.ndarray) -> np.ndarray:
        """(B,): root mean square over the cells of how many spreads each is off its mean.

        pixels: (B, S, S, c) uint8.
        """
        off = (_cells(pixels) - self.mean) / self.spread
        return np.sqrt(np.square(off).mean(axis=1))

    def is_like(self, pixels: np.ndarray) -> np.ndarray:
        """(B,) bool: whether each lies within FAR of the farthest training picture."""
        return self.distances(pixels) <= FAR * self.farthest

    def looks(self, pixels: np.ndarray) -> list[str]:
        """(B,) what each picture looks like: LIKE those of the training, or in words why not.

        pixels: (B, S, S, c) uint8. A picture that is like them once it is turned is called by that.
        """
        found = [LIKE if like else UNLIKE for like in self.is_like(pixels)]
        for number, picture in enumerate(pixels[:, None]):
            if shows_nothing(picture):
                found[number] = shows_nothing(picture)
            elif found[number]:
                off = {name: self.distances(turn(picture))[0] for name, turn in TURNED.items()}
                nearest = min(off, key=lambda name: off[name])
                if off[nearest] <= FAR * self.farthest:
                    found[number] = nearest
        return found


def shows_nothing(picture: np.ndarray) -> str:
    """Whether a picture, of any shape, is black or overexposed, in words."""
    if picture.mean() < DARKEST_GREY:
        return "black"
    return "overexposed" if (picture >= WHITEST_GREY).mean() > WHITE_SHARE else LIKE


def compare_with_background(pixels: np.ndarray, frames: np.ndarray) -> list[str]:
    """(B,) what pictures look like beside their own DIGIT's untouched frames: as
    `OODDetector.looks`.

    pixels, frames: (B, S, S, c) uint8.
    """
    found = []
    for picture, frame in zip(pixels[:, None], _cells(frames), strict=True):
        off = _off(picture, frame)
        turned = {name: _off(turn(picture), frame) for name, turn in TURNED.items()}
        nearest = min(turned, key=lambda name: turned[name])
        if turned[nearest] < LEFT * off:
            found.append(nearest)
        else:
            found.append(LIKE if off <= APART_GREY else UNLIKE)
    return found


def _off(picture: np.ndarray, frame: np.ndarray) -> float:
    """How far a picture's, (1, S, S, c), nearest cells lie off a frame's, (K,), grey levels."""
    apart = np.abs(_cells(picture) - frame).reshape(-1, picture.shape[-1]).mean(axis=1)
    return float(np.quantile(apart, NEAREST_SHARE))


def fit_ood_detector(images: ImageFile | np.ndarray) -> OODDetector | None:
    """What these pictures look like, (B, S, S, c) uint8; None for fewer than FEWEST."""
    if len(images) < FEWEST:
        return None
    parts = [slice(start, start + BATCH_SIZE) for start in range(0, len(images), BATCH_SIZE)]
    cells = np.concatenate([_cells(images[part]) for part in parts])
    spread = np.maximum(cells.std(axis=0), MIN_SPREAD_GREY)
    known = OODDetector(cells.mean(axis=0), spread, 0.0)
    off = (cells - known.mean) / spread
    return OODDetector(known.mean, spread, float(np.sqrt(np.square(off).mean(axis=1)).max()))


def _cells(pixels: np.ndarray) -> np.ndarray:
    """(B, K): means over a grid of cells."""
    ends = np.linspace(0, pixels.shape[1], CELLS + 1).astype(int)
    sums = np.add.reduceat(pixels.astype(np.float64), ends[:-1], axis=1)
    sums = np.add.reduceat(sums, ends[:-1], axis=2)
    sizes = np.diff(ends)
    means = sums / (sizes[:, None, None] * sizes[None, :, None])
    return means.reshape(len(pixels), -1)
