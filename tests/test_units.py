"""Drawn units, the camera's shift and tilt, and pyrender's own pictures: truths of each."""

import pickle
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path

import msgspec
import numpy as np
import pytest
from kinds import gel_camera, psnr
from msgspec import structs

from t2twin import Twin
from t2twin.core.errors import T2TwinError
from t2twin.core.records import convert
from t2twin.sim.dataset.generate import make_dataset
from t2twin.sim.optical import pyrender_renderer
from t2twin.sim.optical.camera import Camera, optical_grid
from t2twin.sim.optical.illumination import Rays
from t2twin.sim.optical.image_renderer import ImageRenderer
from t2twin.sim.optical.optics import Optics
from t2twin.sim.optical.surface import ball_surface
from t2twin.sim.optical.units import UnitRanges, sample_unit
from t2twin.sim.sampling.recipe import Light, load_recipe

DIGIT = gel_camera()
GEL, CAMERA, FRAMES = DIGIT.own_gel, DIGIT.camera, DIGIT.spec.camera.frames
ROWS, COLUMNS = CAMERA.rows, CAMERA.columns
NOISE_GREY = DIGIT.spec.camera.noise_grey
OWN = DIGIT.spec.units
DRAW = UnitRanges()
DRAWN = 200
BALL = ball_surface(GEL, 0.5, -1.0, 1.1)


def unit(seed, draw=DRAW, center=None):
    return sample_unit(np.random.default_rng(seed), DIGIT.spec, draw, center)


def same(one, other):
    arrays = ("background", "leds_mm", "sizes_mm", "response")
    others = ("gamma", "camera", "noise", "young_mpa", "lobe", "albedo")
    return all(np.array_equal(getattr(one, name), getattr(other, name)) for name in arrays) and all(
        getattr(one, name) == getattr(other, name) for name in others
    )


def moved(optics, **camera):
    return replace(optics, camera=structs.replace(optics.camera, **camera))


@pytest.fixture(scope="module")
def units():
    return [unit(seed) for seed in range(DRAWN)]


@pytest.fixture(scope="module")
def shipped():
    return DIGIT.optics


def test_units_of_a_recipe_see_the_gel_only():
    with pytest.raises(T2TwinError, match=r"a unit's camera sees 48.0 mm of the gel's width"):
        unit(0, wide := structs.replace(DRAW, scale_px_per_mm=(5.0, 6.0)))
    light = Light(kind="drawn", draw=wide)
    with pytest.raises(T2TwinError, match="a unit's camera sees"):
        make_dataset("data", recipe=structs.replace(load_recipe("open"), light=light))
    assert not Path("data").exists()


def test_the_same_seed_gives_the_same_unit_in_any_thread(units):
    with ThreadPoolExecutor(4) as pool:
        again = list(pool.map(unit, range(8)))
    for one, other in zip(units, again, strict=False):
        assert same(one.optics, other.optics)
        assert one.noise_grey == other.noise_grey and one.leds == other.leds
    assert not same(units[0].optics, units[1].optics)


def test_units_keep_to_the_ranges(units):
    assert OWN is not None

    def check(values, between):
        assert between[0] <= np.min(values) and np.max(values) <= between[1]
        assert np.ptp(values) > 0.8 * (between[1] - between[0])

    optics = [one.optics for one in units]
    cameras = [each.camera for each in optics]
    check([c.scale_px_per_mm for c in cameras], OWN.scale_px_per_mm)
    check([c.distance_mm for c in cameras], OWN.distance_mm)
    check([c.gamma for c in optics], (DRAW.linear_gamma[0], DRAW.gamma[1]))
    check([(c.shift_x_px, c.shift_y_px) for c in cameras], DRAW.shift_px)
    check([(c.tilt_x_deg, c.tilt_y_deg) for c in cameras], DRAW.tilt_deg)
    check([one.noise_grey for one in units], DRAW.noise_grey)
    sizes = np.array([c.sizes_mm for c in optics])
    assert sizes.max() <= DRAW.led_size_mm[1] and sizes.min() > 0.9 * DRAW.led_size_mm[0]
    places = np.array([c.leds_mm for c in optics])
    check(np.hypot(places[..., 0], places[..., 1]), OWN.led_distance_mm)
    turns = np.degrees(np.arctan2(-places[..., 1], places[..., 0])) - (30.0, 150.0, -90.0)
    check(turns, DRAW.led_turn_deg)


