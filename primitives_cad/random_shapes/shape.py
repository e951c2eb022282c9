"""Random shapes: height maps sampled from a seed; their solids are built at the first use."""

from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from t2twin.primitives_cad.height_map import REACH_MM
from t2twin.primitives_cad.primitive_parameters import PLATE_THICKNESS_MM
from t2twin.primitives_cad.random_shapes import PREFIX
from t2twin.primitives_cad.random_shapes.features import Composition, sample_composition
from t2twin.primitives_cad.random_shapes.rasterize import heights_mm
from t2twin.primitives_cad.shape import NOTHING_MM, HeightMap, Shape

if TYPE_CHECKING:
    import trimesh

PITCH_MM = 0.1
"""Pitch of a random shape's height map, mm (assumed: two pixels of a DIGIT, a fifth of the
narrowest feature)."""

BASE_DEPTH_MM = 8.0
"""Depth of the base plate below the highest point, mm (assumed: more than a press, a tilt and a
lower feature together)."""

SPACING_MM = (1.5, 1.5)
"""Spacing of the protocol's grid, as on the tools (Grella et al. 2023)."""

STREAM = 1_701
"""Separates these random numbers from others with the same seed."""

MAX_TRIES = 100
"""Limit on the compositions sampled until one can be pressed; about one in sixty cannot."""

MIN_AREA_MM2 = 0.1
"""Least area of a shape's features near the press axis, mm2."""

NEAR_MM = 6.0
"""Largest distance of that area from the press axis along x and y, mm."""


class RandomShape(Shape):
    """A random shape. seed: of its composition."""

    seed: int
    composition: Composition

    def __init__(self, seed: int) -> None:
        composition, surface = _sample(seed)
        fields = {
            "name": f"{PREFIX}{seed}",
            "surface": surface,
            "spacing_mm": SPACING_MM,
            "parameters": {
                "features": float(len(composition.features)),
                "tilt_deg": float(np.degrees(np.arctan(np.hypot(*composition.tilt)))),
            },
            "base_mm": -BASE_DEPTH_MM,
            "notes": (),
            "seed": seed,
            "composition": composition,
        }
        for name, value in fields.items():
            object.__setattr__(self, name, value)

    @property
    def is_under_surface(self) -> bool:
        """True: the mesh is made from the surface."""
        return True

    @cached_property
    def mesh(self) -> "trimesh.Trimesh":  # pyright: ignore[reportIncompatibleVariableOverride]
        """The solid, mm."""
        return solid_under(self.surface)

    def __reduce__(self) -> tuple[type["RandomShape"], tuple[int]]:
        return RandomShape, (self.seed,)


def _sample(seed: int) -> tuple[Composition, HeightMap]:
    """The first composition of the seed with an area near the press axis, and its surface."""
    half = round(REACH_MM / PITCH_MM)
    axis = np.arange(-half - 1, half + 2) * PITCH_MM
    inside = axis[1:-1]
    near = np.abs(inside) <= NEAR_MM
    rng = np.random.default_rng((STREAM, seed))
    for _ in range(MAX_TRIES):
        composition = sample_composition(rng)
        sampled = heights_mm(composition, inside, inside)
        top = sampled.max()
        if top == NOTHING_MM:  # cuts and holes leave nothing of the features
            continue
        high = sampled[np.ix_(near, near)] > top - BASE_DEPTH_MM / 2
        if high.sum() * PITCH_MM**2 >= MIN_AREA_MM2:
            heights = np.full((axis.size, axis.size), NOTHING_MM, np.float32)
            heights[1:-1, 1:-1] = np.maximum(sampled - top, -np.float32(BASE_DEPTH_MM))
            return composition, HeightMap(heights, axis, axis)
    raise AssertionError(f"{PREFIX}{seed}: no composition was found in {MAX_TRIES} tries")


def solid_under(surface: HeightMap) -> "trimesh.Trimesh":
    """A closed mesh, mm: the surface with two triangles per cell, on a plate.

    Leaves out the rim of NOTHING_MM.
    """
    import trimesh

    rows, columns = (np.flatnonzero((surface.heights_mm > NOTHING_MM / 2).any(axis=axis))
                     for axis in (1, 0))  # fmt: skip
    rows, columns = slice(rows[0], rows[-1] + 1), slice(columns[0], columns[-1] + 1)
    heights = surface.heights_mm[rows, columns].astype(float)
    x, y = np.meshgrid(surface.x_mm[columns], surface.y_mm[rows])
    ny, nx = heights.shape
    top = np.column_stack([x.ravel(), y.ravel(), heights.ravel()])
    number = np.arange(ny * nx).reshape(ny, nx)
    a, b, c, d = number[:-1, :-1], number[:-1, 1:], number[1:, 1:], number[1:, :-1]
    faces = [np.stack(t, axis=-1).reshape(-1, 3) for t in ((a, b, c), (a, c, d))]
    # the rim, counterclockwise seen from above, and its copy on the plate's underside
    rim = np.concatenate([number[0, :-1], number[:-1, -1], number[-1, :0:-1], number[:0:-1, 0]])
    floor = float(heights.min()) - PLATE_THICKNESS_MM
    below = np.column_stack([top[rim, :2], np.full(rim.size, floor)])
    under = len(top) + np.arange(rim.size)
    on, under_on = np.roll(rim, -1), np.roll(under, -1)
    faces += [np.column_stack([rim, under, under_on]), np.column_stack([rim, under_on, on])]
    middle = len(top) + rim.size
    faces.append(np.column_stack([np.full(rim.size, middle), under_on, under]))
    center = np.array([[*top[:, :2].mean(axis=0), floor]])
    return trimesh.Trimesh(
        np.concatenate([top, below, center]), np.concatenate(faces), process=False
    )
