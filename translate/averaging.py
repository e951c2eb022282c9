"""A running mean of a network's weights over its steps, which predicts better than the last ones.

Polyak and Juditsky 1992 for the mean; Yazıcı et al. 2019 for generators, whose weights circle
around what they are after; Karras et al. 2024 (section 3.1) for a reach that grows with the steps.
"""

import torch
from torch import nn
from torch.optim.swa_utils import AveragedModel

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
