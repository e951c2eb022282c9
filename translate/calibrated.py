"""How a network's spreads become standard deviations whose intervals hold what they say.

A spread s, in parts of full scale, becomes T m (s / m)^q with m = MIDDLE_SPREAD: the temperature T
makes intervals of 90 % hold 90 % (Guo et al. 2017 for a temperature), and the power q makes them do
so in each of several worlds. A network knows presses like those of its training better than its
spreads say and others worse, and the others have the larger spreads: a power above 1 widens those.
The force has a temperature of its own. All is fitted on presses that were not trained on.

The errors of neighbouring places go together; how, in parts of their spreads, is one matrix for all
pictures.

Shape letters: P presses, F places of the field.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch

LEVEL = 0.9
"""Share of the presses that the interval must hold."""

HALF_WIDTH = 1.6448536
"""Half the width of that interval of a Gaussian, standard deviations."""

MIDDLE_SPREAD = 0.01
"""A spread that the power leaves as it is, parts of full scale (assumed: of the size of the
errors)."""

POWERS = tuple(float(power) for power in np.arange(0.8, 2.01, 0.05).round(2))
"""Powers that are tried (assumed)."""

AS_GOOD = 0.005
"""What intervals may hold more or less and be as good (assumed)."""

LEAST_TEMPERATURE = 0.05
"""Where the presses are few and all of them hit (assumed)."""

OWN_SHARE = 0.02
"""What the correlation is drawn towards none by (assumed), so that it can be factored also where
the presses are fewer than the places."""


@dataclass(frozen=True)
class Errors:
    """Of one world's presses. field: (P, F), in parts of the spreads; spread: (P, F) those, parts
    of full scale; force: (P,), in parts of its spread."""

    field: torch.Tensor
    spread: torch.Tensor
    force: torch.Tensor

    def at_power(self, power: float) -> torch.Tensor:
        """(P, F) the field's errors, in parts of the spreads as the power makes them."""
        return self.field / (self.spread / MIDDLE_SPREAD) ** (power - 1.0)


@dataclass(frozen=True)
class Calibration:
    """temperature: (2,), of field and force. power: of the field's spreads. correlation: (F, F), of
    the field's errors."""

    temperature: torch.Tensor
    power: float
    correlation: torch.Tensor


def calibration_of(worlds: Sequence[Errors], power: float) -> Calibration:
    """Of one or more worlds. power: what it is where one world alone can tell none."""
    if len(worlds) > 1:
        power = _power(worlds)
    field = torch.cat([world.at_power(power) for world in worlds])
    force = torch.cat([world.force for world in worlds])
    moment = field.double().T @ field.double() / field.shape[0]
    scale = moment.diagonal().clamp(min=1e-12).rsqrt()
    correlation = (1.0 - OWN_SHARE) * scale[:, None] * moment * scale
    correlation.fill_diagonal_(1.0)
    temperatures = torch.stack([_temperature(field), _temperature(force)])
    return Calibration(temperatures, power, correlation.float())


def standard_deviation(
    spread: torch.Tensor, power: torch.Tensor, temperature: torch.Tensor
) -> torch.Tensor:
    """Of spreads, of any shape, parts of full scale. power, temperature: ()."""
    return temperature * MIDDLE_SPREAD * (spread / MIDDLE_SPREAD) ** power


def _power(worlds: Sequence[Errors]) -> float:
    """The one nearest to 1 of those that are as good as the best."""
    apart = {power: _apart(worlds, power) for power in POWERS}
    good = [power for power, off in apart.items() if off < min(apart.values()) + AS_GOOD]
    return min(good, key=lambda power: abs(power - 1.0))


def _apart(worlds: Sequence[Errors], power: float) -> float:
    """How far the interval is from its level in the world where it is farthest."""
    errors = [world.at_power(power).abs() for world in worlds]
    half = HALF_WIDTH * _temperature(torch.cat(errors))
    return max(abs(float((each <= half).float().mean()) - LEVEL) for each in errors)


def _temperature(off: torch.Tensor) -> torch.Tensor:
    ordered = off.abs().flatten().sort().values
    place = min(int(LEVEL * ordered.numel()), ordered.numel() - 1)
    return (ordered[place] / HALF_WIDTH).clamp(min=LEAST_TEMPERATURE)
