"""The optimizer of a network by its preset.

A running mean of a network's weights over its steps, which predicts better than the last ones.

Polyak and Juditsky 1992 for the mean; Yazıcı et al. 2019 for generators, whose weights circle
around what they are after; Karras et al. 2024 (section 3.1) for a reach that grows with the steps.
"""

import torch
from torch import nn
from torch.optim.swa_utils import AveragedModel

from t2twin.translate.models.presets import Preset


class DenseAdamW(torch.optim.AdamW):
    """AdamW that steps on kernels as they lie in memory, channels last: the fused step would copy
    every gradient first, which takes as long as all the rest of it."""

    def _init_group(self, group, *tensors: list[torch.Tensor]) -> bool:
        is_complex = super()._init_group(group, *tensors)
        for kind in tensors:
            kind[:] = [each.permute(0, 2, 3, 1) if each.dim() == 4 else each for each in kind]
        return is_complex


def adamw(network: nn.Module, preset: Preset, rate_share: float = 1.0) -> torch.optim.Optimizer:
    """AdamW (Loshchilov and Hutter 2019) over a network's weights. rate_share: of the preset's
    learning rate."""
    return DenseAdamW(
        network.parameters(),
        preset.learning_rate * rate_share,
        (preset.beta1, preset.beta2),
        weight_decay=preset.weight_decay,
        fused=True,  # five times as fast on a CPU
    )


Tensors = tuple[torch.Tensor, ...] | list[torch.Tensor]


def running_mean(network: nn.Module, part: float) -> AveragedModel | None:
    """A mean that reaches back over a part of the steps so far: 1 is the plain mean of all, 0 none.

    It follows with each `update_parameters(network)`: step n weighs 1 / (n part) in it, so that in
    the end steps weigh as n^(1 / part - 1). Its `module` is a network like the one followed, batch
    norm's statistics being means too.
    """
    if part == 0.0:
        return None

    def mix(means: Tensors, present: Tensors, followed: torch.Tensor | int) -> None:
        share = 1.0 / max(1.0, (int(followed) + 1) * part)
        for mean, now in zip(means, present, strict=True):
            if mean.is_floating_point():
                mean.lerp_(now, share)
            else:  # batch norm's counters
                mean.copy_(now)

    mean = AveragedModel(network, multi_avg_fn=mix, use_buffers=True)
    return mean.requires_grad_(False)
