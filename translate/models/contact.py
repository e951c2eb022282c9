"""The contact in the camera's view: the losses of its layers, their calibration, and its readout.

Shape letters: B batch, H side of the maps.
"""

from collections.abc import Iterable, Sequence

import torch
from torch.nn import functional

from t2twin.translate.data.pairs import ImageFile
from t2twin.translate.networks.field_net import CONTACT_KNOTS, FieldNet, Outputs
from t2twin.translate.uncertainty.calibration import (
    MIN_ERRORS,
    calibrated,
    fit_knots,
    identity_knots,
    negative_log_likelihood,
)

# Pressure from which a cell is in contact, kPa (assumed: a hundredth of a gel's modulus)
CONTACT_KPA = 5.0
# Weight of errors in the contact relative to others (assumed: it is about a tenth of the view)
IN_CONTACT_WEIGHT = 4.0
SQUARED_WEIGHT = 0.3  # Weight of squared errors relative to absolute errors (assumed)
ROUNDING = 0.03  # Absolute error below which it is rounded off, fraction of the scale (assumed)
MIN_SCALES = (0.01, 1.0)  # Of depth, mm, and pressure, kPa (assumed), for presses without contact
# Share of the images without contact that show one, and limit on the share of those with a contact
# in which it is missed (assumed)
FALSE_SHARE, MISSED_SHARE = 0.01, 0.005
MIN_WITHOUT_CONTACT = 20  # Minimum number of held-out images that a limit is set on (assumed)
SCALE_PRESSES = 2000  # Presses that the scales are measured on
EVEN = 0.5  # Probability from which a cell is in contact
MAPS = ("depth_mm", "depth_std_mm", "pressure_kpa", "pressure_std_kpa", "probability")
CENTER = ("center_mm", "center_std_mm")  # Names of the predictions, see `read_contact`
SPREADS = ("depth", "pressure")  # Outputs with a spread


def contact_scale(maps: ImageFile) -> torch.Tensor:
    """(2,) root mean squares of depth, mm, and pressure, kPa, in the contacts of training pairs."""
    depth, pressure = torch.from_numpy(maps[:SCALE_PRESSES]).float().unbind(dim=1)
    inside = pressure > CONTACT_KPA
    values = [each[inside].square().mean().sqrt().nan_to_num() for each in (depth, pressure)]
    return torch.stack(values).maximum(torch.tensor(MIN_SCALES))


def contact_errors(network: FieldNet, outputs: Outputs, maps: torch.Tensor) -> Outputs:
    """Outputs minus targets, of the scales. maps: (B, 2, H, H) depth, mm, and pressure, kPa."""
    scaled = zip(SPREADS, maps.unbind(dim=1), network.contact_scale, strict=True)
    return {name: outputs[name] - values / scale for name, values, scale in scaled}


def contact_losses(network: FieldNet, outputs: Outputs, maps: torch.Tensor) -> Outputs:
    """The losses of a batch by name. maps: as for `contact_errors`."""
    inside = (maps[:, 1] > CONTACT_KPA).float()
    weight = 1.0 + (IN_CONTACT_WEIGHT - 1.0) * inside
    weight = weight / weight.mean()
    losses = {}
    for name, error in contact_errors(network, outputs, maps).items():
        rounded = (error.square() + ROUNDING**2).sqrt() - ROUNDING
        losses[f"contact_{name}"] = (weight * (rounded + SQUARED_WEIGHT * error.square())).mean()
        likelihood = negative_log_likelihood(error.detach(), outputs[f"{name}_spread"])
        losses[f"contact_{name}_spread"] = likelihood.mean()
    losses["contact_mask"] = functional.binary_cross_entropy_with_logits(outputs["contact"], inside)
    return losses


