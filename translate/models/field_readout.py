"""Predictions of the field model from the outputs of its network, and the whole as one module.

Shape letters: B batch, S image side, N taxels, F places of the dense counts, R rows and C columns
of a tactile image.
"""

from copy import deepcopy
from typing import NamedTuple

import numpy as np
import torch
from torch import nn

from t2twin.sim.taxels.phi import barycentric
from t2twin.translate.data.images import RGB_MEAN, RGB_STD
from t2twin.translate.models.contact import ContactPrediction, ContactReadout
from t2twin.translate.networks.field_net import KNOTS, FieldNet, FieldOutputs
from t2twin.translate.uncertainty.calibration import interpolate_scale, standard_deviation
from t2twin.translate.uncertainty.spread_scale import SAME_FRAME

FORCE_OFFSET_N = 0.1
"""Added to a force before its logarithm is taken, N (assumed: the force is zero without contact,
and at least half a newton otherwise)."""

MIN_FORCE_SCALE = 1e-3
"""Standard deviation of the training forces' logarithms above which the network predicts the force
(assumed)."""


class FieldPrediction(NamedTuple):
    """Predictions for B images.

    counts, counts_std: (B, N), counts. dense_counts, dense_counts_std: (B, F), counts. force_n,
    force_std_n: (B,), N, or None if the run was trained on presses of one force. shear_n,
    shear_std_n: (B, 2), N, or None if it was trained without.
    """

    counts: torch.Tensor
    counts_std: torch.Tensor
    dense_counts: torch.Tensor
    dense_counts_std: torch.Tensor
    force_n: torch.Tensor | None
    force_std_n: torch.Tensor | None
    shear_n: torch.Tensor | None = None
    shear_std_n: torch.Tensor | None = None


class AllPredictions(NamedTuple):
    """The predictions of one pass for B images.

    features: (B, n), for the frame check, and contact: None unless they are wanted.
    """

    field: FieldPrediction
    features: torch.Tensor | None
    contact: ContactPrediction | None

    def named(self) -> dict[str, torch.Tensor]:
        """What is predicted, by the names in NAMES."""
        parts = [*self.field, self.features, *(self.contact or ())]
        return {name: each for name, each in zip(NAMES, parts, strict=False) if each is not None}


FEATURES = "frame_features"
"""Name of the features for the frame check."""

NAMES = (*FieldPrediction._fields, FEATURES, *ContactPrediction._fields)
"""Names of all predictions, in order."""


class FieldReadout(nn.Module):
    """Reads the counts of a layout from the outputs of a calibrated network.

    reading: (N, F), maps the dense counts to the counts. full_scale: counts.
    """

    reading: torch.Tensor
    factor: torch.Tensor
    place_knots: torch.Tensor
    press_knots: torch.Tensor
    force_knots: torch.Tensor
    force_scale: torch.Tensor
    shear_knots: torch.Tensor
    shear_scale: torch.Tensor

    def __init__(self, network: FieldNet, reading: np.ndarray, full_scale: float) -> None:
        super().__init__()
        self.full_scale = full_scale
        self.predicts_force = predicts_force(network)
        factor = torch.linalg.cholesky(network.correlation.cpu().double()).float()
        self.register_buffer("reading", torch.from_numpy(reading).float())
        self.register_buffer("factor", factor)
        shear = ("shear_knots", "shear_scale") if network.predicts_shear else ()
        for name in (*KNOTS, "force_scale", *shear):
            self.register_buffer(name, getattr(network, name).detach().clone())
        self.to(network.correlation.device)

    def forward(self, outputs: FieldOutputs) -> FieldPrediction:
        """All counts are clipped to zero and full scale."""
        dense_counts = (outputs.mean * self.full_scale).clamp(0.0, self.full_scale)
        std = standard_deviation(outputs.log_spread, self.place_knots, self.press_knots)
        dense_counts_std = self.full_scale * std
        counts = (dense_counts @ self.reading.T).clamp(0.0, self.full_scale)
        # A taxel averages several places, whose errors are correlated.
        parts = (dense_counts_std[:, None, :] * self.reading) @ self.factor
        counts_std = parts.square().sum(dim=2).sqrt()
        found = FieldPrediction(counts, counts_std, dense_counts, dense_counts_std, None, None)
        if outputs.shear is not None and outputs.shear_log_spread is not None:
            factor = interpolate_scale(outputs.shear_log_spread, self.shear_knots)
            spread = outputs.shear_log_spread.exp() * factor
            found = found._replace(
                shear_n=self.shear_scale * outputs.shear, shear_std_n=self.shear_scale * spread
            )
        if not self.predicts_force:
            return found
        shifted = torch.exp(outputs.force * self.force_scale[1] + self.force_scale[0])
        spread = outputs.force_log_spread.exp() * interpolate_scale(
            outputs.force_log_spread, self.force_knots
        )
        spread = spread * self.force_scale[1]
        force = (shifted - FORCE_OFFSET_N).clamp(min=0.0)
        return found._replace(force_n=force, force_std_n=shifted * spread)

    def sample(self, prediction: FieldPrediction, number: int, seed: int) -> torch.Tensor:
        """(B, number, F) fields sampled from the predicted distributions, counts."""
        generator = torch.Generator().manual_seed(seed)
        shape = (prediction.dense_counts.shape[0], number, prediction.dense_counts.shape[1])
        normal = torch.randn(shape, generator=generator).to(prediction.dense_counts.device)
        deviation = prediction.dense_counts_std[:, None] * (normal @ self.factor.T)
        return (prediction.dense_counts[:, None] + deviation).clamp(0.0, self.full_scale)


