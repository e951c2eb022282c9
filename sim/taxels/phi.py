"""phi maps the counts of an array to a one-channel tactile image, phi^-1 maps it back.

I = phi(Y) = A Y: barycentric interpolation over the Delaunay triangles of the taxels at the pixel
centers (Grella et al. 2023), zero outside their convex hull. phi^-1 is A's left inverse
(A^T A)^-1 A^T: exact for an image phi(Y), and the least-squares estimate for any other image.

Shape letters: B images in a batch, R rows, C columns, N taxels.
"""

from __future__ import annotations

from copy import copy
from typing import TYPE_CHECKING

import numpy as np
import scipy
from scipy import sparse

from t2twin.core.cache_dir import cached_array, short_digest
from t2twin.core.errors import T2TwinError
from t2twin.sim.taxels.layout import PAD_DIAMETER_MM, Layout

if TYPE_CHECKING:
    import torch

TACTILE_SHAPE = (396, 240)  # rows and columns of a tactile image (Grella et al. 2023).

PX_PER_MM = 8.8  # scale of the tactile image (assumed: 45 mm of the skin's length over 396 rows)
ON_LINE_MM = 1e-3  # taxels this near a line lie on it (assumed: far below any printed board's)
LARGEST_CONDITION = 1e8  # of A^T A for phi^-1 (assumed: leaves an accuracy of 1e-8)
ROUNDING = 100 * float(np.finfo(float).eps)  # SciPy's tolerance, in barycentric coordinates

# A place inside a triangle, the triangle's corners and the place's barycentric weights.
WEIGHTS = np.dtype([("place", "i4"), ("corners", "i4", 3), ("weights", "f8", 3)])


class Phi:
    """phi and phi^-1 for one taxel layout and one image size.

    x_mm, y_mm: (N,) taxel positions in the sensor frame, mm; the image's center is its origin.
    matrix: A as a sparse (R*C, N) array. hull: (R, C) bool, whether a pixel lies inside the convex
    hull. centers_mm: x of the columns and y of the rows. Raises T2TwinError as Layout
    does, and for taxels on one line, outside the image or too close to be distinguished in it.
    """

    def __init__(
        self,
        x_mm: np.ndarray,
        y_mm: np.ndarray,
        shape: tuple[int, int] = TACTILE_SHAPE,
        px_per_mm: float = PX_PER_MM,
    ) -> None:
        half_mm = np.array([shape[1], shape[0]]) / px_per_mm / 2
        points = _checked_positions(x_mm, y_mm, half_mm)
        columns_mm = (np.arange(shape[1]) + 0.5) / px_per_mm - half_mm[0]
        rows_mm = (np.arange(shape[0]) + 0.5) / px_per_mm - half_mm[1]
        centers = np.stack(np.meshgrid(columns_mm, rows_mm), axis=-1).reshape(-1, 2)
        matrix = barycentric(points, centers)
        matrix.data.clip(0.0, 1.0, out=matrix.data)  # rounding leaves some outside [0, 1]
        self._set(matrix, _full_inverse(matrix, shape), shape, (columns_mm, rows_mm))

    def _set(
        self, matrix: sparse.csr_array, inverse: np.ndarray, shape: tuple[int, int],
        centers_mm: tuple[np.ndarray, np.ndarray],
    ) -> None:  # fmt: skip
        """matrix: A, (R*C, N). inverse: the transpose of a left inverse of it, (R*C, N)."""
        self.matrix = matrix
        self.shape = shape
        self.centers_mm = centers_mm
        self.hull = (matrix.sum(axis=1) > 0).reshape(shape)
        # A dense product is about three times faster than a sparse one.
        self._forward = np.ascontiguousarray(matrix.toarray().T, dtype=np.float32)  # (N, R*C)
        self._backward = inverse  # (R*C, N), in double precision because of cancellation
        self._tensors: dict[tuple[str, torch.device, torch.dtype], torch.Tensor] = {}

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
        """The same phi followed by an area resize to `shape`, with an exact inverse of its own."""
        rows = _area_weights(self.shape[0], shape[0])
        columns = _area_weights(self.shape[1], shape[1])
        resize = sparse.kron(rows, columns, format="csr")
        matrix = sparse.csr_array(resize @ self.matrix)
        centers_mm = (columns @ self.centers_mm[0], rows @ self.centers_mm[1])
        phi = copy(self)
        phi._set(matrix, _full_inverse(matrix, shape), shape, centers_mm)
        return phi

    def with_inverse_from(self, pixels: np.ndarray) -> Phi:
        """The same phi, with a phi^-1 that uses only some pixels, indices from 0 to R*C - 1."""
        phi = copy(self)
        phi._tensors = {}
        phi._backward = np.zeros_like(self._backward)
        phi._backward[pixels] = _left_inverse(
            self.matrix[pixels],
            "the taxels lie too close together, or too near the rim, to be distinguished in the "
            f"pixels used of an image of {self.shape[0]} x {self.shape[1]}",
        )
        return phi

    def to_torch(self, counts: torch.Tensor) -> torch.Tensor:
        """phi on tensors, differentiable. counts: (B, N). Returns (B, 1, R, C), same device."""
        forward = self._matrix_like(counts, "forward")
        return (counts @ forward).view(-1, 1, *self.shape)

    def from_torch(self, images: torch.Tensor) -> torch.Tensor:
        """phi^-1 on tensors, differentiable. images: (B, 1, R, C). Returns (B, N), same device."""
        backward = self._matrix_like(images, "backward")
        return images.reshape(images.shape[0], -1) @ backward

    def _matrix_like(self, values: torch.Tensor, name: str) -> torch.Tensor:
        """The matrix "forward" or "backward" like values, kept: copying it to a GPU takes long."""
        import torch

        key = (name, values.device, values.dtype)
        if key not in self._tensors:
            with torch.inference_mode(False):  # so that it is differentiable later
                matrix = torch.from_numpy(getattr(self, f"_{name}"))
                self._tensors[key] = matrix.to(values.device, values.dtype)
        return self._tensors[key]


