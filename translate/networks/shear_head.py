"""The shear force on the DIGIT, from displacements of the image relative to the background frame.

The force that drags the gel's surface displaces the markers. In a layer of thickness h and shear
modulus G, a force F along x displaces the surface by u with G / h times the integral of u over the
area = F (Hooke's law; exact for an infinite layer that does not slip on its base). So the head
scores displacements in windows of the image and adds up the contributions of all windows.

Shape letters: B batch, H image side after the reduction, W windows along each side, R reach, D =
(2 R + 1)^2 displacements.
"""

import torch
from torch import nn
from torch.nn import functional

IMAGE_SIDE = 96
"""Side of the images that displacements are scored on, pixels; larger ones are reduced to less than
twice that (assumed: the markers of the sampled DIGIT units are then at least 1.5 pixels wide)."""

WINDOW = 8
"""Distance of neighboring windows, pixels; a window is three times as large (assumed: it contains a
marker at the largest pitch)."""

REACH = 3
"""Largest displacement that is scored, pixels: 0.4 mm along x and 0.5 mm along y (assumed: nine of
ten touches that slide displace the markers less)."""

BLUR = 11
"""Side of the square whose mean is subtracted from each pixel, pixels (assumed: wider than a
marker, narrower than the light's variation)."""

MIN_CONTRAST = 0.01
"""Contrast of a window below which its scores tend to zero, in standard deviations of colors
(assumed: half a grey level, the noise of 30 frames)."""

WIDTH = 48
"""Channels of the head (assumed)."""

SHARES = 3
"""Features of a window besides the scores: contrasts of the image and of the background frame, and
the root mean square of their difference."""


def displacement_scores(
    image: torch.Tensor, frame: torch.Tensor, means: torch.Tensor, reach: int = REACH
) -> torch.Tensor:
    """Normalized cross-correlation of windows of an image with a displaced frame.

    image, frame: (B, 1, H, H), whose local means are zero. means: (W, H), see `box_means`. Returns
    (B, D, W, W), from -1 to 1. The displacements are row by row, from -reach to reach along y and
    x: the score of (dy, dx) is large where image[y, x] is frame[y - dy, x - dx].
    """
    height, width = image.shape[2:]
    padded, places = functional.pad(frame, (reach,) * 4), range(2 * reach, -1, -1)
    products = []
    for i in places:  # row by row, which fits the processor's cache
        row = padded[:, :, i : i + height]
        displaced = torch.cat([row[..., j : j + width] for j in places], dim=1)
        products.append(averaged(image * displaced, means))
    energy = averaged(image.square(), means) * averaged(frame.square(), means)
    return torch.cat(products, dim=1) * torch.rsqrt(energy + MIN_CONTRAST**4)


def averaged(maps: torch.Tensor, means: torch.Tensor) -> torch.Tensor:
    """(..., H, H) to (..., W, W): means over boxes, whose weights on a line are means, (W, H)."""
    lines = (maps @ means.T).transpose(-1, -2)  # one large product is fast
    return (lines @ means.T).transpose(-1, -2)


def box_means(side: int, step: int, reach: int) -> torch.Tensor:
    """(W, side): weights of the pixels of a line in the mean over each box.

    A box is a run of `step` pixels and `reach` more pixels on both sides, as far as the line has
    them.
    """
    first = step * torch.arange(side // step)[:, None]
    pixel = torch.arange(side)
    inside = ((pixel >= first - reach) & (pixel < first + step + reach)).float()
    return inside / inside.sum(dim=1, keepdim=True)


class ShearHead(nn.Module):
    """Predicts the shear force and the logarithm of its raw spread, (B, 2) each.

    size: side of the input images, pixels. vector: numbers of the encoder's vector.
    """

    blur: torch.Tensor
    means: torch.Tensor

    def __init__(self, size: int, vector: int) -> None:
        super().__init__()
        part = max(1, size // IMAGE_SIDE)
        self.reduce = nn.AvgPool2d(part) if part > 1 else nn.Identity()
        blur, means = (box_means(size // part, *box) for box in ((1, BLUR // 2), (WINDOW, WINDOW)))
        self.register_buffer("blur", blur, persistent=False)
        self.register_buffer("means", means, persistent=False)
        self.normalize = nn.BatchNorm2d((2 * REACH + 1) ** 2 + SHARES)
        self.windows = nn.Conv2d(self.normalize.num_features, WIDTH, 1)
        self.vector = nn.Linear(vector, WIDTH)
        self.mix = nn.Sequential(
            nn.ReLU(),
            nn.Conv2d(WIDTH, WIDTH, 3, 1, 1),
            nn.ReLU(),
            nn.Conv2d(WIDTH, WIDTH, 3, 1, 1),
            nn.ReLU(),
        )
        self.part = nn.Conv2d(WIDTH, 2, 1)
        self.spread = nn.Sequential(nn.Linear(WIDTH + 2, WIDTH), nn.ReLU(), nn.Linear(WIDTH, 2))

    def forward(
        self, image: torch.Tensor, frame: torch.Tensor, vector: torch.Tensor
    ) -> tuple[torch.Tensor, torch.Tensor]:
        """image, frame: (B, 3, S, S), normalized. vector: of the encoder.

        In training, batches are mirrored at random, and their forces mirrored back.
        """
        mirrored = (torch.rand(2) < 0.5).tolist() if self.training else [False, False]
        if any(mirrored):
            axes = [axis for axis, each in zip((3, 2), mirrored, strict=True) if each]
            image, frame = image.flip(axes), frame.flip(axes)
        windows = self.windows(self.normalize(self._features(image, frame)))
        windows = self.mix(windows + self.vector(vector)[:, :, None, None])
        shear = self.part(windows).float().sum(dim=(2, 3)) / self.means.shape[0]
        if any(mirrored):
            shear = shear * (1.0 - 2.0 * torch.tensor(mirrored).float()).to(shear.device)
        # Detached: the spread's loss does not change the features of the mean.
        known = torch.cat([windows.float().mean(dim=(2, 3)), shear.abs()], dim=1).detach()
        return shear, self.spread(known).float()

    def _features(self, image: torch.Tensor, frame: torch.Tensor) -> torch.Tensor:
        """(B, D + SHARES, W, W): scores and shares of the windows, in float32."""
        with torch.autocast(image.device.type, enabled=False):
            greys = [self.reduce(each.float().mean(dim=1, keepdim=True)) for each in (image, frame)]
            flat = [grey - averaged(grey, self.blur) for grey in greys]
            shares = [*(each.square() for each in flat), (greys[0] - greys[1]).square()]
            levels = averaged(torch.cat(shares, dim=1), self.means)
            scores = displacement_scores(flat[0], flat[1], self.means)
            return torch.cat([scores, levels.sqrt()], dim=1)
