"""How a network's spreads become standard deviations whose intervals hold what they say.

A network's spreads tell well which reading is surer than which, and badly by how much: small ones
are often too small and large ones too large. So a spread is multiplied by a factor of its own size,
read from rungs: on presses that were not trained on, in order of their spreads, each rung's factor
makes intervals of 90 % hold 90 % of its part (temperature scaling, Guo et al. 2017, part by part;
standard deviations rise with the spreads, as in isotonic calibration). A second factor goes by the
press: one that is surer as a whole is of a kind that is known, and held more often than its places'
spreads alone would say. The force has rungs of its own.

The errors of neighboring places go together; how, in parts of their standard deviations, is one
matrix for all pictures.

Shape letters: P presses, F places of the field, K rungs.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import torch
from scipy.optimize import isotonic_regression

LEVEL = 0.9
"""Share of the errors that the interval must hold."""

HALF_WIDTH = 1.6448536
"""Half the width of that interval of a Gaussian, standard deviations."""

PLACE_SHARES = (*(0.1,) * 8, 0.05, 0.05, 0.025, 0.025, 0.02, 0.01, 0.01, 0.005, 0.005)
"""Parts of all places' errors that the rungs stand for, by rising spread; the largest spreads
differ most (assumed)."""

PRESS_SHARES = FORCE_SHARES = (0.125,) * 8
"""Parts of all presses that the rungs of press and force stand for (assumed)."""

MIN_ERRORS = 100
"""Errors that a rung stands for at least (assumed: the ninth tenth of fewer is anyone's guess)."""

MIN_APART = 1e-3
"""Of two rungs' logarithms (assumed), so that there is a way from one to the next."""

MIN_FACTOR = 0.05
"""Where the presses are few and all of them hit (assumed)."""

ROUNDS = 4
"""How often the factors of place and press are fitted in turn (assumed: then little changes)."""

OWN_SHARE = 0.02
"""What the correlation is drawn towards none by (assumed), so that it can be factored also where
the presses are fewer than the places."""


@dataclass(frozen=True)
class Errors:
    """Of one world's presses. field: (P, F), parts of full scale; spread: (P, F), what the network
    says of it; force: (P,), and force_spread: (P,), the same of the force's logarithm."""

    field: torch.Tensor
    spread: torch.Tensor
    force: torch.Tensor
    force_spread: torch.Tensor


@dataclass(frozen=True)
class UncertaintyCalibration:
    """place, press, force: (2, K), rungs: logarithms of the spreads, rising, and of their factors.
    correlation: (F, F), of the field's errors."""

    place: torch.Tensor
    press: torch.Tensor
    force: torch.Tensor
    correlation: torch.Tensor


def calibration_of(worlds: Sequence[Errors]) -> UncertaintyCalibration:
    """Of one or more worlds; each press has the same say."""
    field, spread, force, force_spread = (
        torch.cat([getattr(world, name) for world in worlds]).double()
        for name in ("field", "spread", "force", "force_spread")
    )
    place = press = identity_knots(len(PLACE_SHARES)).double()
    known = torch.ones(len(field), 1, dtype=torch.float64)
    for _ in range(ROUNDS):
        place = _rungs(spread, field / known, PLACE_SHARES, MIN_ERRORS)
        std = spread * interpolate_scale(spread.log(), place)
        level = std.mean(dim=1, keepdim=True)
        least = MIN_ERRORS * field.shape[1]
        press = _rungs(level.expand_as(std), level * field / std, PRESS_SHARES, least)
        known = interpolate_scale(level.log(), press)
    off = field / standard_deviation(spread.log(), place, press)
    moment = off.T @ off / len(off)
    scale = moment.diagonal().clamp(min=1e-12).rsqrt()
    correlation = (1.0 - OWN_SHARE) * scale[:, None] * moment * scale
    correlation.fill_diagonal_(1.0)
    of_force = _rungs(force_spread, force, FORCE_SHARES, MIN_ERRORS)
    return UncertaintyCalibration(
        place.float(), press.float(), of_force.float(), correlation.float()
    )


def standard_deviation(
    log_spread: torch.Tensor, place: torch.Tensor, press: torch.Tensor
) -> torch.Tensor:
    """(B, F), parts of full scale, of the spreads' logarithms. place, press: (2, K), rungs."""
    std = log_spread.exp() * interpolate_scale(log_spread, place)
    return std * interpolate_scale(std.mean(dim=1, keepdim=True).log(), press)


def interpolate_scale(log_spread: torch.Tensor, rungs: torch.Tensor) -> torch.Tensor:
    """What spreads are multiplied by: linear between the rungs in logarithms, and beyond the first
    and the last as at these. Any shape."""
    at, factor = rungs[0], rungs[1]
    rise = (factor[1:] - factor[:-1]) / (at[1:] - at[:-1])
    way = torch.minimum(torch.maximum(log_spread[..., None], at[:-1]), at[1:]) - at[:-1]
    return torch.exp(factor[0] + (way * rise).sum(dim=-1))


def identity_knots(number: int) -> torch.Tensor:
    """(2, number) rungs that change nothing."""
    return torch.stack([torch.arange(float(number)), torch.zeros(number)])


def _rungs(
    spread: torch.Tensor, off: torch.Tensor, shares: Sequence[float], least: int
) -> torch.Tensor:
    """(2, K) of errors and what spreads say of them, of one shape. K: as many as there are shares;
    where errors are few, the last rungs stand for none of their own. least: of errors a rung."""
    logarithm, order = spread.flatten().log().sort()
    off = off.flatten().abs()[order]
    at, std, weight = [], [], []
    for part in _parts(len(off), shares, least):
        used = (off[part] / logarithm[part].exp()).sort().values
        factor = used[min(int(LEVEL * len(used)), len(used) - 1)] / HALF_WIDTH
        at.append(float(logarithm[part].mean()))
        std.append(at[-1] + float(factor.clamp(min=MIN_FACTOR).log()))
        weight.append(len(used))
    rising = isotonic_regression(std, weights=weight).x
    rungs = identity_knots(len(shares)).double()
    last = len(at) - 1
    for k in range(len(shares)):
        rungs[0, k] = at[min(k, last)] + max(0, k - last)
        rungs[1, k] = rising[min(k, last)] - at[min(k, last)]
        if 0 < k <= last:
            rungs[0, k] = max(float(rungs[0, k]), float(rungs[0, k - 1]) + MIN_APART)
    return rungs


def _parts(number: int, shares: Sequence[float], least: int) -> list[slice]:
    """Cuts `number` errors in order; a part that would hold too few goes with the next."""
    ends = [round(number * float(share)) for share in np.cumsum(shares)]
    starts = [0]
    for end in ends[:-1]:
        if end - starts[-1] >= least and number - end >= least:
            starts.append(end)
    return [slice(*part) for part in pairwise([*starts, number])]
