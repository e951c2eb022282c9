"""The shear force on the DIGIT, from displacements of the image relative to the background frame.

A shear force displaces the markers on the gel. On a layer of thickness h and shear modulus G, the
integral of the displacement over the area is F h / G (Hooke's law). This is exact for an unbounded
layer on a rigid base. The head measures the displacement in windows of the image (Lucas and Kanade
1981). The force is the sum of these displacements, with weights that a network predicts.

Shape letters: B batch, S input side, H side after a reduction, W windows along each side.
"""

import torch
from torch import nn
from torch.nn import functional

IMAGE_SIDE = 96
"""Side of the images that displacements are measured on, pixels (assumed: most markers of sampled
DIGIT units are then 2 pixels wide). Larger images are reduced to less than twice that."""

SCALES = (1, 2)
"""Reductions of these images. A displacement can be measured up to the radius of a marker, and
after a reduction by 2 also where markers have merged to larger ones."""

STEP, MARGIN = 8, 4
"""Distance of neighboring windows, and what a window extends beyond it on each side, pixels. The
median errors of the plain sum of the displacements are 2.2 degrees and 11 %, with a margin of 8
pixels 2.5 degrees and 13 % (measured on 210 touches of tools)."""

BLUR = 10
"""Pixels on each side of a pixel whose mean is subtracted from it (assumed: more than a marker and
less than the variation of the light)."""

MIN_TEXTURE = 1e-4
"""Mean squared gradient of a window that halves its displacement, in colors' variance per squared
pixel (as measured for MARGIN; ten times as much is worse)."""

MAX_DISPLACEMENT = 3.0
"""Limit of a displacement, pixels of its scale (assumed: larger ones are errors)."""

WIDTH = 32
"""Channels of the network that predicts the weights (assumed)."""


def averaged(maps: torch.Tensor, means: torch.Tensor) -> torch.Tensor:
    """(..., H, H) to (..., W, W): means over boxes, whose weights on a line are means, (W, H)."""
    lines = (maps @ means.T).transpose(-1, -2)  # one large product is fast
    return (lines @ means.T).transpose(-1, -2)


def box_means(side: int, step: int, margin: int) -> torch.Tensor:
    """(side // step, side): weights of the pixels of a line in the mean over each box.

    A box is a run of `step` pixels and `margin` more on both sides, as far as the line has them.
    """
    first = step * torch.arange(side // step)[:, None]
    pixel = torch.arange(side)
    inside = ((pixel >= first - margin) & (pixel < first + step + margin)).float()
    return inside / inside.sum(dim=1, keepdim=True)


def displacements(
    image: torch.Tensor, frame: torch.Tensor, means: torch.Tensor
) -> tuple[torch.Tensor, torch.Tensor]:
    """Displacement of each window of an image relative to a frame, by least squares.

    image, frame: (B, 1, H, H). means: (W, H), see `box_means`. Returns the displacement along x and
    y, (B, 2, W, W), pixels, and the root mean squares of the gradient along x and y and of the
    difference, (B, 3, W, W).
    """
    middle, difference = (image + frame) / 2, frame - image
    along_x = _gradient(middle)
    along_y = _gradient(middle.transpose(-1, -2)).transpose(-1, -2)
    products = [
        along_x * along_x,
        along_y * along_y,
        difference * difference,
        along_x * along_y,
        along_x * difference,
        along_y * difference,
    ]
    xx, yy, dd, xy, xd, yd = averaged(torch.cat(products, dim=1), means).split(1, dim=1)
    roots = torch.cat([xx, yy, dd], dim=1).sqrt()
    xx, yy = xx + MIN_TEXTURE, yy + MIN_TEXTURE
    moved = torch.cat([yy * xd - xy * yd, xx * yd - xy * xd], dim=1) / (xx * yy - xy * xy)
    return moved.clamp(-MAX_DISPLACEMENT, MAX_DISPLACEMENT), roots


def _gradient(maps: torch.Tensor) -> torch.Tensor:
    """Central differences along the last axis, zero at the rim. The shape of maps."""
    rim = torch.zeros_like(maps[..., :1])
    return torch.cat([rim, (maps[..., 2:] - maps[..., :-2]) / 2, rim], dim=-1)


class ShearHead(nn.Module):
    """Predicts the shear force and the logarithm of its raw spread, (B, 2) each.

    size: side of the input images, pixels. vector: numbers of the encoder's vector.
    """

    def __init__(self, size: int, vector: int) -> None:
        super().__init__()
        self.part = max(1, size // IMAGE_SIDE)
        for scale in SCALES:
            side = size // (self.part * scale)
            boxes = {"blur": (1, BLUR // scale), "means": (STEP // scale, MARGIN // scale)}
            for name, box in boxes.items():
                self.register_buffer(f"{name}_{scale}", box_means(side, *box), persistent=False)
        self.normalize = nn.BatchNorm2d(5 * len(SCALES))
        self.windows = nn.Conv2d(5 * len(SCALES), WIDTH, 3, 1, 1)
        self.vector = nn.Linear(vector, WIDTH)
        self.mix = nn.Sequential(nn.ReLU(), nn.Conv2d(WIDTH, WIDTH, 3, 1, 1), nn.ReLU())
        self.weights = nn.Conv2d(WIDTH, 2 * len(SCALES), 1)
        self.spread = nn.Sequential(nn.Linear(WIDTH + 2, WIDTH), nn.ReLU(), nn.Linear(WIDTH, 2))

    def forward(
        self, image: torch.Tensor, frame: torch.Tensor, vector: torch.Tensor
    ) -> tuple[torch.Tensor, torch.Tensor]:
        """image, frame: (B, 3, S, S), normalized. vector: of the encoder.

        In training, batches are mirrored at random, and their forces mirrored back.
        """
        mirrored = (torch.rand(2) < 0.5).tolist() if self.training else [False, False]
        axes = [axis for axis, each in zip((3, 2), mirrored, strict=True) if each]
        if axes:
            image, frame = image.flip(axes), frame.flip(axes)
        moved, roots = self._measured(image, frame)
        features = self.normalize(torch.cat([moved, roots], dim=1))
        mixed = self.mix(self.windows(features) + self.vector(vector)[:, :, None, None])
        weighted = (1.0 + self.weights(mixed).float()) * moved
        shear = weighted.mean(dim=(2, 3)).unflatten(1, (len(SCALES), 2)).sum(dim=1)
        if axes:
            shear = shear * (1.0 - 2.0 * torch.tensor(mirrored).float()).to(shear.device)
        # Detached: the spread's loss does not change the features of the mean.
        known = torch.cat([mixed.float().mean(dim=(2, 3)), shear.abs()], dim=1).detach()
        return shear, self.spread(known).float()

    def _measured(
        self, image: torch.Tensor, frame: torch.Tensor
    ) -> tuple[torch.Tensor, torch.Tensor]:
        """What `displacements` returns at all scales, x and y of one after the other, float32."""
        found = []
        with torch.autocast(image.device.type, enabled=False):
            greys = [each.float().mean(dim=1, keepdim=True) for each in (image, frame)]
            for scale in SCALES:
                means, blur = (getattr(self, f"{name}_{scale}") for name in ("means", "blur"))
                small = [functional.avg_pool2d(each, self.part * scale) for each in greys]
                flat = [each - averaged(each, blur) for each in small]
                found.append(displacements(flat[0], flat[1], means))
        moved, roots = (torch.cat(each, dim=1) for each in zip(*found, strict=True))
        return moved, roots
