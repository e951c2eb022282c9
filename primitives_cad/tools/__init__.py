"""Hand tools for testing: each a solid in its own frame, and four keypoints to press it at.

Every tool lies along x and y, its flat side up (+z), lengths in mm. The tools' sizes are
assumed, near those of common ones; Grella et al. 2023 name the five tools and no sizes.
"""

import importlib
from types import ModuleType
from typing import TYPE_CHECKING

from t2twin.primitives_cad.shape import Keypoint

if TYPE_CHECKING:
    import cadquery as cq
    import trimesh


CHORDAL_MM = {"pliers": 0.0025}
"""Chordal error asked for tools that need another one than the usual, mm: along the pliers'
rounded handles the mesher leaves eight times what it is asked, measured; this keeps it to 0.004."""


def solid(tool: str) -> "cq.Shape":
    """The CadQuery solid of a tool, in the tool's own frame."""
    return _module(tool).solid()


def mesh(tool: str) -> "trimesh.Trimesh":
    """A watertight mesh of a tool, mm, in the tool's own frame."""
    from t2twin.primitives_cad import solids

    return solids.tessellate(solid(tool), CHORDAL_MM.get(tool, solids.CHORDAL_MM))


def keypoints(tool: str) -> tuple[Keypoint, ...]:
    """The four places of a tool to press with, in the tool's own frame."""
    return _module(tool).KEYPOINTS


def _module(tool: str) -> ModuleType:
    # Each tool imports cadquery, which takes seconds: only the one asked for is loaded.
    return importlib.import_module(f"{__name__}.{tool.replace('-', '_')}")
