"""ResNet18 from the picture of a reading to the counts, trained on L3 (Grella et al. 2023).

Shape letters: B batch, S image side, N taxels, R rows and C columns of a tactile image.
"""

from copy import deepcopy
from functools import cached_property

import torch
from torch import nn
from torch.nn import functional

from t2twin.sim.taxels.phi import Phi
from t2twin.translate.data.images import RGB_MEAN, RGB_STD
from t2twin.translate.data.pairs import DataInfo, Examples
from t2twin.translate.models.base import CountsTranslator, adamw
from t2twin.translate.models.presets import Preset
from t2twin.translate.networks.resnet18 import ResNet18


class ResNet18Translator(CountsTranslator):
    """One network, which predicts the counts of the layout that it was trained on."""

    def __init__(self, preset: Preset, info: DataInfo, device: torch.device, bf16: bool) -> None:
        self.network = ResNet18(info.array.x_mm.size, preset.filters)
        super().__init__(preset, info, device, bf16, {"resnet18": self.network})

    def make_optimizers(self) -> dict[str, torch.optim.Optimizer]:
        """See Translator."""
        return {"resnet18": adamw(self.network.parameters(), self.preset)}

    def optimize(self, examples: Examples) -> dict[str, torch.Tensor]:
        """One step on L3, the mean squared error of the counts as a fraction of full scale.

        images: (B, 3, S, S) normalized. Returns the loss by name.
        """
        with self.precision():
            predicted = self.network(examples.images.to(self.device))
        targets = examples.targets.to(self.device) / self.full_scale
        loss = functional.mse_loss(predicted.float(), targets)
        self.descend(loss, self.network, "resnet18")
        return {"l3": loss.detach()}

    def predict(self, images: torch.Tensor) -> torch.Tensor:
        """See CountsTranslator. images: (B, 3, S, S)."""
        return (self.outputs(images).float() * self.full_scale).clamp(0.0, self.full_scale)

    @cached_property
    def phi(self) -> Phi:
        """phi of its layout at the full size of a tactile image."""
        return self.info.array.phi

    def counts_and_tactile_images(self, images: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
        """See CountsTranslator. The tactile images are phi of the counts."""
        counts = self.predict(images)
        return counts, torch.from_numpy(self.phi(counts.cpu().numpy()))

    def as_module(self) -> nn.Module:
        """See CountsTranslator."""
        return _FromPixels(self.predictor, self.phi, self.full_scale)


class _FromPixels(nn.Module):
    """From RGB pixels in [0, 1] to counts and tactile images, in float32 on the CPU."""

    mean: torch.Tensor
    std: torch.Tensor

    def __init__(self, network: nn.Module, phi: Phi, full_scale: float) -> None:
        super().__init__()
        self.network = deepcopy(network).cpu()
        self.phi = phi
        self.full_scale = full_scale
        self.register_buffer("mean", torch.from_numpy(RGB_MEAN).view(3, 1, 1))
        self.register_buffer("std", torch.from_numpy(RGB_STD).view(3, 1, 1))

    def forward(self, pixels: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
        counts = self.network((pixels - self.mean) / self.std) * self.full_scale
        counts = counts.clamp(0.0, self.full_scale)
        return counts, self.phi.to_torch(counts)[:, 0]
