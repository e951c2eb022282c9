"""Base class of the translators: what training, checkpoints and predictions need of a model.

Shape letters: B batch, c channels and S side of the input pictures, N taxels, R rows and C columns
of a tactile image.
"""

from abc import ABC, abstractmethod
from collections.abc import Iterable
from copy import copy, deepcopy
from functools import cached_property
from typing import Any, Self

import numpy as np
import torch
from torch import nn
from torch.optim.swa_utils import AveragedModel

from t2twin.sim.taxels.layout import Layout
from t2twin.translate.data.images import (
    COLORS,
    RGB_MEAN,
    RGB_STD,
    WHITE_GREY,
    augment,
    on_device,
    to_input,
)
from t2twin.translate.data.pairs import DataInfo, Examples, Pairs
from t2twin.translate.models import distributed
from t2twin.translate.models.frame_check import FrameCheck
from t2twin.translate.models.presets import Preset

# Predictions for B pictures by name: "counts", (B, N), or "image", (B, S, S, c) in grey levels
Outputs = dict[str, torch.Tensor]
TACTILE_IMAGES = "tactile_images"
FEATURES = "frame_features"  # Name of the features for the frame check among the predictions


class Translator(ABC):
    """The networks of one model with their optimizers, losses and predictions.

    networks: all that are trained, by name. The first predicts, or its weight average, if any.
    """

    reads_any_layout = is_contact_alone = False  # the second: only the contact's layers are trained
    # The network's input, (B, c, S, S), of pictures, (B, S, S, c) float32 in [0, 1], and the mean
    # and standard deviation that it normalizes with
    to_input = staticmethod(to_input)
    mean, std = RGB_MEAN, RGB_STD

    def __init__(
        self, preset: Preset, info: DataInfo, device: torch.device, bf16: bool,
        networks: dict[str, nn.Module],
    ) -> None:  # fmt: skip
        self.preset, self.info, self.device, self.bf16 = preset, info, device, bf16
        self.full_scale = info.target.full_scale
        self.networks = networks
        for network in networks.values():
            network.to(device, memory_format=torch.channels_last)  # pyright: ignore[reportCallIssue]
        first = next(iter(networks.values()))
        self.average = weight_average(first, preset.averaged_part)
        self.predictor: nn.Module = self.average.module if self.average else first

    @cached_property
    @abstractmethod
    def optimizers(self) -> dict[str, torch.optim.Optimizer]:
        """By name; made on first use, for which torch imports its compiler."""

    @abstractmethod
    def step(self, examples: Examples) -> Outputs:
        """Takes one step on a batch of pairs. Returns the losses by name."""

    @abstractmethod
    def read(self, outputs: Any) -> Outputs:
        """The predictions from the outputs of the predictor."""

    def tactile_images(self, found: Outputs) -> Outputs:
        """Tactile images, (B, R, C), counts, of predictions with counts, by TACTILE_IMAGES."""
        raise NotImplementedError

    def outputs(self, inputs: torch.Tensor, *wanted: bool) -> Any:
        """The outputs of the predictor in evaluation mode. wanted: for a FieldNet, see there."""
        self.predictor.eval()
        with torch.inference_mode(), self.precision():
            return self.predictor(inputs.to(self.device))

    def predict_all(self, images: torch.Tensor, *wanted: bool) -> Outputs:
        """The predictions of one pass of `to_input`. wanted: see `outputs`."""
        with torch.inference_mode():
            return self.read(self.outputs(images, *wanted))

    def predict(self, images: torch.Tensor) -> torch.Tensor:
        """Counts within zero and full scale, or images, of `to_input`."""
        return self.predict_all(images)[self.info.target.value]

    def examples(
        self, pairs: Pairs, batch: np.ndarray, rng: np.random.Generator | None = None
    ) -> Examples:
        """The pairs with these indices, (B,); with rng, images of the source are augmented."""
        batch, preset = np.sort(batch), self.preset  # the order on disk
        pixels, target = (self._tensor(each[batch]) for each in (pairs.inputs, pairs.target))
        pixels = pixels / WHITE_GREY
        stored = (pairs.dense_counts, pairs.force_n, pairs.shear_n, pairs.contact)
        more = [None if each is None else self._tensor(each[batch]) for each in stored]
        if rng is not None and pairs.pictures is None:
            if preset.background_share and pairs.backgrounds is not None:
                drawn = rng.random(len(batch)) < preset.background_share
                replaced = on_device(np.flatnonzero(drawn), pixels.device)
                pixels[replaced, ..., :COLORS] = pixels[replaced, ..., COLORS:]
                for each in more:
                    if each is not None:
                        each[replaced] = 0.0
            if preset.brightness or preset.contrast or preset.noise or preset.drift:
                pixels = augment(
                    pixels, rng, preset.brightness, preset.contrast, preset.noise, preset.drift
                )
        return Examples(self.to_input(pixels), target, *more)

    def _tensor(self, values: np.ndarray) -> torch.Tensor:
        """On the device, float32. Images and contact maps are moved in their smaller types."""
        if values.dtype not in (np.uint8, np.float16):
            values = values.astype(np.float32, copy=False)
        return torch.from_numpy(values).to(self.device).float()

    def prepare(self, pairs: Pairs) -> None:
        """Sets buffers from the training pairs before the first step; by default none."""
        return

    def calibrate(self, *sets: Pairs) -> None:
        """Fits the uncertainty of the predictor to held-out pairs; by default there is none."""
        return

    def further_errors(self, pairs: Pairs) -> dict[str, float]:
        """Errors of pairs, by their names in EpochRecord, of which the best epoch has least too."""
        return {}

    def read_at(self, layout: Layout) -> Self:
        """The same networks with counts of another layout, if `reads_any_layout`."""
        raise NotImplementedError

    def in_float32(self) -> Self:
        """The same networks, computing in float32."""
        other = copy(self)
        other.bf16 = False
        return other

    def descend(self, loss: torch.Tensor, network: nn.Module, *optimizers: str) -> None:
        """Takes a step of some optimizers of a network's weights down a loss."""
        for name in optimizers:
            self.optimizers[name].zero_grad()
        loss.backward()
        distributed.average([p.grad for p in network.parameters() if p.grad is not None])
        for name in optimizers:
            self.optimizers[name].step()
        if self.average is not None and network is next(iter(self.networks.values())):
            self.average.update_parameters(network)

    def precision(self) -> torch.autocast:
        """Context in which the networks compute; losses are computed outside, in float32."""
        return torch.autocast(self.device.type, torch.bfloat16, enabled=self.bf16)

    def traced(self, *inputs: torch.Tensor) -> Outputs:
        """The predictions of normalized pixels, and a background frame in a field run."""
        return self.read(self.predictor(*inputs))


