"""Training throughput: `t2twin train` against the loop that one would write first.

    python -m benchmarks.training [--data DIR]

The same networks at preset cpu, with the same batch, on the same pairs, turn by turn on the same
machine. The plain loop computes in float32 on contiguous tensors, takes every picture from its PNG
in the Parquet files anew each epoch through a DataLoader, and steps with Adam as it comes. It runs
in a process of its own, whose memory is as the system sets it, and leaves out the augmentation that
the preset asks of t2twin. An epoch of either ends with the validation, which is in its time; the
first decoding, the estimate and saving are not. Beside it stands the share of t2twin's time that
goes into having the batches ready, read and jittered. Without --data a data set of scale smoke is
made for it. Last, some steps of preset paper are timed, for the hours that all of it would take
here.
"""

import io
import statistics
import tempfile
import time
from argparse import Namespace
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow.parquet as pq
import torch
from PIL import Image
from torch import nn
from torch.utils.data import DataLoader, Dataset

from benchmarks.declared import TRAINING
from benchmarks.evidence.run import main
from t2twin.primitives_cad import catalogue
from t2twin.sim.cyskin.phi import Phi
from t2twin.sim.dataset.generate import make_dataset
from t2twin.sim.world import protocol
from t2twin.translate.data.images import RGB_MEAN, RGB_STD
from t2twin.translate.data.pairs import DataInfo, Examples, load_info, load_pairs
from t2twin.translate.models.distributed import use_all_cores
from t2twin.translate.models.presets import PAPER_MODELS, PRESETS, Model, Preset
from t2twin.translate.networks.pix2pix import PatchGAN, UNet
from t2twin.translate.networks.resnet18 import ResNet18
from t2twin.translate.runs.build import TRANSLATORS, has_bf16
from t2twin.translate.runs.log import read_log
from t2twin.translate.training.train import train
from t2twin.translate.training.trainer import load_examples

PRESET = "cpu"
ROUNDS = 3
MIN_STEPS = 24
"""Steps of a round, at least; as many epochs as that takes."""
PAPER_STEPS = 3
"""Timed steps of preset paper, after one that is not counted."""


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
        self.full_scale = info.full_scale_counts
        self.network = ResNet18(info.x_mm.size, preset.filters)
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
        self.full_scale, self.l1_weight = info.full_scale_counts, preset.l1_weight
        self.phi = Phi(info.x_mm, info.y_mm).resized((preset.size, preset.size))
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


def measure(options: Namespace) -> dict[str, Any]:
    with tempfile.TemporaryDirectory() as temporary:
        folder = Path(temporary)
        data_dir = options.data or folder / "data"
        if options.data is None:
            make_dataset(data_dir, "smoke", seed=0)
        models = {
            model: _measure(model, data_dir, folder)
            | {"paper_preset_hours": _paper_hours(model, load_info(data_dir))}
            for model in PAPER_MODELS
        }
    return {
        "threads": torch.get_num_threads(),
        "preset": PRESET,
        "bf16": has_bf16(),
        "rounds": ROUNDS,
        "models": models,
    }


def _measure(model: Model, data_dir: Path, folder: Path) -> dict[str, Any]:
    """Images a second of both, the medians of the rounds, and the median of the rounds' ratios."""
    preset = PRESETS[model][PRESET]
    splits = {split: PngPairs(data_dir, split, preset) for split in ("train", "val")}
    steps = len(splits["train"]) // preset.batch
    epochs = -(-MIN_STEPS // steps)
    ours, plain = [], []
    with ProcessPoolExecutor(1, get_context("spawn")) as apart:
        for number in range(ROUNDS):
            ours.append(_ours(model, data_dir, folder / f"{model}-{number}", epochs))
            round_ = apart.submit(_plain, model, preset, splits, load_info(data_dir), epochs)
            plain.append(round_.result())
    images = epochs * steps * preset.batch
    return {
        "pairs": len(splits["train"]),
        "validated_on": len(splits["val"]),
        "batch": preset.batch,
        "steps_a_round": epochs * steps,
        "images_a_second": images / statistics.median(ours),
        "plain_images_a_second": images / statistics.median(plain),
        "ratio": statistics.median(slow / fast for slow, fast in zip(plain, ours, strict=True)),
        "loading_share": epochs * steps * _loading(preset, data_dir) / statistics.median(ours),
    }


def _loading(preset: Preset, data_dir: Path) -> float:
    """Seconds in which t2twin has a batch ready, the median of a round's."""
    pairs = load_pairs(data_dir, "train", preset.size, preset.grey)
    rng = np.random.default_rng(0)
    seconds = []
    for _ in range(MIN_STEPS):
        started = time.perf_counter()
        load_examples(pairs, rng.permutation(len(pairs))[: preset.batch], preset, rng)
        seconds.append(time.perf_counter() - started)
    return statistics.median(seconds)


def _paper_hours(model: Model, info: DataInfo) -> float:
    """Hours that the steps of preset paper take on the paper's training set, if none is spared."""
    preset, scale = PRESETS[model]["paper"], protocol.scale_of("paper")
    pairs = sum(
        len(protocol.indices(name, scale))
        for name in catalogue.PRIMITIVES
        if catalogue.split(name) == "train"
    )
    bf16 = preset.bf16 and has_bf16()
    translator = TRANSLATORS[model](preset, info, torch.device("cpu"), bf16)
    images = torch.zeros(preset.batch, 1 if preset.grey else 3, preset.size, preset.size)
    counts = torch.zeros(preset.batch, info.x_mm.size)
    translator.step(Examples(images, counts))
    started = time.perf_counter()
    for _ in range(PAPER_STEPS):
        translator.step(Examples(images, counts))
    step_seconds = (time.perf_counter() - started) / PAPER_STEPS
    return preset.epochs * (pairs // preset.batch) * step_seconds / 3600


def _ours(model: Model, data_dir: Path, run_dir: Path, epochs: int) -> float:
    """Seconds of the epochs by the run's own log."""
    train(model, data_dir, PRESET, run_dir, epochs=epochs)
    return sum(record.seconds for record in read_log(run_dir))


def _plain(
    model: Model, preset: Preset, splits: dict[str, PngPairs], info: DataInfo, epochs: int
) -> float:
    """Seconds of the same epochs in the plain loop."""
    use_all_cores()
    loader = DataLoader(splits["train"], preset.batch, shuffle=True, drop_last=True)
    validation = DataLoader(splits["val"], preset.batch)
    kind = PlainTouch2Touch if model == "touch2touch" else PlainResNet18
    translator = kind(preset, info)
    started = time.perf_counter()
    for _ in range(epochs):
        for network in translator.networks:
            network.train()
        for images, counts in loader:
            translator.step(images, counts)
        for network in translator.networks:
            network.eval()
        squares = 0.0
        with torch.no_grad():
            for images, counts in validation:
                squares += (translator.predict(images) - counts).square().sum().item()
    return time.perf_counter() - started


def _adam(network: nn.Module, preset: Preset) -> torch.optim.Adam:
    return torch.optim.Adam(
        network.parameters(), preset.learning_rate, (preset.beta1, preset.beta2)
    )


def _normalized(pixels: np.ndarray) -> np.ndarray:
    return (pixels - RGB_MEAN) / RGB_STD


if __name__ == "__main__":
    main(TRAINING)
