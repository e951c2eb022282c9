"""touch2touch: pix2pix from the grey DIGIT image to the tactile image (Grella et al. 2023).

The generator draws the tactile image, scaled so that -1 is nothing and 1 full scale, at the
preset's square size; phi at that size is phi at 396 x 240 followed by an area resize, and its
inverse reads the counts from what was drawn. The counts never enter the loss; their RMSE is only
watched. A preset may add a loss of the image's shape (t2twin.translate.models.soft_iou_loss).

Shape letters: B batch, S image side, N taxels, R rows and C columns of a full tactile image.
"""

from copy import copy, deepcopy
from typing import Self

import torch
from torch import nn
from torch.nn import functional

from t2twin.sim.cyskin.layout import Layout
from t2twin.sim.cyskin.phi import TACTILE_SHAPE, Phi
from t2twin.translate.data.pairs import DataInfo, Examples, Pairs
from t2twin.translate.models.distributed import average_gradients
from t2twin.translate.models.layouts import check_inside, reading_at
from t2twin.translate.models.optimizer import adamw, running_mean
from t2twin.translate.models.presets import Preset
from t2twin.translate.models.soft_iou_loss import shape_loss
from t2twin.translate.networks.pix2pix import PatchGAN, UNet


class Touch2Touch:
    """The Translator of a generator and a discriminator; it predicts with the generator."""

    draws = True
    learns_field = False

    def __init__(self, preset: Preset, info: DataInfo, device: torch.device, bf16: bool) -> None:
        self.info = info
        self.phi = Phi(info.x_mm, info.y_mm).resized((preset.size, preset.size))
        self.full_scale = info.full_scale_counts
        self.l1_weight = preset.l1_weight
        self.shape_weight = preset.shape_weight
        self.device = device
        self.bf16 = bf16
        self.generator = UNet(preset.size, preset.filters)
        self.discriminator = PatchGAN(filters=preset.filters)
        self.networks: dict[str, nn.Module] = {
            "generator": self.generator,
            "discriminator": self.discriminator,
        }
        for network in self.networks.values():
            network.to(device, memory_format=torch.channels_last)  # pyright: ignore[reportCallIssue]
        self.optimizers = {
            "generator": adamw(self.generator, preset),
            "discriminator": adamw(self.discriminator, preset, preset.discriminator_share),
        }
        self.running = running_mean(self.generator, preset.averaged_part)
        self.predictor = self.generator if self.running is None else self.running.module

    def prepare(self, pairs: Pairs) -> None:
        """See Translator: it needs to know nothing of them."""

    def calibrate(self, *sets: Pairs) -> None:
        """See Translator: it says nothing of how sure it is."""

    def step(self, examples: Examples) -> dict[str, float]:
        """One step of the discriminator, then one of the generator.

        images: (B, 1, S, S) in [-1, 1]. Returns the losses by name.
        """
        real = self.to_image(examples.counts.to(self.device))
        return self.learn(examples.images.to(self.device), real)

    def learn(self, images: torch.Tensor, real: torch.Tensor) -> dict[str, float]:
        """A step on what is seen and what is to be drawn of it, (B, 1, S, S) each, in [-1, 1]."""
        with self._precision():
            drawn = self.generator(images)
        discriminator_loss = self._discriminator_step(images, real, drawn.detach())
        losses = self._generator_step(images, real, drawn)
        if self.running is not None:
            self.running.update_parameters(self.generator)
        return {"discriminator": discriminator_loss, **losses}

    def predict(self, images: torch.Tensor) -> torch.Tensor:
        """(B, 1, S, S) -> counts (B, N), within zero and full scale. In evaluation mode."""
        return self.counts_of(self.draw(images))

    def counts_and_tactile_images(self, images: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
        """Counts, (B, N), and the tactile images as drawn, resized, (B, R, C), counts."""
        drawn = self.draw(images)
        large = functional.interpolate(drawn, TACTILE_SHAPE, mode="bilinear", antialias=True)
        return self.counts_of(drawn), large[:, 0].clamp(min=0.0)

    def draw(self, images: torch.Tensor) -> torch.Tensor:
        """(B, 1, S, S) -> the tactile images as drawn, in counts, (B, 1, S, S)."""
        return (self.drawn(images) + 1.0) * (self.full_scale / 2.0)

    def drawn(self, images: torch.Tensor) -> torch.Tensor:
        """What the generator draws of what it sees, (B, 1, S, S) in [-1, 1] both. In evaluation
        mode."""
        self.predictor.eval()
        with torch.inference_mode(), self._precision():
            drawn = self.predictor(images.to(self.device))
        return drawn.float()

    def counts_of(self, tactile_images: torch.Tensor) -> torch.Tensor:
        """phi^-1 of drawn images, clipped to what taxels can say. (B, 1, S, S) -> (B, N)."""
        return self.phi.from_torch(tactile_images).clamp(0.0, self.full_scale)

    def read_at(self, layout: Layout) -> Self:
        """See Translator. The images stay what they are: phi's inverse reads them at their size."""
        phi = Phi(layout.x_mm, layout.y_mm)
        check_inside(self.info, layout.x_mm, layout.y_mm, layout.name)
        other = copy(self)
        other.phi = reading_at(phi.resized(self.phi.shape), self.phi)
        return other

    def in_float32(self) -> Self:
        """See Translator."""
        other = copy(self)
        other.bf16 = False
        return other

    def as_module(self) -> nn.Module:
        """See Translator."""
        return _FromPixels(self.predictor, self.phi, self.full_scale)

    def to_image(self, counts: torch.Tensor) -> torch.Tensor:
        """(B, N) counts -> their tactile images, (B, 1, S, S): -1 nothing, 1 full scale."""
        return self.phi.to_torch(counts) * (2.0 / self.full_scale) - 1.0

    def _precision(self) -> torch.autocast:
        return torch.autocast(self.device.type, torch.bfloat16, enabled=self.bf16)

    def _discriminator_step(
        self, images: torch.Tensor, real: torch.Tensor, drawn: torch.Tensor
    ) -> float:
        """Tell real pairs from drawn ones; the loss is halved to slow this network down."""
        optimizer = self.optimizers["discriminator"]
        optimizer.zero_grad()
        with self._precision():
            of_real = self.discriminator(images, real)
            of_drawn = self.discriminator(images, drawn)
        loss = 0.5 * (_adversarial(of_real, 1.0) + _adversarial(of_drawn, 0.0))
        loss.backward()
        average_gradients(self.discriminator)
        optimizer.step()
        return float(loss.detach())

    def _generator_step(
        self, images: torch.Tensor, real: torch.Tensor, drawn: torch.Tensor
    ) -> dict[str, float]:
        """Pass for real, stay close to the real image, and, where it weighs, to its shape."""
        optimizer = self.optimizers["generator"]
        optimizer.zero_grad()
        self.discriminator.requires_grad_(False)
        with self._precision():
            of_drawn = self.discriminator(images, drawn)
        adversarial = _adversarial(of_drawn, 1.0)
        l1 = functional.l1_loss(drawn.float(), real)
        losses, total = {"adversarial": adversarial, "l1": l1}, adversarial + self.l1_weight * l1
        if self.shape_weight:
            losses["shape"] = shape_loss((drawn.float() + 1.0) / 2.0, (real + 1.0) / 2.0)
            total = total + self.shape_weight * losses["shape"]
        total.backward()
        self.discriminator.requires_grad_(True)
        average_gradients(self.generator)
        optimizer.step()
        return {name: float(loss.detach()) for name, loss in losses.items()}


class _FromPixels(nn.Module):
    """From grey pixels in [0, 1] to counts and tactile images, in float32 on the CPU."""

    rows: torch.Tensor
    columns: torch.Tensor

    def __init__(self, generator: nn.Module, phi: Phi, full_scale: float) -> None:
        super().__init__()
        self.network = deepcopy(generator).cpu()
        self.phi = phi
        self.full_scale = full_scale
        self.register_buffer("rows", _resizing(phi.shape[0], TACTILE_SHAPE[0]))
        self.register_buffer("columns", _resizing(phi.shape[1], TACTILE_SHAPE[1]).T.contiguous())

    def forward(self, pixels: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
        drawn = (self.network(2.0 * pixels - 1.0) + 1.0) * (self.full_scale / 2.0)
        counts = self.phi.from_torch(drawn).clamp(0.0, self.full_scale)
        return counts, (self.rows @ drawn[:, 0] @ self.columns).clamp(min=0.0)


def _resizing(size: int, new: int) -> torch.Tensor:
    """(new, size): the bilinear resize of `counts_and_tactile_images` along one side, as a product.

    ONNX's own Resize has no antialiasing in the version of its operators that is written.
    """
    unit = torch.eye(size)[None, None]
    return functional.interpolate(unit, (new, size), mode="bilinear", antialias=True)[0, 0]


def _adversarial(logits: torch.Tensor, label: float) -> torch.Tensor:
    logits = logits.float()
    return functional.binary_cross_entropy_with_logits(logits, torch.full_like(logits, label))