def barycentric(
    points: np.ndarray, at: np.ndarray, tolerance: float = ROUNDING
) -> sparse.csr_array:
    """Barycentric weights of places at (P, 2) over the Delaunay triangles of points (N, 2), (P, N).

    tolerance: at the edges of triangles, in barycentric coordinates. Each place has three weights
    with sum 1, or zeros outside the convex hull. Raises T2TwinError for points without a triangle.
    """
    digest = short_digest(points.tobytes() + at.tobytes())
    key = repr((digest, points.shape, at.shape, tolerance, scipy.__version__))
    found = cached_array("phi", key, __file__, lambda: _find_weights(points, at, tolerance))
    rows, columns = np.repeat(found["place"].astype(int), 3), found["corners"].ravel()
    entries = (found["weights"].ravel(), (rows, columns))
    return sparse.csr_array(entries, shape=(at.shape[0], points.shape[0]))


def _find_weights(points: np.ndarray, at: np.ndarray, tolerance: float) -> np.ndarray:
    """The WEIGHTS of the places inside the convex hull; arguments as for `barycentric`."""
    from scipy.spatial import Delaunay, QhullError  # slow to import

    try:
        triangles = Delaunay(points)
    except QhullError:
        raise T2TwinError("the taxels span no triangles; phi needs three off one line") from None
    triangle = triangles.find_simplex(at, tol=tolerance)
    inside = np.flatnonzero(triangle >= 0)
    corners = triangles.simplices[triangle[inside]]  # (inside, 3)
    transform = triangles.transform[triangle[inside]]  # (inside, 3, 2): a 2 x 2 and an offset
    weights = np.einsum("pij,pj->pi", transform[:, :2], at[inside] - transform[:, 2])
    found = np.empty(inside.size, WEIGHTS)
    found["place"], found["corners"] = inside, corners
    found["weights"] = np.column_stack([weights, 1.0 - weights.sum(axis=1)])
    return found


def _checked_positions(x_mm: np.ndarray, y_mm: np.ndarray, half_mm: np.ndarray) -> np.ndarray:
    """The positions as (N, 2). Raises T2TwinError for a layout that phi cannot interpolate."""
    layout = Layout("of phi", x_mm, y_mm, np.full(np.size(x_mm), PAD_DIAMETER_MM))
    points = np.column_stack([layout.x_mm, layout.y_mm])
    if np.linalg.svd(points - points.mean(axis=0), compute_uv=False)[-1] < ON_LINE_MM:
        raise T2TwinError("the taxels lie on one line; phi needs three that span a triangle")
    outside = np.flatnonzero((np.abs(points) > half_mm).any(axis=1))
    if outside.size:
        n = int(outside[0])
        raise T2TwinError(
            f"taxel {n} at x {points[n, 0]:g} mm, y {points[n, 1]:g} mm is outside the tactile "
            f"image, which reaches {half_mm[0]:.2f} mm in x and {half_mm[1]:.2f} mm in y"
        )
    return points


def _full_inverse(matrix: sparse.csr_array, shape: tuple[int, int]) -> np.ndarray:
    """`_left_inverse` with all pixels of an image of this shape."""
    return _left_inverse(
        matrix,
        f"the taxels lie too close together to be distinguished in an image of {shape[0]} x "
        f"{shape[1]} pixels; they must be at least a pixel apart",
    )


def _left_inverse(matrix: sparse.csr_array, refusal: str) -> np.ndarray:
    """A (A^T A)^-1, the transpose of the left inverse of A, (pixels, N). refusal: message."""
    normal = (matrix.T @ matrix).toarray()
    if np.linalg.cond(normal) > LARGEST_CONDITION:
        raise T2TwinError(refusal)
    return matrix @ np.linalg.inv(normal)


def _area_weights(size: int, new: int) -> sparse.csr_array:
    """(new, size) weights of an area resize: the overlaps of new and old pixels."""
    edges = np.linspace(0.0, size, new + 1)
    pixel = np.arange(size)
    overlap = np.minimum(edges[1:, None], pixel + 1.0) - np.maximum(edges[:-1, None], pixel)
    return sparse.csr_array(overlap.clip(0.0) * (new / size))