def test_backgrounds_are_plain_and_hardly_clipped(units):
    for one in units:
        background = one.optics.background
        assert 40 < background.mean() < 180
        assert (background >= 254).mean() < 0.05 and (background <= 1).mean() < 0.05


def test_a_press_is_seen_in_every_unit(units):
    for one in units[:40]:
        renderer = ImageRenderer(one.optics, GEL, NOISE_GREY)
        change = np.abs(renderer.render(BALL).astype(int) - renderer.background).max(axis=-1)
        assert np.percentile(change, 95) > 15
        assert (change > 5).mean() < 0.6


def test_a_unit_about_an_optics_file_is_near_it(shipped):
    own = ImageRenderer(shipped, GEL, NOISE_GREY)
    for seed in range(5):
        near = unit(seed, center=shipped).optics
        assert np.abs(near.leds_mm - shipped.leds_mm).max() <= DRAW.around_led_mm[1]
        scales = [of.camera.scale_px_per_mm for of in (near, shipped)]
        assert scales[0] == pytest.approx(scales[1], rel=0.03)
        assert near.gamma == pytest.approx(shipped.gamma, rel=0.06)
        light = np.abs(near.background.astype(float) - shipped.background)
        assert 0 < light.mean() < 0.15 * shipped.background.mean()
        renderer = ImageRenderer(near, GEL, NOISE_GREY)
        changes = [(o.render(BALL).astype(float) - o.background).ravel() for o in (renderer, own)]
        assert np.corrcoef(changes)[0, 1] > 0.8


def test_ranges_are_read_from_plain_values_and_held_to_their_bounds():
    draw = convert({"gamma": [1.0, 1.5], "specks": [0, 2]}, UnitRanges, "recipe.toml")
    assert draw == UnitRanges(gamma=(1.0, 1.5), specks=(0, 2))
    assert convert(msgspec.to_builtins(draw), UnitRanges, "recipe.toml") == draw
    with pytest.raises(T2TwinError, match=r"recipe.toml: .*<= 4.*gamma"):
        convert({"gamma": [1.0, 9.0]}, UnitRanges, "recipe.toml")
    with pytest.raises(T2TwinError, match=r"gamma: Expected `float` <= 4"):
        UnitRanges(gamma=(1.0, 9.0))
    with pytest.raises(T2TwinError, match=r"tilt_deg is \[1, -1\]; expected low first"):
        UnitRanges(tilt_deg=(1.0, -1.0))


def test_a_digit_takes_a_units_light_and_noise(units):
    digit = DIGIT.with_unit(units[3])
    assert digit.noise_grey == pytest.approx(units[3].noise_grey / np.sqrt(FRAMES))
    assert digit.elastomer == GEL
    background = units[3].optics.background
    np.testing.assert_array_equal(digit.background_frame(), background)
    grainy = DIGIT.with_unit(replace(units[3], noise_grey=2.0 * np.sqrt(FRAMES)))
    noisy = grainy.background_frame(np.random.default_rng(0)).astype(float)
    inside = (background > 20) & (background < 235)
    wanted = np.hypot(2.0, np.sqrt(1 / 12))
    assert (noisy - background)[inside].std() == pytest.approx(wanted, rel=0.02)


# The camera


@pytest.mark.parametrize(
    "camera", [{"scale_px_per_mm": 0.0}, {"distance_mm": -3.0}, {"rows": 1}, {"tilt_x_deg": np.nan}]
)
def test_impossible_cameras_are_refused(camera):
    with pytest.raises(T2TwinError, match="expected a"):
        structs.replace(CAMERA, **camera)


def test_a_shift_moves_the_picture_by_as_many_pixels(shipped):
    still = ImageRenderer(
        replace(shipped, background=np.full_like(shipped.background, 120)), GEL, NOISE_GREY
    )
    shifted = ImageRenderer(moved(still.optics, shift_x_px=12.0, shift_y_px=-20.0), GEL, NOISE_GREY)
    before, after = still.render(BALL), shifted.render(BALL)
    middle = before[60:-60, 40:-40].astype(int)
    found = after[40:-80, 52:-28].astype(int)
    assert np.abs(found - middle).max() <= 1
    assert np.abs(after[60:-60, 40:-40] - middle).max() > 50


