"""From the DIGIT image and the unit's background frame to the field over the whole cover.

A ResNet18 encodes the image. Its last map, pooled to a vector, predicts a canvas over the whole
cover, for the places outside the DIGIT's view. Its finer maps are resampled onto the canvas where
the view lies. A small decoder predicts mean and spread from the two.

The places of the field form columns of equal spacing. Each column is shifted by half a place
relative to its neighbors. The decoder treats the places as a grid of columns by rows.

Shape letters: B batch, S image side, F places, D columns of E places, F = D * E, G numbers of the
vector.
"""

from typing import NamedTuple

import numpy as np
import torch
from torch import nn

from t2twin.core.errors import T2TwinError
from t2twin.translate.networks.resnet18 import BasicBlock, ResNet18
from t2twin.translate.networks.shear_head import ShearHead
from t2twin.translate.uncertainty.calibration import (
    FORCE_SHARES,
    PLACE_SHARES,
    PRESS_SHARES,
    SHEAR_SHARES,
    identity_knots,
)

DIFFERENCE_SCALE = 2.0
"""Factor of the difference from the background frame (assumed: a press changes an image by some
tenths of the standard deviation of its colors)."""

MAX_POOLED = 4
"""Maximum cells along each side of the last map that the vector is made from (assumed)."""

CANVAS = 32
"""Channels of the canvas that the vector predicts (assumed)."""

MIN_SPREAD = 2.5e-4
"""Minimum spread of the field, fraction of full scale (assumed: 10 counts, twice a reading's
noise)."""

MIN_FORCE_SPREAD = 0.01
"""Minimum spread of the force, in standard deviations of the training forces' logarithms
(assumed)."""

MIN_SHEAR_SPREAD = 0.01
"""Minimum spread of the shear force, in root mean squares of the training presses (assumed)."""

SHEAR = "shear"
"""First letters of the names of the weights and buffers of the shear force."""

KNOTS = {"place_knots": PLACE_SHARES, "press_knots": PRESS_SHARES, "force_knots": FORCE_SHARES}
"""Buffers with the knots of the calibration, and the shares of the errors in their bins."""


class FieldOutputs(NamedTuple):
    """Outputs of the network, not calibrated.

    mean, log_spread: (B, F), field as a fraction of full scale, and logarithm of its raw spread.
    force, force_log_spread: (B,), standardized logarithm of the force, and the same of its spread.
    shear, shear_log_spread: (B, 2), standardized shear force along x and y, and logarithm of its
    raw spread; None if it is not predicted.
    """

    mean: torch.Tensor
    log_spread: torch.Tensor
    force: torch.Tensor
    force_log_spread: torch.Tensor
    shear: torch.Tensor | None = None
    shear_log_spread: torch.Tensor | None = None


