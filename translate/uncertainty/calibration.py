"""Calibration of predicted standard deviations on held-out presses.

A raw spread of the network ranks errors well, but has the wrong magnitude. First `SpreadScale`
multiplies the spreads of a press by factors of its light, force and place. It is fitted with the
pinball loss of the 90 % quantile of the errors (Koenker and Bassett 1978), as in conformalized
quantile regression (Romano et al. 2019). Then knots of each output give a factor that depends on
the spread itself (temperature scaling by bins, Guo et al. 2017), monotone as in isotonic
calibration, so that 90 % intervals cover 90 % of the errors in each bin. The correlation of the
standardized errors between places is one matrix for all images.

Shape letters: P presses, F places of the dense counts, K knots, S image side.
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
PRESS_SHARES = (0.125,) * 8  # The same of presses, their forces and shear forces (assumed)
# Smallest standard deviation, fraction of full scale (assumed: 10 counts, about the error where
# nothing touches). The noise of readings is many times larger, and not contained
MIN_STD = 10.0 / 40_000.0
MIN_ERRORS = 100  # In a bin (assumed: a 90 % quantile of fewer is unreliable)
MIN_KNOT_DISTANCE = 1e-3  # Of the knots' logarithms (assumed), so that slopes stay finite
MIN_FACTOR = 0.05  # Lower bound of a factor (assumed), for bins with tiny errors
ROUNDS = 4  # Alternating fits of place and press (assumed: little changes afterwards)
# Shrinkage of the correlation towards the identity (assumed), so that its Cholesky factor exists
SHRINKAGE = 0.02
# Of the t distribution of the likelihood. With a Gaussian, validation without the least certain
# fifth gains a third as much; 3 and 8 are equally good (measured)
DEGREES_OF_FREEDOM = 4.0


@dataclass(frozen=True)
class Errors:
    """Errors and raw spreads on one dataset's presses."""

    dense_counts: torch.Tensor  # (P, F), fraction of full scale
    spread: torch.Tensor  # the same of their spreads
    force: torch.Tensor  # (P,), of the force's logarithm
    force_spread: torch.Tensor
    of_place: torch.Tensor | None = None  # `SpreadScale.features`
    of_press: torch.Tensor | None = None
    shear: torch.Tensor | None = None  # (M, 2), of the presses that have moved
    shear_spread: torch.Tensor | None = None


# Names of the fields of all presses
FIELDS = ("of_place", "of_press", "dense_counts", "spread", "force", "force_spread")


def fit_calibration(datasets: Sequence[Errors]) -> dict[str, torch.Tensor]:
    """The knots and the correlation, by the names of FieldNet's buffers."""
    dense, spread, force, force_spread = _joined(
        datasets, "dense_counts", "spread", "force", "force_spread"
    )
    place = press = identity_knots(len(PLACE_SHARES)).double()
    press_factor = torch.ones(len(dense), 1, dtype=torch.float64)
    for _ in range(ROUNDS):
        place = fit_knots(spread, dense / press_factor, PLACE_SHARES)
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
    found = {"place_knots": place, "press_knots": press, "correlation": correlation}
    found["force_knots"] = fit_knots(force_spread, force, PRESS_SHARES)
    moving = [each for each in datasets if each.shear is not None and len(each.shear)]
    if moving:
        shear, shear_spread = _joined(moving, "shear", "shear_spread")
        found["shear_knots"] = fit_knots(shear_spread, shear, PRESS_SHARES)
    return {name: each.float() for name, each in found.items()}


def _joined(datasets: Sequence[Errors], *names: str) -> list[torch.Tensor]:
    """Fields of the errors of all presses, float64."""
    return [torch.cat([getattr(each, name) for each in datasets]).double() for name in names]


def negative_log_likelihood(error: torch.Tensor, log_spread: torch.Tensor) -> torch.Tensor:
    """Negative logarithms of Student's density, which spreads are trained on, up to a constant."""
    square = error.square() * torch.exp(-2.0 * log_spread)
    tail = torch.log1p(square / DEGREES_OF_FREEDOM)
    return log_spread + 0.5 * (DEGREES_OF_FREEDOM + 1.0) * tail


def standard_deviation(
    log_spread: torch.Tensor, place: torch.Tensor, press: torch.Tensor
) -> torch.Tensor:
    """(B, F) standard deviations of the dense counts, fraction of full scale, at least MIN_STD."""
    std = calibrated(log_spread, place)
    std = std * interpolate_scale(std.mean(dim=1, keepdim=True).log(), press)
    return std.clamp(min=MIN_STD)


