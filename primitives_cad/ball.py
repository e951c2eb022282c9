"""The ball that a DIGIT is calibrated with, as a shape that the twin presses."""

from pathlib import Path
from typing import TYPE_CHECKING

from t2twin.core.files import atomic_write
from t2twin.primitives_cad import catalogue
from t2twin.primitives_cad.shape import Shape

if TYPE_CHECKING:
    import cadquery as cq

HELD_MM = 5.0
"""Length of the stem above a ball's middle, mm: longer than any elastomer is thick (assumed)."""


def write_ball(path: Path, diameter_mm: float) -> Shape:
    """Writes a ball on a stem of its own width as a STEP file, its pressing side up, and gives it
    as a shape. Raises T2TwinError where it cannot be written."""
    import cadquery as cq

    with atomic_write(path) as temporary:
        cq.exporters.export(_solid(diameter_mm), str(temporary), cq.exporters.ExportTypes.STEP)
    return catalogue.load(path)


def _solid(diameter_mm: float) -> "cq.Workplane":
    import cadquery as cq

    stem = cq.Workplane().circle(diameter_mm / 2).extrude(-HELD_MM)
    return stem.union(cq.Workplane().sphere(diameter_mm / 2))
