"""A random shape: drawn from its seed, pressed as any other, a solid when it is asked for."""

from functools import cached_property

import numpy as np
import trimesh

from t2twin.primitives_cad.height_map import REACH_MM
from t2twin.primitives_cad.random_shapes.features import Composition, sample_composition
from t2twin.primitives_cad.random_shapes.rasterize import heights_mm
from t2twin.primitives_cad.random_shapes.seeds import PREFIX
from t2twin.primitives_cad.random_shapes.solid import solid_under
from t2twin.primitives_cad.shape import NOTHING_MM, HeightMap, Shape

PITCH_MM = 0.1
"""Pitch of a random shape's height map, mm (assumed: two pixels of a DIGIT, a fifth of the
narrowest feature)."""

BASE_DEPTH_MM = 8.0
"""How far below the highest point the base plate lies, mm (assumed: deeper than any press, a tilt
and a lower feature together)."""

SPACING_MM = (1.5, 1.5)
"""Spacing of the protocol's grid, as on the tools (Grella et al. 2023)."""

STREAM = 1_701
"""Keeps these draws apart from all others of the same seed."""

MAX_TRIES = 100
"""Compositions that are drawn until one leaves something to press; one in some hundred does not."""

MIN_AREA_MM2 = 0.1
"""Least area of a shape's features near the press axis, mm2, for it to be pressed."""

NEAR_MM = 6.0
"""How near to the press axis that area is looked for, mm, along x and y."""


class RandomShape(Shape):
    """A random shape. seed, composition: what it was drawn from and what came."""

    seed: int
    composition: Composition

    def __init__(self, seed: int) -> None:
        composition, surface = _drawn(seed)
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

    @cached_property
    def mesh(self) -> trimesh.Trimesh:  # pyright: ignore[reportIncompatibleVariableOverride]
        """The solid, mm, made when it is first asked for."""
        return solid_under(self.surface)

    def __reduce__(self) -> tuple[type["RandomShape"], tuple[int]]:
        return RandomShape, (self.seed,)


def _drawn(seed: int) -> tuple[Composition, HeightMap]:
    """The first composition of the seed that leaves something near the press axis, and its
    surface."""
    half = round(REACH_MM / PITCH_MM)
    axis = np.arange(-half - 1, half + 2) * PITCH_MM
    inside = axis[1:-1]
    near = np.abs(inside) <= NEAR_MM
    rng = np.random.default_rng((STREAM, seed))
    for _ in range(MAX_TRIES):
        composition = sample_composition(rng)
        heights = np.full((axis.size, axis.size), NOTHING_MM, np.float32)
        heights[1:-1, 1:-1] = drawn = heights_mm(composition, inside, inside)
        top = drawn.max()
        there = drawn[np.ix_(near, near)] > top - BASE_DEPTH_MM / 2
        if there.sum() * PITCH_MM**2 >= MIN_AREA_MM2:
            relief = np.maximum(drawn - top, -np.float32(BASE_DEPTH_MM))
            heights[1:-1, 1:-1] = relief
            return composition, HeightMap(heights, axis, axis)
    raise AssertionError(f"{PREFIX}{seed}: nothing was drawn in {MAX_TRIES} tries")
