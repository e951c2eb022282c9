"""The discriminator of pix2pix: a 70 x 70 PatchGAN (Isola et al. 2017, section 6.1.2)."""

import torch
from torch import nn

from t2twin.translate.networks.unet import initialise


class PatchGAN(nn.Module):
    """Says of each 70 x 70 patch whether the pair (condition, image) is real.

    channels_in: the condition's and the image's together. filters: base width, 64 in the paper.
    """

    def __init__(self, channels_in: int = 2, filters: int = 64):
        super().__init__()
        layers: list[nn.Module] = [nn.Conv2d(channels_in, filters, 4, 2, 1), nn.LeakyReLU(0.2)]
        for width, stride in ((2, 2), (4, 2), (8, 1)):
            layers += [
                nn.Conv2d(filters * width // 2, filters * width, 4, stride, 1, bias=False),
                nn.BatchNorm2d(filters * width),
                nn.LeakyReLU(0.2),
            ]
        layers.append(nn.Conv2d(filters * 8, 1, 4, 1, 1))
        self.layers = nn.Sequential(*layers)
        self.apply(initialise)

    def forward(self, condition: torch.Tensor, image: torch.Tensor) -> torch.Tensor:
        """(B, c, S, S) and (B, c', S, S) -> (B, 1, S/8 - 2, S/8 - 2) logits, positive for real."""
        return self.layers(torch.cat([condition, image], dim=1))
