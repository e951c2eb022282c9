"""Checks that no training solid is a test object, by comparing solids, not names.

Compared are invariants of each body to rotation, reflection and scale: surface area and principal
second moments, relative to the volume. A mesh ten times as coarse changes them by less than 1 %.
"""

import sys
from functools import cache
from pathlib import Path

import numpy as np
import trimesh

from t2twin.core.errors import T2TwinError
from t2twin.core.progress import Progress
from t2twin.primitives_cad import catalogue
from t2twin.sim.sampling.plan import load_shape, solids_in
from t2twin.sim.sampling.recipe import NAMED, Recipe

SAME_SHARE = 0.02
"""Solids are the same if each invariant differs by less than this share. Assumed: twice the effect
of a coarse mesh. Of 200 random shapes and the 32 primitives the nearest differs by 0.6."""


def check_held_out(recipe: Recipe, cache_dir: str | Path | None = None) -> None:
    """Prepares a user's solids, prints their notes, and raises T2TwinError if one of them in
    training or validation is a whole tool.

    cache_dir: as for catalogue.load. The benchmark `random_presses` compares the random shapes.
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
            tool = tool_in(shape.mesh)
            if tool is not None:
                raise T2TwinError(
                    f"{path} is the tool {tool}, which is a test object; remove it, or give its "
                    'part split = "test" and no val_share'
                )


def tool_in(mesh: trimesh.Trimesh) -> str | None:
    """The name of the first tool that a body of a mesh equals, or None."""
    own = invariants(mesh)
    for tool, known in _tools().items():
        if (np.abs(own[:, None] / known - 1.0) < SAME_SHARE).all(axis=-1).any():
            return tool
    return None


@cache
def _tools() -> dict[str, np.ndarray]:
    """The invariants of all tools."""
    return {tool: invariants(catalogue.tool_mesh(tool)) for tool in catalogue.TOOLS}


def invariants(mesh: trimesh.Trimesh) -> np.ndarray:
    """(bodies, 4): area^(3/2) / volume and the principal second moments / volume^(5/3), rising,
    of each body that encloses a volume."""
    rows = []
    for body in mesh.split(only_watertight=False, repair=False):
        if volume := abs(body.volume):
            inertia = np.abs(body.principal_inertia_components)  # about the axes
            second = np.sort(inertia.sum() / 2.0 - inertia)  # along the axes
            rows.append([body.area**1.5 / volume, *second / volume ** (5 / 3)])
    return np.array(rows).reshape(-1, 4)
