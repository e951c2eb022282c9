"""Whether a picture is like those that a run was trained on.

A translator gives counts for whatever it is shown, a face or a landscape too. So a run keeps what
its training pictures look like from afar: their means over a coarse grid of cells, with the spread
of each, and how far the farthest of them lies from the mean.

Shape letters: B images, S the run's image side, c channels, K = CELLS * CELLS * c values.
"""

from dataclasses import dataclass

import numpy as np

from t2twin.translate.data.pairs import ImageFile

CELLS = 8
"""Cells along either side of a picture (assumed: a contact covers a few of them)."""

LEAST_SPREAD_GREY = 2.0
"""Least spread of a cell, grey levels (assumed: a camera's own drift)."""

FAR = 1.5
"""How many times as far as the farthest training picture an unfamiliar one lies (assumed; measured
at scale small: pictures of shapes that were never trained on within 0.9, those of a real DIGIT in
its own light from 2.2, upside down or turned from 4)."""

FEWEST = 100
"""Training pictures that say enough (assumed)."""

AT_ONCE = 1024
"""Pictures that are looked at together; bounds memory."""


@dataclass(frozen=True)
class Familiar:
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


def familiar_with(images: ImageFile | np.ndarray) -> Familiar | None:
    """What these pictures look like, (B, S, S, c) uint8; None for fewer than FEWEST."""
    if len(images) < FEWEST:
        return None
    parts = [slice(start, start + AT_ONCE) for start in range(0, len(images), AT_ONCE)]
    cells = np.concatenate([_cells(images[part]) for part in parts])
    spread = np.maximum(cells.std(axis=0), LEAST_SPREAD_GREY)
    known = Familiar(cells.mean(axis=0), spread, 0.0)
    off = (cells - known.mean) / spread
    return Familiar(known.mean, spread, float(np.sqrt(np.square(off).mean(axis=1)).max()))


def _cells(pixels: np.ndarray) -> np.ndarray:
    """(B, K): means over a grid of cells."""
    ends = np.linspace(0, pixels.shape[1], CELLS + 1).astype(int)
    sums = np.add.reduceat(pixels.astype(np.float64), ends[:-1], axis=1)
    sums = np.add.reduceat(sums, ends[:-1], axis=2)
    sizes = np.diff(ends)
    means = sums / (sizes[:, None, None] * sizes[None, :, None])
    return means.reshape(len(pixels), -1)
