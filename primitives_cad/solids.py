"""CadQuery solids of the primitives, in the shape frame: top of the feature at z = 0, base
plate below it, centred on the press axis."""

import cadquery as cq

from t2twin.primitives_cad.families import (
    FEATURE_HEIGHT_MM,
    PLATE_SIDE_MM,
    PLATE_THICKNESS_MM,
    cap_radius_mm,
    family,
    parameters,
)


def primitive(name: str) -> cq.Shape:
    """The solid of a primitive on its own base plate, lengths in mm."""
    return (plate(PLATE_SIDE_MM, PLATE_SIDE_MM).union(feature(name))).val()  # pyright: ignore[reportReturnType]


def plate(width_mm: float, length_mm: float) -> cq.Workplane:
    """A base plate centred on the axis, its top FEATURE_HEIGHT_MM below z = 0."""
    return (
        cq.Workplane()
        .workplane(offset=-FEATURE_HEIGHT_MM - PLATE_THICKNESS_MM)
        .rect(width_mm, length_mm)
        .extrude(PLATE_THICKNESS_MM)
    )


def feature(name: str) -> cq.Workplane:
    """What stands on the plate: from the plate's top to z = 0."""
    sizes = parameters(name)
    kind = family(name)
    if kind == "line-sharp":
        return _floor().rect(sizes["width"], sizes["length"]).extrude(FEATURE_HEIGHT_MM)
    if kind == "line-smooth":
        bar = _floor().rect(sizes["width"], sizes["length"]).extrude(FEATURE_HEIGHT_MM)
        return bar.faces(">Z").edges("|Y").fillet(sizes["radius"])
    if kind == "square":
        return _floor().rect(sizes["side"], sizes["side"]).extrude(FEATURE_HEIGHT_MM)
    if kind == "square-empty":
        inner = sizes["side"] - 2.0 * sizes["edge"]
        outline = _floor().rect(sizes["side"], sizes["side"]).rect(inner, inner)
        return outline.extrude(FEATURE_HEIGHT_MM)
    if kind == "circle":
        return _floor().circle(sizes["radius"]).extrude(FEATURE_HEIGHT_MM)
    if kind == "circle-empty":
        outline = _floor().circle(sizes["radius"]).circle(sizes["radius"] - sizes["edge"])
        return outline.extrude(FEATURE_HEIGHT_MM)
    if kind == "hemisphere":
        return _capped_cylinder(sizes["radius"], sizes["radius"])
    return _capped_cylinder(sizes["height"], sizes["curvature"])


def _floor() -> cq.Workplane:
    return cq.Workplane().workplane(offset=-FEATURE_HEIGHT_MM)


def _capped_cylinder(height_mm: float, curvature_mm: float) -> cq.Workplane:
    """A spherical cap on a cylinder of the cap's own radius; a hemisphere where height is R."""
    rim = cap_radius_mm(height_mm, curvature_mm)
    middle = height_mm / 2.0
    arc_point = (cap_radius_mm(middle, curvature_mm), -middle)
    profile = (
        cq.Workplane("XZ")
        .moveTo(0.0, -FEATURE_HEIGHT_MM)
        .lineTo(rim, -FEATURE_HEIGHT_MM)
        .lineTo(rim, -height_mm)
        .threePointArc(arc_point, (0.0, 0.0))
        .close()
    )
    return profile.revolve(360.0, (0.0, 0.0, 0.0), (0.0, 1.0, 0.0))