def read_contact(network: FieldNet, outputs: Outputs, view_mm: tuple[float, float]) -> Outputs:
    """The calibrated predictions, by the names in MAPS, (B, H, H), and in CENTER, (B, 2).

    The pressure is 0 where the probability of contact is below one half. The center of pressure is
    from the middle of the view; not a number without contact. view_mm: half the width and height.
    """
    depth_std = calibrated(outputs["depth_spread"], network.contact_depth_knots)
    std = calibrated(outputs["pressure_spread"], network.contact_pressure_knots)
    largest = outputs["contact"].amax(dim=(1, 2), keepdim=True)
    probability = torch.sigmoid(outputs["contact"])
    has_contact = largest > outputs["contact_limit"]
    probability = torch.where(has_contact, probability, probability.clamp(max=EVEN))
    pressure = torch.where(probability > EVEN, outputs["pressure"].clamp(min=0.0), 0.0)
    center, spread = center_of_pressure(pressure, std, view_mm)
    center_std = calibrated(spread.log(), network.contact_center_knots)
    mm, kpa = network.contact_scale[0], network.contact_scale[1]  # a trace cannot iterate
    maps = (mm * outputs["depth"], mm * depth_std, kpa * pressure, kpa * std, probability)
    return dict(zip((*MAPS, *CENTER), (*maps, center, center_std), strict=True))


def fit_contact_limits(
    network: FieldNet, without_contact: Sequence[torch.Tensor], with_contact: Sequence[torch.Tensor]
) -> None:
    """Sets the limits of contact, so that hardly any image without contact shows one.

    Largest logits of held-out images, each without and with background frames.
    """
    for mode, (none, some) in enumerate(zip(without_contact, with_contact, strict=True)):
        limit = torch.zeros(())
        if min(len(none), len(some)) >= MIN_WITHOUT_CONTACT:
            limit = torch.minimum(
                torch.quantile(none, 1.0 - FALSE_SHARE), torch.quantile(some, MISSED_SHARE)
            )
        network.contact_limits[mode] = limit.clamp(min=0.0)


def center_of_pressure(
    pressure: torch.Tensor, std: torch.Tensor, view_mm: tuple[float, float]
) -> tuple[torch.Tensor, torch.Tensor]:
    """(B, 2) center of pressure, mm, and its standard deviation if errors are independent."""
    side = pressure.shape[-1]
    middles = (torch.arange(side, device=pressure.device) + 0.5) * 2.0 / side - 1.0
    total = pressure.sum(dim=(1, 2))
    total = torch.where(total > 0.0, total, torch.nan)
    centers, stds = [], []
    for half, axis in zip(view_mm, (1, 2), strict=True):  # summed over rows, then over columns
        at = half * middles
        center = (pressure.sum(dim=axis) @ at) / total
        squares = std.square().sum(dim=axis) * (at - center[:, None]).square()
        centers.append(center)
        stds.append(squares.sum(dim=1).sqrt() / total)
    return torch.stack(centers, dim=1), torch.stack(stds, dim=1)


def fit_contact_knots(
    network: FieldNet, view_mm: tuple[float, float], parts: Iterable[tuple[Outputs, torch.Tensor]]
) -> None:
    """Sets the knots of the contact from outputs and maps of held-out presses."""
    names = ("depth", "depth_spread", "pressure", "pressure_spread", "contact")
    parts = [({name: outputs[name] for name in names}, maps) for outputs, maps in parts]
    if not parts:
        return
    outputs = {name: torch.cat([each[name] for each, _ in parts]) for name in names}
    maps = torch.cat([each for _, each in parts])
    for name, error in contact_errors(network, outputs, maps).items():
        _set_knots(network, name, outputs[f"{name}_spread"].exp(), error)
    network.contact_center_knots.copy_(identity_knots(len(CONTACT_KNOTS["contact_center_knots"])))
    found = read_contact(network, outputs | {"contact_limit": network.contact_limits[1]}, view_mm)
    true, _ = center_of_pressure(maps[:, 1], torch.zeros_like(maps[:, 1]), view_mm)
    error = found["center_mm"] - true
    known = error.isfinite().all(dim=1)
    if int(known.sum()) >= MIN_ERRORS:
        _set_knots(network, "center", found["center_std_mm"][known], error[known])


def _set_knots(network: FieldNet, name: str, spread: torch.Tensor, error: torch.Tensor) -> None:
    """Fits the knots of one output, on the CPU in float64."""
    key = f"contact_{name}_knots"
    knots = fit_knots(spread.double().cpu(), error.double().cpu(), CONTACT_KNOTS[key])
    getattr(network, key).copy_(knots)
