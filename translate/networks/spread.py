"""Minimum of a predicted spread."""

import torch


def with_minimum(least: float, log_spread: torch.Tensor) -> torch.Tensor:
    """The logarithm of the sum of a spread and its minimum; a hard bound has no gradient."""
    return torch.log(torch.exp(log_spread) + least)  # ONNX has no logaddexp
