"""ResNet18 (He et al. 2016) from the picture of a reading to the counts (Grella et al. 2023).

Parameters have torchvision's names: weights of its resnet18 load with `load_state_dict`.

Shape letters: B batch, S image side, N taxels.
"""

from functools import cached_property

import torch
from torch import nn
from torch.nn import functional

from t2twin.core.errors import T2TwinError
from t2twin.sim.taxels.phi import Phi
from t2twin.translate.data.pairs import DataInfo, Examples
from t2twin.translate.models.base import TACTILE_IMAGES, Outputs, Translator, adamw
from t2twin.translate.models.presets import Preset

# Minimum base width. Below it, oneDNN (PyTorch 2.13, AVX-512) writes outside its buffer in the
# backward pass of strided 1 x 1 convolutions, if its threads divide a batch unevenly. Measured
# with a guard page after every tensor
MIN_FILTERS = 16


class BasicBlock(nn.Module):
    """Two 3 x 3 convolutions with a skip connection."""

    def __init__(self, channels: int, width: int, stride: int):
        super().__init__()
        self.conv1 = nn.Conv2d(channels, width, 3, stride, 1, bias=False)
        self.bn1 = nn.BatchNorm2d(width)
        self.conv2 = nn.Conv2d(width, width, 3, 1, 1, bias=False)
        self.bn2 = nn.BatchNorm2d(width)
        self.downsample = None
        if stride != 1 or channels != width:
            convolution = nn.Conv2d(channels, width, 1, stride, bias=False)
            self.downsample = nn.Sequential(convolution, nn.BatchNorm2d(width))

    def forward(self, x: torch.Tensor) -> torch.Tensor:
        skip = x if self.downsample is None else self.downsample(x)
        x = self.bn1(self.conv1(x)).relu_()
        return self.bn2(self.conv2(x)).add_(skip).relu_()


class ResNet18(nn.Module):
    """ResNet18 with `outputs` output values; 0 leaves out the pooling and the last layer.

    filters: base width, 64 in the published network. channels: of the images.
    """

    def __init__(self, outputs: int, filters: int = 64, channels: int = 3):
        super().__init__()
        if filters < MIN_FILTERS:
            raise T2TwinError(
                f"the base width of a ResNet18 is {filters}; expected at least {MIN_FILTERS}"
            )
        self.conv1 = nn.Conv2d(channels, filters, 7, 2, 3, bias=False)
        self.bn1 = nn.BatchNorm2d(filters)
        self.maxpool = nn.MaxPool2d(3, 2, 1)
        self.layer1 = _stage(filters, filters, stride=1)
        self.layer2 = _stage(filters, 2 * filters, stride=2)
        self.layer3 = _stage(2 * filters, 4 * filters, stride=2)
        self.layer4 = _stage(4 * filters, 8 * filters, stride=2)
        if outputs:
            self.avgpool = nn.AdaptiveAvgPool2d(1)
            self.fc = nn.Linear(8 * filters, outputs)
        for module in self.modules():
            if isinstance(module, nn.Conv2d):
                nn.init.kaiming_normal_(module.weight, mode="fan_out", nonlinearity="relu")

    def forward(self, images: torch.Tensor) -> torch.Tensor:
        """(B, channels, S, S) -> (B, outputs)."""
        return self.fc(self.avgpool(self.maps(images)[-1]).flatten(1))

    def maps(self, images: torch.Tensor) -> tuple[torch.Tensor, ...]:
        """Outputs of the first layer and of the four stages, with sides S / 2 to S / 32."""
        found = [self.bn1(self.conv1(images)).relu_()]
        found.append(self.layer1(self.maxpool(found[-1])))
        for stage in (self.layer2, self.layer3, self.layer4):
            found.append(stage(found[-1]))
        return tuple(found)


def _stage(channels: int, width: int, stride: int) -> nn.Sequential:
    return nn.Sequential(BasicBlock(channels, width, stride), BasicBlock(width, width, 1))


class ResNet18Translator(Translator):
    """One network, which predicts the counts of the layout that it was trained on."""

    def __init__(self, preset: Preset, info: DataInfo, device: torch.device, bf16: bool) -> None:
        self.network = ResNet18(info.array.x_mm.size, preset.filters)
        super().__init__(preset, info, device, bf16, {"resnet18": self.network})

    @cached_property
    def optimizers(self) -> dict[str, torch.optim.Optimizer]:
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
