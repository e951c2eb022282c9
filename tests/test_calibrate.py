"""Calibrating the optics: places, depths and light found again, held-out scores, bad input."""

import functools
import re
import shutil
from dataclasses import replace
from itertools import product

import numpy as np
import pytest
from ball_frames import BALL_MM, HELD_OUT, POSES, refused, save, small_digit
from kinds import psnr
from msgspec import structs
from PIL import Image

import t2twin
from t2twin.cli import main
from t2twin.core.errors import T2TwinError
from t2twin.core.frame_order import TURNS_DEG
from t2twin.sim.calibrate.calibrate import RANGES, calibrate, guess_light, mean_light, sample_lights
from t2twin.sim.calibrate.fit import BallFit, Geometry, Presses, Terms
from t2twin.sim.calibrate.frames import (
    clean_background,
    contact_patch,
    crop,
    cut_and_paste,
    score,
    sized_frame,
)
from t2twin.sim.optical.illumination import LOBE_PLACES, LOBE_TERMS, Leds
from t2twin.sim.optical.image_renderer import ImageRenderer
from t2twin.sim.optical.optics import Optics
from t2twin.sim.optical.surface import ball_surface
from t2twin.sim.optical.units import sample_unit
from t2twin.sim.sensors.pair import SensorPair

DIGIT, SMALL = SensorPair().camera, small_digit()
CAMERA, GEL, NOISE_GREY = DIGIT.camera, DIGIT.own_gel, DIGIT.spec.camera.noise_grey
ROWS, COLUMNS = CAMERA.rows, CAMERA.columns
ONE_PIXEL_MM = 1 / CAMERA.scale_px_per_mm


def renderer_of(optics):
    return ImageRenderer(optics, GEL, NOISE_GREY)


def test_places_and_depths_are_found_again(calibrated):
    poses = calibrated.poses
    assert len(calibrated.held_out) == HELD_OUT
    off = np.hypot(*(poses - POSES)[:, :2].T)
    assert off.max() < 2 * ONE_PIXEL_MM
    ratio = poses[:, 2] / POSES[:, 2]
    assert np.abs(ratio - 1).max() < 0.12
    assert np.ptp(ratio) < 0.12


def test_the_leds_are_found_again(calibrated):
    truth = SMALL.optics.leds_mm
    for fitted, true in zip(calibrated.optics.leds_mm, truth, strict=True):
        directions = [np.arctan2(place[1], place[0]) for place in (fitted, true)]
        turn = np.angle(np.exp(1j * (directions[0] - directions[1])))
        assert abs(np.degrees(turn)) < 6
        heights = [np.arctan2(-place[2], np.hypot(*place[:2])) for place in (fitted, true)]
        assert abs(np.degrees(heights[0] - heights[1])) < 6


def test_held_out_presses_score_near_the_noise(calibrated):
    scores = calibrated.scores
    assert scores["calibrated"].psnr_db > 32
    assert scores["calibrated"].psnr_db > scores["cut_and_paste"].psnr_db + 4
    assert scores["cut_and_paste"].psnr_db > scores["do_nothing"].psnr_db + 4
    assert scores["calibrated"].ssim > scores["cut_and_paste"].ssim
    assert min(each.psnr_db for each in calibrated.held_out) > 30


def test_an_untouched_gel_gives_the_cleaned_background(calibrated):
    renderer = renderer_of(calibrated.optics)
    still = renderer.render(ball_surface(GEL, 0, 0, 1.0) * 0)
    np.testing.assert_array_equal(still, calibrated.optics.background)
    truth = SMALL.image_renderer.background
    assert np.abs(still.astype(float) - truth).mean() < 0.5 * NOISE_GREY