def calibrated(log_spread: torch.Tensor, knots: torch.Tensor) -> torch.Tensor:
    """Standard deviations of raw spreads, of any shape. knots: (2, K)."""
    return log_spread.exp() * interpolate_scale(log_spread, knots)


def interpolate_scale(log_spread: torch.Tensor, knots: torch.Tensor) -> torch.Tensor:
    """Factors of raw spreads: linear between the knots in logarithms, constant outside."""
    at, factor = knots[0], knots[1]
    slope = (factor[1:] - factor[:-1]) / (at[1:] - at[:-1])
    distance = torch.minimum(torch.maximum(log_spread[..., None], at[:-1]), at[1:]) - at[:-1]
    return torch.exp(factor[0] + (distance * slope).sum(dim=-1))


def identity_knots(number: int) -> torch.Tensor:
    """(2, number) knots whose factor is 1 everywhere."""
    return torch.stack([torch.arange(float(number)), torch.zeros(number)])


def fit_knots(
    spread: torch.Tensor, errors: torch.Tensor, shares: Sequence[float], least: int = MIN_ERRORS
) -> torch.Tensor:
    """(2, K) knots of errors and their raw spreads, two tensors of one shape, float64.

    With few errors the last knots repeat the last bin's factor. least: of the errors in a bin.
    """
    log_spread, order = spread.flatten().log().sort()
    errors = errors.flatten().abs()[order]
    at, log_std, weight = [], [], []
    ends = [round(len(errors) * float(share)) for share in np.cumsum(shares)]
    starts = [0]
    for end in ends[:-1]:  # a bin with too few errors is merged with the next
        if end - starts[-1] >= least and len(errors) - end >= least:
            starts.append(end)
    for part in (slice(*ends) for ends in pairwise([*starts, len(errors)])):
        ratio = (errors[part] / log_spread[part].exp()).sort().values
        factor = ratio[min(int(LEVEL * len(ratio)), len(ratio) - 1)] / HALF_WIDTH
        at.append(float(log_spread[part].mean()))
        log_std.append(at[-1] + float(factor.clamp(min=MIN_FACTOR).log()))
        weight.append(len(ratio))
    factors = isotonic_regression(log_std, weights=weight).x - at
    for k in range(1, len(at)):
        at[k] = max(at[k], at[k - 1] + MIN_KNOT_DISTANCE)
    number = np.arange(len(shares))
    own = np.minimum(number, len(at) - 1)
    return torch.from_numpy(np.stack([np.array(at)[own] + number - own, factors[own]]))


SCALE_WIDTH = 24  # Width of the layers (assumed; 48 gains nothing)
# Cells along each side of an image, whose mean colors are compared with the mean frame (assumed:
# some are without contact). With the light's magnitude alone, intervals of some lights are wrong
SCALE_CELLS = 6
# Added to predicted counts before their logarithm is taken, fraction of full scale (assumed: 20
# counts, the error where nothing touches)
MIN_SHARE = 5e-4
MIN_COLOR = 0.01  # The same for differences of colors, in their standard deviations (assumed)
# Largest difference, normalized, up to which a background frame is the mean frame, that is, none
# was given (assumed: rounding errors)
SAME_FRAME = 1e-3
EDGE_MM = 1.5  # Distance from the view's edge of places at the edge (assumed: most of the spacing)
FARTHEST_MM = 6.0  # Distance from the view's edge beyond which places are alike, mm (assumed)
FEATURE_LIMIT = 4.0  # Of a standardized feature (assumed), so that nothing is extrapolated far
LOG_LIMITS = (-2.0, 3.0)  # Limits of a factor's logarithm (assumed)
OF_PLACE, OF_PRESS = 5, 12  # Features of a place, and of a press without the cells of its light
# Errors below it count alike, fraction of full scale, or standard deviations of the force's
# logarithm (assumed: 2.5 counts)
MIN_ERROR = 6e-5
MIN_DEVIATION = 1e-3  # Of a feature (assumed), for features that hardly vary
MIN_PRESSES = 500  # For a fit (assumed: fewer do not represent other presses)
# Presses of a block, which are often of the same shapes; one block of every three is held out
# (assumed). Knots of the presses that the factors were fitted to would be too narrow for others
# (split conformal prediction, Lei et al. 2018)
BLOCK, HELD_OUT_EVERY = 16, 3
STEPS, BATCH, RATE, WEIGHT_DECAY, SEED = 1400, 64, 0.01, 0.01, 0  # Of the fit (assumed)
# Share of the cells of the light that are left out in the fit (assumed). Without it, intervals are
# too narrow in light that the fit has not seen
CELL_DROPOUT = 0.5


