"""Calibration of predicted standard deviations on held-out presses.

The network predicts a raw spread per place, which ranks errors well but has the wrong magnitude.
The spread is multiplied by a factor that depends on the spread itself: a piecewise linear function
in logarithms, given by knots. Each knot's factor makes 90 % intervals cover 90 % of the errors in
its bin (temperature scaling by bins, Guo et al. 2017). The result is monotone, as in isotonic
calibration. A second factor depends on the mean standard deviation of the press. The force has its
own knots.

The correlation of the standardized errors between places is one matrix for all images.

Factors of the press come first. A spread of the network ranks the errors within a press well, but
hardly those of different presses. A network with two small layers predicts how much wider or
narrower intervals must be. It knows the predicted counts and force, and the place relative to the
view. It also knows the share of the contact at the view's edge and outside, the light, and whether
there is a background frame. The light is the difference of the background frame, or without one of
the image, from the mean frame, in cells: with its magnitude alone, intervals are too wide in the
default light or too narrow in others. The network is fitted to held-out presses with the pinball
loss of the 90 % quantile of the errors (Koenker and Bassett 1978), as in conformalized quantile
regression (Romano et al. 2019). The knots then have little left to correct.

Shape letters: P presses, F places of the dense counts, K knots, S image side, N
features.
"""

from collections.abc import Sequence
from copy import deepcopy
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
import torch
from scipy.optimize import isotonic_regression
from torch import nn
from torch.nn import functional

from t2twin.translate.data.images import COLORS

LEVEL = 0.9  # Coverage that the calibrated intervals reach
HALF_WIDTH = 1.6448536  # Half the width of that interval of a Gaussian, standard deviations
# Share of all places in the bin of each knot, in ascending order of spread; the largest spreads
# need the finest bins (assumed)
PLACE_SHARES = (*(0.1,) * 8, 0.05, 0.05, 0.025, 0.025, 0.02, 0.01, 0.01, 0.005, 0.005)
# Share of all presses in the bin of each knot of press and force (assumed)
PRESS_SHARES = FORCE_SHARES = (0.125,) * 8
# Share of all components of the shear force in the bin of each knot (assumed)
SHEAR_SHARES = (0.125,) * 8
# Smallest standard deviation, fraction of full scale (assumed: 10 counts, about the error where
# nothing touches). The noise of readings is many times larger, and not contained
MIN_STD = 10.0 / 40_000.0
# Minimum number of errors in a bin (assumed: a 90 % quantile of fewer is unreliable)
MIN_ERRORS = 100
# Smallest distance of two knots' logarithms (assumed), so that slopes stay finite
MIN_KNOT_DISTANCE = 1e-3
MIN_FACTOR = 0.05  # Lower bound of a factor (assumed), for bins with tiny errors
# Alternating fits of the factors of place and press (assumed: little changes afterwards)
ROUNDS = 4
# Shrinkage of the correlation towards the identity (assumed), so that its Cholesky factor exists
# with fewer presses than places
SHRINKAGE = 0.02


@dataclass(frozen=True)
class Errors:
    """Errors and predicted spreads on one dataset's presses.

    dense_counts: (P, F), errors as a fraction of full scale. spread: (P, F), raw spreads of the
    network. force: (P,), errors of the force's logarithm. force_spread: (P,), raw spreads of these.
    of_place, of_press: features of places and presses, see SpreadScale. shear,
    shear_spread: (M, 2), the same of the shear force of the M presses that have moved, if it is
    predicted and known.
    """

    dense_counts: torch.Tensor
    spread: torch.Tensor
    force: torch.Tensor
    force_spread: torch.Tensor
    of_place: torch.Tensor | None = None
    of_press: torch.Tensor | None = None
    shear: torch.Tensor | None = None
    shear_spread: torch.Tensor | None = None


