"""A unit's noise: drawn as it was measured, kept in its optics, left white where it is not."""

from dataclasses import replace

import numpy as np
import pytest
from kinds import gel_camera

from t2twin.core.errors import T2TwinError
from t2twin.sim.calibrate.frames import measure_noise
from t2twin.sim.optical.camera import optical_grid
from t2twin.sim.optical.image_renderer import ImageRenderer
from t2twin.sim.optical.optics import Optics
from t2twin.sim.optical.response import Noise

DIGIT = gel_camera()
GEL, NOISE_GREY = DIGIT.own_gel, DIGIT.spec.camera.noise_grey
ROWS, COLUMNS = DIGIT.camera.rows, DIGIT.camera.columns

TAPS = np.array([0.2, 0.5, 0.7, 0.5, 0.2])
MIX = np.array([[2.6, 0.0, 0.0], [-0.7, 1.4, 0.0], [0.2, -1.3, 2.7]])


@pytest.fixture(scope="module")
def noise() -> Noise:
    return Noise(MIX, TAPS / np.linalg.norm(TAPS))


def alike(drawn, rows, columns):
    """How alike pixels so far apart are, all colors together."""
    pairs = drawn[rows:, columns:], drawn[: ROWS - rows, : COLUMNS - columns]
    return float(np.mean(pairs[0] * pairs[1]) / np.mean(drawn**2))


def test_noise_has_the_spread_and_the_neighbors_it_says(noise):
    drawn = noise.sample(np.random.default_rng(0), ROWS, COLUMNS)
    covariance = np.cov(drawn.reshape(-1, 3).T)
    np.testing.assert_allclose(covariance, MIX @ MIX.T, atol=0.25)
    assert noise.grey == pytest.approx(np.sqrt(np.trace(covariance) / 3), rel=0.03)
    own = np.correlate(noise.taps, noise.taps, "full")[4:]
    for lag in range(1, 5):
        assert alike(drawn, lag, 0) == pytest.approx(own[lag], abs=0.04)
        assert alike(drawn, 0, lag) == pytest.approx(own[lag], abs=0.04)
    assert alike(drawn, 1, 1) == pytest.approx(own[1] ** 2, abs=0.04)
    assert np.abs(drawn.mean(axis=(0, 1))).max() < 0.1
    edge = drawn[:3].std() / drawn.std()
    assert edge == pytest.approx(1.0, abs=0.1)


def test_what_is_drawn_is_measured_again(noise):
    rng = np.random.default_rng(0)
    still = np.full((ROWS, COLUMNS, 3), 90.0)
    frames = np.array([np.rint(still + noise.sample(rng, ROWS, COLUMNS)) for _ in range(6)]).astype(
        np.uint8
    )
    found = measure_noise(still, frames, frames[0])
    assert found is not None
    # what is slow is taken off as drift, and with it a part of noise as smooth as this
    assert found.grey == pytest.approx(noise.grey, rel=0.05)
    np.testing.assert_allclose(found.mix @ found.mix.T, MIX @ MIX.T, atol=0.6)
    again, truth = (np.correlate(of.taps, of.taps, "full") for of in (found, noise))
    np.testing.assert_allclose(again, truth, atol=0.07)


def test_pictures_show_it_and_averages_less_of_it(noise):
    x, y = optical_grid(GEL)
    surface = np.zeros((y.size, x.size))
    unit = replace(DIGIT.optics, noise=noise)
    renderer = ImageRenderer(unit, GEL, NOISE_GREY)
    quiet = renderer.background.astype(float)
    one = renderer.render(surface, np.random.default_rng(1)) - quiet
    mean = renderer.render(surface, np.random.default_rng(1), NOISE_GREY / 2) - quiet
    assert one.std() == pytest.approx(noise.grey, rel=0.05)
    assert mean.std() == pytest.approx(noise.grey / 2, rel=0.08)
    assert alike(one, 0, 1) > 0.6
    again = renderer.render(surface, np.random.default_rng(1)) - quiet
    np.testing.assert_array_equal(one, again)
    shipped = DIGIT.image_renderer.render(surface, np.random.default_rng(1)) - quiet
    assert abs(alike(shipped, 0, 1)) < 0.02


def test_the_file_keeps_it(noise, tmp_path):
    path = tmp_path / "unit.npz"
    replace(DIGIT.optics, noise=noise).save(path)
    kept = Optics.load(path).noise
    assert kept is not None
    np.testing.assert_array_equal(kept.mix, noise.mix)
    np.testing.assert_array_equal(kept.taps, noise.taps)
    DIGIT.optics.save(path)
    with np.load(path) as file:
        assert "noise_mix" not in file.files
        parts = dict(file)
    np.savez(path, **parts, noise_mix=MIX)
    with pytest.raises(T2TwinError, match="noise_taps is not a file"):
        Optics.load(path)
    np.savez(path, **parts, young_kpa=500.0)
    with pytest.raises(T2TwinError, match="its young_kpa is not read"):
        Optics.load(path)


@pytest.mark.parametrize(
    ("mix", "taps", "says"),
    [
        (MIX, TAPS[:3], r"taps must be \(5,\)"),
        (MIX * np.nan, TAPS, "mix must lie between"),
        (MIX, TAPS * 9, "taps must lie between"),
    ],
)
def test_noise_that_cannot_be_is_refused(mix, taps, says):
    with pytest.raises(T2TwinError, match=says):
        Noise(mix, taps)
