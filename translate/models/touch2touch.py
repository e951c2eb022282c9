"""touch2touch: pix2pix from the picture of one sensor to that of another (Grella et al. 2023).

Pictures (data.pairs) are scaled so that -1 is zero or black, and 1 is full scale or white, at the
preset's square size. The loss does not contain the counts; phi^-1 at that size reads them. In the
networks (Isola et al. 2017), every block is a 4 x 4 convolution of stride 2.

A preset may add a soft IoU loss (Rahman and Wang 2016), because L1 gives little weight to the
outline of a contact. The membership of a pixel in the contact rises smoothly over one half at the
level of the contact IoU of an evaluation. Intersection and union are minimum and maximum (Zadeh
1965), so that the IoU of an image with itself is 1.

Shape letters: B batch, S image side, N taxels, R rows and C columns of a full tactile image.
"""

import math
from collections import OrderedDict
from copy import copy
from functools import cached_property
from typing import Self

import numpy as np
import torch
from msgspec import structs
from scipy.spatial import ConvexHull
from torch import nn
from torch.nn import functional

from t2twin.core.errors import T2TwinError
from t2twin.sim.dataset.columns import IMAGE
from t2twin.sim.taxels.layout import Layout
from t2twin.translate.data.images import COLORS, WHITE_GREY, to_scaled
from t2twin.translate.data.pairs import DataInfo, Examples
from t2twin.translate.models.base import TACTILE_IMAGES, Outputs, Translator, adamw
from t2twin.translate.models.presets import Preset

GENERATED = "generated"
OUTSIDE_MM = 0.01  # Of a taxel outside the trained layout's hull: positions are often rounded
SAME_COVER = 1e-6  # Largest difference of two hulls' coverage of a pixel, as a fraction (assumed)
CONTACT_LEVEL = 0.1  # Of the maximum: there the membership is one half (evaluation.metrics)
SHARPNESS = 2  # Exponent of the membership (assumed; with a higher one, few pixels have a gradient)
MIN_CONTACT = 0.01  # Of full scale: a target image below it has no contact (assumed: noise)
MIN_UNION = 0.5  # Pixels, against division by zero: less than the union of any contact
MAX_WIDTH_FACTOR = 8  # Of the base filters, where channels stop doubling (Isola et al. 2017)
DROPOUT_BLOCKS = 3  # Innermost blocks of the decoder that have dropout (Isola et al. 2017)
INITIAL_STD = 0.02  # Standard deviation of the initial weights (Isola et al. 2017)


class UNet(nn.Module):
    """U-Net for square images, whose side is a power of two of at least 16. filters: base width.

    Size 256 with 64 filters is the generator of the paper, with 54.4 M parameters.
    """

    def __init__(self, size: int, filters: int, channels_in: int = 1, channels_out: int = 1):
        super().__init__()
        levels = int(math.log2(size)) if size > 0 else 0
        if size < 16 or size != 2**levels:
            raise T2TwinError(f"the image side is {size}; expected a power of two of at least 16")
        widths = [filters * min(2**level, MAX_WIDTH_FACTOR) for level in range(levels)]
        self.encoder, self.decoder = nn.ModuleList(), nn.ModuleList()
        for level, width in enumerate(widths):
            layers: list[nn.Module] = [nn.LeakyReLU(0.2)] if level > 0 else []
            before = widths[level - 1] if level > 0 else channels_in
            layers.append(nn.Conv2d(before, width, 4, 2, 1, bias=False))
            # One pixel has no statistics; pix2pix does not normalize the first block.
            if 0 < level < levels - 1:
                layers.append(nn.BatchNorm2d(width))
            self.encoder.append(nn.Sequential(*layers))
        for level in range(levels - 1, 0, -1):
            before = widths[level] * (1 if level == levels - 1 else 2)
            # The first is the place of a former ReLU; names of weights depend on it.
            layers = [
                nn.Identity(), nn.ConvTranspose2d(before, widths[level - 1], 4, 2, 1, bias=False),
                nn.BatchNorm2d(widths[level - 1]),
            ]  # fmt: skip
            if level > levels - 1 - DROPOUT_BLOCKS:
                layers.append(HalfDropout())
            self.decoder.append(nn.Sequential(*layers))
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


