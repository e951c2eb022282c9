"""The ball for the calibration of a DIGIT, as a shape for the twin."""

from pathlib import Path
from typing import TYPE_CHECKING

from t2twin.core.files import atomic_write
from t2twin.primitives_cad import catalogue
from t2twin.primitives_cad.shape import Shape

if TYPE_CHECKING:
    import cadquery as cq

STEM_MM = 5.0
"""Length of the stem from the ball's center, mm: more than an elastomer's thickness (assumed)."""


def write_ball(path: Path, diameter_mm: float) -> Shape:
    """Write a ball on a stem of its diameter as a STEP file, pressing side up; returns the shape.

    Raises T2TwinError where the file cannot be written.
    """
    import cadquery as cq

    with atomic_write(path) as temporary:
        cq.exporters.export(_solid(diameter_mm), str(temporary), cq.exporters.ExportTypes.STEP)
    return catalogue.load(path)


def _solid(diameter_mm: float) -> "cq.Workplane":
    import cadquery as cq

    stem = cq.Workplane().circle(diameter_mm / 2).extrude(-STEM_MM)
    return stem.union(cq.Workplane().sphere(diameter_mm / 2))
