"""Factors of spreads, fitted to presses whose errors follow a known rule."""

from copy import deepcopy
from functools import cache

import numpy as np
import pytest
import torch

from t2twin.translate.uncertainty import calibration
from t2twin.translate.uncertainty.calibration import (
    HALF_WIDTH,
    Errors,
    SpreadScale,
    fit_scale,
    scaled,
)

PLACES, PRESSES = 4, 3000


def known(colored: bool) -> tuple[SpreadScale, Errors, torch.Tensor]:
    """Presses with raw spreads of 1 % (force 0.1); half of the errors are three times as wide as
    the others', and the light alone tells which: with colored, its color and not its level."""
    generator = torch.Generator().manual_seed(1)
    at = np.linspace(-9.0, 9.0, PLACES)
    scale = SpreadScale(at, at, (6.0, 8.0), (1, PLACES), 12)
    in_other_light = torch.rand(PRESSES, generator=generator) < 0.5
    shift = torch.where(in_other_light, 1.0, 0.0)[:, None, None, None]
    images = torch.rand(PRESSES, 6, 12, 12, generator=generator)
    if colored:
        images[:, 3:4] += shift
        images[:, 5:6] += 1.0 - shift
    else:
        images += shift
    share = torch.rand(PRESSES, PLACES, generator=generator)
    force = torch.randn(PRESSES, generator=generator)
    spread, of_force = torch.full((PRESSES, PLACES), 0.01), torch.full((PRESSES,), 0.1)
    features = scale.features(
        images, torch.full((3, 12, 12), 0.5), share, spread.log(), force, of_force.log()
    )
    width = torch.where(in_other_light, 3.0, 1.0)
    noise = torch.randn(PRESSES, PLACES + 1, generator=generator) * width[:, None]
    errors = Errors(0.01 * noise[:, :-1], spread, 0.1 * noise[:, -1], of_force, *features)
    return scale, errors, in_other_light


@cache
def fitted(colored: bool) -> tuple[SpreadScale, Errors, torch.Tensor]:
    """The same, with factors fitted to them."""
    found = known(colored)
    fit_scale(found[0], [found[1]])
    return found


@pytest.mark.parametrize("colored", [False, True])
def test_intervals_cover_nine_tenths_in_each_light(colored: bool) -> None:
    scale, errors, in_other_light = fitted(colored)
    found = scaled(scale, errors)
    for part, width in ((in_other_light, 3.0), (~in_other_light, 1.0)):
        for error, spread, raw in (
            (found.dense_counts, found.spread, 0.01),
            (found.force, found.force_spread, 0.1),
        ):
            within = (error[part].abs() <= HALF_WIDTH * spread[part]).float().mean()
            assert 0.88 < float(within) < 0.92
            assert float(spread[part].median()) == pytest.approx(raw * width, rel=0.1)
    raw = (errors.dense_counts[in_other_light].abs() <= HALF_WIDTH * 0.01).float().mean()
    assert float(raw) < 0.5  # without the factors
    reset = deepcopy(scale)
    reset.reset()
    assert torch.equal(scaled(reset, errors).spread, errors.spread)


def test_a_fit_starts_from_no_factors_and_is_repeated(monkeypatch: pytest.MonkeyPatch) -> None:
    scale, errors, _ = known(False)
    few = scaled(scale, errors)  # not fitted
    assert torch.equal(few.spread, errors.spread)
    assert torch.equal(few.force_spread, errors.force_spread)
    monkeypatch.setattr(calibration, "STEPS", 40)
    fit_scale(scale, [errors])
    again = deepcopy(scale.state_dict())
    fit_scale(scale, [errors])
    assert all(torch.equal(each, again[name]) for name, each in scale.state_dict().items())


def test_a_feature_far_outside_changes_an_interval_by_a_bounded_factor() -> None:
    scale, errors, _ = fitted(False)
    assert errors.of_place is not None and errors.of_press is not None
    place, force = scale(1e3 * errors.of_place, -1e3 * errors.of_press)
    for each in (place, force):
        assert torch.isfinite(each).all() and each.abs().max() <= 3.0
