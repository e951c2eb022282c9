"""ResNet18 (He et al. 2016), with torchvision's parameter names.

Weights of torchvision's resnet18 load with `load_state_dict`.
"""

import torch
from torch import nn

from t2twin.core.errors import T2TwinError

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
        self.downsample = (
            nn.Sequential(nn.Conv2d(channels, width, 1, stride, bias=False), nn.BatchNorm2d(width))
            if stride != 1 or channels != width
            else None
        )

    def forward(self, x: torch.Tensor) -> torch.Tensor:
        skip = x if self.downsample is None else self.downsample(x)
        x = self.bn1(self.conv1(x)).relu_()
        return self.bn2(self.conv2(x)).add_(skip).relu_()


class ResNet18(nn.Module):
    """ResNet18 with `outputs` output values; 0 leaves out the pooling and the last layer.

    filters: base width, 64 in the published network, which has 11,689,512 parameters at 1000
    outputs. channels: of the images. Raises T2TwinError for fewer than MIN_FILTERS.
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
