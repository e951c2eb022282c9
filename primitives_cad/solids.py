"""CadQuery solids of the primitives in the shape frame, and triangle meshes of CadQuery solids."""

import cadquery as cq
import numpy as np
import trimesh
from OCP.BRepMesh import BRepMesh_IncrementalMesh  # pyright: ignore[reportAttributeAccessIssue]

from t2twin.core.errors import T2TwinError
from t2twin.primitives_cad.primitive_parameters import (
    FEATURE_HEIGHT_MM,
    PLATE_SIDE_MM,
    PLATE_THICKNESS_MM,
    cap_radius_mm,
    family,
    parameters,
)

CHORDAL_MM = 0.005  # error requested from the mesher (assumed: half of the documented 0.01 mm)
ANGULAR_RAD = 0.25  # largest angle between the normals of neighboring triangles, rad (assumed)
BEYOND_MM = 1.0e3  # a length beyond any primitive, mm


def primitive(name: str) -> cq.Shape:
    """The solid of a primitive on its own base plate, lengths in mm."""
    return (plate(PLATE_SIDE_MM, PLATE_SIDE_MM).union(feature(name))).val()  # pyright: ignore[reportReturnType]


def plate(width_mm: float, length_mm: float) -> cq.Workplane:
    """A base plate centered on the axis, its top FEATURE_HEIGHT_MM below z = 0."""
    ground = cq.Workplane().workplane(offset=-FEATURE_HEIGHT_MM - PLATE_THICKNESS_MM)
    return ground.rect(width_mm, length_mm).extrude(PLATE_THICKNESS_MM)


def feature(name: str) -> cq.Workplane:
    """The feature on the plate: from the plate's top to z = 0."""
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
    """A spherical cap on a cylinder of its radius; a hemisphere if height_mm is curvature_mm."""
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


def tessellate(solid: cq.Shape, chordal_mm: float = CHORDAL_MM) -> trimesh.Trimesh:
    """A watertight mesh of a solid, mm, with an error of about chordal_mm."""
    return watertight(*triangles_of(solid, chordal_mm))


def triangles_of(solid: cq.Shape, chordal_mm: float = CHORDAL_MM) -> tuple[np.ndarray, np.ndarray]:
    """Points (n, 3) mm and triangles (m, 3); each face of the solid has its own points."""
    own = solid.copy()
    # CadQuery requests an error relative to each edge's length; here it is absolute, in mm.
    BRepMesh_IncrementalMesh(own.wrapped, chordal_mm, False, ANGULAR_RAD, True)
    # With such a tolerance CadQuery returns the existing mesh.
    vertices, faces = own.tessellate(BEYOND_MM)
    points = np.array([vertex.toTuple() for vertex in vertices], dtype=np.float64)
    return points.reshape(-1, 3), np.array(faces, dtype=np.int64).reshape(-1, 3)


def watertight(points: np.ndarray, triangles: np.ndarray) -> trimesh.Trimesh:
    """A mesh of points (n, 3) mm and triangles (m, 3), with coincident vertices merged."""
    mesh = trimesh.Trimesh(points, triangles, process=False)
    mesh.merge_vertices()
    mesh.update_faces((mesh.faces != np.roll(mesh.faces, 1, axis=1)).all(axis=1))
    mesh.remove_unreferenced_vertices()
    if not mesh.is_watertight or mesh.volume <= 0.0:
        raise T2TwinError("the solid's mesh is not closed; it must be a watertight solid")
    return mesh
