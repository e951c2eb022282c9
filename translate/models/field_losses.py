"""The training loss of a field network.

Shape letters: B batch, F places of the field.
"""

from dataclasses import dataclass

import torch

from t2twin.translate.models.field_readout import MIN_FORCE_SCALE, log_force, predicts_force
from t2twin.translate.networks.field_net import FieldNet, FieldOutputs

ABSOLUTE_WEIGHT = 0.1
"""Weight of the field's absolute error relative to its squared error, both divided by the field's
standard deviation (assumed). Squared errors of places without contact are negligible next to those
of a contact; without this term the network predicts up to 100 counts there."""

ROUNDING = 0.01
"""Error, in standard deviations of the field, below which the absolute error is rounded off
(assumed)."""

FORCE_WEIGHT = 0.3
"""Weight of the force's squared error relative to the field's, both divided by their variance
(assumed)."""

MIN_RELATIVE_SHEAR_N = 0.3
"""Shear force below which its error is no longer relative to it, N (assumed: as for the figures of
an evaluation)."""

DEGREES_OF_FREEDOM = 4.0
"""Of the t distribution of the likelihood. After 2,000 steps on fixed features, validation without
the least certain fifth has a 13 % lower RMSE, with a Gaussian 4 %; 3 and 8 are equally good
(measured)."""


@dataclass(frozen=True)
class FieldTargets:
    """Targets of a batch.

    field: (B, F), fraction of full scale. force_n: (B,). shear_n: (B, 2), or None.
    """

    field: torch.Tensor
    force_n: torch.Tensor
    shear_n: torch.Tensor | None


def training_loss(
    network: FieldNet, outputs: FieldOutputs, targets: FieldTargets
) -> tuple[torch.Tensor, dict[str, torch.Tensor]]:
    """The loss of a batch, and its parts by name.

    Errors are divided by the standard deviation of their target, likelihoods are in nats.
    """
    error = outputs.mean - targets.field
    relative = error / network.field_variance.sqrt()
    losses = {
        "field": relative.square().mean(),
        "field_absolute": (relative.square() + ROUNDING**2).sqrt().mean(),
        "spread": _negative_log_likelihood(error.detach(), outputs.log_spread).mean(),
    }
    loss = losses["field"] + ABSOLUTE_WEIGHT * losses["field_absolute"] + losses["spread"]
    if predicts_force(network):
        error = outputs.force - force_target(network, targets.force_n)
        likelihood = _negative_log_likelihood(error.detach(), outputs.force_log_spread)
        losses |= {"force": error.square().mean(), "force_spread": likelihood.mean()}
        loss = loss + FORCE_WEIGHT * losses["force"] + losses["force_spread"]
    if outputs.shear is not None and outputs.shear_log_spread is not None:
        assert targets.shear_n is not None
        error = outputs.shear - targets.shear_n / network.shear_scale
        log_spread = outputs.shear_log_spread
        losses["shear"] = _negative_log_likelihood(error, log_spread.detach()).mean()
        likelihood = _negative_log_likelihood(error.detach(), log_spread).mean(dim=1)
        # Without markers, presses that stay still have no error.
        moving = targets.shear_n.any(dim=1).float()
        losses["shear_spread"] = likelihood @ moving / moving.sum().clamp(min=1.0)
        loss = loss + losses["shear"] + losses["shear_spread"]
    return loss, losses


def force_target(network: FieldNet, force_n: torch.Tensor) -> torch.Tensor:
    """The standardized logarithm of forces. Any shape."""
    mean, std = network.force_scale
    return (log_force(force_n) - mean) / std.clamp(min=MIN_FORCE_SCALE)


def relative_squares(error_n: torch.Tensor, shear_n: torch.Tensor) -> torch.Tensor:
    """(B,): squared errors of shear forces relative to them. Both (B, 2), N."""
    size = shear_n.square().sum(dim=1) + MIN_RELATIVE_SHEAR_N**2
    return error_n.square().sum(dim=1) / size


def _negative_log_likelihood(error: torch.Tensor, log_spread: torch.Tensor) -> torch.Tensor:
    """Negative logarithms of Student's density, up to a constant. All of one shape."""
    square = error.square() * torch.exp(-2.0 * log_spread)
    tail = torch.log1p(square / DEGREES_OF_FREEDOM)
    return log_spread + 0.5 * (DEGREES_OF_FREEDOM + 1.0) * tail