def fit_calibration(datasets: Sequence[Errors]) -> dict[str, torch.Tensor]:
    """Fits the calibration to one or more datasets; every press has the same weight.

    Returns by the names of FieldNet's buffers place_knots, press_knots, force_knots and, if it is
    known, shear_knots, (2, K): ascending logarithms of spreads, and of their factors; and
    correlation, (F, F), of the standardized errors of the dense counts.
    """
    dense, spread, force, force_spread = (
        torch.cat([getattr(dataset, name) for dataset in datasets]).double()
        for name in ("dense_counts", "spread", "force", "force_spread")
    )
    place = press = identity_knots(len(PLACE_SHARES)).double()
    press_factor = torch.ones(len(dense), 1, dtype=torch.float64)
    for _ in range(ROUNDS):
        place = fit_knots(spread, dense / press_factor, PLACE_SHARES, MIN_ERRORS)
        std = spread * interpolate_scale(spread.log(), place)
        level = std.mean(dim=1, keepdim=True)
        least = MIN_ERRORS * dense.shape[1]
        press = fit_knots(level.expand_as(std), level * dense / std, PRESS_SHARES, least)
        press_factor = interpolate_scale(level.log(), press)
    standardized = dense / standard_deviation(spread.log(), place, press)
    moment = standardized.T @ standardized / len(standardized)
    inverse_std = moment.diagonal().clamp(min=1e-12).rsqrt()
    correlation = (1.0 - SHRINKAGE) * inverse_std[:, None] * moment * inverse_std
    correlation.fill_diagonal_(1.0)
    found = {
        "place_knots": place,
        "press_knots": press,
        "force_knots": fit_knots(force_spread, force, FORCE_SHARES, MIN_ERRORS),
        "correlation": correlation,
    }
    shear = [(each.shear, each.shear_spread) for each in datasets if each.shear is not None]
    if sum(len(errors) for errors, _ in shear):
        errors, spread = (torch.cat(each).double() for each in zip(*shear, strict=True))
        found["shear_knots"] = fit_knots(spread, errors, SHEAR_SHARES, MIN_ERRORS)
    return {name: each.float() for name, each in found.items()}


# Of the t distribution of the likelihood. After 2,000 steps on fixed features, validation without
# the least certain fifth has a 13 % lower RMSE, with a Gaussian 4 %; 3 and 8 are equally good
# (measured)
DEGREES_OF_FREEDOM = 4.0


def negative_log_likelihood(error: torch.Tensor, log_spread: torch.Tensor) -> torch.Tensor:
    """Negative logarithms of Student's density, which spreads are trained on, up to a constant."""
    square = error.square() * torch.exp(-2.0 * log_spread)
    tail = torch.log1p(square / DEGREES_OF_FREEDOM)
    return log_spread + 0.5 * (DEGREES_OF_FREEDOM + 1.0) * tail


def standard_deviation(
    log_spread: torch.Tensor, place: torch.Tensor, press: torch.Tensor
) -> torch.Tensor:
    """(B, F) standard deviations, fraction of full scale, at least MIN_STD.

    log_spread: (B, F), logarithms of the raw spreads. place, press: (2, K) knots.
    """
    std = calibrated(log_spread, place)
    std = std * interpolate_scale(std.mean(dim=1, keepdim=True).log(), press)
    return std.clamp(min=MIN_STD)


def calibrated(log_spread: torch.Tensor, knots: torch.Tensor) -> torch.Tensor:
    """Standard deviations of raw spreads, of any shape. knots: (2, K)."""
    return log_spread.exp() * interpolate_scale(log_spread, knots)


def interpolate_scale(log_spread: torch.Tensor, knots: torch.Tensor) -> torch.Tensor:
    """Factors of raw spreads: linear between the knots in logarithms, constant outside.

    log_spread: any shape. knots: (2, K). Returns the shape of log_spread.
    """
    at, factor = knots[0], knots[1]
    slope = (factor[1:] - factor[:-1]) / (at[1:] - at[:-1])
    distance = torch.minimum(torch.maximum(log_spread[..., None], at[:-1]), at[1:]) - at[:-1]
    return torch.exp(factor[0] + (distance * slope).sum(dim=-1))


def identity_knots(number: int) -> torch.Tensor:
    """(2, number) knots whose factor is 1 everywhere."""
    return torch.stack([torch.arange(float(number)), torch.zeros(number)])


