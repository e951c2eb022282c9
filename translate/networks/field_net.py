"""From the DIGIT image, beside the unit's untouched frame, to the field over the whole cover.

A ResNet18 looks; what it sees goes two ways. As one vector it lays a canvas over the whole cover,
for what lies beyond the view and for what the picture says as a whole. Its maps are laid into that
canvas where the view lies, so that what is seen in a place is said of that place. A small decoder
goes over the two, and beside the mean it tells the spread.

The field's places are columns of evenly spaced ones, each column off its neighbors by half a
place; the decoder takes them as a grid of columns by rows.

Shape letters: B batch, S image side, F places, D columns and E places in each, F = D * E, G numbers
of the vector.
"""

import math
from typing import NamedTuple

import numpy as np
import torch
from torch import nn

from t2twin.core.errors import T2TwinError
from t2twin.translate.networks.resnet18 import BasicBlock, ResNet18
from t2twin.translate.uncertainty.calibration import (
    FORCE_SHARES,
    PLACE_SHARES,
    PRESS_SHARES,
    identity_knots,
)

DIFFERENCE_SCALE = 2.0
"""What the difference from the untouched frame is multiplied by (assumed: a press changes a picture
by some tenths of what the pictures' colors spread over)."""

MAX_POOLED = 4
"""Most cells along either side of the last map that the vector is made from (assumed)."""

CANVAS = 32
"""Channels of the canvas that the vector lays (assumed)."""

MIN_SPREAD = 2.5e-4
"""Least spread of the field, parts of full scale (assumed: 10 counts, twice a reading's noise)."""

MIN_FORCE_SPREAD = 0.01
"""Least spread of the force, in parts of that of the training's (assumed)."""


RUNGS = {"place_rungs": PLACE_SHARES, "press_rungs": PRESS_SHARES, "force_rungs": FORCE_SHARES}
"""What is kept of a calibration, and what each one's rungs stand for."""


EARLIER_MIDDLE = 0.01
"""The spread that the power of earlier weights leaves as it is, parts of full scale."""


class FieldParts(NamedTuple):
    """What the network says. mean, log_spread: (B, F), of the field in parts of full scale, and the
    logarithm of what a standard deviation is proportional to (module calibrated). force,
    force_log_spread: (B,), the same of the force's logarithm, in parts of what that spreads over in
    the training."""

    mean: torch.Tensor
    log_spread: torch.Tensor
    force: torch.Tensor
    force_log_spread: torch.Tensor


