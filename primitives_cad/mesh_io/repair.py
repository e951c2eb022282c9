"""Repairs meshes: merges loose corners and closes small holes.

No library does this without a loss. trimesh's `fill_holes` closes holes that touch at corners
wrongly: of 64 balls without the three neighbors of a triangle it repairs none, this module all
(trimesh 5.2, 2026-11-23). manifold3d (Apache license, 1.4 MB) rejects open meshes. pymeshfix is GPL
and keeps only the largest of several bodies.
"""

from itertools import pairwise

import numpy as np
import trimesh

LOOSE_DIGITS = 4
"""Decimals of a mm to which the corners of an open mesh are rounded (assumed; STL is single
precision)."""

HOLES_SHARE = 0.01
"""Largest share of the surface that closes holes (assumed: a few missing triangles, but no face).
"""

MAX_RIM_EDGES = 2000
"""Limit on the edges around holes (assumed: more is a surface, not a solid)."""

THINNEST_MM = 1e-6
"""Least volume over half the surface, mm: thinner bodies are sheets (assumed: far below any length
of a shape)."""


def close_mesh(mesh: trimesh.Trimesh) -> tuple[trimesh.Trimesh, str | None]:
    """A closed mesh (mm) with its faces turned outwards, and a clause about closed holes or None.

    Bodies that touch or overlap are not changed. Raises ValueError with the reason where the mesh
    is not a solid.
    """
    note = None
    if not mesh.is_watertight:
        mesh, note = _merged(mesh)
    with np.errstate(invalid="ignore", divide="ignore"):  # a sheet has no center of volume
        if not mesh.is_winding_consistent or mesh.volume <= 0.0:
            trimesh.repair.fix_normals(mesh)
        sheet = mesh.volume <= THINNEST_MM * mesh.area / 2.0
    if sheet:
        raise ValueError("encloses no volume; a solid is needed")
    return mesh, note


def _merged(mesh: trimesh.Trimesh) -> tuple[trimesh.Trimesh, str | None]:
    """The mesh with merged corners, without duplicate faces and small holes."""
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
    """Whether the faces pass each edge equally often in both directions."""
    edges = mesh.edges
    forward = edges[:, 0] < edges[:, 1]
    _, which = np.unique(mesh.edges_sorted, axis=0, return_inverse=True)
    return not np.bincount(which.reshape(-1), np.where(forward, 1.0, -1.0)).any()


def _rim_edges(mesh: trimesh.Trimesh) -> np.ndarray:
    """(n, 2) corners of the edges of a single triangle, in that triangle's order."""
    return mesh.edges[trimesh.grouping.group_rows(mesh.edges_sorted, require_count=1)]


def _filled(mesh: trimesh.Trimesh) -> tuple[trimesh.Trimesh, str]:
    """The mesh with its holes closed by fans of triangles, and a clause about them."""
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
    """Corners around each hole, from the edges (n, 2) around all; empty where the edges do not
    close or are too many."""
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
    """Angles through the hole from the last edge of a walk to the edges to corners, rad.

    Where holes touch at a corner, the smallest angle stays on the same hole.
    """
    here, normal = mesh.vertices[walk[-1]], mesh.vertex_normals[walk[-1]]
    back = np.asarray(mesh.vertices[walk[0]] - here)
    ways = np.asarray(mesh.vertices[corners] - here)
    along = ways @ back - (ways @ normal) * (back @ normal)
    return np.arctan2(np.cross(back, ways) @ normal, along) % (2.0 * np.pi)
