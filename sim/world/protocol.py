"""Which presses the protocol makes (Grella et al. 2023), and the smaller scales that thin it.

A press is known by its index in the shape's full list: grid point by grid point, row by row, and
at each point the orientations. A scale is a choice of indices, so what is pressed at a smaller
scale is pressed at the same pose at a larger one.
"""

from dataclasses import dataclass
from itertools import product

import numpy as np

from t2twin.core.errors import T2TwinError
from t2twin.primitives_cad import catalogue
from t2twin.primitives_cad.shape import Shape
from t2twin.sim.contact.types import PressCommand

FORCE_N = 8.0
"""Commanded force along the press axis, N (Grella et al. 2023)."""

LAST_YAW_RAD = 7 / 4 * np.pi
"""Orientations are equally spaced from 0 to this (Grella et al. 2023)."""

GRID_OFFSET_MM = (0.3, 0.17)
"""Where the middle of the grid lies from the shape's own middle, x and y in the shape's frame, mm
(assumed: as well as a robot finds a part). Were it zero, turning would bring a fifth of the
presses of a round shape back to where another one was: its middle, and points at angles that the
orientations happen to make up."""


@dataclass(frozen=True)
class Grid:
    """points x points places, spacing_mm of the shape apart, each at so many orientations."""

    points: int
    orientations: int


PRIMITIVE_GRID = Grid(points=7, orientations=12)
OBJECT_GRID = Grid(points=3, orientations=7)
"""The objects' seven orientations are spaced as the primitives' twelve are (assumed)."""


@dataclass(frozen=True)
class Scale:
    """How the full lists are thinned: the grid points kept (row, column), and how many
    orientations at each. Those are evenly spaced, and start elsewhere from point to point, so
    that all of them occur."""

    name: str
    primitive_points: tuple[tuple[int, int], ...]
    primitive_orientations: int
    object_points: tuple[tuple[int, int], ...]
    object_orientations: int


def _square(*axis: int) -> tuple[tuple[int, int], ...]:
    return tuple(product(axis, axis))


SCALES = {
    "smoke": Scale("smoke", ((0, 0), (3, 3), (6, 6)), 1, ((1, 1),), 1),
    "small": Scale("small", _square(1, 2, 4, 5), 2, _square(0, 1, 2), 1),
    "paper": Scale("paper", _square(*range(7)), 12, _square(*range(3)), 7),
}


STRIDE = 5
"""Orientations by which kept points differ: coprime to 12 and 7, so that neighbors differ well."""


def grid_of(name: str) -> Grid:
    return OBJECT_GRID if name in catalogue.OBJECTS else PRIMITIVE_GRID


def scale_of(name: str) -> Scale:
    """A scale by name. Raises T2TwinError for an unknown one."""
    if name not in SCALES:
        raise T2TwinError(f"no scale {name!r}; allowed are {', '.join(SCALES)}")
    return SCALES[name]


def indices(name: str, scale: Scale) -> list[int]:
    """Indices of a shape's presses at a scale, rising."""
    grid = grid_of(name)
    is_object = name in catalogue.OBJECTS
    points = scale.object_points if is_object else scale.primitive_points
    turns = scale.object_orientations if is_object else scale.primitive_orientations
    step = grid.orientations // turns
    # A shape of its own place in the catalogue starts elsewhere, so that no orientation is
    # tied to a place of the grid.
    first = catalogue.NAMES.index(name)
    return sorted(
        (row * grid.points + column) * grid.orientations
        + (first + STRIDE * n + k * step) % grid.orientations
        for n, (row, column) in enumerate(points)
        for k in range(turns)
    )


def press_at(shape: Shape, index: int) -> PressCommand:
    """The press of an index of a shape's full list."""
    return press_of(shape.name, shape.spacing_mm, index)


def press_of(
    name: str, spacing_mm: tuple[float, float], index: int, grid: Grid | None = None
) -> PressCommand:
    """The press of an index, of a shape by name and the spacing of its grid along x and y.

    grid: a catalogue shape's own unless given.

    The sensor goes to a grid point of the shape and turns about the press axis there; seen from
    the sensor, the grid turns with the shape: (x, y) = Rz(yaw) (grid point).
    """
    grid = grid or grid_of(name)
    point, orientation = divmod(index, grid.orientations)
    row, column = divmod(point, grid.points)
    middle = (grid.points - 1) / 2
    grid_x = (column - middle) * spacing_mm[0] + GRID_OFFSET_MM[0]
    grid_y = (row - middle) * spacing_mm[1] + GRID_OFFSET_MM[1]
    yaw = LAST_YAW_RAD * orientation / (grid.orientations - 1)
    cos, sin = float(np.cos(yaw)), float(np.sin(yaw))
    return PressCommand(
        shape=name,
        x_mm=cos * grid_x - sin * grid_y,
        y_mm=sin * grid_x + cos * grid_y,
        yaw_rad=float(yaw),
        force_n=FORCE_N,
    )
