"""Base class of the translators: what training, checkpoints and predictions need of a model.

Shape letters: B batch, c channels and S side of the input pictures, N taxels, R rows and C columns
of a tactile image.
"""

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable, Sequence
from copy import copy, deepcopy
from functools import cached_property
from typing import Any, Self

import numpy as np
import torch
from torch import nn
from torch.optim.swa_utils import AveragedModel

from t2twin.sim.taxels.layout import Layout
from t2twin.translate.data.images import RGB_MEAN, RGB_STD, WHITE_GREY, to_input
from t2twin.translate.data.pairs import DataInfo, Examples, Pairs
from t2twin.translate.models.distributed import average_gradients
from t2twin.translate.models.presets import Preset

# Predictions for B pictures by name: "counts", (B, N), or "image", (B, S, S, c) in grey levels
Outputs = dict[str, torch.Tensor]
TACTILE_IMAGES = "tactile_images"


class Translator(ABC):
    """The networks of one model with their optimizers, losses and predictions.

    networks: all trained networks by name, the predicting one first. average: its weight average,
    if the preset has one, which predicts then. is_contact_alone: whether only the contact's layers
    are trained. mean, std: of the pictures, which the network gets normalized.
    """

    learns_dense_counts = reads_any_layout = is_contact_alone = False
    mean, std = RGB_MEAN, RGB_STD

    def __init__(
        self,
        preset: Preset,
        info: DataInfo,
        device: torch.device,
        bf16: bool,
        networks: dict[str, nn.Module],
    ) -> None:
        self.preset = preset
        self.info = info
        self.full_scale = info.target.full_scale
        self.device = device
        self.bf16 = bf16
        self.networks = networks
        for network in networks.values():
            network.to(device, memory_format=torch.channels_last)  # pyright: ignore[reportCallIssue]
        first = next(iter(networks.values()))
        self.average = weight_average(first, preset.averaged_part)
        self.predictor: nn.Module = self.average.module if self.average else first

    @cached_property
    def optimizers(self) -> dict[str, torch.optim.Optimizer]:
        """By name; made on first use, for which torch imports its compiler."""
        return self.make_optimizers()

    @abstractmethod
    def make_optimizers(self) -> dict[str, torch.optim.Optimizer]:
        """New optimizers of all weights that are trained."""

    def step(self, examples: Examples) -> dict[str, torch.Tensor]:
        """Takes one step on a batch of pairs. Returns the losses by name."""
        losses = self.optimize(examples)
        if self.average is not None:
            self.average.update_parameters(next(iter(self.networks.values())))
        return losses

    @abstractmethod
    def optimize(self, examples: Examples) -> dict[str, torch.Tensor]:
        """The part of a step before the weight average. Returns the losses by name."""

    def predict_all(
        self, images: torch.Tensor, with_contact: bool = False, with_features: bool = False
    ) -> Outputs:
        """The predictions of one pass of `to_input`; the flags are for field runs."""
        with torch.inference_mode():
            return self.read(self.outputs(images))

    @abstractmethod
    def read(self, outputs: Any) -> Outputs:
        """The predictions from the outputs of the predictor."""

    @abstractmethod
    def tactile_images(self, found: Outputs) -> Outputs:
        """Tactile images, (B, R, C), counts, of predictions with counts, by TACTILE_IMAGES."""

    def predict(self, images: torch.Tensor) -> torch.Tensor:
        """Counts within zero and full scale, or images, of `to_input`."""
        return self.predict_all(images)[self.info.target.value]

    def errors(self, pixels: torch.Tensor, truth: torch.Tensor) -> torch.Tensor:
        """Predictions minus targets, (B, n), counts or grey levels. pixels: from 0 to 255."""
        predicted = self.predict(self.to_input(pixels.float() / WHITE_GREY))
        return (predicted - truth.to(self.device)).flatten(1)

    def to_input(self, pixels: np.ndarray | torch.Tensor) -> torch.Tensor:
        """The network's input, (B, c, S, S), of pictures, (B, S, S, c) float32 in [0, 1]."""
        return to_input(pixels)

    def prepare(self, pairs: Pairs) -> None:
        """Sets buffers from the training pairs before the first step; by default none."""
        return

    def calibrate(self, *sets: Pairs) -> None:
        """Fits the uncertainty of the predictor to held-out pairs; by default there is none."""
        return

    def shear_error(self, pairs: Pairs) -> float | None:
        """Geometric mean of the relative error of pairs that have moved; None without."""
        return None

    def contact_error(self, pairs: Pairs) -> float | None:
        """Mean over the presses of the RMSE of the depth in the contact, mm; None without."""
        return None

    def read_at(self, layout: Layout) -> Self:
        """The same networks with counts of another layout, if `reads_any_layout`."""
        raise NotImplementedError

    def in_float32(self) -> Self:
        """The same networks, computing in float32."""
        other = copy(self)
        other.bf16 = False
        return other

    def outputs(self, inputs: torch.Tensor) -> Any:
        """The predictor's outputs in evaluation mode."""
        return self.evaluate(self.predictor, inputs.to(self.device))

    def evaluate(self, function: Callable[..., Any], *inputs: Any) -> Any:
        """The result of the predictor, or of a part of it, in evaluation mode."""
        self.predictor.eval()
        with torch.inference_mode(), self.precision():
            return function(*inputs)

    def descend(self, loss: torch.Tensor, network: nn.Module, *optimizers: str) -> None:
        """Takes a step of some optimizers of a network's weights down a loss."""
        for name in optimizers:
            self.optimizers[name].zero_grad()
        loss.backward()
        average_gradients(network)
        for name in optimizers:
            self.optimizers[name].step()

    def set_rates(self, share: float) -> None:
        """Sets the learning rates to a share of the initial ones."""
        for optimizer in self.optimizers.values():
            for group in optimizer.param_groups:
                group["lr"] = share * optimizer.defaults["lr"]

    def precision(self) -> torch.autocast:
        """Context in which the networks compute; losses are computed outside, in float32."""
        return torch.autocast(self.device.type, torch.bfloat16, enabled=self.bf16)

    def as_module(self) -> "FromPixels":
        """The whole prediction as one module in float32 on the CPU, ready for tracing."""
        return FromPixels(self._on_cpu())

    def _on_cpu(self) -> Self:
        """A copy that predicts in float32 on the CPU."""
        other = self.in_float32()
        other.device, other.predictor = torch.device("cpu"), deepcopy(self.predictor).cpu()
        return other


