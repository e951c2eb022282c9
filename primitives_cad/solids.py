"""CadQuery solids of the primitives and of a ball, and triangle meshes of CadQuery solids."""

from pathlib import Path

import cadquery as cq
import numpy as np
import trimesh
from OCP.BRepMesh import BRepMesh_IncrementalMesh  # pyright: ignore[reportAttributeAccessIssue]

from t2twin.core.errors import T2TwinError
from t2twin.core.files import atomic_write
from t2twin.primitives_cad import catalogue
from t2twin.primitives_cad.catalogue import (
    FEATURE_HEIGHT_MM,
    PLATE_SIDE_MM,
    PLATE_THICKNESS_MM,
    cap_radius_mm,
)
from t2twin.primitives_cad.shape import Shape

CHORDAL_MM = 0.005  # error requested from the mesher (assumed: half of the documented 0.01 mm)
ANGULAR_RAD = 0.25  # largest angle between the normals of neighboring triangles, rad (assumed)
BEYOND_MM = 1.0e3  # a length beyond any primitive, mm
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
        curvature = sizes.get("curvature", sizes.get("radius", 0.0))
        return _capped_cylinder(sizes.get("height", curvature), curvature)
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


def write_ball(path: Path, diameter_mm: float) -> Shape:
    """Write a ball on a stem of its diameter as STEP, pressing side up; returns the shape."""
    stem = cq.Workplane().circle(diameter_mm / 2).extrude(-STEM_MM)
    ball = stem.union(cq.Workplane().sphere(diameter_mm / 2))
    with atomic_write(path) as temporary:
        cq.exporters.export(ball, str(temporary), cq.exporters.ExportTypes.STEP)
    return catalogue.load(path)