class FromPixels(nn.Module):
    """A whole prediction in float32 on the CPU, ready for tracing.

    From pixels in [0, 1], (B, c, S, S), and the background frame of a field run, (1, 3, S, S), to
    the counts, the tactile images, the other predictions and a check's odds. `names` names these.
    """

    mean: torch.Tensor
    std: torch.Tensor

    def __init__(self, translator: Translator, check: FrameCheck | None = None) -> None:
        super().__init__()
        self.names: list[str] = []
        self.check = check
        self.network = deepcopy(translator.predictor).cpu()
        self.translator = translator.in_float32()
        self.translator.device, self.translator.predictor = torch.device("cpu"), self.network
        self.register_buffer("mean", torch.from_numpy(translator.mean).view(-1, 1, 1))
        self.register_buffer("std", torch.from_numpy(translator.std).view(-1, 1, 1))

    def forward(self, *pixels: torch.Tensor) -> tuple[torch.Tensor, ...]:
        inputs = [(each.expand_as(pixels[0]) - self.mean) / self.std for each in pixels]
        found = self.translator.traced(*inputs)
        every = {"counts": found["counts"]} | self.translator.tactile_images(found) | found
        if self.check is not None:
            every |= self.check.odds(found[FEATURES], inputs[0])
        self.names = list(every)
        return tuple(every.values())


def adamw(
    weights: Iterable[nn.Parameter], preset: Preset, rate_share: float = 1.0
) -> torch.optim.Optimizer:
    """AdamW (Loshchilov and Hutter 2019) at a share of the preset's learning rate."""
    return torch.optim.AdamW(
        weights,
        preset.learning_rate * rate_share,
        (preset.beta1, preset.beta2),
        weight_decay=preset.weight_decay,
        fused=True,  # five times as fast on a CPU
    )


def weight_average(network: nn.Module, part: float) -> AveragedModel | None:
    """An average of a network's weights over a part of the steps so far; None for 0 (Karras 2024).

    Final weights of steps are proportional to n^(1 / part - 1); batch norm is averaged too.
    """
    if part == 0.0:
        return None

    def mix(averages: Any, values: Any, steps: torch.Tensor | int) -> None:
        share = 1.0 / max(1.0, (int(steps) + 1) * part)
        for average, value in zip(averages, values, strict=True):
            if average.is_floating_point():
                average.lerp_(value, share)
            else:  # batch norm's counters
                average.copy_(value)

    average = AveragedModel(network, multi_avg_fn=mix, use_buffers=True)
    return average.requires_grad_(False)
