"""Calibration of predicted standard deviations on held-out presses.

The network predicts a raw spread per place, which ranks errors well but has the wrong magnitude.
The spread is multiplied by a factor that depends on the spread itself: a piecewise linear function
in logarithms, given by knots. Each knot's factor makes 90 % intervals cover 90 % of the errors in
its bin (temperature scaling by bins, Guo et al. 2017). The result is monotone, as in isotonic
calibration. A second factor depends on the mean standard deviation of the press. The force has its
own knots. Before, the spreads are multiplied by factors of the press (module spread_scale).

The correlation of the standardized errors between places is one matrix for all images.

Shape letters: P presses, F places of the dense counts, K knots.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import torch
from scipy.optimize import isotonic_regression

LEVEL = 0.9
"""Coverage that the calibrated intervals reach."""

HALF_WIDTH = 1.6448536
"""Half the width of that interval of a Gaussian, standard deviations."""

PLACE_SHARES = (*(0.1,) * 8, 0.05, 0.05, 0.025, 0.025, 0.02, 0.01, 0.01, 0.005, 0.005)
"""Share of all places in the bin of each knot, in ascending order of spread; the largest spreads
need the finest bins (assumed)."""

PRESS_SHARES = FORCE_SHARES = (0.125,) * 8
"""Share of all presses in the bin of each knot of press and force (assumed)."""

SHEAR_SHARES = (0.125,) * 8
"""Share of all components of the shear force in the bin of each knot (assumed)."""

MIN_STD = 10.0 / 40_000.0
"""Smallest standard deviation, fraction of full scale (assumed: 10 counts, about the error where
nothing touches). The noise of readings is many times larger, and not contained."""

MIN_ERRORS = 100
"""Minimum number of errors in a bin (assumed: a 90 % quantile of fewer is unreliable)."""

MIN_KNOT_DISTANCE = 1e-3
"""Smallest distance of two knots' logarithms (assumed), so that slopes stay finite."""

MIN_FACTOR = 0.05
"""Lower bound of a factor (assumed), for bins with tiny errors."""

ROUNDS = 4
"""Alternating fits of the factors of place and press (assumed: little changes afterwards)."""

SHRINKAGE = 0.02
"""Shrinkage of the correlation towards the identity (assumed), so that its Cholesky factor exists
with fewer presses than places."""


@dataclass(frozen=True)
class Errors:
    """Errors and predicted spreads on one dataset's presses.

    dense_counts: (P, F), errors as a fraction of full scale. spread: (P, F), raw spreads of the
    network. force: (P,), errors of the force's logarithm. force_spread: (P,), raw spreads of these.
    of_place, of_press: features of places and presses, see spread_scale.SpreadScale. shear,
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


DEGREES_OF_FREEDOM = 4.0
"""Of the t distribution of the likelihood. After 2,000 steps on fixed features, validation without
the least certain fifth has a 13 % lower RMSE, with a Gaussian 4 %; 3 and 8 are equally good
(measured)."""


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