class SpreadScale(nn.Module):
    """Logarithms of the factors of the raw spreads; 0 until it is fitted."""

    outside_mm: torch.Tensor
    center: torch.Tensor
    deviation: torch.Tensor

    def __init__(
        self, x_mm: np.ndarray, y_mm: np.ndarray, view_mm: tuple[float, float],
        grid: tuple[int, int], size: int,
    ) -> None:  # fmt: skip
        """x_mm, y_mm: (F,) the places. view_mm: half the width and half the height of the view.
        grid: columns and rows of the places. size: S."""
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
        self, images: torch.Tensor, mean_frame: torch.Tensor, mean: torch.Tensor,
        log_spread: torch.Tensor, force: torch.Tensor, force_log_spread: torch.Tensor,
    ) -> tuple[torch.Tensor, torch.Tensor]:  # fmt: skip
        """(P, F, OF_PLACE) features of the places and (P, n) of the press.

        images: (P, 6, S, S), each with its background frame. mean and the rest: raw outputs.
        """
        share = mean.clamp(0.0, 1.0)
        total = share.sum(dim=1) + MIN_SHARE * share.shape[1]
        around = functional.max_pool2d(share.unflatten(1, (1, *self.grid)), 3, 1, 1).flatten(1)
        log_share, log_around = (share + MIN_SHARE).log(), (around + MIN_SHARE).log()
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
        """Logarithms of the factors, of the dense counts, (P, F), and of the force, (P,)."""
        repeated = of_press[:, None].expand(-1, of_place.shape[1], -1)
        both = torch.cat([of_place, repeated], dim=2).float()
        known = ((both - self.center) / self.deviation).clamp(-FEATURE_LIMIT, FEATURE_LIMIT)
        of_places, of_force = self.place(known), self.force(known[:, 0, OF_PLACE:])
        return of_places[..., 0].clamp(*LOG_LIMITS), of_force[..., 0].clamp(*LOG_LIMITS)


def fit_scale(scale: SpreadScale, datasets: Sequence[Errors]) -> None:
    """Fits the factors to held-out presses, in place; with fewer than MIN_PRESSES they stay."""
    of_place, of_press, error, spread, force_error, force_spread = (
        each.float() for each in _joined(datasets, *FIELDS)
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
        fitted.deviation.copy_(deviation.clamp(min=MIN_DEVIATION))
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
    """The presses that factors are fitted to, or those of the knots; few presses are in both."""
    if len(errors.force) < MIN_PRESSES:
        return errors
    is_held_out = np.arange(len(errors.force)) // BLOCK % HELD_OUT_EVERY == 0
    part = torch.from_numpy(np.flatnonzero(is_held_out == held_out))
    return replace(errors, **{name: getattr(errors, name)[part] for name in FIELDS})


def scaled(scale: SpreadScale, errors: Errors) -> Errors:
    """The errors with their spreads times the factors."""
    assert errors.of_place is not None and errors.of_press is not None
    device = scale.center.device
    found = scale(errors.of_place.to(device), errors.of_press.to(device))
    place, force = (each.exp().cpu() for each in found)
    return replace(errors, spread=errors.spread * place, force_spread=errors.force_spread * force)


def _quantile_loss(errors: torch.Tensor, log_std: torch.Tensor) -> torch.Tensor:
    """Pinball loss of the logarithm of half the interval's width."""
    half_width = HALF_WIDTH * log_std.exp()
    beyond = (errors.abs() + MIN_ERROR).log() - (half_width + MIN_ERROR).log()
    return torch.maximum(LEVEL * beyond, (LEVEL - 1.0) * beyond).mean()


def _layers(features: int) -> nn.Sequential:
    """Two hidden layers; the result is 0 until they are fitted."""
    last = nn.Linear(SCALE_WIDTH, 1)
    nn.init.zeros_(last.weight)
    nn.init.zeros_(last.bias)
    first, second = nn.Linear(features, SCALE_WIDTH), nn.Linear(SCALE_WIDTH, SCALE_WIDTH)
    return nn.Sequential(first, nn.SiLU(), second, nn.SiLU(), last)


def _cells(difference: torch.Tensor, side: int) -> torch.Tensor:
    """(P, n) logarithms of the colors' mean absolute difference in each cell of images."""
    means = functional.avg_pool2d(difference, side).abs().mean(dim=1)
    return (means + MIN_COLOR).log().flatten(1)
