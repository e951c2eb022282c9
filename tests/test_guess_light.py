"""A light from the background alone: whose background, whose camera, and that it is a middle."""

import functools
from dataclasses import replace

import numpy as np
import pytest
from PIL import Image

import t2twin
from t2twin.cli import main
from t2twin.sim.calibrate.calibrate import (
    RANGES,
    crop_scores,
    mean_light,
    mean_score,
    sample_lights,
)
from t2twin.sim.optical.image_renderer import ImageRenderer
from t2twin.sim.optical.optics import Optics
from t2twin.sim.optical.surface import ball_surface
from t2twin.sim.optical.units import sample_unit
from t2twin.sim.sensors.pair import SensorPair

FEW = 60
DIGIT = SensorPair().camera
CAMERA = replace(DIGIT.camera, scale_px_per_mm=18.0, distance_mm=21.0)


def renderer_of(optics):
    return ImageRenderer(optics, DIGIT.own_gel, DIGIT.noise_grey)


@pytest.fixture(scope="module")
def background():
    return sample_unit(np.random.default_rng((9, 0)), DIGIT.spec, RANGES).optics.background


@pytest.fixture(scope="module")
def lights(background):
    return sample_lights(background, DIGIT, CAMERA, FEW)


def test_camera_and_background_are_the_users_own(lights, background):
    light = mean_light(lights)
    np.testing.assert_array_equal(light.background, background)
    assert light.camera == CAMERA and light.noise is None
    np.testing.assert_array_equal(renderer_of(light).background, background)
    np.testing.assert_allclose(light.response, np.mean([of.response for of in lights], axis=0))
    for name in ("leds_mm", "sizes_mm"):
        each = np.array([getattr(of, name) for of in lights])
        assert (each.min(axis=0) < getattr(light, name)).all()
        assert (getattr(light, name) < each.max(axis=0)).all()


def test_the_mean_errs_less_than_the_drawn_ones(lights):
    """On a unit that is none of them, which is why it is the mean."""
    surface = ball_surface(DIGIT.own_gel, 0.5, 0.2, 1.0)
    places = np.array([(163.0, 129.0)])
    mean, singly = [], []
    for number in range(1, 7):
        unit = sample_unit(np.random.default_rng((9, number)), DIGIT.spec, RANGES).optics
        own = sample_lights(unit.background, DIGIT, unit.camera, FEW)
        wanted = renderer_of(unit).render(surface)[None]

        def psnr_db(light: Optics, wanted: np.ndarray = wanted) -> float:
            shown = renderer_of(light).render(surface)[None]
            return mean_score(crop_scores(wanted, shown, places)).psnr_db

        mean.append(psnr_db(mean_light(own)))
        singly.append(np.mean([psnr_db(light) for light in own[:10]]))
    assert np.mean(mean) > np.mean(singly) + 2.0


def test_the_command_writes_what_the_function_gives_and_names_a_contact(
    tmp_path, capsys, monkeypatch
):
    few = functools.partial(sample_lights, count=FEW)
    monkeypatch.setattr("t2twin.sim.calibrate.calibrate.sample_lights", few)
    twin, path = t2twin.Twin(), tmp_path / "mine.png"
    frames = twin.background, twin.press("hemisphere-2", force_n=4.0, seed=0).image
    for frame, said in zip(frames, (False, True), strict=True):
        Image.fromarray(frame).save(path)
        main(["calibrate", "--background", str(path), "--out", str(tmp_path / "out")])
        assert (f"{path} shows a contact, by field" in capsys.readouterr().err) == said
    written, given = Optics.load(tmp_path / "out" / "optics.npz"), t2twin.guess_light(path)
    for name in ("background", "leds_mm", "sizes_mm", "response"):
        np.testing.assert_array_equal(getattr(written, name), getattr(given, name))
    assert not (tmp_path / "out" / "optics.json").exists()
