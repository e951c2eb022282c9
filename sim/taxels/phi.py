"""phi maps the counts of an array to a one-channel tactile image, phi^-1 maps it back.

I = phi(Y) = A Y: barycentric interpolation over the Delaunay triangles of the taxels at the pixel
centers (Grella et al. 2023), zero outside their convex hull. phi^-1 is A's left inverse
(A^T A)^-1 A^T: exact for an image phi(Y), and the least-squares estimate for any other image.

Shape letters: B images in a batch, R rows, C columns, N taxels.
"""

from __future__ import annotations

from copy import copy
from functools import partial
from typing import TYPE_CHECKING, Self

import numpy as np
from scipy import sparse

from t2twin.core.arrays import kept
from t2twin.core.cache_dir import cached_array, short_digest
from t2twin.core.errors import T2TwinError
from t2twin.sim.taxels.layout import PAD_DIAMETER_MM, Layout

if TYPE_CHECKING:
    import torch

TACTILE_SHAPE = (396, 240)  # rows and columns of a tactile image (Grella et al. 2023).
PX_PER_MM = 8.8  # scale of the tactile image (assumed: 45 mm of the skin's length over 396 rows)
LARGEST_CONDITION = 1e8  # of A^T A for phi^-1 (assumed: leaves an accuracy of 1e-8)
ROUNDING = 100 * float(np.finfo(float).eps)  # SciPy's tolerance, in barycentric coordinates


class Phi:
    """phi and phi^-1 for one taxel layout and one image size.

    x_mm, y_mm: (N,) taxel positions in the sensor frame, mm; the image's center is its origin.
    matrix: A as a sparse (R*C, N) array. centers_mm: x of the columns and y of the rows. Raises
    T2TwinError as Layout does, and for taxels on one line, outside the image or too close to be
    distinguished in it.
    """

    def __init__(
        self, x_mm: np.ndarray, y_mm: np.ndarray, shape: tuple[int, int] = TACTILE_SHAPE,
        px_per_mm: float = PX_PER_MM,
    ) -> None:  # fmt: skip
        layout = Layout("of phi", x_mm, y_mm, np.full(np.size(x_mm), PAD_DIAMETER_MM))
        points = np.column_stack([layout.x_mm, layout.y_mm])
        half_mm = np.array([shape[1], shape[0]]) / px_per_mm / 2
        outside = np.flatnonzero((np.abs(points) > half_mm).any(axis=1))
        if outside.size:
            n = int(outside[0])
            raise T2TwinError(
                f"taxel {n} at x {points[n, 0]:g} mm, y {points[n, 1]:g} mm is outside the tactile "
                f"image, which reaches {half_mm[0]:.2f} mm in x and {half_mm[1]:.2f} mm in y"
            )
        columns_mm = (np.arange(shape[1]) + 0.5) / px_per_mm - half_mm[0]
        rows_mm = (np.arange(shape[0]) + 0.5) / px_per_mm - half_mm[1]
        centers = np.stack(np.meshgrid(columns_mm, rows_mm), axis=-1).reshape(-1, 2)
        matrix = barycentric(points, centers)
        matrix.data.clip(0.0, 1.0, out=matrix.data)  # rounding leaves some outside [0, 1]
        self._set(matrix, shape, (columns_mm, rows_mm))

    def _set(
        self, matrix: sparse.csr_array, shape: tuple[int, int],
        centers_mm: tuple[np.ndarray, np.ndarray], pixels: np.ndarray | slice = slice(None),
    ) -> Self:  # fmt: skip
        """matrix: A. pixels: indices of those that phi^-1 uses."""
        self.matrix, self.shape, self.centers_mm = matrix, shape, kept(centers_mm)
        matrix.data.setflags(write=False)
        used = matrix[pixels]
        normal = (used.T @ used).toarray()
        if np.linalg.cond(normal) > LARGEST_CONDITION:
            raise T2TwinError(
                "the taxels lie too close together, or too near the rim, to be distinguished in an "
                f"image of {shape[0]} x {shape[1]} pixels; they must be at least a pixel apart"
            )
        # A dense product is about three times faster than a sparse one.
        self._forward = np.ascontiguousarray(matrix.toarray().T, dtype=np.float32)  # (N, R*C)
        # In double precision because of cancellation.
        self._backward = np.zeros(self._forward.shape[::-1])  # (R*C, N)
        self._backward[pixels] = used @ np.linalg.inv(normal)
        self._tensors: dict[tuple[str, torch.device, torch.dtype], torch.Tensor] = {}
        return self

    def __call__(self, counts: np.ndarray) -> np.ndarray:
        """Tactile images of arrays. counts: (N,) or (B, N). Returns (R, C) or (B, R, C) float32."""
        images = np.asarray(counts, dtype=np.float32) @ self._forward
        return images.reshape(*images.shape[:-1], *self.shape)

    def inverse(self, images: np.ndarray) -> np.ndarray:
        """Arrays of tactile images. images: (R, C) or (B, R, C). Returns (N,) or (B, N) float32."""
        counts = np.asarray(images, dtype=float).reshape(*images.shape[:-2], -1) @ self._backward
        return counts.astype(np.float32)

    def resized(self, shape: tuple[int, int]) -> Phi:
        """The same phi followed by an area resize to `shape`, with an exact inverse of its own."""
        rows = _area_weights(self.shape[0], shape[0])
        columns = _area_weights(self.shape[1], shape[1])
        matrix = sparse.csr_array(sparse.kron(rows, columns, format="csr") @ self.matrix)
        centers_mm = (columns @ self.centers_mm[0], rows @ self.centers_mm[1])
        return copy(self)._set(matrix, shape, centers_mm)

    def with_inverse_from(self, pixels: np.ndarray) -> Phi:
        """The same phi, with a phi^-1 that uses only some pixels, indices from 0 to R*C - 1."""
        return copy(self)._set(self.matrix, self.shape, self.centers_mm, pixels)

    def to_torch(self, counts: torch.Tensor) -> torch.Tensor:
        """phi on tensors, differentiable. counts: (B, N). Returns (B, 1, R, C), same device."""
        return (counts @ self._matrix_like(counts, "_forward")).view(-1, 1, *self.shape)

    def from_torch(self, images: torch.Tensor) -> torch.Tensor:
        """phi^-1 on tensors, differentiable. images: (B, 1, R, C). Returns (B, N), same device."""
        return images.reshape(images.shape[0], -1) @ self._matrix_like(images, "_backward")

    def _matrix_like(self, values: torch.Tensor, name: str) -> torch.Tensor:
        """A matrix like values, kept: copying it to a GPU takes long."""
        import torch

        key = (name, values.device, values.dtype)
        if key not in self._tensors:
            with torch.inference_mode(False):  # so that it is differentiable later
                matrix = torch.from_numpy(getattr(self, name))
                self._tensors[key] = matrix.to(values.device, values.dtype)
        return self._tensors[key]


