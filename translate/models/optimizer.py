"""Optimizers and weight averages of networks, as their presets define them.

The weight average of a network predicts better than its last weights (Polyak and Juditsky 1992; for
GAN generators Yazıcı et al. 2019). Its window grows with the number of steps (Karras et al. 2024,
section 3.1).
"""

from collections.abc import Iterable, Sequence

import torch
from torch import nn
from torch.optim.swa_utils import AveragedModel

from t2twin.translate.models.presets import Preset


def adamw(
    weights: Iterable[nn.Parameter], preset: Preset, rate_share: float = 1.0
) -> torch.optim.Optimizer:
    """AdamW (Loshchilov and Hutter 2019) for the weights of a network, or of a part of it.

    rate_share: factor of the preset's learning rate.
    """
    return torch.optim.AdamW(
        weights,
        preset.learning_rate * rate_share,
        (preset.beta1, preset.beta2),
        weight_decay=preset.weight_decay,
        fused=True,  # five times as fast on a CPU
    )


def weight_average(network: nn.Module, part: float) -> AveragedModel | None:
    """An average of a network's weights over a share of the steps so far.

    part: 1 for the mean of all steps, 0 for none (returns None). Step n, added by
    `update_parameters(network)`, has weight 1 / (n part), so that the final weights of steps are
    proportional to n^(1 / part - 1). Batch norm's statistics are averaged too.
    """
    if part == 0.0:
        return None

    def mix(
        averages: Sequence[torch.Tensor], values: Sequence[torch.Tensor], steps: torch.Tensor | int
    ) -> None:
        share = 1.0 / max(1.0, (int(steps) + 1) * part)
        for average, value in zip(averages, values, strict=True):
            if average.is_floating_point():
                average.lerp_(value, share)
            else:  # batch norm's counters
                average.copy_(value)

    average = AveragedModel(network, multi_avg_fn=mix, use_buffers=True)
    return average.requires_grad_(False)
