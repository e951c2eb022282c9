"""Base classes of the translators, what training and prediction need, and their optimizers.

A translator gets pictures of the source's readings (data.sides).

The weight average of a network predicts better than its last weights (Polyak and Juditsky 1992; for
GAN generators Yazıcı et al. 2019). Its window grows with the number of steps (Karras et al. 2024,
section 3.1).

Shape letters: B batch, c channels and S side of the input pictures, N taxels, R rows and C columns
of a tactile image.
"""

from abc import ABC, abstractmethod
from collections.abc import Iterable, Sequence
from copy import copy
from functools import cached_property
from typing import Any, Self

import numpy as np
import torch
from torch import nn
from torch.optim.swa_utils import AveragedModel

from t2twin.sim.taxels.layout import Layout
from t2twin.translate.data.images import WHITE_GREY, to_input
from t2twin.translate.data.pairs import DataInfo, Examples, Pairs
from t2twin.translate.models.distributed import average_gradients
from t2twin.translate.models.presets import Preset


class Translator(ABC):
    """The networks of one model with their optimizers, as training and checkpoints need them.

    networks: all trained networks by name, the predicting one first. average: the weight average of
    the first network, if the preset has one. predictor: the network used for prediction,
    `average.module` or the first network. device: where the networks are; inputs are moved there.
    bf16: whether networks compute in bfloat16.
    learns_dense_counts: whether training needs pairs with the dense counts.
    is_replayable: whether every step does the same, so that a GPU can replay a captured one.
    """

    learns_dense_counts = False
    is_replayable = True

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
        """By the names of their networks or of parts of them.

        Made on first use: torch imports its compiler for the first one, which takes as long as to
        import torch, and a prediction needs none.
        """
        return self.make_optimizers()

    @abstractmethod
    def make_optimizers(self) -> dict[str, torch.optim.Optimizer]:
        """New optimizers of all weights that are trained, as `optimizers` names them."""

    def step(self, examples: Examples) -> dict[str, torch.Tensor]:
        """Takes one step on a batch of pairs. Returns the losses by name."""
        losses = self.optimize(examples)
        self.update_average()
        return losses

    @abstractmethod
    def optimize(self, examples: Examples) -> dict[str, torch.Tensor]:
        """The part of a step before the weight average. Returns the losses by name."""

    def update_average(self) -> None:
        """Adds the weights after a step to the weight average, if there is one."""
        if self.average is not None:
            self.average.update_parameters(next(iter(self.networks.values())))

    @abstractmethod
    def errors(self, pixels: torch.Tensor, truth: torch.Tensor) -> torch.Tensor:
        """Predictions minus targets, (B, n), in the unit of the target: counts or grey levels.

        pixels: (B, S, S, c), from 0 to 255. truth: (B, N) counts or (B, S, S, c) uint8. The
        predictor is in evaluation mode afterwards.
        """

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
        """Geometric mean of the shear force's relative error over the pairs that have moved.

        None if it is not predicted or no pair has moved.
        """
        return None

    def contact_error(self, pairs: Pairs) -> float | None:
        """Mean over the presses of the RMSE of the depth in the contact, mm; None if it is not
        predicted or no press has contact maps."""
        return None

    def in_float32(self) -> Self:
        """The same networks, computing in float32."""
        other = copy(self)
        other.bf16 = False
        return other

    def outputs(self, inputs: torch.Tensor) -> Any:
        """The predictor's outputs in evaluation mode."""
        self.predictor.eval()
        with torch.inference_mode(), self.precision():
            return self.predictor(inputs.to(self.device))

    def descend(self, loss: torch.Tensor, network: nn.Module, *optimizers: str) -> None:
        """Takes a step of some optimizers, all of weights of a network, down a loss."""
        for name in optimizers:
            self.optimizers[name].zero_grad()
        loss.backward()
        average_gradients(network)
        for name in optimizers:
            self.optimizers[name].step()

    def set_rates(self, share: float) -> None:
        """Sets the learning rates of all optimizers. share: factor of the initial ones."""
        for optimizer in self.optimizers.values():
            rate = share * optimizer.defaults["lr"]
            for group in optimizer.param_groups:
                if isinstance(group["lr"], torch.Tensor):
                    group["lr"].fill_(rate)
                else:
                    group["lr"] = rate

    def precision(self) -> torch.autocast:
        """Context in which the networks compute.

        In bfloat16, weights and the statistics of batch norm remain float32. Losses are computed
        outside of this context, in float32.
        """
        return torch.autocast(self.device.type, torch.bfloat16, enabled=self.bf16)


class CountsTranslator(Translator):
    """A translator to counts.

    Input images are as `to_input` returns them, (B, c, S, S) float32; counts are (B, N) float32,
    within zero and full scale. reads_any_layout: whether it has a spatial output, an image
    or dense counts, which `read_at` reads.
    """

    reads_any_layout = False

    def read_at(self, layout: Layout) -> "CountsTranslator":
        """The same networks with counts of another layout.

        Raises T2TwinError for a layout that phi cannot interpolate, and for one that the spatial
        output does not cover or does not resolve.
        """
        raise NotImplementedError

    @abstractmethod
    def predict(self, images: torch.Tensor) -> torch.Tensor:
        """Counts. The predictor is in evaluation mode afterwards."""

    @abstractmethod
    def counts_and_tactile_images(self, images: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
        """Counts as `predict` returns them, and tactile images, (B, R, C) float32, counts."""

    @abstractmethod
    def as_module(self) -> nn.Module:
        """The whole prediction as one module in float32 on the CPU, ready for tracing.

        It maps (B, c, S, S) pixels in [0, 1], grey or RGB, to counts and tactile images, (B, R, C),
        counts. Its networks are copies.
        """

    def errors(self, pixels: torch.Tensor, truth: torch.Tensor) -> torch.Tensor:
        return self.predict(self.to_input(pixels.float() / WHITE_GREY)) - truth.to(self.device)


def adamw(
    weights: Iterable[nn.Parameter], preset: Preset, rate_share: float = 1.0
) -> torch.optim.Optimizer:
    """AdamW (Loshchilov and Hutter 2019) for the weights of a network, or of a part of it.

    rate_share: factor of the preset's learning rate. On a GPU, learning rates are tensors, so that
    a captured step can be replayed with another one.
    """
    weights = list(weights)
    on_gpu = weights[0].is_cuda
    optimizer = torch.optim.AdamW(
        weights,
        preset.learning_rate * rate_share,
        (preset.beta1, preset.beta2),
        weight_decay=preset.weight_decay,
        capturable=on_gpu,
        fused=True,  # five times as fast on a CPU
    )
    if on_gpu:
        for group in optimizer.param_groups:
            group["lr"] = torch.tensor(group["lr"], device=weights[0].device)
    return optimizer


def weight_average(network: nn.Module, part: float) -> AveragedModel | None:
    """An average of a network's weights over a share of the steps so far.

    part: 1 for the mean of all steps, 0 for none (returns None). Step n, added by
    `update_parameters(network)`, has weight 1 / (n part), so that the final weights of steps are
    proportional to n^(1 / part - 1). Batch norm's statistics are averaged too.
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
