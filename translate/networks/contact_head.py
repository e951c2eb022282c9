"""From the image and the maps of an encoder to the contact in the camera's view.

A small feature pyramid (Lin et al. 2017): it adds the maps of a ResNet18 and fine maps of its own,
from the coarsest to the finest, which has half the side of the image.
Its gradients train the encoder too, if both are trained together.

Shape letters: B batch, S image side, an even number, H = S / 2 side of the predicted maps.
"""

from typing import NamedTuple

import torch
from torch import nn
from torch.nn import functional

from t2twin.translate.networks.spread import with_minimum

MIN_DEPTH_SPREAD, MIN_PRESSURE_SPREAD = 2e-3, 1e-3
"""Minimum spreads, fractions of the scales of depth and pressure (assumed: a micrometer)."""

PLANES = 3
"""Outputs of the mean: depth, pressure, and the logit of contact."""


class ContactOutputs(NamedTuple):
    """Outputs of the decoder, not calibrated, (B, H, H) each.

    depth, pressure: fractions of their scales. depth_log_spread, pressure_log_spread: logarithms of
    their raw spreads. logit: of the probability of contact.
    """

    depth: torch.Tensor
    depth_log_spread: torch.Tensor
    pressure: torch.Tensor
    pressure_log_spread: torch.Tensor
    logit: torch.Tensor


def side_of_maps(size: int) -> int:
    """H of a network with this image side."""
    return size // 2


class ContactHead(nn.Module):
    """The decoder of a ResNet18 of base width `filters`."""

    def __init__(self, filters: int) -> None:
        super().__init__()
        self.pixels = nn.Conv2d(6, filters, 4, 2, 1, bias=False)
        self.place = nn.Conv2d(5, filters, 1, bias=False)
        self.fine = nn.Sequential(nn.BatchNorm2d(filters), nn.ReLU())
        self.coarser = convolution(filters, 2 * filters, 2)
        # Widths of the maps of sides S / 32 to S / 2: of the encoder's, and of the decoder's.
        theirs, own = (8, 4, 2, 1, 1), (8, 2, 2, 2, 1)
        steps = range(1, len(own))
        self.raised = nn.ModuleList(
            nn.Conv2d(filters * own[n - 1], filters * own[n], 1, bias=False) for n in steps
        )
        self.lateral = nn.ModuleList(
            nn.Conv2d(filters * theirs[n], filters * own[n], 1) for n in steps
        )
        self.merged = nn.ModuleList(convolution(filters * own[n], filters * own[n]) for n in steps)
        self.last = convolution(filters, filters)
        self.mean = nn.Conv2d(filters, PLANES, 1)
        self.spread = nn.Sequential(
            nn.Conv2d(filters, filters // 2, 3, 1, 1), nn.ReLU(), nn.Conv2d(filters // 2, 2, 1)
        )

    def forward(self, inputs: torch.Tensor, maps: tuple[torch.Tensor, ...]) -> ContactOutputs:
        """inputs: (B, 6, S, S), of the encoder. maps: its outputs, S / 2 to S / 32 wide."""
        *skips, found = maps
        pixels = self.pixels(inputs)
        fine = self.fine(pixels + self.place(_places(pixels)))
        more = (None, None, self.coarser(fine), fine)
        for raised, lateral, merged, skip, own in zip(
            self.raised, self.lateral, self.merged, reversed(skips), more, strict=True
        ):
            coarse = functional.interpolate(raised(found), size=skip.shape[-2:], mode="nearest")
            total = coarse + lateral(skip)
            found = merged(total if own is None else total + own)
        found = self.last(found)
        depth, pressure, logit = self.mean(found).float().unbind(dim=1)
        # Detached: the spread's loss does not change the features of the mean.
        spread = self.spread(found.detach()).float()
        return ContactOutputs(
            depth,
            with_minimum(MIN_DEPTH_SPREAD, spread[:, 0]),
            pressure,
            with_minimum(MIN_PRESSURE_SPREAD, spread[:, 1]),
            logit,
        )


def _places(maps: torch.Tensor) -> torch.Tensor:
    """(1, 5, H, H) powers of x and y of the cells, which the direction of the light depends on."""
    line = torch.linspace(-1.0, 1.0, maps.shape[-1], device=maps.device)
    x, y = torch.meshgrid(line, line, indexing="xy")
    return torch.stack([x, y, x * x, x * y, y * y])[None]


def convolution(channels: int, width: int, stride: int = 1, size: int = 3) -> nn.Sequential:
    """A convolution of an odd size, with normalization and rectification."""
    layer = nn.Conv2d(channels, width, size, stride, size // 2, bias=False)
    return nn.Sequential(layer, nn.BatchNorm2d(width), nn.ReLU())
