"""The lobe: a unit with a known lobe and drifting light is recovered; its file; its images."""

from dataclasses import replace

import numpy as np
import pytest
from ball_frames import BALL_MM, POSES

from t2twin.core.errors import T2TwinError
from t2twin.sim.calibrate.calibrate import score
from t2twin.sim.calibrate.fit import BallFit, Geometry, Measurements, Presses, Terms
from t2twin.sim.calibrate.frames import clean_background, contact_patch, crop
from t2twin.sim.optical.illumination import LOBE_PLACES, LOBE_TERMS, Leds
from t2twin.sim.optical.image_renderer import ImageRenderer
from t2twin.sim.optical.optics import Optics
from t2twin.sim.optical.surface import ball_surface
from t2twin.sim.sensors.pair import SensorPair

DRIFT_GREY = np.array([4, -3, 5])
HOLD, SKIRT = 0.8, 1.0
DIGIT = SensorPair().camera
GEL = DIGIT.own_gel


@pytest.fixture(scope="module")
def unit():
    """The default optics with a lobe that changes images by tens of grey levels."""
    lobe = np.zeros((3, 3, LOBE_PLACES, LOBE_TERMS))
    rng = np.random.default_rng(0)
    for led in range(3):
        lobe[led, led] = 0.5 * rng.uniform(-1, 1, (LOBE_PLACES, LOBE_TERMS))
    return replace(DIGIT.optics, lobe=lobe)


def surface(pose):
    x_mm, y_mm, depth_mm = pose
    return ball_surface(GEL, x_mm, y_mm, depth_mm, BALL_MM / 2, HOLD, SKIRT)


def test_a_unit_with_a_lobe_and_drift_is_recovered(unit):
    warm = np.clip(unit.background.astype(int) + DRIFT_GREY, 0, 255).astype(np.uint8)
    renderer = ImageRenderer(replace(unit, background=warm), GEL, 0.0)
    frames = np.array([renderer.render(surface(pose)) for pose in POSES])
    clean = clean_background(unit.background, frames[1:])
    assert np.abs(clean.astype(float) - warm).mean() < 0.5
    patches = np.array([contact_patch(frame, unit.background) for frame in frames])
    nothing = np.full(len(POSES) - 1, np.nan)
    known = Measurements(np.full(len(POSES) - 1, BALL_MM), nothing, nothing)
    model = BallFit(Presses(DIGIT, clean, frames[1:], patches[1:], known), DIGIT.camera)
    geometry = Geometry.of(Leds(unit.leds_mm, unit.sizes_mm))
    geometry = replace(geometry, values=np.array([*geometry.values[:-2], HOLD, SKIRT]))
    psnr_db = {}
    for has_lobe in (False, True):
        state = model._solved(geometry, POSES[1:], Terms(3, 4, 1e-4, has_lobe))
        fitted = ImageRenderer(model.optics(state), GEL, 0.0).render(surface(POSES[0]))
        psnr_db[has_lobe] = score(crop(frames[0], patches[0]), crop(fitted, patches[0])).psnr_db
    assert psnr_db[True] > 38
    assert psnr_db[True] > psnr_db[False] + 3


def test_a_file_keeps_the_lobe(unit, tmp_path):
    unit.save(tmp_path / "unit.npz")
    again = Optics.load(tmp_path / "unit.npz")
    assert again.lobe is not None
    np.testing.assert_array_equal(again.lobe, unit.lobe)
    assert DIGIT.optics.lobe is None
    for wrong in (unit.lobe[:2], np.full_like(unit.lobe, np.nan), np.full_like(unit.lobe, 1e9)):
        with pytest.raises(T2TwinError, match="lobe"):
            replace(unit, lobe=wrong)


def test_a_gel_at_rest_gives_the_background_with_a_lobe(unit):
    still = ImageRenderer(unit, GEL, 0.0).render(np.zeros_like(surface(POSES[0])))
    np.testing.assert_array_equal(still, unit.background)


def test_a_lobe_of_zeros_changes_nothing(unit):
    zero = ImageRenderer(replace(unit, lobe=np.zeros_like(unit.lobe)), GEL, 0.0)
    pressed = surface(POSES[0])
    np.testing.assert_array_equal(zero.render(pressed), DIGIT.image_renderer.render(pressed))
