"""field: from the DIGIT image to the field over the whole cover, how sure that is, and the force.

The mean is trained on the squared error alone, as a yardstick of counts asks for. The spread learns
by the likelihood of a Gaussian whose residual is held (Seitzer et al. 2022 show what happens to the
mean where it is not), through layers of its own, so that it takes nothing from the mean. What it
says too much or too little is put right by one temperature, fitted on the validation's presses;
beside it goes how the places' errors hang together, from which whole fields can be drawn.

The force is told by its logarithm, where the presses of the training have several.

Shape letters: B batch, S image side, N taxels, F places of the field, R rows and C columns of a
tactile image.
"""

from copy import copy
from dataclasses import dataclass
from functools import cached_property
from typing import Self

import numpy as np
import torch
from torch import nn

from t2twin.primitives_cad.errors import T2TwinError
from t2twin.sim.digit.camera import DIGIT_CAMERA
from t2twin.translate.averaging import running_mean
from t2twin.translate.calibrated import calibration_of
from t2twin.translate.data.examples import Examples
from t2twin.translate.data.images import to_input
from t2twin.translate.data.pairs import DataInfo, Pairs
from t2twin.translate.distributed import average_gradients
from t2twin.translate.networks.field_net import FieldNet, FieldParts
from t2twin.translate.phi import Phi
from t2twin.translate.presets import Preset

FORCE_WEIGHT = 0.1
"""Weight of the force's error beside the field's, both in parts of their variance (assumed)."""

FORCE_OFFSET_N = 0.1
"""What is added to a force before its logarithm is taken, N (assumed: where nothing touches it is
zero, and the least press has half a newton)."""

MEAN_FRAME_SHARE = 0.25
"""Part of the pairs that are shown with the world's mean frame in place of their DIGIT's own
(assumed), so that a picture without a frame can be translated too."""

LOOKED_AT = 2000
"""Pictures whose mean stands for the mean frame where the pairs hold no frames (assumed)."""

AT_ONCE = 64
"""Images in one batch where nothing is learnt; bounds memory."""


@dataclass(frozen=True)
class Told:
    """What is told of B images. mean, std: (B, F) float32, counts. force_n, force_std_n: (B,)
    float32, N, None of a run whose presses had one force."""

    mean: torch.Tensor
    std: torch.Tensor
    force_n: torch.Tensor | None
    force_std_n: torch.Tensor | None