def patch_gan(channels: int, filters: int) -> nn.Sequential:
    """Classifies each 70 x 70 patch of a condition with an image as real or generated.

    (B, channels, S, S) -> (B, 1, S/8 - 2, S/8 - 2) logits, positive for real. channels: of both
    together. filters: base width, 64 in the paper.
    """
    layers: list[nn.Module] = [nn.Conv2d(channels, filters, 4, 2, 1), nn.LeakyReLU(0.2)]
    for width, stride in ((2, 2), (4, 2), (8, 1)):
        layers += [
            nn.Conv2d(filters * width // 2, filters * width, 4, stride, 1, bias=False),
            nn.BatchNorm2d(filters * width),
            nn.LeakyReLU(0.2),
        ]
    layers.append(nn.Conv2d(filters * 8, 1, 4, 1, 1))
    return nn.Sequential(OrderedDict(layers=nn.Sequential(*layers))).apply(initialize)


def soft_iou_loss(predicted: torch.Tensor, target: torch.Tensor) -> torch.Tensor:
    """1 - soft IoU of images, (B, 1, S, S) in [0, 1], averaged over targets with a contact."""
    ours, theirs = _membership(predicted), _membership(target)
    pixels = (1, 2, 3)
    intersection = torch.minimum(ours, theirs).sum(pixels)
    union = torch.maximum(ours, theirs).sum(pixels)
    has_contact = target.amax(pixels) > MIN_CONTACT
    loss = 1.0 - intersection / union.clamp(min=MIN_UNION)
    return (loss * has_contact).sum() / has_contact.sum().clamp(min=1)


def _membership(images: torch.Tensor) -> torch.Tensor:
    """(B, 1, S, S): membership of each pixel in the contact."""
    maximum = images.detach().amax((1, 2, 3), keepdim=True).clamp(min=MIN_CONTACT)
    height = (images / (CONTACT_LEVEL * maximum)) ** SHARPNESS
    return height / (1.0 + height)


class Pix2Pix(Translator):
    """The generator, which predicts images of a gel camera, and the discriminator."""

    to_input = staticmethod(to_scaled)
    mean = std = np.array([0.5], np.float32)

    def __init__(self, preset: Preset, info: DataInfo, device: torch.device, bf16: bool) -> None:
        channels_in = 1 if preset.grey else COLORS
        channels_out = channels_in if info.target.value == IMAGE else 1
        self.generator = UNet(preset.size, preset.filters, channels_in, channels_out)
        self.discriminator = patch_gan(channels_in + channels_out, preset.filters)
        networks = {"generator": self.generator, "discriminator": self.discriminator}
        super().__init__(preset, info, device, bf16, networks)

    @cached_property
    def optimizers(self) -> dict[str, torch.optim.Optimizer]:
        shares = {"generator": 1.0, "discriminator": self.preset.discriminator_share}
        return {
            name: adamw(self.networks[name].parameters(), self.preset, share)
            for name, share in shares.items()
        }

    def target_pictures(self, targets: torch.Tensor) -> torch.Tensor:
        """(B, c', S, S) in [-1, 1], of the targets of Examples: the images, (B, S, S, c')."""
        return to_scaled(targets / WHITE_GREY)

    def read(self, outputs: torch.Tensor) -> Outputs:
        """See Translator. Grey levels, not rounded."""
        return {"image": (outputs.float().permute(0, 2, 3, 1) + 1.0) * (WHITE_GREY / 2.0)}

    def step(self, examples: Examples) -> Outputs:
        """One step of the discriminator, then one of the generator, which minimizes the adversarial
        loss, L1 and, with a weight, the soft IoU loss."""
        preset, inputs = self.preset, examples.images.to(self.device)
        targets = self.target_pictures(examples.targets.to(self.device))
        with self.precision():
            generated = self.generator(inputs)
            real_logits = self.discriminator(torch.cat([inputs, targets], dim=1))
            generated_logits = self.discriminator(torch.cat([inputs, generated.detach()], dim=1))
        # halved to slow the discriminator down
        loss = 0.5 * (_adversarial(real_logits, 1.0) + _adversarial(generated_logits, 0.0))
        self.descend(loss, self.discriminator, "discriminator")
        self.discriminator.requires_grad_(False)
        with self.precision():
            logits = self.discriminator(torch.cat([inputs, generated], dim=1))
        losses = {
            "discriminator": loss,
            "adversarial": _adversarial(logits, 1.0),
            "l1": functional.l1_loss(generated.float(), targets),
        }
        total = losses["adversarial"] + preset.l1_weight * losses["l1"]
        if preset.iou_weight:
            losses["iou"] = soft_iou_loss((generated.float() + 1.0) / 2.0, (targets + 1.0) / 2.0)
            total = total + preset.iou_weight * losses["iou"]
        self.descend(total, self.generator, "generator")
        self.discriminator.requires_grad_(True)
        return {name: each.detach() for name, each in losses.items()}


def _adversarial(logits: torch.Tensor, label: float) -> torch.Tensor:
    logits = logits.float()
    return functional.binary_cross_entropy_with_logits(logits, torch.full_like(logits, label))


class Touch2Touch(Pix2Pix):
    """pix2pix with tactile images as targets."""

    reads_any_layout = True

    def __init__(self, preset: Preset, info: DataInfo, device: torch.device, bf16: bool) -> None:
        self.phi = info.array.phi.resized((preset.size, preset.size))
        super().__init__(preset, info, device, bf16)

    def target_pictures(self, targets: torch.Tensor) -> torch.Tensor:
        """(B, N) counts -> tactile images, (B, 1, S, S): -1 is zero, 1 is full scale."""
        return self.phi.to_torch(targets) * (2.0 / self.full_scale) - 1.0

    def read(self, outputs: torch.Tensor) -> Outputs:
        """See Translator: phi^-1, clipped to full scale, and the small images, GENERATED."""
        small = (outputs.float() + 1.0) * (self.full_scale / 2.0)
        return {"counts": self.phi.from_torch(small).clamp(0.0, self.full_scale), GENERATED: small}

    def tactile_images(self, found: Outputs) -> Outputs:
        """See Translator: the generator's, resized."""
        down, across = self._resize
        large = down @ found.pop(GENERATED)[:, 0] @ across.T
        return {TACTILE_IMAGES: large.clamp(min=0.0)}

    @cached_property
    def _resize(self) -> list[torch.Tensor]:
        """(new, old): bilinear resizes of the sides; ONNX's operator has no antialiasing."""
        return [
            functional.interpolate(
                torch.eye(old)[None, None], (new, old), mode="bilinear", antialias=True
            )[0, 0].to(self.device)
            for old, new in zip(self.phi.shape, self.info.array.tactile_image[:2], strict=True)
        ]

    def read_at(self, layout: Layout) -> Self:
        """See Translator. The images keep their size; the new layout's phi^-1 reads them."""
        array, x_mm, y_mm = self.info.array, layout.x_mm, layout.y_mm
        own = structs.replace(array, x_mm=x_mm, y_mm=y_mm, pad_diameter_mm=layout.pad_diameter_mm)
        phi = own.phi.resized(self.phi.shape)
        sides = ConvexHull(np.column_stack([array.x_mm, array.y_mm])).equations  # (sides, 3)
        distance_mm = (np.stack([x_mm, y_mm, np.ones_like(x_mm)], axis=1) @ sides.T).max(axis=1)
        n = int(distance_mm.argmax())
        if distance_mm[n] > OUTSIDE_MM:
            raise T2TwinError(
                f"taxel {n} of the layout {layout.name}, at x {x_mm[n]:g} mm, y {y_mm[n]:g} mm, is "
                f"{distance_mm[n]:.2f} mm outside the array that the run was trained on "
                f"({array.layout}); expected all taxels inside, where the tactile image is defined"
            )
        other = copy(self)
        # phi^-1 ignores the pixels on the rim that the two hulls cover differently, because their
        # values also depend on what lies outside the new hull.
        covers = [each.matrix.sum(axis=1) for each in (phi, self.phi)]
        same = np.flatnonzero(np.abs(covers[0] - covers[1]) < SAME_COVER)
        other.phi = phi.with_inverse_from(same)
        return other