class FieldNet(nn.Module):
    """The network of one field and image size.

    x_mm, y_mm: (F,) the field's places, column by column, mm. view_mm: half the width and half the
    height that the picture shows, mm. size: S. filters: base width of the ResNet18.

    Kept with the weights, and not learnt: mean_frame, (3, S, S), the mean of the world's untouched
    frames, normalized; field_mean, (F,), and field_variance, the mean over the places, in parts of
    full scale and of its square; force_scale, (2,), mean and spread of the forces' logarithm;
    place_rungs, press_rungs, force_rungs, (2, K), what makes spreads standard deviations, and
    correlation, (F, F), of the field's errors (module calibrated).
    Raises T2TwinError for places that are no such columns, and for too few filters.
    """

    fine_places: torch.Tensor
    coarse_places: torch.Tensor
    mean_frame: torch.Tensor
    field_mean: torch.Tensor
    field_variance: torch.Tensor
    force_scale: torch.Tensor
    place_rungs: torch.Tensor
    press_rungs: torch.Tensor
    force_rungs: torch.Tensor
    correlation: torch.Tensor

    def __init__(
        self,
        x_mm: np.ndarray,
        y_mm: np.ndarray,
        view_mm: tuple[float, float],
        size: int,
        filters: int,
    ) -> None:
        super().__init__()
        self.grid = grid_of(x_mm)
        self.encoder = ResNet18(0, filters, channels=6)
        cells = -(-size // 32)
        self.pooled = max(n for n in range(1, MAX_POOLED + 1) if cells % n == 0)
        self.pool = nn.AvgPool2d(cells // self.pooled) if cells > self.pooled else nn.Identity()
        width, vector = 2 * filters, 8 * filters
        self.gather = nn.Linear(8 * filters * self.pooled**2, vector)
        self.canvas = nn.Linear(vector, CANVAS * x_mm.size)
        self.coarse = nn.Conv2d(4 * filters, width, 1)
        self.decode = nn.Sequential(
            nn.Conv2d(CANVAS + 2 * width, width, 3, 1, 1, bias=False),
            nn.BatchNorm2d(width),
            nn.ReLU(),
            BasicBlock(width, width, 1),
        )
        self.mean = nn.Conv2d(width, 1, 1)
        self.mean_of_all = nn.Linear(vector, x_mm.size)
        self.spread = nn.Sequential(
            nn.Conv2d(width, filters, 3, 1, 1), nn.ReLU(), nn.Conv2d(filters, 1, 1)
        )
        self.spread_of_all = nn.Linear(vector, x_mm.size)
        self.force = nn.Linear(vector, 1)
        self.force_spread = nn.Linear(vector, 1)
        for name, part in (("fine", 8), ("coarse", 16)):
            laid = torch.from_numpy(laid_at(x_mm, y_mm, view_mm, -(-size // part)))
            self.register_buffer(f"{name}_places", laid, persistent=False)
        self.register_buffer("mean_frame", torch.zeros(3, size, size))
        self.register_buffer("field_mean", torch.zeros(x_mm.size))
        self.register_buffer("field_variance", torch.ones(()))
        self.register_buffer("force_scale", torch.tensor([0.0, 0.0]))
        for name, shares in RUNGS.items():
            self.register_buffer(name, identity_knots(len(shares)))
        self.register_buffer("correlation", torch.eye(x_mm.size))

    def _load_from_state_dict(
        self, state_dict: dict[str, torch.Tensor], prefix: str, *rest
    ) -> None:
        """Weights of an earlier version hold temperatures and a power in place of the rungs."""
        of_field, of_force = state_dict.pop(f"{prefix}temperature", torch.ones(2)).log()
        power = state_dict.pop(f"{prefix}power", torch.ones(()))
        for name, shares in RUNGS.items():
            rungs = identity_knots(len(shares))
            if name == "place_rungs":
                rungs[0] = torch.linspace(math.log(MIN_SPREAD), 0.0, len(shares))
                rungs[1] = of_field + (power - 1.0) * (rungs[0] - math.log(EARLIER_MIDDLE))
            elif name == "force_rungs":
                rungs[1] = of_force
            state_dict.setdefault(f"{prefix}{name}", rungs)
        super()._load_from_state_dict(state_dict, prefix, *rest)

    def forward(self, images: torch.Tensor) -> FieldParts:
        """images: (B, 6, S, S), normalized, the picture and the untouched frame."""
        picture, frame = images.split(3, dim=1)
        seen = torch.cat([picture, DIFFERENCE_SCALE * (picture - frame)], dim=1)
        fine, coarse, last = self.encoder.maps(seen)
        vector = self.gather(self.pool(last).flatten(1)).relu()
        canvas = self.canvas(vector).unflatten(1, (CANVAS, *self.grid))
        fine = self._lay(fine, self.fine_places)
        coarse = self._lay(self.coarse(coarse), self.coarse_places)
        decoded = self.decode(torch.cat([canvas, fine, coarse], dim=1))
        mean = (self.mean(decoded).flatten(1) + self.mean_of_all(vector)).float()
        # The spread reads what the mean is made of and does not change it.
        decoded, still = decoded.detach(), vector.detach()
        spread = (self.spread(decoded).flatten(1) + self.spread_of_all(still)).float()
        scale = self.field_variance.sqrt()
        return FieldParts(
            self.field_mean + scale * mean,
            _at_least(MIN_SPREAD, scale.log() + spread),
            self.force(vector).float()[:, 0],
            _at_least(MIN_FORCE_SPREAD, self.force_spread(still).float()[:, 0]),
        )

    def _lay(self, seen: torch.Tensor, places: torch.Tensor) -> torch.Tensor:
        """A map of the view as the field's places have it, (B, C, D, E), zero beyond the view."""
        return (seen.flatten(2) @ places.to(seen.dtype)).unflatten(2, self.grid)


def _at_least(least: float, log_spread: torch.Tensor) -> torch.Tensor:
    """The logarithm of a spread and a least one added up: a bound would leave no gradient."""
    return torch.log(torch.exp(log_spread) + least)  # ONNX has no logaddexp


def grid_of(x_mm: np.ndarray) -> tuple[int, int]:
    """Columns of the field's places, and places in each.

    Raises T2TwinError where they are not equally many in each.
    """
    starts = np.flatnonzero(np.diff(x_mm, prepend=-np.inf) > 0.01)
    rows = np.diff(starts, append=x_mm.size)
    if (rows != rows[0]).any():
        raise T2TwinError(
            "the field's places are no columns of one length; make the dataset with this version"
        )
    return starts.size, int(rows[0])


def laid_at(
    x_mm: np.ndarray, y_mm: np.ndarray, view_mm: tuple[float, float], side: int
) -> np.ndarray:
    """(side * side, F) float32: what each cell of a map of the view gives to each place.

    Bilinear between the cells' centers, the map being zero from half a cell beyond its rim on.
    """
    across, down = (
        _hat((at / (2 * half) + 0.5) * side - 0.5, side)
        for at, half in zip((x_mm, y_mm), view_mm, strict=True)
    )
    weights = down[:, None, :] * across[None, :, :]  # rows, columns, places
    return weights.reshape(side * side, -1).astype(np.float32)


def _hat(at: np.ndarray, cells: int) -> np.ndarray:
    """(cells, F): linear interpolation weights at these places, in cells."""
    return np.maximum(0.0, 1.0 - np.abs(at[None, :] - np.arange(cells)[:, None]))
