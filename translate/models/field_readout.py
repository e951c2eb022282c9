"""From what the network of a field says to what is told of it: counts of a layout, with their
standard deviations, the field's own, and the force in newtons.

Shape letters: B images, N taxels, F places of the field.
"""

from typing import NamedTuple

import numpy as np
import torch
from torch import nn

from t2twin.translate.networks.field_net import FieldNet, FieldParts
from t2twin.translate.uncertainty.calibration import interpolate_scale, standard_deviation

FORCE_OFFSET_N = 0.1
"""What is added to a force before its logarithm is taken, N (assumed: where nothing touches it is
zero, and the least press has half a newton)."""

MIN_FORCE_SCALE = 1e-3
"""Least spread of the logarithm of the training's forces that says they are several (assumed)."""


class FieldPrediction(NamedTuple):
    """What is told of B images. counts, counts_std: (B, N), counts. field, field_std: (B, F),
    counts. force_n, force_std_n: (B,), N, None of a run whose presses had one force."""

    counts: torch.Tensor
    counts_std: torch.Tensor
    field: torch.Tensor
    field_std: torch.Tensor
    force_n: torch.Tensor | None
    force_std_n: torch.Tensor | None


class FieldReadout(nn.Module):
    """Reads a layout from a field, of a network with its calibration.

    reading: (N, F), times the field's counts those of the taxels. full_scale: counts.
    """

    reading: torch.Tensor
    factor: torch.Tensor
    place_rungs: torch.Tensor
    press_rungs: torch.Tensor
    force_rungs: torch.Tensor
    force_scale: torch.Tensor

    def __init__(self, network: FieldNet, reading: np.ndarray, full_scale: float) -> None:
        super().__init__()
        self.full_scale = full_scale
        self.knows_force = knows_force(network)
        factor = torch.linalg.cholesky(network.correlation.cpu().double()).float()
        self.register_buffer("reading", torch.from_numpy(reading).float())
        self.register_buffer("factor", factor)
        for name in ("place_rungs", "press_rungs", "force_rungs", "force_scale"):
            self.register_buffer(name, getattr(network, name).detach().clone())
        self.to(network.correlation.device)

    def forward(self, said: FieldParts) -> FieldPrediction:
        """Counts lie within zero and full scale."""
        field = (said.mean * self.full_scale).clamp(0.0, self.full_scale)
        std = standard_deviation(said.log_spread, self.place_rungs, self.press_rungs)
        field_std = self.full_scale * std
        counts = (field @ self.reading.T).clamp(0.0, self.full_scale)
        # A taxel between places reads several, whose errors go together.
        parts = (field_std[:, None, :] * self.reading) @ self.factor
        counts_std = parts.square().sum(dim=2).sqrt()
        if not self.knows_force:
            return FieldPrediction(counts, counts_std, field, field_std, None, None)
        lifted = torch.exp(said.force * self.force_scale[1] + self.force_scale[0])
        spread = said.force_log_spread.exp() * interpolate_scale(
            said.force_log_spread, self.force_rungs
        )
        spread = spread * self.force_scale[1]
        force = (lifted - FORCE_OFFSET_N).clamp(min=0.0)
        return FieldPrediction(counts, counts_std, field, field_std, force, lifted * spread)

    def drawn(self, told: FieldPrediction, number: int, seed: int) -> torch.Tensor:
        """(B, number, F) fields as they may be, counts, from the told distribution."""
        generator = torch.Generator().manual_seed(seed)
        shape = (told.field.shape[0], number, told.field.shape[1])
        normal = torch.randn(shape, generator=generator).to(told.field.device)
        drawn = told.field[:, None] + told.field_std[:, None] * (normal @ self.factor.T)
        return drawn.clamp(0.0, self.full_scale)


def log_force(force_n: torch.Tensor) -> torch.Tensor:
    """The logarithm by which forces are learnt. Any shape, N."""
    return torch.log(force_n + FORCE_OFFSET_N)


def knows_force(network: FieldNet) -> bool:
    """Whether the presses that a network was trained on had several forces."""
    return float(network.force_scale[1]) > MIN_FORCE_SCALE
