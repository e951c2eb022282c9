"""Presses of the protocol (Grella et al. 2023), and the subsets of smaller scales.

The index of a press counts the shape's grid points row by row, and at each point the orientations.
A scale is a set of indices, so each press of a smaller scale has the same pose at a larger one.
"""

from collections.abc import Sequence
from itertools import product

import numpy as np

from t2twin.primitives_cad import catalogue
from t2twin.sim.contact.types import PressCommand

FORCE_N = 8.0  # commanded along the press axis (Grella et al. 2023)
LAST_YAW_RAD = 7 / 4 * np.pi  # orientations are equally spaced from 0 to this (ibid.)

GRID_OFFSET_MM = (0.3, 0.17)
"""Offset of the grid's middle from the shape's, x and y in the shape's frame, mm (assumed: accuracy
of a robot). Without it, a fifth of the presses of a round shape would repeat others: at its middle,
and at points whose angles differ by a difference of orientations."""


# Points of a grid along x and y, at the shape's spacing_mm, and orientations at each; the objects'
# seven orientations have the same range as the primitives' twelve (assumed)
PRIMITIVE_GRID, OBJECT_GRID = (7, 12), (3, 7)


Subset = tuple[Sequence[tuple[int, int]], int]
"""Some of a shape's presses: grid points (row, column), and the number of orientations at each,
which are equally spaced and start at another one from point to point."""


def _square(*axis: int) -> list[tuple[int, int]]:
    return [*product(axis, axis)]


# Subsets of a primitive and of an object
SCALES: dict[str, tuple[Subset, Subset]] = {
    "smoke": (([(0, 0), (3, 3), (6, 6)], 1), ([(1, 1)], 1)),
    "light": ((_square(0, 1, 3, 5, 6), 1), ([(0, 0), (0, 2), (1, 1), (2, 0), (2, 2)], 2)),
    "small": ((_square(1, 2, 4, 5), 2), (_square(0, 1, 2), 1)),
    "paper": ((_square(*range(7)), 12), (_square(*range(3)), 7)),
}


STRIDE = 5  # shift of the orientations from point to point: coprime to 12 and 7


def grid_of(name: str) -> tuple[int, int]:
    """Points along a side of the grid of a shape, and orientations at each."""
    return OBJECT_GRID if name in catalogue.OBJECTS else PRIMITIVE_GRID


def indices(name: str, scale: tuple[Subset, Subset]) -> list[int]:
    """Indices of a shape's presses at a scale, rising."""
    side, orientations = grid_of(name)
    points, turns = scale[name in catalogue.OBJECTS]
    step = orientations // turns
    # Each shape starts at another orientation, so that orientation and place are independent.
    first = catalogue.NAMES.index(name)
    return sorted(
        (row * side + column) * orientations + (first + STRIDE * n + k * step) % orientations
        for n, (row, column) in enumerate(points)
        for k in range(turns)
    )


def press_of(name: str, spacing_mm: tuple[float, float], index: int) -> PressCommand:
    """The press with an index, of a catalogue shape with a spacing of its grid along x and y.

    The grid rotates with the shape about the press axis: (x, y) = Rz(yaw) (grid point).
    """
    side, orientations = grid_of(name)
    point, orientation = divmod(index, orientations)
    row, column = divmod(point, side)
    middle = (side - 1) / 2
    grid_x = (column - middle) * spacing_mm[0] + GRID_OFFSET_MM[0]
    grid_y = (row - middle) * spacing_mm[1] + GRID_OFFSET_MM[1]
    yaw = LAST_YAW_RAD * orientation / (orientations - 1)
    cos, sin = float(np.cos(yaw)), float(np.sin(yaw))
    x_mm, y_mm = cos * grid_x - sin * grid_y, sin * grid_x + cos * grid_y
    return PressCommand(name, x_mm, y_mm, float(yaw), FORCE_N)
