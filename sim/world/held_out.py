"""Checks that no training solid is a test object, by comparing solids, not names."""

import sys
from functools import cache
from pathlib import Path

from t2twin.core.errors import T2TwinError
from t2twin.core.progress import Progress
from t2twin.primitives_cad import catalogue
from t2twin.primitives_cad.same_solid import KnownSolids
from t2twin.sim.world.plan import load_shape, solids_in
from t2twin.sim.world.recipe import NAMED, Recipe


def check_held_out(recipe: Recipe, cache_dir: str | Path | None = None) -> None:
    """Prepares a user's solids, prints their notes, and raises T2TwinError if one of them in
    training or validation is a test object.

    That is a whole tool, as the solid or one of its bodies, also rotated, mirrored or scaled.
    cache_dir: as for catalogue.load. Random shapes do not depend on the tools;
    the benchmark `random_presses` compares them.
    """
    for part in recipe.parts:
        if part.shapes in NAMED:
            continue
        for path in Progress(solids_in(part.shapes), desc="held-out check", unit="solid"):
            shape = load_shape(part, path, cache_dir)
            for note in shape.notes:
                Progress.write(f"t2twin: {note}", file=sys.stderr)
            if part.split == "test" and not part.val_share:
                continue
            tool = test_solids().same_as(shape.mesh)
            if tool is not None:
                raise T2TwinError(
                    f"{path} is the tool {tool}, which is a test object; remove it, or give its "
                    'part split = "test" and no val_share'
                )


@cache
def test_solids() -> KnownSolids:
    """All tools, whole."""
    return KnownSolids({tool: catalogue.tool_mesh(tool) for tool in catalogue.TOOLS})
