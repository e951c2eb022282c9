"""touch2touch: pix2pix from the picture of one sensor to that of another (Grella et al. 2023).

Pictures (data.pairs) are scaled so that -1 is zero or black, and 1 is full scale or white, at the
preset's square size. The loss does not contain the counts; phi^-1 at that size reads them.

A preset may add a soft IoU loss (Rahman and Wang 2016), because L1 gives little weight to the
outline of a contact. The membership of a pixel in the contact rises smoothly over one half at the
level of the contact IoU of an evaluation. Intersection and union are minimum and maximum (Zadeh
1965), so that the IoU of an image with itself is 1.

Shape letters: B batch, S image side, N taxels, R rows and C columns of a full tactile image.
"""

from abc import abstractmethod
from copy import copy
from functools import cached_property
from typing import Self

import numpy as np
import torch
from scipy.spatial import ConvexHull
from torch.nn import functional

from t2twin.core.errors import T2TwinError
from t2twin.sim.dataset.info import ArrayInfo
from t2twin.sim.taxels.layout import Layout
from t2twin.translate.data.images import COLORS, WHITE_GREY, to_scaled
from t2twin.translate.data.pairs import DataInfo, Examples
from t2twin.translate.models.base import TACTILE_IMAGES, Outputs, Translator, adamw
from t2twin.translate.models.presets import Preset
from t2twin.translate.networks.pix2pix import PatchGAN, UNet

GENERATED = "generated"

# Largest distance of a taxel outside the trained layout's hull, mm: positions are often rounded
OUTSIDE_MM = 0.01
SAME_COVER = 1e-6  # Largest difference of two hulls' coverage of a pixel, as a fraction (assumed)
# Fraction of the maximum at which the membership is one half (evaluation.metrics.CONTACT_LEVEL)
CONTACT_LEVEL = 0.1
SHARPNESS = 2  # Exponent of the membership (assumed; with a higher one, few pixels have a gradient)
# A target image with no pixel above this fraction of full scale has no contact (assumed: noise)
MIN_CONTACT = 0.01
MIN_UNION = 0.5  # Pixels, against division by zero: less than the union of any contact


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
    """The generator, which predicts, and the discriminator."""

    to_input = staticmethod(to_scaled)
    mean = std = np.array([0.5], np.float32)

    def __init__(
        self, preset: Preset, info: DataInfo, device: torch.device, bf16: bool, channels_out: int
    ) -> None:
        channels_in = 1 if preset.grey else COLORS
        self.generator = UNet(preset.size, preset.filters, channels_in, channels_out)
        self.discriminator = PatchGAN(channels_in + channels_out, preset.filters)
        networks = {"generator": self.generator, "discriminator": self.discriminator}
        super().__init__(preset, info, device, bf16, networks)

    @cached_property
    def optimizers(self) -> dict[str, torch.optim.Optimizer]:
        """See Translator."""
        shares = {"generator": 1.0, "discriminator": self.preset.discriminator_share}
        return {
            name: adamw(self.networks[name].parameters(), self.preset, share)
            for name, share in shares.items()
        }

    @abstractmethod
    def target_pictures(self, targets: torch.Tensor) -> torch.Tensor:
        """(B, c', S, S) in [-1, 1], of the targets of Examples."""

    def step(self, examples: Examples) -> Outputs:
        """One step of the discriminator, then one of the generator."""
        inputs = examples.images.to(self.device)
        targets = self.target_pictures(examples.targets.to(self.device))
        with self.precision():
            generated = self.generator(inputs)
            real_logits = self.discriminator(inputs, targets)
            generated_logits = self.discriminator(inputs, generated.detach())
        # halved to slow the discriminator down
        loss = 0.5 * (_adversarial(real_logits, 1.0) + _adversarial(generated_logits, 0.0))
        self.descend(loss, self.discriminator, "discriminator")
        losses = self._generator_step(inputs, targets, generated)
        return {"discriminator": loss.detach(), **losses}

    def _generator_step(
        self, inputs: torch.Tensor, targets: torch.Tensor, generated: torch.Tensor
    ) -> dict[str, torch.Tensor]:
        """Minimizes the adversarial loss, L1 and, with a weight, the soft IoU loss."""
        self.discriminator.requires_grad_(False)
        with self.precision():
            logits = self.discriminator(inputs, generated)
        losses = {
            "adversarial": _adversarial(logits, 1.0),
            "l1": functional.l1_loss(generated.float(), targets),
        }
        total = losses["adversarial"] + self.preset.l1_weight * losses["l1"]
        if self.preset.iou_weight:
            losses["iou"] = soft_iou_loss((generated.float() + 1.0) / 2.0, (targets + 1.0) / 2.0)
            total = total + self.preset.iou_weight * losses["iou"]
        self.descend(total, self.generator, "generator")
        self.discriminator.requires_grad_(True)
        return {name: loss.detach() for name, loss in losses.items()}


def _adversarial(logits: torch.Tensor, label: float) -> torch.Tensor:
    logits = logits.float()
    return functional.binary_cross_entropy_with_logits(logits, torch.full_like(logits, label))


class Touch2Touch(Pix2Pix):
    """pix2pix with tactile images as targets."""

    reads_any_layout = True

    def __init__(self, preset: Preset, info: DataInfo, device: torch.device, bf16: bool) -> None:
        self.phi = info.array.phi.resized((preset.size, preset.size))
        super().__init__(preset, info, device, bf16, channels_out=1)

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
        array = self.info.array
        phi = array.phi_of(layout.x_mm, layout.y_mm).resized(self.phi.shape)
        _check_inside(array, layout)
        other = copy(self)
        # phi^-1 ignores the pixels on the rim that the two hulls cover differently, because their
        # values also depend on what lies outside the new hull.
        covers = [each.matrix.sum(axis=1) for each in (phi, self.phi)]
        other.phi = phi.with_inverse_from(
            np.flatnonzero(np.abs(covers[0] - covers[1]) < SAME_COVER)
        )
        return other


def _check_inside(trained: ArrayInfo, layout: Layout) -> None:
    """Raises T2TwinError for taxels outside the trained layout's hull, without an image there."""
    x_mm, y_mm = layout.x_mm, layout.y_mm
    sides = ConvexHull(np.column_stack([trained.x_mm, trained.y_mm])).equations  # (sides, 3)
    distance_mm = (np.stack([x_mm, y_mm, np.ones_like(x_mm)], axis=1) @ sides.T).max(axis=1)
    n = int(distance_mm.argmax())
    if distance_mm[n] > OUTSIDE_MM:
        raise T2TwinError(
            f"taxel {n} of the layout {layout.name}, at x {x_mm[n]:g} mm, y {y_mm[n]:g} mm, is "
            f"{distance_mm[n]:.2f} mm outside the array that the run was trained on "
            f"({trained.layout}); expected all taxels inside, where the tactile image is defined"
        )


class ImageTranslator(Pix2Pix):
    """pix2pix with images of a gel camera as targets."""

    def __init__(self, preset: Preset, info: DataInfo, device: torch.device, bf16: bool) -> None:
        super().__init__(preset, info, device, bf16, channels_out=1 if preset.grey else COLORS)

    def target_pictures(self, targets: torch.Tensor) -> torch.Tensor:
        """The images, (B, S, S, c), scaled."""
        return to_scaled(targets / WHITE_GREY)

    def read(self, outputs: torch.Tensor) -> Outputs:
        """See Translator. Grey levels, not rounded."""
        return {"image": (outputs.float().permute(0, 2, 3, 1) + 1.0) * (WHITE_GREY / 2.0)}