def test_a_shifted_and_tilted_camera_projects_its_rays_back():
    camera = Camera(ROWS, COLUMNS, 18.0, 21.0, 7.0, -4.0, 2.0, -1.0)
    x, y, z = camera.gel_points(GEL, np.arange(COLUMNS), np.arange(ROWS))
    rows, columns = camera.project(x, y, z)
    np.testing.assert_allclose(rows, np.arange(320)[:, None] * np.ones(240), atol=1e-9)
    np.testing.assert_allclose(columns, np.ones((320, 1)) * np.arange(240), atol=1e-9)
    rest = GEL.rest_surface_mm(x, y) + np.tan(np.radians(2.0)) * y
    np.testing.assert_allclose(z, rest - np.tan(np.radians(1.0)) * x, atol=0.01)
    rays = Rays(camera, GEL)
    np.testing.assert_allclose(rays.places_mm[0][1:-1, 1:-1], x[::2, ::2], atol=0.06)


def test_a_tilt_keeps_the_apex(shipped):
    level = ImageRenderer(shipped, GEL, NOISE_GREY).render(BALL)
    tilted = ImageRenderer(moved(shipped, tilt_x_deg=2.0), GEL, NOISE_GREY)
    np.testing.assert_array_equal(tilted.render(BALL * 0), shipped.background)
    assert np.abs(tilted.render(BALL).astype(int) - level).max() > 5
    rest = Rays(structs.replace(CAMERA, tilt_x_deg=2.0), GEL).rest_mm - Rays(CAMERA, GEL).rest_mm
    y_mm = optical_grid(GEL)[1]
    np.testing.assert_allclose(rest[:, 0], np.tan(np.radians(2.0)) * y_mm, atol=1e-5)


def test_shift_and_tilt_are_in_a_file_only_where_there_are_any(shipped, tmp_path):
    shipped.save(tmp_path / "plain.npz")
    with np.load(tmp_path / "plain.npz") as file:
        assert not {"shift_x_px", "tilt_y_deg"} & set(file)
    off = moved(shipped, shift_x_px=3.0, tilt_y_deg=-1.0)
    off.save(tmp_path / "off.npz")
    again = Optics.load(tmp_path / "off.npz")
    assert same(again, off) and again.camera == off.camera
    assert same(Optics.load(tmp_path / "plain.npz"), shipped)


# pyrender itself


def test_pyrender_and_the_baked_model_agree_for_the_light_that_ships(monkeypatch):
    monkeypatch.setattr(pyrender_renderer, "LED_POINTS", 5)
    digit = pickle.loads(pickle.dumps(DIGIT.with_options({"renderer": "pyrender"})))
    baked = DIGIT.image_renderer.render(BALL)
    rendered = digit.image_renderer.render(BALL)
    crop = (slice(90, 190), slice(80, 180))
    assert psnr(rendered[crop], baked[crop]) > 32
    np.testing.assert_array_equal(digit.background_frame(), digit.image_renderer.background)
    noisy = digit.image_renderer.render(BALL * 0, np.random.default_rng(0), 3.0).astype(float)
    assert (noisy - digit.image_renderer.background).std() == pytest.approx(3.0, rel=0.03)


@pytest.mark.exhaustive
def test_pyrender_renders_a_drawn_unit_in_its_own_light(units, monkeypatch):
    monkeypatch.setattr(pyrender_renderer, "LED_POINTS", 2)
    digit = DIGIT.with_options({"renderer": "pyrender"}).with_unit(units[0])
    background = units[0].optics.background
    rendered = digit.image_renderer.render(BALL).astype(float) - background
    baked = DIGIT.with_unit(units[0]).image_renderer.render(BALL).astype(float) - background
    assert np.corrcoef(rendered.ravel(), baked.ravel())[0, 1] > 0.7


def test_pyrender_is_refused_where_no_leds_are_known(shipped, tmp_path):
    shipped.save(tmp_path / "mine.npz")
    (tmp_path / "table.npz").write_text("a,b")
    with pytest.raises(T2TwinError, match="it is no NPZ file"):
        Optics.load(tmp_path / "table.npz")
    with pytest.raises(T2TwinError, match="cannot render an optics file"):
        Twin(tmp_path / "mine.npz", renderer="pyrender")
    with pytest.raises(T2TwinError, match="cannot render an optics file"):
        DIGIT.with_options({"renderer": "pyrender"}).with_unit(unit(0, center=shipped))
    with pytest.raises(T2TwinError, match="expected one of baked, pyrender"):
        DIGIT.with_options({"renderer": "opengl"})
