"""The samples that a press is fitted to: blocks of 2 x 2 pixels in a square around it.

A picture has (ROWS / 2, COLUMNS / 2) of them.
"""

import numpy as np

from t2twin.sim.digit.camera import COLUMNS, ROWS

HALF_SAMPLES = 36
"""Half side of the square around a press that is fitted, samples: 7.5 mm, so that the shadows'
ends are in it."""

Square = tuple[slice, slice]
"""Rows and columns of samples."""


def inner(square: Square) -> Square:
    """The same square of samples on the lattice, which has one more beyond each edge."""
    rows, columns = (slice(side.start + 1, side.stop + 1) for side in square)
    return rows, columns


def samples_of(picture: np.ndarray) -> np.ndarray:
    """(ROWS / 2, COLUMNS / 2, 3): a picture (ROWS, COLUMNS, 3), block by block."""
    return picture.reshape(ROWS // 2, 2, COLUMNS // 2, 2, 3).mean(axis=(1, 3))


def square_about(patch: np.ndarray) -> Square:
    """The square of samples around a patch, inside the picture."""
    row = round(min(max(patch[0] / 2, HALF_SAMPLES), ROWS // 2 - HALF_SAMPLES))
    column = round(min(max(patch[1] / 2, HALF_SAMPLES), COLUMNS // 2 - HALF_SAMPLES))
    return (
        slice(row - HALF_SAMPLES, row + HALF_SAMPLES),
        slice(column - HALF_SAMPLES, column + HALF_SAMPLES),
    )
