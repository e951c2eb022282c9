"""What a network's spreads are multiplied by so that its intervals hold what they say.

One temperature for the field and one for the force, fitted on presses that were not trained on
(Guo et al. 2017 for the temperature; here it is the interval of 90 % that must hold 90 %). The
errors of neighbouring places go together; how, in parts of their spreads, is one matrix for all
pictures.

Shape letters: P presses, F places of the field.
"""

from dataclasses import dataclass

import torch

LEVEL = 0.9
"""Share of the presses that the interval must hold."""

HALF_WIDTH = 1.6448536
"""Half the width of that interval of a Gaussian, standard deviations."""

LEAST_TEMPERATURE = 0.05
"""Where the presses are few and all of them hit (assumed)."""

OWN_SHARE = 0.02
"""What the correlation is drawn towards none by (assumed), so that it can be factored also where
the presses are fewer than the places."""


@dataclass(frozen=True)
class Calibration:
    """temperature: (2,), of field and force. correlation: (F, F), of the field's errors."""

    temperature: torch.Tensor
    correlation: torch.Tensor


def calibration_of(field: torch.Tensor, force: torch.Tensor) -> Calibration:
    """From errors in parts of the spreads as the network gives them: (P, F) and (P,)."""
    temperatures = [_temperature(each) for each in (field, force)]
    moment = field.double().T @ field.double() / field.shape[0]
    scale = moment.diagonal().clamp(min=1e-12).rsqrt()
    correlation = (1.0 - OWN_SHARE) * scale[:, None] * moment * scale
    correlation.fill_diagonal_(1.0)
    return Calibration(torch.stack(temperatures), correlation.float())


def _temperature(off: torch.Tensor) -> torch.Tensor:
    ordered = off.abs().flatten().sort().values
    place = min(int(LEVEL * ordered.numel()), ordered.numel() - 1)
    return (ordered[place] / HALF_WIDTH).clamp(min=LEAST_TEMPERATURE)
