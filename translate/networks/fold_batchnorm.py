"""Networks made ready to predict with: batch norms folded into the convolutions before them."""

from itertools import pairwise

import torch
from torch import nn
from torch.nn.utils.fusion import fuse_conv_bn_eval


def fuse(network: nn.Module) -> None:
    """Folds every batch norm into the convolution named just before it, in place.

    The result is the same but for rounding, with half as many passes over the memory; the network
    is in evaluation mode after it, and cannot be trained on.
    """
    network.eval()
    for module in list(network.modules()):
        for (name, layer), (after, norm) in pairwise(list(module.named_children())):
            if isinstance(layer, nn.Conv2d | nn.ConvTranspose2d) and isinstance(
                norm, nn.BatchNorm2d
            ):
                transposed = isinstance(layer, nn.ConvTranspose2d)
                setattr(module, name, fuse_conv_bn_eval(layer, norm, transposed))
                setattr(module, after, nn.Identity())
    network.requires_grad_(False)
    network.to(memory_format=torch.channels_last)  # pyright: ignore[reportCallIssue]