def fit_knots(
    spread: torch.Tensor, errors: torch.Tensor, shares: Sequence[float], least: int
) -> torch.Tensor:
    """(2, K) knots of errors and their raw spreads, two tensors of one shape.

    K is the number of shares; if there are few errors, the last knots repeat the last bin's factor.
    least: minimum number of errors in a bin.
    """
    log_spread, order = spread.flatten().log().sort()
    errors = errors.flatten().abs()[order]
    at, log_std, weight = [], [], []
    for part in _bins(len(errors), shares, least):
        ratio = (errors[part] / log_spread[part].exp()).sort().values
        factor = ratio[min(int(LEVEL * len(ratio)), len(ratio) - 1)] / HALF_WIDTH
        at.append(float(log_spread[part].mean()))
        log_std.append(at[-1] + float(factor.clamp(min=MIN_FACTOR).log()))
        weight.append(len(ratio))
    monotone = isotonic_regression(log_std, weights=weight).x
    knots = identity_knots(len(shares)).double()
    last = len(at) - 1
    for k in range(len(shares)):
        knots[0, k] = at[min(k, last)] + max(0, k - last)
        knots[1, k] = monotone[min(k, last)] - at[min(k, last)]
        if 0 < k <= last:
            knots[0, k] = max(float(knots[0, k]), float(knots[0, k - 1]) + MIN_KNOT_DISTANCE)
    return knots


def _bins(number: int, shares: Sequence[float], least: int) -> list[slice]:
    """Divides `number` ordered errors; a bin with fewer than `least` is merged with the next."""
    ends = [round(number * float(share)) for share in np.cumsum(shares)]
    starts = [0]
    for end in ends[:-1]:
        if end - starts[-1] >= least and number - end >= least:
            starts.append(end)
    return [slice(*part) for part in pairwise([*starts, number])]


SCALE_WIDTH = 24  # Width of the layers (assumed; 48 gains nothing)
# Cells along each side of an image, whose mean colors are compared with the mean frame (assumed:
# some are without contact)
SCALE_CELLS = 6
# Added to predicted counts before their logarithm is taken, fraction of full scale (assumed: 20
# counts, the error where nothing touches)
LEAST_SHARE = 5e-4
LEAST_COLOR = 0.01  # The same for differences of colors, in their standard deviations (assumed)
# Largest difference, normalized, up to which a background frame is the mean frame, that is, none
# was given (assumed: rounding errors)
SAME_FRAME = 1e-3
# Distance from the view's edge within which a place is at the edge, mm (assumed: most of the
# distance of neighboring places)
EDGE_MM = 1.5
FARTHEST_MM = 6.0  # Distance from the view's edge beyond which places are alike, mm (assumed)
FEATURE_LIMIT = (
    4.0  # Limit of a standardized feature (assumed), so that nothing is extrapolated far
)
LOG_LIMITS = (-2.0, 3.0)  # Limits of a factor's logarithm (assumed)
# Features of a place, and of a press without the cells of its background frame
OF_PLACE, OF_PRESS = 5, 12
# Errors below it count alike, fraction of full scale, or standard deviations of the force's
# logarithm (assumed: 2.5 counts)
LEAST_ERROR = 6e-5
# Least standard deviation of a feature (assumed), for features that hardly vary
LEAST_DEVIATION = 1e-3
# Minimum number of held-out presses for a fit (assumed: fewer do not represent other presses)
MIN_PRESSES = 500
# Presses of a block, which are often of the same shapes; one block of every three is held out
# (assumed). Knots of the presses that the factors were fitted to would be too narrow for others
# (split conformal prediction, Lei et al. 2018)
BLOCK, HELD_OUT_EVERY = 16, 3
STEPS, BATCH, RATE, WEIGHT_DECAY, SEED = 1400, 64, 0.01, 0.01, 0  # Of the fit (assumed)
# Share of the cells of the light that are left out in the fit (assumed). Without it, intervals are
# too narrow in light that the fit has not seen
CELL_DROPOUT = 0.5


