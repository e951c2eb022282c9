"""Triangles from CadQuery solids."""

import cadquery as cq
import numpy as np
import trimesh
from OCP.BRepMesh import BRepMesh_IncrementalMesh  # pyright: ignore[reportAttributeAccessIssue]

from t2twin.primitives_cad.errors import T2TwinError

CHORDAL_MM = 0.005
"""Chordal error asked of the mesher, mm (assumed: half of the 0.01 mm that is promised)."""

ANGULAR_RAD = 0.25
"""Largest turn of the normal from one triangle to the next, rad (assumed)."""

BEYOND_MM = 1.0e3
"""A length beyond any primitive, mm."""

SAME_MM = 1.0e-7
"""Points nearer to each other than this are one point, mm: the CAD kernel's own tolerance."""


def tessellate(solid: cq.Shape, chordal_mm: float = CHORDAL_MM) -> trimesh.Trimesh:
    """A watertight mesh of a solid, mm, no further from it than about chordal_mm.

    Raises T2TwinError where the solid's faces do not close.
    """
    return closed(*_triangles(solid, chordal_mm))


def tessellate_symmetric(solid: cq.Shape, chordal_mm: float = CHORDAL_MM) -> trimesh.Trimesh:
    """A watertight mesh, mirror symmetric to the bit, of a solid symmetric in x and in y, mm.

    The mesher's own triangles are not symmetric, so one quarter is meshed and mirrored.
    """
    corner = cq.Workplane().box(BEYOND_MM, BEYOND_MM, BEYOND_MM, centered=(False, False, True))
    points, triangles = _triangles(solid.intersect(corner.val()), chordal_mm)  # pyright: ignore[reportArgumentType]
    points[np.abs(points) < SAME_MM] = 0.0
    on_cut = (points[triangles][:, :, :2] == 0.0).all(axis=1).any(axis=1)
    triangles = triangles[~on_cut]
    all_points, all_triangles = [], []
    for turn, mirror in enumerate(((1, 1, 1), (-1, 1, 1), (-1, -1, 1), (1, -1, 1))):
        all_points.append(points * mirror)
        # A mirrored triangle faces inwards until its corners are taken the other way round.
        order = triangles if turn % 2 == 0 else triangles[:, ::-1]
        all_triangles.append(order + turn * len(points))
    return closed(np.concatenate(all_points), np.concatenate(all_triangles))


def _triangles(solid: cq.Shape, chordal_mm: float) -> tuple[np.ndarray, np.ndarray]:
    """Points (n, 3) mm and triangles (m, 3), each face of the solid meshed with its own points."""
    own = solid.copy()
    # CadQuery asks the kernel for an error relative to each edge's length; here it is in mm.
    BRepMesh_IncrementalMesh(own.wrapped, chordal_mm, False, ANGULAR_RAD, True)
    # With so large a tolerance CadQuery takes the mesh that is already there.
    vertices, faces = own.tessellate(BEYOND_MM)
    points = np.array([vertex.toTuple() for vertex in vertices], dtype=np.float64)
    return points.reshape(-1, 3), np.array(faces, dtype=np.int64).reshape(-1, 3)


def closed(points: np.ndarray, triangles: np.ndarray) -> trimesh.Trimesh:
    """A mesh with its coincident vertices joined: points (n, 3) mm, triangles (m, 3).

    Raises T2TwinError where the result is not watertight.
    """
    mesh = trimesh.Trimesh(points, triangles, process=False)
    mesh.merge_vertices()
    corners = mesh.faces
    whole = (
        (corners[:, 0] != corners[:, 1])
        & (corners[:, 1] != corners[:, 2])
        & (corners[:, 2] != corners[:, 0])
    )
    mesh.update_faces(whole)
    mesh.remove_unreferenced_vertices()
    if not mesh.is_watertight or mesh.volume <= 0.0:
        raise T2TwinError("the solid's mesh is not closed; it must be a watertight solid")
    return mesh
