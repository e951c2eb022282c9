"""phi turns an array of taxels into a one-channel tactile image, phi^-1 reads it back.

I = phi(Y) = A Y: barycentric interpolation over the Delaunay triangles of the taxel positions
(Grella et al. 2023), taken at the pixel centers, zero outside the taxels' convex hull. A is built
once for a layout and an image size. phi^-1 is A's left inverse (A^T A)^-1 A^T: it gives back
exactly the Y that made an image, and the nearest Y in the sense of least squares for an image that
no Y made, which is what a generator draws.

Shape letters: B images in a batch, R rows, C columns, N taxels.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from scipy import sparse
from scipy.spatial import Delaunay, KDTree, QhullError

from t2twin.core.errors import T2TwinError

if TYPE_CHECKING:
    import torch

TACTILE_SHAPE = (396, 240)
"""Rows and columns of a tactile image (Grella et al. 2023)."""

PX_PER_MM = 8.8
"""Scale of the tactile image, px/mm (assumed: the 45 mm of the skin's length over 396 rows)."""

SAME_PLACE_MM = 1e-3
"""Two taxels closer than this are in one place, mm (assumed: far below any printed board)."""

LARGEST_CONDITION = 1e8
"""Largest condition number of A^T A that phi^-1 accepts (assumed: leaves 1e-8 in doubles)."""

ROUNDING = 100 * float(np.finfo(float).eps)
"""How far outside a triangle a place counts as inside, in barycentric parts (scipy's default)."""


class Phi:
    """phi and phi^-1 for one taxel layout and one image size.

    x_mm, y_mm: (N,) taxel positions, mm, sensor frame (x along columns, y along rows), the
        image's center at the origin.
    shape: rows and columns of the image. px_per_mm: its scale; pixels are square.

    Attributes: `matrix`, A as a sparse (R*C, N) array; `hull`, (R, C) bool, where a pixel
    center lies inside the taxels' convex hull; `centers_mm`, the x of the columns and the y of the
    rows.

    Raises T2TwinError for fewer than three taxels, two taxels in one place, taxels on one line,
    a taxel outside the image, and taxels too close for the image's pixels to tell apart.
    """

    def __init__(
        self,
        x_mm: np.ndarray,
        y_mm: np.ndarray,
        shape: tuple[int, int] = TACTILE_SHAPE,
        px_per_mm: float = PX_PER_MM,
    ) -> None:
        x_mm, y_mm = np.asarray(x_mm, dtype=float), np.asarray(y_mm, dtype=float)
        half_mm = np.array([shape[1], shape[0]]) / px_per_mm / 2
        points = _checked_positions(x_mm, y_mm, half_mm)
        columns_mm = (np.arange(shape[1]) + 0.5) / px_per_mm - half_mm[0]
        rows_mm = (np.arange(shape[0]) + 0.5) / px_per_mm - half_mm[1]
        centers = np.stack(np.meshgrid(columns_mm, rows_mm), axis=-1).reshape(-1, 2)
        matrix = barycentric(points, centers)
        matrix.data.clip(0.0, 1.0, out=matrix.data)  # rounding leaves some just outside
        self._set(matrix, _inverse_of_all(matrix, shape), shape, (columns_mm, rows_mm))

    @classmethod
    def _of_matrix(
        cls,
        matrix: sparse.csr_array,
        inverse: np.ndarray,
        shape: tuple[int, int],
        centers_mm: tuple[np.ndarray, np.ndarray],
    ) -> Phi:
        """phi of an A, (R*C, N), that is there already, and of what reads its images, (R*C, N)."""
        phi = cls.__new__(cls)
        phi._set(matrix, inverse, shape, centers_mm)
        return phi

    def _set(
        self,
        matrix: sparse.csr_array,
        inverse: np.ndarray,
        shape: tuple[int, int],
        centers_mm: tuple[np.ndarray, np.ndarray],
    ) -> None:
        self.matrix = matrix
        self.shape = shape
        self.centers_mm = centers_mm
        self.hull = (matrix.sum(axis=1) > 0).reshape(shape)
        # A has three entries a row, yet one dense product is some three times faster than the
        # sparse one, because it writes the batch image by image.
        self._forward = np.ascontiguousarray(matrix.toarray().T, dtype=np.float32)  # (N, R*C)
        self._backward = inverse  # (R*C, N), in doubles: its terms cancel

    @property
    def taxels(self) -> int:
        """N, the number of taxels."""
        return self._forward.shape[0]

    def __call__(self, counts: np.ndarray) -> np.ndarray:
        """Tactile images of arrays. counts: (N,) or (B, N). Returns (R, C) or (B, R, C) float32."""
        counts = np.asarray(counts, dtype=np.float32)
        if counts.shape[-1] != self.taxels:
            raise T2TwinError(
                f"phi was built for {self.taxels} taxels and was given {counts.shape[-1]}"
            )
        return (counts @ self._forward).reshape(*counts.shape[:-1], *self.shape)

    def inverse(self, images: np.ndarray) -> np.ndarray:
        """Arrays of tactile images. images: (R, C) or (B, R, C). Returns (N,) or (B, N) float32."""
        images = np.asarray(images, dtype=float)
        if images.shape[-2:] != self.shape:
            raise T2TwinError(
                f"phi^-1 was built for images of {self.shape[0]} x {self.shape[1]} pixels and was "
                f"given {' x '.join(map(str, images.shape[-2:]))}"
            )
        counts = images.reshape(*images.shape[:-2], -1) @ self._backward
        return counts.astype(np.float32)

    def resized(self, shape: tuple[int, int]) -> Phi:
        """The same phi followed by an area resize to `shape`, as one matrix with its own inverse.

        Resizing is linear too, so nothing is lost between the two sizes: `resized(s).inverse`
        is exact for every image that phi and the resize can make.
        """
        rows = _area_weights(self.shape[0], shape[0])
        columns = _area_weights(self.shape[1], shape[1])
        resize = sparse.kron(rows, columns, format="csr")
        matrix = sparse.csr_array(resize @ self.matrix)
        centers_mm = (columns @ self.centers_mm[0], rows @ self.centers_mm[1])
        return Phi._of_matrix(matrix, _inverse_of_all(matrix, shape), shape, centers_mm)

    def with_inverse_from(self, pixels: np.ndarray) -> Phi:
        """The same phi, with a phi^-1 that reads the counts from these pixels alone.

        pixels: their numbers, row by row, between 0 and R*C. What the other pixels hold does not
        count. Raises T2TwinError where these pixels do not tell the taxels apart.
        """
        inverse = np.zeros_like(self._backward)
        inverse[pixels] = _left_inverse(
            self.matrix[pixels],
            "the taxels lie too close together, or too near the rim, to be told apart in the "
            f"pixels that are read of an image of {self.shape[0]} x {self.shape[1]}",
        )
        return Phi._of_matrix(self.matrix, inverse, self.shape, self.centers_mm)

    def to_torch(self, counts: torch.Tensor) -> torch.Tensor:
        """phi on tensors, differentiable. counts: (B, N). Returns (B, 1, R, C), same device."""
        import torch

        forward = torch.from_numpy(self._forward).to(counts.device, counts.dtype)
        return (counts @ forward).view(-1, 1, *self.shape)

    def from_torch(self, images: torch.Tensor) -> torch.Tensor:
        """phi^-1 on tensors, differentiable. images: (B, 1, R, C). Returns (B, N), same device."""
        import torch

        backward = torch.from_numpy(self._backward).to(images.device, images.dtype)
        return images.reshape(images.shape[0], -1) @ backward


def barycentric(
    points: np.ndarray, at: np.ndarray, tolerance: float = ROUNDING
) -> sparse.csr_array:
    """Barycentric weights over the Delaunay triangles of some points.

    points: (N, 2). at: (P, 2), the places, in the same unit. tolerance: how far a place may lie
    outside its triangle, in barycentric parts.
    Returns (P, N): the three weights of each place, their sum 1, and zeros for a place outside the
    points' convex hull. Raises T2TwinError where the points span no triangle.
    """
    try:
        triangles = Delaunay(points)
    except QhullError:
        raise T2TwinError(
            "the taxels span no triangles; phi needs three that are not on one line"
        ) from None
    triangle = triangles.find_simplex(at, tol=tolerance)
    inside = np.flatnonzero(triangle >= 0)
    corners = triangles.simplices[triangle[inside]]  # (inside, 3)
    transform = triangles.transform[triangle[inside]]  # (inside, 3, 2): a 2 x 2 and an offset
    weights = np.einsum("pij,pj->pi", transform[:, :2], at[inside] - transform[:, 2])
    weights = np.column_stack([weights, 1.0 - weights.sum(axis=1)])
    entries = (weights.ravel(), (np.repeat(inside, 3), corners.ravel()))
    return sparse.csr_array(entries, shape=(at.shape[0], points.shape[0]))


def _checked_positions(x_mm: np.ndarray, y_mm: np.ndarray, half_mm: np.ndarray) -> np.ndarray:
    """The positions as (N, 2), or T2TwinError for a layout that phi cannot interpolate."""
    if x_mm.ndim != 1 or x_mm.shape != y_mm.shape:
        raise T2TwinError(
            f"taxel positions have shapes {x_mm.shape} and {y_mm.shape}; x_mm and y_mm must be "
            "two lists of one length"
        )
    if x_mm.size < 3:
        raise T2TwinError(f"phi needs at least 3 taxels, the layout has {x_mm.size}")
    points = np.column_stack([x_mm, y_mm])
    if not np.isfinite(points).all():
        raise T2TwinError("a taxel position is not a finite number; positions are given in mm")
    close = sorted(KDTree(points).query_pairs(SAME_PLACE_MM))
    if close:
        a, b = close[0]
        raise T2TwinError(
            f"taxels {a} and {b} are both at x {points[a, 0]:g} mm, y {points[a, 1]:g} mm; every "
            "taxel must have its own place"
        )
    if np.linalg.svd(points - points.mean(axis=0), compute_uv=False)[-1] < SAME_PLACE_MM:
        raise T2TwinError("the taxels lie on one line; phi needs three that span a triangle")
    outside = np.flatnonzero((np.abs(points) > half_mm).any(axis=1))
    if outside.size:
        n = int(outside[0])
        raise T2TwinError(
            f"taxel {n} at x {points[n, 0]:g} mm, y {points[n, 1]:g} mm is outside the tactile "
            f"image, which reaches {half_mm[0]:.2f} mm in x and {half_mm[1]:.2f} mm in y either "
            "side of its center"
        )
    return points


def _inverse_of_all(matrix: sparse.csr_array, shape: tuple[int, int]) -> np.ndarray:
    """`_left_inverse` of all the pixels of an image of this shape."""
    return _left_inverse(
        matrix,
        f"the taxels lie too close together to be told apart in an image of {shape[0]} x "
        f"{shape[1]} pixels; they must be at least a pixel apart",
    )


def _left_inverse(matrix: sparse.csr_array, refusal: str) -> np.ndarray:
    """A (A^T A)^-1, (pixels, N), whose transpose is the left inverse of A, (pixels, N).

    refusal: what is said where these pixels do not tell the taxels apart.
    """
    normal = (matrix.T @ matrix).toarray()
    if np.linalg.cond(normal) > LARGEST_CONDITION:
        raise T2TwinError(refusal)
    return matrix @ np.linalg.inv(normal)


def _area_weights(size: int, new: int) -> sparse.csr_array:
    """(new, size): each new pixel is the mean of the old ones it covers, by length of overlap."""
    edges = np.linspace(0.0, size, new + 1)
    pixel = np.arange(size)
    overlap = np.minimum(edges[1:, None], pixel + 1.0) - np.maximum(edges[:-1, None], pixel)
    return sparse.csr_array(overlap.clip(0.0) * (new / size))