class FieldNet(nn.Module):
    """The network of one field and image size.

    x_mm, y_mm: (F,) the field's places, column by column, mm. view_mm: half the width and half the
    height of the DIGIT's view, mm. size: S. filters: base width of the ResNet18. predicts_shear:
    whether it predicts the shear force on the DIGIT.

    Buffers:

    - mean_frame, (3, S, S), the mean of the world's background frames, normalized;
    - field_mean, (F,), and field_variance, its mean over the places, fractions of full scale and of
      its square;
    - force_scale, (2,), mean and standard deviation of the forces' logarithms;
    - place_knots, press_knots, force_knots, (2, K), and correlation, (F, F), the calibration;
    - shear_scale, (), root mean square of the training presses' shear force, N, and shear_knots,
      if it is predicted.

    Raises T2TwinError for places that form no such columns, and for too few filters.
    """

    fine_places: torch.Tensor
    coarse_places: torch.Tensor
    mean_frame: torch.Tensor
    field_mean: torch.Tensor
    field_variance: torch.Tensor
    force_scale: torch.Tensor
    place_knots: torch.Tensor
    press_knots: torch.Tensor
    force_knots: torch.Tensor
    correlation: torch.Tensor
    shear_scale: torch.Tensor
    shear_knots: torch.Tensor

    def __init__(
        self,
        x_mm: np.ndarray,
        y_mm: np.ndarray,
        view_mm: tuple[float, float],
        size: int,
        filters: int,
        predicts_shear: bool = False,
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
            weights = resampling_weights(x_mm, y_mm, view_mm, -(-size // part))
            self.register_buffer(f"{name}_places", torch.from_numpy(weights), persistent=False)
        self.register_buffer("mean_frame", torch.zeros(3, size, size))
        self.register_buffer("field_mean", torch.zeros(x_mm.size))
        self.register_buffer("field_variance", torch.ones(()))
        self.register_buffer("force_scale", torch.tensor([0.0, 0.0]))
        for name, shares in KNOTS.items():
            self.register_buffer(name, identity_knots(len(shares)))
        self.register_buffer("correlation", torch.eye(x_mm.size))
        self.predicts_shear = predicts_shear
        if predicts_shear:  # last, so that the other weights start as without it
            self.shear = ShearHead(size, vector)
            self.register_buffer("shear_scale", torch.zeros(()))
            self.register_buffer("shear_knots", identity_knots(len(SHEAR_SHARES)))

    def forward(self, images: torch.Tensor) -> FieldOutputs:
        """images: (B, 6, S, S), normalized, each with its background frame."""
        image, frame = images.split(3, dim=1)
        inputs = torch.cat([image, DIFFERENCE_SCALE * (image - frame)], dim=1)
        fine, coarse, last = self.encoder.maps(inputs)
        vector = self.gather(self.pool(last).flatten(1)).relu()
        canvas = self.canvas(vector).unflatten(1, (CANVAS, *self.grid))
        fine = self._resample(fine, self.fine_places)
        coarse = self._resample(self.coarse(coarse), self.coarse_places)
        decoded = self.decode(torch.cat([canvas, fine, coarse], dim=1))
        mean = (self.mean(decoded).flatten(1) + self.mean_of_all(vector)).float()
        # Detached: the spread's loss does not change the features of the mean.
        decoded, detached = decoded.detach(), vector.detach()
        spread = (self.spread(decoded).flatten(1) + self.spread_of_all(detached)).float()
        scale = self.field_variance.sqrt()
        outputs = FieldOutputs(
            self.field_mean + scale * mean,
            _log_add(MIN_SPREAD, scale.log() + spread),
            self.force(vector).float()[:, 0],
            _log_add(MIN_FORCE_SPREAD, self.force_spread(detached).float()[:, 0]),
        )
        if not self.predicts_shear:
            return outputs
        shear, spread = self.shear(image, frame, detached)
        return outputs._replace(shear=shear, shear_log_spread=_log_add(MIN_SHEAR_SPREAD, spread))

    def _resample(self, view_map: torch.Tensor, places: torch.Tensor) -> torch.Tensor:
        """A map of the view at the field's places, (B, C, D, E), zero outside the view."""
        return (view_map.flatten(2) @ places.to(view_map.dtype)).unflatten(2, self.grid)


def _log_add(least: float, log_spread: torch.Tensor) -> torch.Tensor:
    """The logarithm of the sum of a spread and its minimum; a hard bound has no gradient."""
    return torch.log(torch.exp(log_spread) + least)  # ONNX has no logaddexp


def grid_of(x_mm: np.ndarray) -> tuple[int, int]:
    """Number of columns of the field's places, and of places in each.

    Raises T2TwinError for columns of different lengths.
    """
    starts = np.flatnonzero(np.diff(x_mm, prepend=-np.inf) > 0.01)
    rows = np.diff(starts, append=x_mm.size)
    if (rows != rows[0]).any():
        raise T2TwinError(
            "the places of the field form columns of different lengths; expected equal lengths, as "
            "this version of t2twin makes them"
        )
    return starts.size, int(rows[0])


def resampling_weights(
    x_mm: np.ndarray, y_mm: np.ndarray, view_mm: tuple[float, float], side: int
) -> np.ndarray:
    """(side * side, F) float32: weights of the cells of a map of the view at each place.

    Bilinear between the centers of the cells; zero from half a cell outside the view.
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
