"""The tactile image of a field: barycentric interpolation between its places, as phi does.

Each pixel stores its three places; phi's matrix would store a weight of every place.

Shape letters: B images, F places, R rows and C columns of a tactile image.
"""

import numpy as np
import torch
from torch import nn

from t2twin.sim.cyskin.phi import PX_PER_MM, TACTILE_SHAPE, barycentric


class FieldImage(nn.Module):
    """Maps (B, F) to (B, R, C), zero outside the places' convex hull. x_mm, y_mm: (F,), mm."""

    corners: torch.Tensor
    weights: torch.Tensor

    def __init__(self, x_mm: np.ndarray, y_mm: np.ndarray) -> None:
        super().__init__()
        columns_mm, rows_mm = (
            (np.arange(size) + 0.5) / PX_PER_MM - size / PX_PER_MM / 2
            for size in reversed(TACTILE_SHAPE)
        )
        centers = np.stack(np.meshgrid(columns_mm, rows_mm), axis=-1).reshape(-1, 2)
        matrix = barycentric(np.column_stack([x_mm, y_mm]), centers)
        inside = np.diff(matrix.indptr) == 3
        corners = np.zeros((centers.shape[0], 3), np.int64)
        weights = np.zeros((centers.shape[0], 3), np.float32)
        corners[inside] = matrix.indices.reshape(-1, 3)
        weights[inside] = matrix.data.reshape(-1, 3).clip(0.0, 1.0)
        self.register_buffer("corners", torch.from_numpy(np.ascontiguousarray(corners.T)))
        self.register_buffer("weights", torch.from_numpy(np.ascontiguousarray(weights.T)))

    def forward(self, field: torch.Tensor) -> torch.Tensor:
        # Indexed by number: the tracer does not support iteration over a tensor.
        first, second, third = (
            field.index_select(1, self.corners[n]) * self.weights[n] for n in range(3)
        )
        return (first + second + third).unflatten(1, TACTILE_SHAPE)
