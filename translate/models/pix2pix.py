"""pix2pix (Isola et al. 2017): a generator, a discriminator and one training step of both.

touch2touch and its reverse are pix2pix models that differ in what is the input and the target.

Shape letters: B batch, S image side, N taxels.
"""

import torch
from torch import nn
from torch.nn import functional

from t2twin.sim.cyskin.phi import Phi
from t2twin.translate.data.pairs import DataInfo
from t2twin.translate.models.base import Translator
from t2twin.translate.models.distributed import average_gradients
from t2twin.translate.models.optimizer import adamw, weight_average
from t2twin.translate.models.presets import Preset
from t2twin.translate.models.soft_iou_loss import soft_iou_loss
from t2twin.translate.networks.pix2pix import PatchGAN, UNet


class Pix2Pix(Translator):
    """The generator and the discriminator of one preset; the generator predicts."""

    def __init__(self, preset: Preset, info: DataInfo, device: torch.device, bf16: bool) -> None:
        self.info = info
        self.phi = Phi(info.x_mm, info.y_mm).resized((preset.size, preset.size))
        self.full_scale = info.full_scale_counts
        self.l1_weight = preset.l1_weight
        self.iou_weight = preset.iou_weight
        self.device = device
        self.bf16 = bf16
        self.generator = UNet(preset.size, preset.filters)
        self.discriminator = PatchGAN(filters=preset.filters)
        self.networks = {"generator": self.generator, "discriminator": self.discriminator}
        for network in self.networks.values():
            network.to(device, memory_format=torch.channels_last)  # pyright: ignore[reportCallIssue]
        self.optimizers = {
            "generator": adamw(self.generator.parameters(), preset),
            "discriminator": adamw(
                self.discriminator.parameters(), preset, preset.discriminator_share
            ),
        }
        self.average = weight_average(self.generator, preset.averaged_part)
        self.predictor: nn.Module = self.average.module if self.average else self.generator

    def generate(self, inputs: torch.Tensor) -> torch.Tensor:
        """The generator's outputs in evaluation mode. (B, 1, S, S) -> (B, 1, S, S), in [-1, 1]."""
        self.predictor.eval()
        with torch.inference_mode(), self.precision():
            generated = self.predictor(inputs.to(self.device))
        return generated.float()

    def scaled_tactile_images(self, counts: torch.Tensor) -> torch.Tensor:
        """(B, N) counts -> tactile images, (B, 1, S, S): -1 is zero, 1 is full scale."""
        return self.phi.to_torch(counts) * (2.0 / self.full_scale) - 1.0

    def pix2pix_step(self, inputs: torch.Tensor, targets: torch.Tensor) -> dict[str, float]:
        """One step of the discriminator, then one of the generator.

        inputs, targets: (B, 1, S, S), in [-1, 1]. Returns the losses by name.
        """
        with self.precision():
            generated = self.generator(inputs)
        discriminator_loss = self._discriminator_step(inputs, targets, generated.detach())
        losses = self._generator_step(inputs, targets, generated)
        if self.average is not None:
            self.average.update_parameters(self.generator)
        return {"discriminator": discriminator_loss, **losses}

    def _discriminator_step(
        self, inputs: torch.Tensor, targets: torch.Tensor, generated: torch.Tensor
    ) -> float:
        """Classifies real and generated pairs; the loss is halved to slow this network down."""
        optimizer = self.optimizers["discriminator"]
        optimizer.zero_grad()
        with self.precision():
            real_logits = self.discriminator(inputs, targets)
            generated_logits = self.discriminator(inputs, generated)
        loss = 0.5 * (_adversarial(real_logits, 1.0) + _adversarial(generated_logits, 0.0))
        loss.backward()
        average_gradients(self.discriminator)
        optimizer.step()
        return float(loss.detach())

    def _generator_step(
        self, inputs: torch.Tensor, targets: torch.Tensor, generated: torch.Tensor
    ) -> dict[str, float]:
        """Minimizes the adversarial loss, L1 and, with a weight, the soft IoU loss."""
        optimizer = self.optimizers["generator"]
        optimizer.zero_grad()
        self.discriminator.requires_grad_(False)
        with self.precision():
            logits = self.discriminator(inputs, generated)
        adversarial = _adversarial(logits, 1.0)
        l1 = functional.l1_loss(generated.float(), targets)
        losses, total = {"adversarial": adversarial, "l1": l1}, adversarial + self.l1_weight * l1
        if self.iou_weight:
            losses["iou"] = soft_iou_loss((generated.float() + 1.0) / 2.0, (targets + 1.0) / 2.0)
            total = total + self.iou_weight * losses["iou"]
        total.backward()
        self.discriminator.requires_grad_(True)
        average_gradients(self.generator)
        optimizer.step()
        return {name: float(loss.detach()) for name, loss in losses.items()}


def _adversarial(logits: torch.Tensor, label: float) -> torch.Tensor:
    logits = logits.float()
    return functional.binary_cross_entropy_with_logits(logits, torch.full_like(logits, label))
