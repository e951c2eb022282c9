"""field: from the DIGIT image to the field over the whole cover, how sure that is, and the force.

The mean is trained on the squared error alone, as a yardstick of counts asks for. The spread learns
by a likelihood whose residual is held (Seitzer et al. 2022 show what happens to the mean where it
is not), through layers of its own, so that it takes nothing from the mean. The likelihood is that
of Student's t: errors are small in most presses and large in few, and by a Gaussian's the few drown
what the many say. What the spread says too much or too little is put right by factors (module
calibrated), fitted on presses of validation; beside them goes how the places' errors hang together,
from which whole fields can be drawn.

The force is told by its logarithm, where the presses of the training have several.

Shape letters: B batch, S image side, N taxels, F places of the field, R rows and C columns of a
tactile image.
"""

from collections.abc import Iterator
from copy import copy, deepcopy
from functools import cached_property
from typing import Self, cast

import numpy as np
import torch
from torch import nn

from t2twin.core.errors import T2TwinError
from t2twin.sim.cyskin.field_reading import reading_matrix
from t2twin.sim.cyskin.layout import Layout
from t2twin.sim.digit.camera.pinhole import DIGIT_CAMERA
from t2twin.translate.data.images import RGB_MEAN, RGB_STD, to_input
from t2twin.translate.data.pairs import DataInfo, Examples, Pairs
from t2twin.translate.models.distributed import average_gradients
from t2twin.translate.models.field_image import FieldDrawing
from t2twin.translate.models.field_readout import (
    MIN_FORCE_SCALE,
    FieldPrediction,
    FieldReadout,
    knows_force,
    log_force,
)
from t2twin.translate.models.optimizer import adamw, running_mean
from t2twin.translate.models.presets import Preset
from t2twin.translate.networks.field_net import FieldNet, FieldParts
from t2twin.translate.uncertainty.calibration import Errors, calibration_of

FORCE_WEIGHT = 0.1
"""Weight of the force's error beside the field's, both in parts of their variance (assumed)."""

MEAN_FRAME_SHARE = 0.25
"""Part of the pairs that are shown with the world's mean frame in place of their DIGIT's own
(assumed), so that a picture without a frame can be translated too."""

DEGREES_OF_FREEDOM = 4.0
"""Of the t distribution by which spreads are learnt. After 2,000 steps on held features it tells
sure from unsure presses where a Gaussian does not: without the least sure fifth of the validation
the RMSE falls by 13 % instead of 4; 3 and 8 are as good (measured)."""

LOOKED_AT = 2000
"""Pictures whose mean stands for the mean frame where the pairs hold no frames (assumed)."""

BATCH_SIZE = 64
"""Images in one batch where nothing is learnt; bounds memory."""


