"""ResNet18 from the picture of a reading to the counts, trained on L3 (Grella et al. 2023).

Shape letters: B batch, S image side, N taxels.
"""

from functools import cached_property

import torch
from torch.nn import functional

from t2twin.sim.taxels.phi import Phi
from t2twin.translate.data.pairs import DataInfo, Examples
from t2twin.translate.models.base import TACTILE_IMAGES, Outputs, Translator, adamw
from t2twin.translate.models.presets import Preset
from t2twin.translate.networks.resnet18 import ResNet18


class ResNet18Translator(Translator):
    """One network, which predicts the counts of the layout that it was trained on."""

    def __init__(self, preset: Preset, info: DataInfo, device: torch.device, bf16: bool) -> None:
        self.network = ResNet18(info.array.x_mm.size, preset.filters)
        super().__init__(preset, info, device, bf16, {"resnet18": self.network})

    @cached_property
    def optimizers(self) -> dict[str, torch.optim.Optimizer]:
        """See Translator."""
        return {"resnet18": adamw(self.network.parameters(), self.preset)}

    def step(self, examples: Examples) -> Outputs:
        """One step on L3, the mean squared error of the counts as a fraction of full scale."""
        with self.precision():
            predicted = self.network(examples.images.to(self.device))
        targets = examples.targets.to(self.device) / self.full_scale
        loss = functional.mse_loss(predicted.float(), targets)
        self.descend(loss, self.network, "resnet18")
        return {"l3": loss.detach()}

    def read(self, outputs: torch.Tensor) -> Outputs:
        """See Translator. outputs: (B, N), fractions of full scale."""
        return {"counts": (outputs.float() * self.full_scale).clamp(0.0, self.full_scale)}

    @cached_property
    def phi(self) -> Phi:
        """phi of its layout at the full size of a tactile image."""
        return self.info.array.phi

    def tactile_images(self, found: Outputs) -> Outputs:
        """See Translator: phi of the counts."""
        return {TACTILE_IMAGES: self.phi.to_torch(found["counts"])[:, 0]}
