"""Calibrating the optics: places, depths and light found again, held-out scores, bad input."""

import re
import shutil
from dataclasses import replace

import numpy as np
import pytest
from ball_frames import BALL_MM, HELD_OUT, POSES, save
from PIL import Image

from t2twin.cli import main
from t2twin.core.errors import T2TwinError
from t2twin.sim.calibrate.calibrate import (
    _check_explains,
    calibrate,
    cut_and_paste,
    guess_light,
    score,
)
from t2twin.sim.calibrate.fit import BallFit, Sums, Terms, select_terms
from t2twin.sim.calibrate.frames import clean_background, contact_patch, upright_frame
from t2twin.sim.optical.image_renderer import ImageRenderer
from t2twin.sim.optical.surface import ball_surface
from t2twin.sim.sensors.pair import SensorPair

DIGIT = SensorPair().camera
CAMERA, GEL, NOISE_GREY = DIGIT.camera, DIGIT.own_gel, DIGIT.spec.camera.noise_grey
ROWS, COLUMNS = CAMERA.rows, CAMERA.columns
ONE_PIXEL_MM = 1 / CAMERA.scale_px_per_mm
LEDS = 3
ALL_TERMS = Terms.most(LEDS)


def renderer_of(optics):
    return ImageRenderer(optics, GEL, NOISE_GREY)


def run(*arguments, code=0):
    """Run the command as the shell would; its exit status must be the given one."""
    try:
        main([str(argument) for argument in ("calibrate", *arguments)])
        status = 0
    except SystemExit as stop:
        status = int(stop.code or 0)
    assert status == code


@pytest.fixture
def report(calibrated):
    return calibrated


def test_places_and_depths_are_found_again(report):
    poses = np.concatenate([report.training_poses, report.poses])
    assert len(report.poses) == HELD_OUT
    off = np.hypot(*(poses - POSES)[:, :2].T)
    assert off.max() < 2 * ONE_PIXEL_MM
    ratio = poses[:, 2] / POSES[:, 2]
    assert np.abs(ratio - 1).max() < 0.12
    assert np.ptp(ratio) < 0.12


def test_the_leds_are_found_again(report):
    truth = DIGIT.optics.leds_mm
    for fitted, true in zip(report.optics.leds_mm, truth, strict=True):
        directions = [np.arctan2(place[1], place[0]) for place in (fitted, true)]
        turn = np.angle(np.exp(1j * (directions[0] - directions[1])))
        assert abs(np.degrees(turn)) < 6
        heights = [np.arctan2(-place[2], np.hypot(*place[:2])) for place in (fitted, true)]
        assert abs(np.degrees(heights[0] - heights[1])) < 6


def test_held_out_presses_score_near_the_noise(report):
    scores = report.scores
    assert scores.calibrated.psnr_db > 32
    assert scores.calibrated.psnr_db > scores.cut_and_paste.psnr_db + 4
    assert scores.cut_and_paste.psnr_db > scores.do_nothing.psnr_db + 4
    assert scores.calibrated.ssim > scores.cut_and_paste.ssim
    assert min(each.psnr_db for each in report.each) > 30


def test_an_untouched_gel_gives_the_cleaned_background(report):
    renderer = renderer_of(report.optics)
    still = renderer.render(ball_surface(GEL, 0, 0, 1.0) * 0)
    np.testing.assert_array_equal(still, report.optics.background)
    truth = DIGIT.image_renderer.background
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


def test_light_that_drifts_is_the_frames_own():
    """The background was taken when the LEDs were colder: the frames are what is simulated."""
    rng = np.random.default_rng(0)
    cold = np.full((ROWS, COLUMNS, 3), 90.0)
    warm = cold + np.array([4.0, 2.0, -3.0]) * np.linspace(0.5, 1.5, COLUMNS)[:, None]
    frames = [np.rint(warm + rng.normal(0, NOISE_GREY, cold.shape)) for _ in range(8)]
    frames[2][180:260, 100:180] = 200.0
    background = np.rint(cold + rng.normal(0, NOISE_GREY, cold.shape)).astype(np.uint8)
    clean = clean_background(background, np.array(frames).astype(np.uint8)).astype(float)
    assert np.abs((clean - warm).mean(axis=0)).max() < 1.0
    assert np.abs((clean - warm)[180:260, 100:180].mean(axis=(0, 1))).max() < 0.5


def sums_of(powers, presses, rng, noise):
    """What a fit needs of presses whose light has a known response, of this degree in the place."""
    response = rng.normal(0.0, 1.0, (3, ALL_TERMS.entries))
    own = Terms(LEDS, powers, 1.0).among(ALL_TERMS)
    response[:, np.setdiff1d(np.arange(ALL_TERMS.entries), own)] = 0
    made = []
    for _ in range(presses):
        columns = rng.normal(0.0, 1.0, (400, ALL_TERMS.entries))
        shown = columns @ response.T + rng.normal(0.0, noise, (400, 3))
        made.append(Sums.of(columns, shown))
    return made


def test_as_many_terms_are_taken_as_presses_determine():
    rng = np.random.default_rng(0)
    assert select_terms(sums_of(4, 12, rng, 0.1), LEDS).degree == 4
    assert select_terms(sums_of(2, 6, rng, 3.0), LEDS).degree == 2