def test_cleaning_keeps_specks_and_loses_noise():
    rng = np.random.default_rng(0)
    truth = np.full((ROWS, COLUMNS, 3), 90.0)
    truth[100:103, 50:53] = 160.0
    frames = [truth + rng.normal(0, NOISE_GREY, truth.shape) for _ in range(9)]
    noisy = [np.clip(np.rint(frame), 0, 255).astype(np.uint8) for frame in frames]
    noisy[3][180:260, 100:180] = 200  # a contact, which must not be averaged in
    clean = clean_background(noisy[0], np.array(noisy[1:])).astype(float)
    assert (clean - truth).std() < 0.5 * NOISE_GREY
    assert np.abs(clean - truth)[100:103, 50:53].mean() < 8
    assert np.abs(clean - truth)[180:260, 100:180].mean() < NOISE_GREY


def test_what_is_written_is_fitted_to_all_presses(calibrated):
    assert calibrated.optics.noise is not None
    assert calibrated.optics.noise.grey == pytest.approx(NOISE_GREY, rel=0.06)
    assert calibrated.scored_by.noise is None
    assert not np.array_equal(calibrated.optics.response, calibrated.scored_by.response)
    surface = ball_surface(GEL, 0.5, 0.2, 1.0, BALL_MM / 2)
    one, other = (
        renderer_of(of).render(surface) for of in (calibrated.optics, calibrated.scored_by)
    )
    assert score(one, other).psnr_db > 32


def test_a_patch_is_where_the_press_is():
    renderer = DIGIT.image_renderer
    picture = renderer.render(ball_surface(GEL, 1.5, -2.0, 1.0))
    patch = contact_patch(picture, renderer.background)
    assert patch is not None
    row, column = patch
    assert row == pytest.approx(159.5 - 2.0 * 19.2, abs=20)
    assert column == pytest.approx(119.5 + 1.5 * 19.2, abs=20)
    assert contact_patch(renderer.background, renderer.background) is None
    dimmer = (renderer.background * 0.9).astype(np.uint8)
    assert contact_patch(dimmer, renderer.background) is None


def test_cut_and_paste_moves_a_press_exactly():
    still = np.full((ROWS, COLUMNS, 3), 50, np.uint8)
    pressed, wanted = still.copy(), still.copy()
    pressed[100:120, 100:120] = 200
    wanted[150:170, 90:110] = 200
    pasted = cut_and_paste(still, pressed[None], np.array([[110, 110]]), np.array([[160, 100]]))
    np.testing.assert_array_equal(pasted[0], wanted)


@pytest.fixture
def copy(small_unit, tmp_path):
    return shutil.copytree(small_unit, tmp_path / "copy")


def test_a_frame_of_another_size_is_refused(copy):
    save(np.zeros((64, 48, 3), np.uint8), copy / "press_04.png")
    said = refused(copy, sensor=SMALL)
    assert re.search(r"press_04\.png is 48 wide, 64 high.*120 wide, 160 high", said)
    for path in copy.glob("*.png"):
        save(np.zeros((64, 48, 3), np.uint8), path)
    assert "must be 120 wide, 160 high" in refused(copy, sensor=SMALL)


def test_frames_are_reduced_and_never_turned():
    frame = np.zeros((ROWS, COLUMNS, 3), np.uint8)
    frame[:40, :30] = (200, 10, 10)  # upper left corner
    large = frame.repeat(2, axis=0).repeat(2, axis=1)
    for each in (frame, large):
        np.testing.assert_array_equal(sized_frame(each, CAMERA), frame)
        with pytest.raises(T2TwinError, match="their side; --turn-deg turns them by 90 or 270"):
            sized_frame(np.rot90(each), CAMERA)
    for shape in ((ROWS, 239, 3), (160, 120, 3), (480, 480, 3)):
        with pytest.raises(T2TwinError, match=r"in these proportions$"):
            sized_frame(np.zeros(shape, np.uint8), CAMERA)


