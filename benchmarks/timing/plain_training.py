"""The plain reference for the benchmark `training`: a dataset that decodes each image every time it
is requested, and training steps in float32 with Adam."""

import io
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import torch
from PIL import Image
from torch import nn
from torch.utils.data import Dataset

from t2twin.sim.taxels.phi import Phi
from t2twin.translate.data.images import RGB_MEAN, RGB_STD
from t2twin.translate.data.pairs import DataInfo
from t2twin.translate.models.presets import Preset
from t2twin.translate.networks.pix2pix import PatchGAN, UNet
from t2twin.translate.networks.resnet18 import ResNet18


class PngPairs(Dataset):
    """A split's pairs, decoded when they are asked for: image (c, S, S) and counts (N,)."""

    def __init__(self, data_dir: Path, split: str, preset: Preset) -> None:
        self.preset = preset
        self.rows = []
        for path in sorted((data_dir / split).glob("*.parquet")):
            self.rows += pq.read_table(path, columns=["image", "taxels"]).to_pylist()

    def __len__(self) -> int:
        return len(self.rows)

    def __getitem__(self, index: int) -> tuple[torch.Tensor, torch.Tensor]:
        row, size = self.rows[index], (self.preset.size, self.preset.size)
        with Image.open(io.BytesIO(row["image"]["bytes"])) as image:
            pixels = image.convert("L" if self.preset.grey else "RGB").resize(
                size, Image.Resampling.BILINEAR
            )
        scaled = np.asarray(pixels, dtype=np.float32) / 255.0
        scaled = 2.0 * scaled[:, :, None] - 1.0 if self.preset.grey else _normalized(scaled)
        counts = torch.tensor(row["taxels"], dtype=torch.float32)
        return torch.from_numpy(np.ascontiguousarray(scaled.transpose(2, 0, 1))), counts


class PlainResNet18:
    """Regression on the counts in parts of full scale."""

    def __init__(self, preset: Preset, info: DataInfo) -> None:
        self.full_scale = info.array.full_scale_counts
        self.network = ResNet18(info.array.x_mm.size, preset.filters)
        self.networks: list[nn.Module] = [self.network]
        self.optimizer = _adam(self.network, preset)

    def step(self, images: torch.Tensor, counts: torch.Tensor) -> None:
        self.optimizer.zero_grad()
        loss = nn.functional.mse_loss(self.network(images), counts / self.full_scale)
        loss.backward()
        self.optimizer.step()
        loss.item()

    def predict(self, images: torch.Tensor) -> torch.Tensor:
        return self.network(images) * self.full_scale


class PlainTouch2Touch:
    """pix2pix: the discriminator's step, then the generator's."""

    def __init__(self, preset: Preset, info: DataInfo) -> None:
        self.full_scale, self.l1_weight = info.array.full_scale_counts, preset.l1_weight
        self.phi = Phi(info.array.x_mm, info.array.y_mm).resized((preset.size, preset.size))
        self.generator = UNet(preset.size, preset.filters)
        self.discriminator = PatchGAN(filters=preset.filters)
        self.networks: list[nn.Module] = [self.generator, self.discriminator]
        self.generator_adam = _adam(self.generator, preset)
        self.discriminator_adam = _adam(self.discriminator, preset)
        self.adversarial = nn.BCEWithLogitsLoss()

    def step(self, images: torch.Tensor, counts: torch.Tensor) -> None:
        real = self.phi.to_torch(counts) * (2.0 / self.full_scale) - 1.0
        fake = self.generator(images)

        self.discriminator_adam.zero_grad()
        of_real = self.discriminator(images, real)
        of_fake = self.discriminator(images, fake.detach())
        discriminator_loss = 0.5 * (
            self.adversarial(of_real, torch.ones_like(of_real))
            + self.adversarial(of_fake, torch.zeros_like(of_fake))
        )
        discriminator_loss.backward()
        self.discriminator_adam.step()

        self.generator_adam.zero_grad()
        for parameter in self.discriminator.parameters():
            parameter.requires_grad = False
        of_fake = self.discriminator(images, fake)
        loss = self.adversarial(of_fake, torch.ones_like(of_fake))
        loss = loss + self.l1_weight * nn.functional.l1_loss(fake, real)
        loss.backward()
        for parameter in self.discriminator.parameters():
            parameter.requires_grad = True
        self.generator_adam.step()
        discriminator_loss.item()
        loss.item()

    def predict(self, images: torch.Tensor) -> torch.Tensor:
        return self.phi.from_torch((self.generator(images) + 1.0) * (self.full_scale / 2.0))


def _adam(network: nn.Module, preset: Preset) -> torch.optim.Adam:
    return torch.optim.Adam(
        network.parameters(), preset.learning_rate, (preset.beta1, preset.beta2)
    )


def _normalized(pixels: np.ndarray) -> np.ndarray:
    return (pixels - RGB_MEAN) / RGB_STD