def test_what_is_written_is_fitted_to_all_presses(report):
    assert report.optics.noise is not None
    assert report.optics.noise.grey == pytest.approx(NOISE_GREY, rel=0.06)
    assert report.scored_by.noise is None
    assert not np.array_equal(report.optics.response, report.scored_by.response)
    surface = ball_surface(GEL, 0.5, 0.2, 1.0, BALL_MM / 2)
    one, other = (renderer_of(of).render(surface) for of in (report.optics, report.scored_by))
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
def copy(unit, tmp_path):
    return shutil.copytree(unit, tmp_path / "copy")


def refused(copy, capsys, *more, ball=BALL_MM, background=None):
    run("--background", background or copy / "background.png", "--presses", copy,
        "--ball-diameter-mm", ball, "--out", copy / "out", *more, code=2)  # fmt: skip
    assert not (copy / "out").exists()
    lines = [line for line in capsys.readouterr().err.splitlines() if "compiling" not in line]
    assert len(lines) == 1
    return lines[0]


def test_a_frame_of_another_size_is_refused(copy, capsys):
    save(np.zeros((64, 48, 3), np.uint8), copy / "press_04.png")
    assert re.search(
        r"press_04\.png is 48 wide, 64 high.*240 wide, 320 high", refused(copy, capsys)
    )
    for path in copy.glob("*.png"):
        save(np.zeros((64, 48, 3), np.uint8), path)
    assert "must be 240 wide, 320 high" in refused(copy, capsys)


def test_frames_as_the_camera_has_them_are_turned_upright():
    upright = np.zeros((ROWS, COLUMNS, 3), np.uint8)
    upright[:40, :30] = (200, 10, 10)  # upper left corner
    np.testing.assert_array_equal(upright_frame(upright, CAMERA), upright)
    on_its_side = np.rot90(upright, -1)
    assert on_its_side.shape == (COLUMNS, ROWS, 3)
    np.testing.assert_array_equal(upright_frame(on_its_side, CAMERA), upright)
    large = on_its_side.repeat(2, axis=0).repeat(2, axis=1)
    np.testing.assert_array_equal(upright_frame(large, CAMERA), upright)
    for shape in ((ROWS, 239, 3), (160, 120, 3), (480, 480, 3)):
        with pytest.raises(T2TwinError, match="in these proportions"):
            upright_frame(np.zeros(shape, np.uint8), CAMERA)


def test_frames_that_no_sensor_takes_are_named(copy, capsys):
    path = copy / "press_04.png"
    frame, shape = np.asarray(Image.open(path)), (ROWS, COLUMNS, 3)
    wrong = {
        "without color": np.repeat(frame.mean(axis=-1, keepdims=True), 3, axis=-1),
        "black": frame // 32,
        "noise": np.random.default_rng(0).integers(0, 256, shape),
    }
    for name, each in wrong.items():
        save(each.astype(np.uint8), path)
        assert f"press_04.png is {name}; expected frames" in refused(copy, capsys)
        with pytest.raises(T2TwinError, match=f"press_04.png is {name}"):
            guess_light(path)


def test_too_few_presses_are_refused(copy, capsys):
    assert "at least 6" in refused(copy, capsys, "--held-out", 8)
    for path in sorted(copy.glob("press_*"))[1:9]:
        shutil.copy(copy / "press_00.png", path)
    assert "copies of others" in refused(copy, capsys, "--held-out", 3)


def test_frames_of_another_gel_camera_are_refused_before_the_long_fit(copy, capsys, monkeypatch):
    """Its stripes of light around a contact cannot be those of a DIGIT's three LEDs."""
    background = np.asarray(Image.open(copy / "background.png")).astype(int)
    rows, columns = np.indices((ROWS, COLUMNS))
    for path, (x_mm, y_mm, _) in zip(sorted(copy.glob("press_*")), POSES, strict=True):
        row, column = 159.5 + y_mm / ONE_PIXEL_MM, 119.5 + x_mm / ONE_PIXEL_MM
        pressed = np.hypot(rows - row, columns - column) < 40
        stripes = np.where((rows - round(row)) // 12 % 2, 40, -40) * pressed
        save(np.clip(background + stripes[..., None], 0, 255).astype(np.uint8), path)
    monkeypatch.setattr(BallFit, "_refined", lambda *_: pytest.fail("the long fit has begun"))
    said = refused(copy, capsys)
    assert "% of the presses' change of the background unexplained" in said


def test_real_frames_held_out(real_digit):
    """Fitted to presses 00 to 13, scored on 14 to 20."""
    report = calibrate(real_digit / "background.png", real_digit, 4.70, 7, tolerance=None)
    ours, pasted = report.scores.calibrated, report.scores.cut_and_paste
    assert ours.psnr_db > 30.4 and ours.psnr_db > pasted.psnr_db + 5
    assert ours.ssim > 0.868 and ours.ssim > pasted.ssim + 0.05
    assert report.scores.do_nothing.psnr_db == pytest.approx(15.4, abs=0.3)


def test_a_fit_that_explains_nothing_is_refused(report):
    """As one to noise does: nearer to the frames than their own background it must be."""
    _check_explains(report.scores)
    worthless = replace(report.scores, calibrated=report.scores.do_nothing)
    with pytest.raises(T2TwinError, match="does not explain"):
        _check_explains(worthless)