def test_frames_that_no_sensor_takes_are_named(copy):
    path = copy / "press_04.png"
    frame = np.asarray(Image.open(path))
    wrong = {
        "without color": np.repeat(frame.mean(axis=-1, keepdims=True), 3, axis=-1),
        "black": frame // 32,
        "noise": np.random.default_rng(0).integers(0, 256, frame.shape),
    }
    for name, each in wrong.items():
        save(each.astype(np.uint8), path)
        assert f"press_04.png is {name}; expected frames" in refused(copy, sensor=SMALL)
        with pytest.raises(T2TwinError, match=f"press_04.png is {name}"):
            guess_light(path, sensor=SMALL)


def test_too_few_presses_are_refused(copy):
    assert "14 places would do" in refused(copy, sensor=SMALL, held_out=8)
    for path in sorted(copy.glob("press_*"))[1:9]:
        shutil.copy(copy / "press_00.png", path)
    assert "9 frames of presses at 1 place" in refused(copy, sensor=SMALL, held_out=3)


def test_frames_of_another_gel_camera_are_refused_before_the_long_fit(copy, monkeypatch):
    """Its stripes of light around a contact cannot be those of a DIGIT's three LEDs."""
    background = np.asarray(Image.open(copy / "background.png")).astype(int)
    rows, columns = np.indices(background.shape[:2])
    for path, (x_mm, y_mm, _) in zip(sorted(copy.glob("press_*")), POSES, strict=True):
        row, column = 79.5 + 9.6 * y_mm, 59.5 + 9.6 * x_mm
        pressed = np.hypot(rows - row, columns - column) < 24
        stripes = np.where((rows - round(row)) // 12 % 2, 40, -40) * pressed
        save(np.clip(background + stripes[..., None], 0, 255).astype(np.uint8), path)
    monkeypatch.setattr(BallFit, "_refined", lambda *_: pytest.fail("the long fit has begun"))
    said = refused(copy, sensor=SMALL)
    assert re.search("% of the presses' change of the background unexplained.*press_0", said)


def test_real_frames_held_out(real_digit):
    """Fitted to presses 00 to 13 and 15, which is at the place of 00, scored on 14 and 16 to 20."""
    report = calibrate(real_digit / "background.png", real_digit, 4.70, 7, tolerance=None)
    ours, pasted = report.scores["calibrated"], report.scores["cut_and_paste"]
    assert ours.psnr_db > 30.4 and ours.psnr_db > pasted.psnr_db + 5
    assert ours.ssim > 0.868 and ours.ssim > pasted.ssim + 0.05
    assert report.scores["do_nothing"].psnr_db == pytest.approx(15.4, abs=0.3)


# The lobe: light in the direction of the gel's normal


DRIFT_GREY = np.array([4, -3, 5])
HOLD, SKIRT = 0.8, 1.0


@pytest.fixture(scope="module")
def lobed():
    """The default optics with a lobe that changes images by tens of grey levels."""
    lobe = np.zeros((3, 3, LOBE_PLACES, LOBE_TERMS))
    rng = np.random.default_rng(0)
    for led in range(3):
        lobe[led, led] = 0.5 * rng.uniform(-1, 1, (LOBE_PLACES, LOBE_TERMS))
    return replace(DIGIT.optics, lobe=lobe)


def ball_at(pose):
    x_mm, y_mm, depth_mm = pose
    return ball_surface(GEL, x_mm, y_mm, depth_mm, BALL_MM / 2, HOLD, SKIRT)


def test_a_unit_with_a_lobe_and_drift_is_recovered(lobed):
    warm = np.clip(lobed.background.astype(int) + DRIFT_GREY, 0, 255).astype(np.uint8)
    renderer = ImageRenderer(replace(lobed, background=warm), GEL, 0.0)
    frames = np.array([renderer.render(ball_at(pose)) for pose in POSES])
    clean = clean_background(lobed.background, frames[1:])
    assert np.abs(clean.astype(float) - warm).mean() < 0.5
    patches = np.array([contact_patch(frame, lobed.background) for frame in frames])
    nothing = np.full(len(POSES) - 1, np.nan)
    known = np.full(len(POSES) - 1, BALL_MM), nothing, nothing
    model = BallFit(Presses(DIGIT, clean, frames[1:], patches[1:], *known, []), DIGIT.camera)
    geometry = Geometry.of(Leds(lobed.leds_mm, lobed.sizes_mm))
    geometry = replace(geometry, values=np.array([*geometry.values[:-2], HOLD, SKIRT]))
    psnr_db = {}
    for has_lobe in (False, True):
        state = model._solved(geometry, POSES[1:], Terms(3, 4, 1e-4, has_lobe))
        fitted = ImageRenderer(state.optics(clean), GEL, 0.0).render(ball_at(POSES[0]))
        psnr_db[has_lobe] = score(crop(frames[0], patches[0]), crop(fitted, patches[0])).psnr_db
    assert psnr_db[True] > 38
    assert psnr_db[True] > psnr_db[False] + 3


def test_a_file_keeps_the_lobe(lobed, tmp_path):
    lobed.save(tmp_path / "unit.npz")
    again = Optics.load(tmp_path / "unit.npz")
    np.testing.assert_array_equal(again.lobe, lobed.lobe)
    for wrong in (lobed.lobe[:2], np.full_like(lobed.lobe, np.nan), np.full_like(lobed.lobe, 1e9)):
        with pytest.raises(T2TwinError, match="lobe"):
            replace(lobed, lobe=wrong)


# Without presses: the mean light of sampled units with the given background and camera


FEW = 60  # units


def test_the_mean_errs_less_than_the_drawn_ones():
    """On a unit that is none of them, which is why it is the mean."""
    surface, middle = ball_surface(GEL, 0.5, 0.2, 1.0), (163.0, 129.0)
    mean, singly = [], []
    for number in range(1, 7):
        unit = sample_unit(np.random.default_rng((9, number)), DIGIT.spec, RANGES).optics
        own = sample_lights(unit.background, DIGIT, unit.camera, FEW)
        wanted, of_mean, *others = (
            crop(renderer_of(light).render(surface), middle)
            for light in (unit, mean_light(own), *own[:10])
        )
        mean.append(psnr(wanted, of_mean))
        singly.append(np.mean([psnr(wanted, other) for other in others]))
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
    with pytest.raises(SystemExit):
        main(["calibrate", "--background", str(path), "--force-tolerance-n", "0.1"])
    assert "--force-tolerance-n is of a fit, which needs --presses" in capsys.readouterr().err
    orders = [t2twin.FrameOrder(*each) for each in product(TURNS_DEG, (False, True))]
    for order in (*orders[1:], t2twin.FrameOrder(180, False, True)):  # the advice, then followed
        stored = frames[0][:, ::-1] if order.mirror else frames[0]
        stored = np.rot90(stored, order.turn_deg // 90)[..., :: -1 if order.bgr else 1]
        Image.fromarray(np.ascontiguousarray(stored)).save(tmp_path / "stored.png")
        with pytest.raises((T2TwinError, t2twin.T2TwinWarning), match=f"order {order} \\("):
            t2twin.guess_light(tmp_path / "stored.png")
        same = t2twin.guess_light(tmp_path / "stored.png", order=order)
        np.testing.assert_array_equal(same.background, frames[0])
    with pytest.warns(t2twin.T2TwinWarning, match=r"not stored in the order --turn-deg 180 --bgr"):
        t2twin.guess_light(path, order=order)
    written = Optics.load(tmp_path / "out" / "optics.npz")
    camera = structs.replace(CAMERA, scale_px_per_mm=18.0, distance_mm=21.0)
    with pytest.warns(t2twin.T2TwinWarning, match="shows a contact, by field"):
        given, other = t2twin.guess_light(path), t2twin.guess_light(path, camera)
    assert other.camera == camera
    np.testing.assert_array_equal(given.background, frames[1])
    for name in ("background", "leds_mm", "sizes_mm", "response"):
        np.testing.assert_array_equal(getattr(written, name), getattr(given, name))
    assert not (tmp_path / "out" / "optics.json").exists()