class SpreadScale(nn.Module):
    """Logarithms of the factors of the raw spreads; 0 until it is fitted.

    x_mm, y_mm: (F,) the places, mm. view_mm: half the width and half the height of the view, mm.
    grid: columns and rows of the places. size: S.
    """

    outside_mm: torch.Tensor
    center: torch.Tensor
    deviation: torch.Tensor

    def __init__(
        self,
        x_mm: np.ndarray,
        y_mm: np.ndarray,
        view_mm: tuple[float, float],
        grid: tuple[int, int],
        size: int,
    ) -> None:
        super().__init__()
        self.grid, self.cell = grid, max(1, size // SCALE_CELLS)
        of_press = OF_PRESS + COLORS * (size // self.cell) ** 2
        outside_mm = np.maximum(np.abs(x_mm) - view_mm[0], np.abs(y_mm) - view_mm[1])
        self.register_buffer("outside_mm", torch.from_numpy(outside_mm).float(), persistent=False)
        with torch.random.fork_rng(devices=[]):  # other weights do not depend on these
            torch.manual_seed(SEED)
            self.place, self.force = _layers(OF_PLACE + of_press), _layers(of_press)
        self.register_buffer("center", torch.zeros(OF_PLACE + of_press))
        self.register_buffer("deviation", torch.ones(OF_PLACE + of_press))
        self.requires_grad_(False)

    def reset(self) -> None:
        """Sets all factors to 1."""
        for layers in (self.place, self.force):
            for each in layers[-1].parameters():
                each.zero_()

    def features(
        self,
        images: torch.Tensor,
        mean_frame: torch.Tensor,
        mean: torch.Tensor,
        log_spread: torch.Tensor,
        force: torch.Tensor,
        force_log_spread: torch.Tensor,
    ) -> tuple[torch.Tensor, torch.Tensor]:
        """(P, F, OF_PLACE) features of the places and (P, N) of the press.

        images: (P, 6, S, S), each with its background frame. mean_frame: (3, S, S). The others are
        outputs of the network.
        """
        share = mean.clamp(0.0, 1.0)
        total = share.sum(dim=1) + LEAST_SHARE * share.shape[1]
        around = functional.max_pool2d(share.unflatten(1, (1, *self.grid)), 3, 1, 1).flatten(1)
        log_share, log_around = (share + LEAST_SHARE).log(), (around + LEAST_SHARE).log()
        near = (self.outside_mm.abs() < EDGE_MM).float()
        outside = (self.outside_mm > 0).float()
        at = self.outside_mm.clamp(-FARTHEST_MM, FARTHEST_MM).expand_as(share)
        of_place = [log_spread, log_share, log_around, at, log_around - log_share]
        image, frame = images.float().split(3, dim=1)
        differences = image - mean_frame, frame - mean_frame, image - frame
        light, of_frame, touched = (_cells(each, self.cell) for each in differences)
        of_press = [
            log_spread.mean(dim=1), log_share.mean(dim=1), total.log(), force, force_log_spread,
            share @ near / total, share @ outside / total,
            light.mean(dim=1), light.amin(dim=1), of_frame.mean(dim=1),
            touched.mean(dim=1), touched.amax(dim=1),
        ]  # fmt: skip
        is_given = differences[1].abs().amax(dim=(1, 2, 3), keepdim=True) > SAME_FRAME
        own_light = torch.where(is_given, differences[1], differences[0])
        cells = functional.avg_pool2d(own_light, self.cell).flatten(1)
        return torch.stack(of_place, dim=2), torch.cat([torch.stack(of_press, dim=1), cells], dim=1)

    def forward(
        self, of_place: torch.Tensor, of_press: torch.Tensor
    ) -> tuple[torch.Tensor, torch.Tensor]:
        """Logarithms of the factors, of the dense counts, (P, F), and of the force, (P,).

        of_place, of_press: the features.
        """
        both = torch.cat(
            [of_place, of_press[:, None].expand(-1, of_place.shape[1], -1)], dim=2
        ).float()
        known = ((both - self.center) / self.deviation).clamp(-FEATURE_LIMIT, FEATURE_LIMIT)
        of_places, of_force = self.place(known), self.force(known[:, 0, OF_PLACE:])
        return of_places[..., 0].clamp(*LOG_LIMITS), of_force[..., 0].clamp(*LOG_LIMITS)


def fit_scale(scale: SpreadScale, datasets: Sequence[Errors]) -> None:
    """Fits the factors to held-out presses, in place; with fewer than MIN_PRESSES they stay.

    datasets: raw spreads and errors, with features.
    """
    of_place, of_press, error, spread, force_error, force_spread = (
        torch.cat([getattr(each, name) for each in datasets])
        for name in ("of_place", "of_press", "dense_counts", "spread", "force", "force_spread")
    )
    if len(of_press) < MIN_PRESSES:
        return
    log_spread, force_log_spread = spread.log(), force_spread.log()
    with torch.random.fork_rng(devices=[]), torch.enable_grad():
        torch.manual_seed(SEED)
        fitted = deepcopy(scale).cpu()
        fitted.place, fitted.force = map(_layers, (scale.center.numel(), of_press.shape[1]))
        parts = (of_place.flatten(0, 1), of_press)
        fitted.center.copy_(torch.cat([part.mean(dim=0) for part in parts]))
        deviation = torch.cat([part.std(dim=0, correction=0) for part in parts])
        fitted.deviation.copy_(deviation.clamp(min=LEAST_DEVIATION))
        optimizer = torch.optim.AdamW(fitted.parameters(), RATE, weight_decay=WEIGHT_DECAY)
        schedule = torch.optim.lr_scheduler.OneCycleLR(optimizer, RATE, STEPS)
        for _ in range(STEPS):
            batch = torch.randint(len(of_press), (BATCH,))
            press, mean = of_press[batch], fitted.center[OF_PLACE:]
            varied = mean + functional.dropout(press - mean, CELL_DROPOUT)
            press = torch.cat([press[:, :OF_PRESS], varied[:, OF_PRESS:]], dim=1)
            place, force = fitted(of_place[batch], press)
            loss = _quantile_loss(error[batch], log_spread[batch] + place)
            loss = loss + _quantile_loss(force_error[batch], force_log_spread[batch] + force)
            optimizer.zero_grad()
            loss.backward()
            optimizer.step()
            schedule.step()
    scale.load_state_dict(fitted.state_dict())


def part_of(errors: Errors, held_out: bool) -> Errors:
    """The presses that the factors are fitted to, or those that are held out for the calibration.
    Few presses are in both parts."""
    presses = len(errors.force)
    if presses < MIN_PRESSES:
        return errors
    is_held_out = np.arange(presses) // BLOCK % HELD_OUT_EVERY == 0
    part = torch.from_numpy(np.flatnonzero(is_held_out == held_out))
    names = ("dense_counts", "spread", "force", "force_spread", "of_place", "of_press")
    return replace(errors, **{name: getattr(errors, name)[part] for name in names})


def scaled(scale: SpreadScale, errors: Errors) -> Errors:
    """The errors with their spreads times the factors. errors: with features."""
    assert errors.of_place is not None and errors.of_press is not None
    device = scale.center.device
    found = scale(errors.of_place.to(device), errors.of_press.to(device))
    place, force = (each.exp().cpu() for each in found)
    return replace(errors, spread=errors.spread * place, force_spread=errors.force_spread * force)


def _quantile_loss(errors: torch.Tensor, log_std: torch.Tensor) -> torch.Tensor:
    """Pinball loss of the logarithm of half the interval's width."""
    half_width = HALF_WIDTH * log_std.exp()
    beyond = (errors.abs() + LEAST_ERROR).log() - (half_width + LEAST_ERROR).log()
    return torch.maximum(LEVEL * beyond, (LEVEL - 1.0) * beyond).mean()


def _layers(features: int) -> nn.Sequential:
    """Two hidden layers; the result is 0 until they are fitted."""
    last = nn.Linear(SCALE_WIDTH, 1)
    nn.init.zeros_(last.weight)
    nn.init.zeros_(last.bias)
    return nn.Sequential(
        nn.Linear(features, SCALE_WIDTH),
        nn.SiLU(),
        nn.Linear(SCALE_WIDTH, SCALE_WIDTH),
        nn.SiLU(),
        last,
    )


def _cells(difference: torch.Tensor, side: int) -> torch.Tensor:
    """(P, n) logarithms of the colors' mean absolute difference in each cell of images."""
    means = functional.avg_pool2d(difference, side).abs().mean(dim=1)
    return (means + LEAST_COLOR).log().flatten(1)
