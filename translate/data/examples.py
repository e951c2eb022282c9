"""What one step of a training learns from."""

from dataclasses import dataclass

import torch


@dataclass(frozen=True)
class Examples:
    """B pairs. images: as `images.to_input` makes them, (B, c, S, S). counts: (B, N) float32.

    field: (B, F) float32, counts, for a translator that learns it. force_n: (B,) float32, 0 where
    nothing touches.
    """

    images: torch.Tensor
    counts: torch.Tensor
    field: torch.Tensor | None = None
    force_n: torch.Tensor | None = None