class FieldTranslator:
    """The Translator of one network, which tells the field; any layout is read from it."""

    draws = True
    learns_field = True

    def __init__(self, preset: Preset, info: DataInfo, device: torch.device, bf16: bool) -> None:
        if info.field_x_mm is None or info.field_y_mm is None:
            raise T2TwinError("the data set's pairs hold no field, which is what field learns")
        self.layout = info.taxels
        self.places_mm = info.field_x_mm, info.field_y_mm
        self.full_scale = info.full_scale_counts
        self.device = device
        self.bf16 = bf16
        view_mm = DIGIT_CAMERA.seen_half_extent_mm()
        self.network = FieldNet(*self.places_mm, view_mm, preset.size, preset.filters)
        self.network.to(device, memory_format=torch.channels_last)  # pyright: ignore[reportCallIssue]
        self.networks: dict[str, nn.Module] = {"field": self.network}
        self.optimizers = {"field": adamw(self.network, preset)}
        self.running = running_mean(self.network, preset.averaged_part)
        averaged = None if self.running is None else cast(FieldNet, self.running.module)
        self.predictor = averaged or self.network

    def prepare(self, pairs: Pairs) -> None:
        """See Translator: the mean frame, which is always that of the pairs, and what field and
        force spread over."""
        assert pairs.field is not None
        field = pairs.field / np.float32(self.full_scale)
        forces = log_force(torch.tensor(pairs.force_n))
        frame = (
            pairs.images[:LOOKED_AT].mean(axis=0, dtype=np.float32)
            if pairs.untouched is None
            else pairs.untouched.mean()
        )
        for network in (self.network, self.predictor):
            network.mean_frame.copy_(to_input(frame[None] / 255.0)[0])
            if not network.field_mean.any():
                network.field_mean.copy_(torch.from_numpy(field.mean(axis=0)))
                network.field_variance.fill_(float(field.var(axis=0).mean()))
            if not knows_force(network):
                network.force_scale.copy_(torch.stack([forces.mean(), forces.std(correction=0)]))

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
        if knows_force(self.network):
            off = said.force - self._force_wanted(examples.force_n.to(self.device))
            losses["force"] = off.square().mean()
            losses["force_spread"] = _likelihood(off.detach(), said.force_log_spread)
            loss = loss + FORCE_WEIGHT * losses["force"] + losses["force_spread"]
        loss.backward()
        average_gradients(self.network)
        optimizer.step()
        if self.running is not None:
            self.running.update_parameters(self.network)
        return {name: float(each.detach()) for name, each in losses.items()}

    def predict(self, images: torch.Tensor) -> torch.Tensor:
        """(B, 3 or 6, S, S) -> counts (B, N), within zero and full scale. In evaluation mode."""
        return self.tell(images).counts

    def tell(self, images: torch.Tensor) -> FieldPrediction:
        """All that is told of images, (B, 3, S, S), or (B, 6, S, S) with their DIGITs' frames."""
        with torch.inference_mode():
            return self.teller(self._say(images))

    def counts_and_tactile_images(self, images: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
        """Counts, (B, N), and the field as a tactile image, (B, R, C), counts."""
        told = self.tell(images)
        return told.counts, self.drawing(told.field)

    def calibrate(self, *sets: Pairs) -> None:
        """See Translator: rungs, and how the errors hang together."""
        found = calibration_of([self._errors_on(pairs) for pairs in sets])
        kept = self.predictor
        kept.place_rungs.copy_(found.place)
        kept.press_rungs.copy_(found.press)
        if knows_force(kept):  # else of nothing
            kept.force_rungs.copy_(found.force)
        kept.correlation.copy_(found.correlation)
        self.__dict__.pop("teller", None)

    def _errors_on(self, pairs: Pairs) -> Errors:
        parts = zip(*self._errors(pairs), strict=True)
        return Errors(*(torch.cat(part).cpu() for part in parts))

    def _errors(self, pairs: Pairs) -> Iterator[tuple[torch.Tensor, ...]]:
        """Of batches of pairs, what Errors holds."""
        assert pairs.field is not None
        for start in range(0, len(pairs), BATCH_SIZE):
            part = slice(start, start + BATCH_SIZE)
            said = self._say(to_input(pairs.pictures[part].astype(np.float32) / 255.0))
            field = torch.from_numpy(pairs.field[part].astype(np.float32)).to(self.device)
            force = torch.from_numpy(pairs.force_n[part].astype(np.float32)).to(self.device)
            off = field / self.full_scale - said.mean.clamp(0.0, 1.0)
            force_off = self._force_wanted(force) - said.force
            yield off, said.log_spread.exp(), force_off, said.force_log_spread.exp()

    @cached_property
    def teller(self) -> FieldReadout:
        """What reads its layout from the field."""
        return FieldReadout(self.predictor, reading_matrix(self.layout), self.full_scale)

    @cached_property
    def drawing(self) -> FieldDrawing:
        """What draws the field as a tactile image."""
        return FieldDrawing(*self.places_mm).to(self.device)

    def read_at(self, layout: Layout) -> Self:
        """See Translator. Any layout on the cover; the pads' sizes count."""
        other = copy(self)
        other.layout = layout
        reading = reading_matrix(layout)
        other.teller = FieldReadout(self.predictor, reading, self.full_scale)
        return other

    def in_float32(self) -> Self:
        """See Translator."""
        other = copy(self)
        other.bf16 = False
        return other

    def as_module(self) -> nn.Module:
        """See Translator. Beside the pixels it takes the untouched frame, (1, 3, S, S), and beside
        counts and tactile images it gives what FromPixels does."""
        return FromPixels(self.predictor, self.teller, self.drawing)

    def _say(self, images: torch.Tensor) -> FieldParts:
        self.predictor.eval()
        images = images.to(self.device)
        if images.shape[1] == 3:
            images = torch.cat([images, self.predictor.mean_frame.expand_as(images)], dim=1)
        with torch.inference_mode(), self._precision():
            return self.predictor(images)

    def _force_wanted(self, force_n: torch.Tensor) -> torch.Tensor:
        middle, scale = self.predictor.force_scale  # a run that is read has no other
        return (log_force(force_n) - middle) / scale.clamp(min=MIN_FORCE_SCALE)

    def _some_with_mean_frame(self, images: torch.Tensor) -> torch.Tensor:
        """(B, 6, S, S): the mean frame where there is none, and for a part of those with one."""
        picture, frame = images[:, :3], self.network.mean_frame.to(images.device)
        if images.shape[1] == 3:
            own = frame.expand_as(picture)
        else:
            without = torch.rand(images.shape[0], 1, 1, 1) < MEAN_FRAME_SHARE
            own = torch.where(without.to(images.device), frame, images[:, 3:])
        both = torch.cat([picture, own], dim=1)
        return both.contiguous(memory_format=torch.channels_last)

    def _precision(self) -> torch.autocast:
        return torch.autocast(self.device.type, torch.bfloat16, enabled=self.bf16)


class FromPixels(nn.Module):
    """From RGB pixels in [0, 1], and an untouched frame's, to counts, tactile images, the counts'
    standard deviations, field and its own, and force and its own where they are known. In float32
    on the CPU."""

    mean: torch.Tensor
    std: torch.Tensor

    def __init__(self, network: FieldNet, teller: FieldReadout, drawing: FieldDrawing) -> None:
        super().__init__()
        self.network = deepcopy(network).cpu()
        self.teller = deepcopy(teller).cpu()
        self.drawing = deepcopy(drawing).cpu()
        self.register_buffer("mean", torch.from_numpy(RGB_MEAN).view(3, 1, 1))
        self.register_buffer("std", torch.from_numpy(RGB_STD).view(3, 1, 1))

    @property
    def mean_frame(self) -> torch.Tensor:
        """(1, 3, S, S) in [0, 1]: the world's mean untouched frame."""
        return (self.network.mean_frame * self.std + self.mean)[None]

    def forward(self, pixels: torch.Tensor, untouched: torch.Tensor) -> tuple[torch.Tensor, ...]:
        both = [(each - self.mean) / self.std for each in (pixels, untouched.expand_as(pixels))]
        told = self.teller(self.network(torch.cat(both, dim=1)))
        force = () if told.force_n is None else (told.force_n, told.force_std_n)
        image = self.drawing(told.field)
        return told.counts, image, told.counts_std, told.field, told.field_std, *force


def _likelihood(off: torch.Tensor, log_spread: torch.Tensor) -> torch.Tensor:
    """Mean negative logarithm of Student's density, up to a constant. All of one shape."""
    square = off.square() * torch.exp(-2.0 * log_spread)
    tail = torch.log1p(square / DEGREES_OF_FREEDOM)
    return (log_spread + 0.5 * (DEGREES_OF_FREEDOM + 1.0) * tail).mean()