def barycentric(
    points: np.ndarray, at: np.ndarray, tolerance: float = ROUNDING
) -> sparse.csr_array:
    """Barycentric weights of places at (P, 2) over the Delaunay triangles of points (N, 2), (P, N).

    tolerance: at the edges of triangles. Each place has three weights with sum 1, or zeros outside
    the convex hull. Raises T2TwinError for points without a triangle.
    """
    key = f"{short_digest(points.tobytes())} {short_digest(at.tobytes())} {tolerance}"
    compute = partial(_barycentric, points, at, tolerance)
    rows, columns, weights = cached_array("phi", key, __file__, compute)
    entries = (weights, (rows.astype(int), columns.astype(int)))
    return sparse.csr_array(entries, shape=(at.shape[0], points.shape[0]))


def _barycentric(points: np.ndarray, at: np.ndarray, tolerance: float) -> np.ndarray:
    """Rows, columns and values of the weights, (3, entries)."""
    from scipy.spatial import Delaunay, QhullError  # slow to import

    try:
        triangles = Delaunay(points)
    except QhullError:
        raise T2TwinError("the taxels span no triangles; phi needs three off one line") from None
    triangle = triangles.find_simplex(at, tol=tolerance)
    inside = np.flatnonzero(triangle >= 0)
    corners = triangles.simplices[triangle[inside]]  # (inside, 3)
    transform = triangles.transform[triangle[inside]]  # (inside, 3, 2): a 2 x 2 and an offset
    first = np.einsum("pij,pj->pi", transform[:, :2], at[inside] - transform[:, 2])
    weights = np.column_stack([first, 1.0 - first.sum(axis=1)])
    return np.stack([np.repeat(inside, 3), corners.ravel(), weights.ravel()])


def _area_weights(size: int, new: int) -> sparse.csr_array:
    """(new, size) weights of an area resize: the overlaps of new and old pixels."""
    edges = np.linspace(0.0, size, new + 1)
    pixel = np.arange(size)
    overlap = np.minimum(edges[1:, None], pixel + 1.0) - np.maximum(edges[:-1, None], pixel)
    return sparse.csr_array(overlap.clip(0.0) * (new / size))
