"""Hand tools of the test split: a solid in the tool's own frame, and four keypoints to press.

Every tool lies along x and y, its flat side up (+z), lengths in mm. Grella et al. 2023 name the
five tools, but not their sizes, which are assumed to be common ones.
"""

import importlib
from types import ModuleType
from typing import TYPE_CHECKING

from t2twin.primitives_cad.shape import Keypoint

if TYPE_CHECKING:
    import cadquery as cq

CHORDAL_MM = {"pliers": 0.0025}
"""Chordal errors requested for particular tools, mm: the mesher's error along the pliers' rounded
handles is eight times the requested one (measured); this reduces it to 0.004."""


def solid(tool: str) -> "cq.Shape":
    """The CadQuery solid of a tool, in the tool's own frame."""
    return _module(tool).solid()


def keypoints(tool: str) -> tuple[Keypoint, ...]:
    """The four keypoints of a tool, in the tool's own frame."""
    return _module(tool).KEYPOINTS


def _module(tool: str) -> ModuleType:
    # Each tool imports cadquery, which takes seconds, so only the requested one is loaded.
    return importlib.import_module(f"{__name__}.{tool.replace('-', '_')}")
