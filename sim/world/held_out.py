"""The test objects are in no world but the test: a check by surface, not by name."""

from functools import cache
from pathlib import Path

from t2twin.primitives_cad import catalogue
from t2twin.primitives_cad.errors import T2TwinError
from t2twin.primitives_cad.progress import Progress
from t2twin.primitives_cad.same_surface import KnownSurfaces
from t2twin.sim.world.plan import solids_in
from t2twin.sim.world.recipe import NAMED, Recipe


def check_held_out(recipe: Recipe, cache_dir: str | Path | None = None) -> None:
    """Raises T2TwinError where a user's solid that is not for the test presses with the surface of
    a tool at one of its keypoints. cache_dir: as for catalogue.load.

    Random shapes are drawn without the tools; benchmarks/worlds.py looks whether one is like them.
    """
    for part in recipe.parts:
        if part.shapes in NAMED or part.split == "test":
            continue
        known = test_surfaces(None if cache_dir is None else str(cache_dir))
        for path in Progress(solids_in(part.shapes), desc="held-out check", unit="solid"):
            same = known.same_as(catalogue.load(path, cache_dir).surface)
            if same is not None:
                raise T2TwinError(
                    f"{path} presses with the same surface as {same}, which is for the test; leave "
                    'it out, or give its part split = "test"'
                )


@cache
def test_surfaces(cache_dir: str | None = None) -> KnownSurfaces:
    """The surfaces of all tools at their keypoints."""
    return KnownSurfaces(
        {name: catalogue.load(name, cache_dir).surface for name in catalogue.OBJECTS}
    )