def log_force(force_n: torch.Tensor) -> torch.Tensor:
    """The shifted logarithm of forces, the target of training. Any shape, N."""
    return torch.log(force_n + FORCE_OFFSET_N)


def predicts_force(network: FieldNet) -> bool:
    """Whether the network was trained on presses of several forces."""
    return float(network.force_scale[1]) > MIN_FORCE_SCALE


class DenseImage(nn.Module):
    """Maps (B, F) to (B, R, C), zero outside the places' convex hull.

    x_mm, y_mm: (F,), mm. shape: R and C. px_per_mm: scale of the image.
    """

    corners: torch.Tensor
    weights: torch.Tensor

    def __init__(
        self, x_mm: np.ndarray, y_mm: np.ndarray, shape: tuple[int, int], px_per_mm: float
    ) -> None:
        super().__init__()
        self.shape = shape
        columns_mm, rows_mm = (
            (np.arange(size) + 0.5) / px_per_mm - size / px_per_mm / 2 for size in reversed(shape)
        )
        centers = np.stack(np.meshgrid(columns_mm, rows_mm), axis=-1).reshape(-1, 2)
        matrix = barycentric(np.column_stack([x_mm, y_mm]), centers)
        inside = np.diff(matrix.indptr) == 3
        corners = np.zeros((centers.shape[0], 3), np.int64)
        weights = np.zeros((centers.shape[0], 3), np.float32)
        corners[inside] = matrix.indices.reshape(-1, 3)
        weights[inside] = matrix.data.reshape(-1, 3).clip(0.0, 1.0)
        self.register_buffer("corners", torch.from_numpy(np.ascontiguousarray(corners.T)))
        self.register_buffer("weights", torch.from_numpy(np.ascontiguousarray(weights.T)))

    def forward(self, field: torch.Tensor) -> torch.Tensor:
        # Indexed by number: the tracer does not support iteration over a tensor.
        first, second, third = (
            field.index_select(1, self.corners[n]) * self.weights[n] for n in range(3)
        )
        return (first + second + third).unflatten(1, self.shape)


def force_target(network: FieldNet, force_n: torch.Tensor) -> torch.Tensor:
    """The standardized logarithm of forces. Any shape."""
    mean, std = network.force_scale
    return (log_force(force_n) - mean) / std.clamp(min=MIN_FORCE_SCALE)


class FromPixels(nn.Module):
    """The whole prediction in float32 on the CPU.

    Inputs: RGB pixels in [0, 1], (B, 3, S, S), and a background frame, (1, 3, S, S). Outputs:
    counts, tactile images, then the other predictions of NAMES that the network has.
    """

    mean: torch.Tensor
    std: torch.Tensor

    def __init__(
        self,
        network: FieldNet,
        readout: FieldReadout,
        dense_image: DenseImage,
        contact: ContactReadout | None,
    ) -> None:
        super().__init__()
        self.network = deepcopy(network).cpu()
        self.readout = deepcopy(readout).cpu()
        self.dense_image = deepcopy(dense_image).cpu()
        self.contact = None if contact is None else deepcopy(contact).cpu()
        self.register_buffer("mean", torch.from_numpy(RGB_MEAN).view(3, 1, 1))
        self.register_buffer("std", torch.from_numpy(RGB_STD).view(3, 1, 1))

    @property
    def mean_frame(self) -> torch.Tensor:
        """(1, 3, S, S) in [0, 1]: the dataset's mean background frame."""
        return (self.network.mean_frame * self.std + self.mean)[None]

    def forward(self, pixels: torch.Tensor, background: torch.Tensor) -> tuple[torch.Tensor, ...]:
        both = [(each - self.mean) / self.std for each in (pixels, background.expand_as(pixels))]
        outputs = self.network(torch.cat(both, dim=1), self.contact is not None, True)
        is_own = (both[1] - self.network.mean_frame).abs().amax() > SAME_FRAME
        contact = None if self.contact is None else self.contact(outputs.contact, is_own)
        found = AllPredictions(self.readout(outputs), outputs.features, contact)
        counts, *others = found.named().values()
        return counts, self.dense_image(found.field.dense_counts), *others

    @property
    def missing(self) -> set[str]:
        """Names of the predictions that the network does not have."""
        force = () if self.readout.predicts_force else ("force_n", "force_std_n")
        shear = () if self.network.predicts_shear else ("shear_n", "shear_std_n")
        contact = () if self.contact is not None else ContactPrediction._fields
        return {*force, *shear, *contact}
