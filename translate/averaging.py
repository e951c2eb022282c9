"""A running mean of a network's weights over its steps, which predicts better than the last ones.

Polyak and Juditsky 1992 for the mean; Yazıcı et al. 2019 for generators, whose weights circle
around what they are after.
"""

import torch
from torch import nn
from torch.optim.swa_utils import AveragedModel

Tensors = tuple[torch.Tensor, ...] | list[torch.Tensor]


def running_mean(network: nn.Module, steps: int) -> AveragedModel | None:
    """A mean that reaches back `steps` steps, exponentially, or none for 0 steps.

    It follows with each `update_parameters(network)`; over fewer steps than that it is the plain
    mean of all. Its `module` is a network like the one followed, batch norm's statistics being
    means too.
    """
    if steps == 0:
        return None

    def mix(means: Tensors, present: Tensors, followed: torch.Tensor | int) -> None:
        share = 1.0 / min(int(followed) + 1, steps)
        for mean, now in zip(means, present, strict=True):
            if mean.is_floating_point():
                mean.lerp_(now, share)
            else:  # batch norm's counters
                mean.copy_(now)

    mean = AveragedModel(network, multi_avg_fn=mix, use_buffers=True)
    return mean.requires_grad_(False)
