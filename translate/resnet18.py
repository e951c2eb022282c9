"""ResNet18 from the DIGIT image straight to the counts, trained on L3 (Grella et al. 2023).

Shape letters: B batch, S image side, N taxels.
"""

import torch
from torch import nn
from torch.nn import functional

from t2twin.translate.data.pairs import DataInfo
from t2twin.translate.distributed import average_gradients
from t2twin.translate.networks.resnet18 import ResNet18
from t2twin.translate.presets import Preset


class ResNet18Translator:
    """The network, its optimiser, and one step of training.

    networks, optimizers: by name. predictor: the network that is kept to predict with.
    """

    def __init__(self, preset: Preset, info: DataInfo, device: torch.device, bf16: bool) -> None:
        self.full_scale = info.full_scale_counts
        self.device = device
        self.bf16 = bf16
        self.predictor = ResNet18(info.x_mm.size, preset.filters)
        self.predictor.to(device, memory_format=torch.channels_last)  # pyright: ignore[reportCallIssue]
        self.networks: dict[str, nn.Module] = {"resnet18": self.predictor}
        self.optimizers: dict[str, torch.optim.Optimizer] = {
            "resnet18": torch.optim.Adam(
                self.predictor.parameters(),
                preset.learning_rate,
                (preset.beta1, preset.beta2),
                fused=True,  # five times as fast on a CPU
            )
        }

    def step(self, images: torch.Tensor, counts: torch.Tensor) -> dict[str, float]:
        """One step on L3, the mean squared error, of counts in parts of full scale.

        images: (B, 3, S, S) normalised. counts: (B, N). Returns the loss by name.
        """
        optimizer = self.optimizers["resnet18"]
        optimizer.zero_grad()
        with self._precision():
            predicted = self.predictor(images.to(self.device))
        loss = functional.mse_loss(predicted.float(), counts.to(self.device) / self.full_scale)
        loss.backward()
        average_gradients(self.predictor)
        optimizer.step()
        return {"l3": float(loss.detach())}

    def predict(self, images: torch.Tensor) -> torch.Tensor:
        """(B, 3, S, S) -> counts (B, N), within nought and full scale. In evaluation mode."""
        self.predictor.eval()
        with torch.inference_mode(), self._precision():
            predicted = self.predictor(images.to(self.device))
        return (predicted.float() * self.full_scale).clamp(0.0, self.full_scale)

    def _precision(self) -> torch.autocast:
        return torch.autocast(self.device.type, torch.bfloat16, enabled=self.bf16)
