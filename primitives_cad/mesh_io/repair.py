"""Meshes made to close around a solid: loose corners joined, small holes closed."""

from itertools import pairwise

import numpy as np
import trimesh

LOOSE_DIGITS = 4
"""Decimals of a mm to which the corners of a mesh with gaps are joined (assumed; STL is
single precision)."""

HOLES_SHARE = 0.01
"""Largest share of a surface that is put over its holes (assumed: a few triangles that a mesh
lost, and no face)."""

MAX_RIM_EDGES = 2000
"""Most edges around holes that are looked at (assumed: more is a surface, not a solid)."""

THINNEST_MM = 1e-6
"""Least volume for half the surface, mm: thinner than this a body is a sheet (assumed: far below
any length of a shape)."""


def closed(mesh: trimesh.Trimesh) -> tuple[trimesh.Trimesh, str | None]:
    """A mesh (mm) that closes around a volume, its faces turned outwards, and what was done to
    its holes.

    Bodies that touch or overlap stay as they are. Raises ValueError with a clause that says why
    a mesh is no solid.
    """
    said = None
    if not mesh.is_watertight:
        mesh, said = _joined(mesh)
    with np.errstate(invalid="ignore", divide="ignore"):  # no volume has no middle
        if not mesh.is_winding_consistent or mesh.volume <= 0.0:
            trimesh.repair.fix_normals(mesh)
        sheet = mesh.volume <= THINNEST_MM * mesh.area / 2.0
    if sheet:
        raise ValueError("encloses no volume; a solid is needed")
    return mesh, said


def _joined(mesh: trimesh.Trimesh) -> tuple[trimesh.Trimesh, str | None]:
    """The mesh with its corners joined, single faces for double ones, and small holes closed."""
    loose = mesh.copy()
    loose.merge_vertices(digits_vertex=LOOSE_DIGITS)
    loose.update_faces(loose.nondegenerate_faces())
    single = loose.copy()
    single.update_faces(single.unique_faces())
    single.remove_unreferenced_vertices()
    if single.is_watertight:
        return single, None
    if _balanced(loose):  # bodies that share edges or faces
        return loose, None
    if not len(_rim_edges(single)):
        raise ValueError(
            "is not a solid: at some edges more than two of its triangles meet; "
            "a watertight mesh is needed"
        )
    return _filled(single)


def _balanced(mesh: trimesh.Trimesh) -> bool:
    """Whether every edge is passed as often in one direction as in the other."""
    edges = mesh.edges
    forward = edges[:, 0] < edges[:, 1]
    _, which = np.unique(mesh.edges_sorted, axis=0, return_inverse=True)
    return not np.bincount(which.reshape(-1), np.where(forward, 1.0, -1.0)).any()


def _rim_edges(mesh: trimesh.Trimesh) -> np.ndarray:
    """(n, 2) corners of the edges that one triangle only has, in that triangle's order."""
    return mesh.edges[trimesh.grouping.group_rows(mesh.edges_sorted, require_count=1)]


def _filled(mesh: trimesh.Trimesh) -> tuple[trimesh.Trimesh, str]:
    """The mesh with its holes closed flat, and a clause that says so."""
    trimesh.repair.fix_winding(mesh)
    rims = _rims(mesh, _rim_edges(mesh))
    added = [(rim[0], b, a) for rim in rims for a, b in pairwise(rim[1:])]
    whole = trimesh.Trimesh(mesh.vertices, [*mesh.faces.tolist(), *added], process=False)
    if not added or not _balanced(whole) or whole.area > (1.0 + HOLES_SHARE) * mesh.area:
        raise ValueError(
            "is open: its triangles do not close around a solid; a watertight mesh is needed"
        )
    widest = max(float(np.ptp(mesh.vertices[rim], axis=0).max()) for rim in rims)
    return whole, (
        f"had {len(rims)} small hole{'s' * (len(rims) > 1)}, the widest {widest:.2g} mm, closed "
        f"flat with {len(added)} triangle{'s' * (len(added) > 1)}"
    )


def _rims(mesh: trimesh.Trimesh, edges: np.ndarray) -> list[list[int]]:
    """Corners around each hole, from the edges (n, 2) around all, or nothing where those do not
    close, or are too many."""
    if len(edges) > MAX_RIM_EDGES:
        return []
    onward: dict[int, list[int]] = {}
    for a, b in edges.tolist():
        onward.setdefault(a, []).append(b)
    rims = []
    while onward:
        walk = [next(iter(onward))]
        while following := onward.pop(walk[-1], None):
            if len(following) > 1:
                turns = _turns(mesh, walk[-2:], following)
                following.append(following.pop(int(turns.argmin())))
                onward[walk[-1]] = following[:-1]
            corner = following[-1]
            if corner not in walk:
                walk.append(corner)
                continue
            at = walk.index(corner)
            rims.append(walk[at:])
            del walk[at + 1 :]
        if len(walk) > 1:
            return []
    return rims


def _turns(mesh: trimesh.Trimesh, walk: list[int], corners: list[int]) -> np.ndarray:
    """How far to turn through the hole, from the way back along the walk to each of corners, rad.

    Where holes touch at a corner, the least turn stays with the same hole.
    """
    here, normal = mesh.vertices[walk[-1]], mesh.vertex_normals[walk[-1]]
    back = np.asarray(mesh.vertices[walk[0]] - here)
    ways = np.asarray(mesh.vertices[corners] - here)
    along = ways @ back - (ways @ normal) * (back @ normal)
    return np.arctan2(np.cross(back, ways) @ normal, along) % (2.0 * np.pi)
