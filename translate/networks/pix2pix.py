"""The networks of pix2pix (Isola et al. 2017): a U-Net generator and a PatchGAN discriminator.

Every block is a 4 x 4 convolution of stride 2. The encoder of the U-Net goes down to one pixel; its
decoder concatenates each encoder level's output (section 6.1.1). The discriminator is the 70 x 70
PatchGAN (section 6.1.2).

Shape letters: B batch, S image side.
"""

import math

import torch
from torch import nn

from t2twin.core.errors import T2TwinError

# Channels stop doubling at this many times the base filters (Isola et al. 2017)
MAX_WIDTH_FACTOR = 8
# Decoder blocks, counted from the innermost, that have dropout (Isola et al. 2017)
DROPOUT_BLOCKS = 3
INITIAL_STD = 0.02  # Standard deviation of the initial weights (Isola et al. 2017)


class UNet(nn.Module):
    """U-Net for square images.

    size: image side, a power of two of at least 16. filters: base width.

    Size 256 with 64 filters is the generator of the paper: 54.4 M parameters with one input and one
    output channel. Raises T2TwinError for other sizes.
    """

    def __init__(self, size: int, filters: int, channels_in: int = 1, channels_out: int = 1):
        super().__init__()
        levels = int(math.log2(size)) if size > 0 else 0
        if size < 16 or size != 2**levels:
            raise T2TwinError(f"the image side is {size}; expected a power of two of at least 16")
        widths = [filters * min(2**level, MAX_WIDTH_FACTOR) for level in range(levels)]
        self.encoder = nn.ModuleList(
            _encoder_block(
                channels_in if level == 0 else widths[level - 1],
                width,
                activate=level > 0,
                # One pixel has no statistics; pix2pix does not normalize the first block.
                normalize=0 < level < levels - 1,
            )
            for level, width in enumerate(widths)
        )
        self.decoder = nn.ModuleList(
            _decoder_block(
                widths[level] * (1 if level == levels - 1 else 2),
                widths[level - 1],
                dropout=level > levels - 1 - DROPOUT_BLOCKS,
            )
            for level in range(levels - 1, 0, -1)
        )
        self.head = nn.Sequential(
            nn.Identity(), nn.ConvTranspose2d(2 * widths[0], channels_out, 4, 2, 1), nn.Tanh()
        )
        self.apply(initialize)

    def forward(self, images: torch.Tensor) -> torch.Tensor:
        """(B, channels_in, S, S) -> (B, channels_out, S, S), both in [-1, 1]."""
        levels = []
        x = images
        for block in self.encoder:
            x = block(x)
            levels.append(x)
        x = x.relu()
        for block, skip in zip(self.decoder, reversed(levels[:-1]), strict=True):
            # ReLU before concatenation: batch norm is fast on dense gradients.
            x = torch.cat([block(x).relu_(), skip.relu()], dim=1)
        return self.head(x)


class HalfDropout(nn.Dropout):
    """nn.Dropout(0.5) (Isola et al. 2017), five times as fast on a CPU."""

    def forward(self, input: torch.Tensor) -> torch.Tensor:
        if not self.training:
            return input
        return input * torch.empty_like(input, dtype=torch.uint8).random_(2).mul_(2)


def initialize(module: nn.Module) -> None:
    """pix2pix's: weights from N(0, 0.02), scales of batch norm from N(1, 0.02), zero biases."""
    if isinstance(module, nn.Conv2d | nn.ConvTranspose2d):
        nn.init.normal_(module.weight, 0.0, INITIAL_STD)
        if module.bias is not None:
            nn.init.zeros_(module.bias)
    elif isinstance(module, nn.BatchNorm2d):
        nn.init.normal_(module.weight, 1.0, INITIAL_STD)
        nn.init.zeros_(module.bias)


def _encoder_block(channels: int, width: int, activate: bool, normalize: bool) -> nn.Sequential:
    layers: list[nn.Module] = [nn.LeakyReLU(0.2)] if activate else []
    layers.append(nn.Conv2d(channels, width, 4, 2, 1, bias=False))
    if normalize:
        layers.append(nn.BatchNorm2d(width))
    return nn.Sequential(*layers)


def _decoder_block(channels: int, width: int, dropout: bool) -> nn.Sequential:
    layers: list[nn.Module] = [
        nn.Identity(),  # the place of a former ReLU; names of weights depend on it
        nn.ConvTranspose2d(channels, width, 4, 2, 1, bias=False),
        nn.BatchNorm2d(width),
    ]
    if dropout:
        layers.append(HalfDropout())
    return nn.Sequential(*layers)


class PatchGAN(nn.Module):
    """Classifies each 70 x 70 patch of a pair (condition, image) as real or generated.

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
        self.apply(initialize)

    def forward(self, condition: torch.Tensor, image: torch.Tensor) -> torch.Tensor:
        """(B, c, S, S) and (B, c', S, S) -> (B, 1, S/8 - 2, S/8 - 2) logits, positive for real."""
        return self.layers(torch.cat([condition, image], dim=1))
