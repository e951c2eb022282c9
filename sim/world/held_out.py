"""Checks that no training solid is a test object, by comparing solids, not names."""

from functools import cache
from pathlib import Path

from t2twin.core.errors import T2TwinError
from t2twin.core.progress import Progress
from t2twin.primitives_cad import catalogue
from t2twin.primitives_cad.same_solid import KnownSolids
from t2twin.primitives_cad.same_surface import KnownSurfaces
from t2twin.sim.world.plan import solids_in
from t2twin.sim.world.recipe import NAMED, Recipe

SHARED = ("clamp/handle",)
"""Keypoints with the surface of a primitive of the training set: the ball at the end of the clamp's
handle is hemisphere-4's."""


def check_held_out(recipe: Recipe, cache_dir: str | Path | None = None) -> None:
    """Raises T2TwinError if a user's solid in training or validation is a test object.

    That is a whole tool, as the solid or one of its bodies, also rotated, mirrored or scaled. It is
    also a solid whose pressing surface is that of a tool at a keypoint, within the reach of a
    press. cache_dir: as for catalogue.load. Random shapes do not depend on the tools;
    benchmarks/random_presses.py compares them.
    """
    folder = None if cache_dir is None else str(cache_dir)
    for part in recipe.parts:
        if part.shapes in NAMED or (part.split == "test" and not part.val_share):
            continue
        for path in Progress(solids_in(part.shapes), desc="held-out check", unit="solid"):
            shape = catalogue.load(path, cache_dir)
            if tool := test_solids().same_as(shape.mesh):
                is_test = f"is the tool {tool}"
            elif place := test_surfaces(folder).same_as(shape.surface):
                is_test = f"presses with the same surface as {place}"
            else:
                continue
            raise T2TwinError(
                f"{path} {is_test}, which is a test object; remove it, or give its part "
                'split = "test" and no val_share'
            )


@cache
def test_solids() -> KnownSolids:
    """All tools, whole."""
    return KnownSolids({tool: catalogue.tool_mesh(tool) for tool in catalogue.TOOLS})


@cache
def test_surfaces(cache_dir: str | None = None) -> KnownSurfaces:
    """The surfaces of all tools at their keypoints, except SHARED."""
    return KnownSurfaces(
        {
            name: catalogue.load(name, cache_dir).surface
            for name in catalogue.OBJECTS
            if name not in SHARED
        }
    )