class FieldTranslator:
    """The Translator of one network, which tells the field; any layout is read from it."""

    draws = True
    learns_field = True

    def __init__(self, preset: Preset, info: DataInfo, device: torch.device, bf16: bool) -> None:
        if info.field_x_mm is None or info.field_y_mm is None:
            raise T2TwinError("the data set's pairs hold no field; field learns from one")
        self.info = info
        self.full_scale = info.full_scale_counts
        self.device = device
        self.bf16 = bf16
        view_mm = DIGIT_CAMERA.seen_half_extent_mm()
        self.network = FieldNet(
            info.field_x_mm, info.field_y_mm, view_mm, preset.size, preset.filters
        )
        self.network.to(device, memory_format=torch.channels_last)  # pyright: ignore[reportCallIssue]
        self.networks: dict[str, nn.Module] = {"field": self.network}
        self.optimizers: dict[str, torch.optim.Optimizer] = {
            "field": torch.optim.AdamW(
                self.network.parameters(),
                preset.learning_rate,
                (preset.beta1, preset.beta2),
                weight_decay=preset.weight_decay,
                fused=True,  # five times as fast on a CPU
            )
        }
        self.running = running_mean(self.network, preset.averaged_part)
        self.predictor: FieldNet = (
            self.network if self.running is None else self.running.module  # pyright: ignore
        )

    def prepare(self, pairs: Pairs) -> None:
        """See Translator: the mean frame, and what field and force spread over."""
        assert pairs.field is not None
        field = pairs.field / np.float32(self.full_scale)
        log_force = np.log(pairs.force_n + FORCE_OFFSET_N)
        frame = (
            pairs.images[slice(LOOKED_AT)].mean(axis=0, dtype=np.float32)
            if pairs.untouched is None
            else pairs.untouched.mean()
        )
        for network in (self.network, self.predictor):
            network.mean_frame.copy_(to_input(frame[None] / 255.0)[0])
            network.field_variance.fill_(float(field.var(axis=0).mean()))
            network.force_scale.copy_(torch.tensor([log_force.mean(), log_force.std()]))
            network.field_mean.copy_(torch.from_numpy(field.mean(axis=0)))

    def step(self, examples: Examples) -> dict[str, float]:
        """One step: the field's squared error and the force's, and the likelihood of both spreads.

        Returns the losses by name: in parts of the variance, and in nats a place.
        """
        assert examples.field is not None and examples.force_n is not None
        optimizer = self.optimizers["field"]
        optimizer.zero_grad()
        with self._precision():
            said = self.network(self._some_with_mean_frame(examples.images).to(self.device))
        off = said.mean - examples.field.to(self.device) / self.full_scale
        losses = {
            "field": off.square().mean() / self.network.field_variance,
            "spread": _likelihood(off.detach(), said.log_spread),
        }
        loss = losses["field"] + losses["spread"]
        if self.knows_force:
            middle, scale = self.network.force_scale
            wanted = (torch.log(examples.force_n.to(self.device) + FORCE_OFFSET_N) - middle) / scale
            off = said.force - wanted
            losses["force"] = off.square().mean()
            losses["force_spread"] = _likelihood(off.detach(), said.force_log_spread)
            loss = loss + FORCE_WEIGHT * losses["force"] + losses["force_spread"]
        loss.backward()
        average_gradients(self.network)
        optimizer.step()
        if self.running is not None:
            self.running.update_parameters(self.network)
        return {name: float(each.detach()) for name, each in losses.items()}

    @property
    def knows_force(self) -> bool:
        """Whether the training's presses had several forces."""
        return float(self.predictor.force_scale[1]) > LEAST_FORCE_SPREAD

    def predict(self, images: torch.Tensor) -> torch.Tensor:
        """(B, 3 or 6, S, S) -> counts (B, N), within zero and full scale. In evaluation mode."""
        return self.tell(images).mean @ self._reading.T

    def tell(self, images: torch.Tensor) -> Told:
        """The field of images, (B, 3, S, S), or (B, 6, S, S) with their DIGITs' frames."""
        said = self._say(images)
        temperature = self.predictor.temperature
        force = force_std = None
        if self.knows_force:
            middle, scale = self.predictor.force_scale
            lifted = torch.exp(said.force * scale + middle)
            force = (lifted - FORCE_OFFSET_N).clamp(min=0.0)
            force_std = lifted * scale * said.force_log_spread.exp() * temperature[1]
        return Told(
            (said.mean * self.full_scale).clamp(0.0, self.full_scale),
            said.log_spread.exp() * (self.full_scale * temperature[0]),
            force,
            force_std,
        )

    def calibrate(self, pairs: Pairs) -> None:
        """See Translator: the temperatures, and how the errors hang together."""
        assert pairs.field is not None
        log_force = torch.from_numpy(np.log(pairs.force_n + FORCE_OFFSET_N)).float()
        middle, scale = self.predictor.force_scale.cpu()
        off, force_off = [], []
        for start in range(0, len(pairs), AT_ONCE):
            part = slice(start, start + AT_ONCE)
            said = self._say(to_input(pairs.pixels(part).astype(np.float32) / 255.0))
            truth = torch.from_numpy(pairs.field[part].astype(np.float32)) / self.full_scale
            mean = said.mean.cpu().clamp(0.0, 1.0)
            off.append((truth - mean) / said.log_spread.cpu().exp())
            wanted = (log_force[part] - middle) / scale.clamp(min=LEAST_FORCE_SPREAD)
            force_off.append((wanted - said.force.cpu()) / said.force_log_spread.cpu().exp())
        found = calibration_of(torch.cat(off), torch.cat(force_off))
        self.predictor.temperature.copy_(found.temperature)
        self.predictor.correlation.copy_(found.correlation)

    def _say(self, images: torch.Tensor) -> FieldParts:
        self.predictor.eval()
        if images.shape[1] == 3:
            frame = self.predictor.mean_frame.to(images.device).expand(images.shape[0], -1, -1, -1)
            images = torch.cat([images, frame], dim=1)
        with torch.inference_mode(), self._precision():
            return self.predictor(images.to(self.device))

    def _some_with_mean_frame(self, images: torch.Tensor) -> torch.Tensor:
        """(B, 6, S, S): the mean frame where there is none, and for a part of those with one."""
        frame = self.network.mean_frame.to(images.device)
        if images.shape[1] == 3:
            own = frame.expand(images.shape[0], -1, -1, -1)
        else:
            without = torch.rand(images.shape[0], 1, 1, 1) < MEAN_FRAME_SHARE
            own = torch.where(without, frame, images[:, 3:])
        both = torch.cat([images[:, :3], own], dim=1)
        return both.contiguous(memory_format=torch.channels_last)

    @cached_property
    def _reading(self) -> torch.Tensor:
        """(N, F): what each place gives to each taxel."""
        info = self.info
        assert info.field_x_mm is not None and info.field_y_mm is not None
        apart = np.hypot(info.x_mm[:, None] - info.field_x_mm, info.y_mm[:, None] - info.field_y_mm)
        reading = np.zeros(apart.shape, np.float32)
        reading[np.arange(info.x_mm.size), apart.argmin(axis=1)] = 1.0
        return torch.from_numpy(reading).to(self.device)

    @cached_property
    def phi(self) -> Phi:
        """phi of the field's places at the full size of a tactile image."""
        assert self.info.field_x_mm is not None and self.info.field_y_mm is not None
        return Phi(self.info.field_x_mm, self.info.field_y_mm)

    def counts_and_tactile_images(self, images: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
        """Counts, (B, N), and the field as a tactile image, (B, R, C), counts."""
        mean = self.tell(images).mean
        return mean @ self._reading.T, torch.from_numpy(self.phi(mean.cpu().numpy()))

    def read_by(self, phi: Phi) -> Self:
        """See Translator."""
        raise T2TwinError("a field is read at its data set's own layout")

    def in_float32(self) -> Self:
        """See Translator."""
        other = copy(self)
        other.bf16 = False
        return other

    def as_module(self) -> nn.Module:
        """See Translator."""
        raise T2TwinError("a field is not written as ONNX")

    def _precision(self) -> torch.autocast:
        return torch.autocast(self.device.type, torch.bfloat16, enabled=self.bf16)


LEAST_FORCE_SPREAD = 1e-3
"""Least spread of the logarithm of the training's forces that says they are several (assumed)."""


def _likelihood(off: torch.Tensor, log_spread: torch.Tensor) -> torch.Tensor:
    """Mean negative logarithm of a Gaussian's density, up to a constant. All of one shape."""
    return (log_spread + 0.5 * off.square() * torch.exp(-2.0 * log_spread)).mean()
