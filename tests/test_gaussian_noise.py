"""White noise: normal, of no pattern, another one with every key."""

import numpy as np
import pytest
from scipy import stats

from t2twin.sim.optical.response import quantiles, standard_normal

SHAPE = (320, 720)


@pytest.fixture(scope="module")
def drawn() -> np.ndarray:
    return standard_normal(np.random.default_rng(0), SHAPE)


def test_it_is_normal(drawn):
    several = [standard_normal(np.random.default_rng(seed), SHAPE) for seed in range(8)]
    assert np.mean(several) == pytest.approx(0.0, abs=0.003)
    assert np.std(several) == pytest.approx(1.0, abs=0.003)
    assert standard_normal(np.random.default_rng(0), (3, 5)).shape == (3, 5)
    shares = stats.norm.cdf(drawn)
    assert stats.kstest(shares.ravel(), "uniform").pvalue > 0.001
    assert np.abs(quantiles()).max() > 3.5


def test_no_place_knows_of_another(drawn):
    few = 4.5 / np.sqrt(drawn.size)  # of as many independent numbers, once in 100,000
    for rows, columns in ((0, 1), (0, 3), (0, 360), (1, 0), (1, 1), (2, 3), (7, 0)):
        one, other = drawn[rows:, columns:], drawn[: SHAPE[0] - rows, : SHAPE[1] - columns]
        for power in (1, 2):
            assert abs(np.corrcoef((one**power).ravel(), (other**power).ravel())[0, 1]) < 1.5 * few
    power = np.abs(np.fft.fft2(drawn)) ** 2 / drawn.size
    assert power.max() < np.log(drawn.size) + 8