class FromPixels(nn.Module):
    """From pixels in [0, 1], (B, c, S, S), to the predictions in `names`."""

    mean: torch.Tensor
    std: torch.Tensor

    def __init__(self, translator: Translator) -> None:
        super().__init__()
        self.translator, self.network = translator, translator.predictor
        self.names: list[str] = []
        self.register_buffer("mean", torch.from_numpy(translator.mean).view(-1, 1, 1))
        self.register_buffer("std", torch.from_numpy(translator.std).view(-1, 1, 1))

    def forward(self, pixels: torch.Tensor) -> tuple[torch.Tensor, ...]:
        return self.in_order(self.translator.read(self.network((pixels - self.mean) / self.std)))

    def in_order(self, found: Outputs) -> tuple[torch.Tensor, ...]:
        """The counts, the tactile images and the other predictions, which `names` then names."""
        tactile = self.translator.tactile_images(found)
        every = {"counts": found["counts"]} | tactile | found
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

    def mix(
        averages: Sequence[torch.Tensor], values: Sequence[torch.Tensor], steps: torch.Tensor | int
    ) -> None:
        share = 1.0 / max(1.0, (int(steps) + 1) * part)
        for average, value in zip(averages, values, strict=True):
            if average.is_floating_point():
                average.lerp_(value, share)
            else:  # batch norm's counters
                average.copy_(value)

    average = AveragedModel(network, multi_avg_fn=mix, use_buffers=True)
    return average.requires_grad_(False)
