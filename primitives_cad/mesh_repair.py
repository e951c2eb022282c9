"""Repairs meshes: merges loose corners and closes small holes.

trimesh's `fill_holes` (5.2) closes holes that touch at corners wrongly, manifold3d rejects open
meshes, and pymeshfix is GPL and keeps only the largest of several bodies.
"""

from itertools import pairwise

import numpy as np
import trimesh

# decimals of a mm of the corners of an open mesh (assumed; STL is single precision)
LOOSE_DIGITS = 4
HOLES_SHARE = 0.01  # largest share of the surface that closes holes (assumed: less than a face)
MAX_RIM_EDGES = 2000  # around closed holes (assumed: more is a surface, not a solid)
UPPER = "its upper surface is pressed"

THINNEST_MM = 1e-6  # least volume over half the surface; thinner bodies are sheets (assumed)


def close_mesh(mesh: trimesh.Trimesh) -> tuple[trimesh.Trimesh, str | None]:
    """A mesh (mm), closed if possible, and a clause about closed holes or what stays open."""
    note = None
    if not mesh.is_watertight:
        mesh, note, closed = _merged(mesh)
        if not closed:
            return mesh, note
    with np.errstate(invalid="ignore", divide="ignore"):  # a sheet has no center of volume
        if not mesh.is_winding_consistent or mesh.volume <= 0.0:
            trimesh.repair.fix_normals(mesh)
        sheet = mesh.volume <= THINNEST_MM * mesh.area / 2.0
    return mesh, f"encloses no volume; {UPPER}" if sheet else note


def _merged(mesh: trimesh.Trimesh) -> tuple[trimesh.Trimesh, str | None, bool]:
    """The mesh with merged corners and closed holes, a clause about it; whether it is closed."""
    loose = mesh.copy()
    loose.merge_vertices(digits_vertex=LOOSE_DIGITS)
    loose.update_faces(loose.nondegenerate_faces())
    single = loose.copy()
    single.update_faces(single.unique_faces())
    single.remove_unreferenced_vertices()
    if not len(single.faces):  # all triangles are smaller than the rounding
        return mesh, _openness(mesh), False
    if single.is_watertight:
        return single, None, True
    if _balanced(loose):  # bodies that share edges or faces
        return loose, None, True
    if 0 < len(_rim_edges(single)) <= MAX_RIM_EDGES:
        filled = _filled(single)
        if filled is not None:
            return *filled, True
    return single, _openness(single), False


def _openness(mesh: trimesh.Trimesh) -> str:
    """A clause about the edges that keep a mesh from being closed."""
    rims = _rim_edges(mesh)
    if not len(rims):
        _, counts = np.unique(mesh.edges_sorted, axis=0, return_counts=True)
        return (
            f"has {_edges(int((counts > 2).sum()))} at which more than two triangles meet; {UPPER}"
        )
    labels = trimesh.graph.connected_component_labels(rims, node_count=len(mesh.vertices))
    low, high = np.full((2, labels.max() + 1, 3), np.inf)
    np.minimum.at(low, labels[rims], mesh.vertices[rims])
    np.minimum.at(high, labels[rims], -mesh.vertices[rims])
    widest = float((-high - low)[np.isfinite(low[:, 0])].max())
    gap = f"{float(f'{widest:.2g}'):g} mm"  # two digits, without an exponent
    return f"is open at {_edges(len(rims))}, the widest gap {gap}; {UPPER}"


def _edges(count: int) -> str:
    return f"{count} edge{'s' * (count > 1)}"


def _balanced(mesh: trimesh.Trimesh) -> bool:
    """Whether the faces pass each edge equally often in both directions."""
    edges = mesh.edges
    forward = edges[:, 0] < edges[:, 1]
    _, which = np.unique(mesh.edges_sorted, axis=0, return_inverse=True)
    return not np.bincount(which.reshape(-1), np.where(forward, 1.0, -1.0)).any()


def _rim_edges(mesh: trimesh.Trimesh) -> np.ndarray:
    """(n, 2) corners of the edges of a single triangle, in that triangle's order."""
    return mesh.edges[trimesh.grouping.group_rows(mesh.edges_sorted, require_count=1)]


def _filled(mesh: trimesh.Trimesh) -> tuple[trimesh.Trimesh, str] | None:
    """The mesh with holes closed by fans, and a clause about them; None for large or odd holes."""
    mesh = mesh.copy()
    trimesh.repair.fix_winding(mesh)
    rims = _rims(mesh, _rim_edges(mesh))
    added = [(rim[0], b, a) for rim in rims for a, b in pairwise(rim[1:])]
    whole = trimesh.Trimesh(mesh.vertices, [*mesh.faces.tolist(), *added], process=False)
    if not added or not _balanced(whole) or whole.area > (1.0 + HOLES_SHARE) * mesh.area:
        return None
    widest = max(float(np.ptp(mesh.vertices[rim], axis=0).max()) for rim in rims)
    return whole, (
        f"had {len(rims)} small hole{'s' * (len(rims) > 1)}, the widest {widest:.2g} mm, closed "
        f"flat with {len(added)} triangle{'s' * (len(added) > 1)}"
    )


def _rims(mesh: trimesh.Trimesh, edges: np.ndarray) -> list[list[int]]:
    """Corners around each hole, from the edges (n, 2) around all; empty where they do not close."""
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
    """Angles from a walk's last edge to edges to corners, rad; the least stays on the same hole."""
    here, normal = mesh.vertices[walk[-1]], mesh.vertex_normals[walk[-1]]
    back = np.asarray(mesh.vertices[walk[0]] - here)
    ways = np.asarray(mesh.vertices[corners] - here)
    along = ways @ back - (ways @ normal) * (back @ normal)
    return np.arctan2(np.cross(back, ways) @ normal, along) % (2.0 * np.pi)
