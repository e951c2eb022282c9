"""CadQuery solids of the primitives and of a ball, in the shape frame."""

from pathlib import Path

import cadquery as cq

from t2twin.core.files import atomic_write
from t2twin.primitives_cad import catalogue
from t2twin.primitives_cad.catalogue import FEATURE_HEIGHT_MM, PLATE_SIDE_MM, cap_radius_mm
from t2twin.primitives_cad.shape import PLATE_THICKNESS_MM, Shape

# length of the ball's stem from its center (assumed: more than an elastomer's thickness)
STEM_MM = 5.0


def primitive(name: str) -> cq.Shape:
    """The solid of a primitive on its own base plate, lengths in mm."""
    return (plate(PLATE_SIDE_MM, PLATE_SIDE_MM).union(feature(name))).val()  # pyright: ignore[reportReturnType]


def plate(width_mm: float, length_mm: float) -> cq.Workplane:
    """A base plate centered on the axis, its top FEATURE_HEIGHT_MM below z = 0."""
    ground = cq.Workplane().workplane(offset=-FEATURE_HEIGHT_MM - PLATE_THICKNESS_MM)
    return ground.rect(width_mm, length_mm).extrude(PLATE_THICKNESS_MM)


def feature(name: str) -> cq.Workplane:
    """The feature on the plate: from the plate's top to z = 0."""
    sizes, kind = catalogue.parameters(name), catalogue.family(name)
    floor = cq.Workplane().workplane(offset=-FEATURE_HEIGHT_MM)
    if kind in ("hemisphere", "bump"):
        # A spherical cap on a cylinder of its radius.
        curvature = sizes.get("curvature", sizes.get("radius", 0.0))
        height = sizes.get("height", curvature)
        rim, arc_point = cap_radius_mm(height, curvature), cap_radius_mm(height / 2.0, curvature)
        profile = cq.Workplane("XZ").moveTo(0.0, -FEATURE_HEIGHT_MM).lineTo(rim, -FEATURE_HEIGHT_MM)
        profile = profile.lineTo(rim, -height).threePointArc((arc_point, -height / 2.0), (0.0, 0.0))
        return profile.close().revolve(360.0, (0.0, 0.0, 0.0), (0.0, 1.0, 0.0))
    if kind.startswith("line"):
        outline = floor.rect(sizes["width"], sizes["length"])
    elif kind.startswith("square"):
        outline = floor.rect(sizes["side"], sizes["side"])
    else:
        outline = floor.circle(sizes["radius"])
    if kind == "square-empty":
        inner = sizes["side"] - 2.0 * sizes["edge"]
        outline = outline.rect(inner, inner)
    elif kind == "circle-empty":
        outline = outline.circle(sizes["radius"] - sizes["edge"])
    solid = outline.extrude(FEATURE_HEIGHT_MM)
    if kind == "line-smooth":
        return solid.faces(">Z").edges("|Y").fillet(sizes["radius"])
    return solid


def write_ball(path: Path, diameter_mm: float) -> Shape:
    """Write a ball on a stem of its diameter as STEP, pressing side up; returns the shape."""
    stem = cq.Workplane().circle(diameter_mm / 2).extrude(-STEM_MM)
    ball = stem.union(cq.Workplane().sphere(diameter_mm / 2))
    with atomic_write(path) as temporary:
        cq.exporters.export(ball, str(temporary), cq.exporters.ExportTypes.STEP)
    return catalogue.load(path)
