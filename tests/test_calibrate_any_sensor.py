"""Calibration of any gel camera: size, LEDs, markers, repeats, what presses cover, refusals."""

import re
from dataclasses import replace
from functools import cache, partial

import numpy as np
import pytest
from ball_frames import refused, save
from kinds import psnr
from msgspec import structs

from t2twin.core.errors import T2TwinError, T2TwinWarning
from t2twin.primitives_cad.shape import ball
from t2twin.sim.calibrate import calibrate as calibration
from t2twin.sim.calibrate import fit
from t2twin.sim.calibrate import frames as images
from t2twin.sim.calibrate.calibrate import calibrate, evaluate, guess_light, read_presses
from t2twin.sim.contact.types import PressCommand
from t2twin.sim.optical.gel_camera import GelCamera
from t2twin.sim.optical.markers import Markers
from t2twin.sim.optical.surface import ball_surface
from t2twin.sim.sensors.pair import SensorPair

BALL_MM = 5.0
HELD_OUT = 3
COLORS = ((0.9, 0.1, 0.1), (0.1, 0.8, 0.2), (0.2, 0.2, 0.9), (0.5, 0.5, 0.5))


@cache
def sensor_of(turn_deg=0.0, colors=COLORS):
    """A flat gel of 24 x 18 mm in images of odd size, lit from four sides, one of them white."""
    own = SensorPair().camera.spec
    flat = {"dome_width_radius_mm": np.inf, "dome_length_radius_mm": np.inf, "dome_flat_mm": 0.0}
    gel = structs.replace(own.gel, width_mm=24.0, length_mm=18.0, **flat)
    camera = structs.replace(own.camera, rows=95, columns=133, scale_px_per_mm=6.0, noise_grey=1.5)
    plain = structs.replace(own.light.leds[0], aim_mm=(0.0, 0.0, 0.0), beam_deg=(60.0, 85.0))
    leds = tuple(
        structs.replace(plain, color=color, angle_deg=(90.0 * number + 20.0 + turn_deg) % 360.0)
        for number, color in enumerate(colors)
    )
    light = structs.replace(own.light, leds=leds, optics="none")
    assert own.units is not None
    units = structs.replace(own.units, scale_px_per_mm=(5.6, 6.6))
    spec = structs.replace(own, name="small", gel=gel, camera=camera, light=light, units=units)
    return GelCamera(structs.replace(spec, markers=None))


def poses_of(count):
    """Presses all over the image."""
    index = np.arange(count)
    across, down = (index * 0.618 + 0.3) % 1.0 - 0.5, (index + 0.5) / count - 0.5
    places = np.stack([18.0 * across, 12.0 * down], axis=1)[
        np.random.default_rng(0).permutation(count)
    ]
    return np.column_stack([places, 0.8 + 0.5 * np.sin(3.0 * index) ** 2])


def frames_of(unit, poses, ball_mm=BALL_MM):
    """A background frame, and one of each press."""
    rng, gel = np.random.default_rng(2), unit.own_gel
    surfaces = [ball_surface(gel, x, y, depth, ball_mm / 2) for x, y, depth in poses]
    render = unit.image_renderer.render
    still = render(np.zeros_like(surfaces[0]), rng)
    return still, np.array([render(surface, rng) for surface in surfaces])


def test_light_from_elsewhere_in_other_colors_is_found():
    """Frames in the light of the sensor's own file are fitted with over 30 dB."""
    unit, sensor = sensor_of(65.0, COLORS[::-1]), sensor_of()
    background, frames = frames_of(unit, poses_of(9))
    count, missing = len(frames), np.full(len(frames), np.nan)
    patches = np.array([images.contact_patch(frame, background) for frame in frames], float)
    measured = np.full(count, BALL_MM), missing, missing
    names = [f"press_{index:02d}.png" for index in range(count)]
    presses = fit.Presses(sensor, background, frames, patches, *measured, names)
    train, test = list(range(count - HELD_OUT)), list(range(count - HELD_OUT, count))
    training = calibration.cleaned(presses, train)
    fitted = calibration.fit_presses(training, sensor.camera)
    assert evaluate(presses, test, training, fitted).scores["calibrated"].psnr_db > 29.5
    geometry = fitted.geometry
    true = np.radians([led.angle_deg for led in unit.spec.light.leds])
    found = np.radians(geometry.values[: geometry.count])
    apart = np.abs(np.angle(np.exp(1j * (found[:, None] - true))))
    assert np.degrees(apart.min(axis=1)).max() < 12 and set(apart.argmin(axis=1)) == {0, 1, 2, 3}
    dim = evaluate(presses, test, training, replace(fitted, response=0.1 * fitted.response))
    assert re.search("no better than a baseline: .* worst frame is press_0", dim.notes[0])
    nothing = replace(presses, frames=np.broadcast_to(background, frames.shape))
    with pytest.raises(T2TwinError, match="does not explain"):
        evaluate(nothing, test, training, fitted)


def test_the_presses_that_are_missing_are_named():
    sensor = sensor_of()
    camera, gel = sensor.camera, sensor.own_gel
    grid = np.meshgrid(np.arange(-10.0, 11.0, 2.0), np.arange(-7.0, 8.0, 2.0))
    poses = np.column_stack([*(axis.ravel() for axis in grid), np.ones(grid[0].size)])
    _, covered, places = images.coverage_of(camera, gel, poses, np.full(len(poses), BALL_MM))
    assert covered > 0.95 and not places
    assert images.coverage_sentences(covered, places)[0].startswith("The contacts cover the gel")
    left = poses[poses[:, 0] < 1]
    radii, half, places = images.coverage_of(camera, gel, left, np.full(len(left), BALL_MM))
    assert 0.25 < half < 0.65
    assert places and all(x_mm > 0 for x_mm, _ in places)
    sentences = " ".join(images.coverage_sentences(half, places))
    assert "right" in sentences and "left" not in sentences
    both = np.concatenate([left[:, :2], places])
    added = np.column_stack([both, np.ones(len(both))])
    assert images.coverage_of(camera, gel, added, np.full(len(added), BALL_MM))[1] > half + 0.3
    picture = np.asarray(images.coverage_picture(sensor.optics, gel, left, radii, places))
    middle = picture.shape[1] // 2
    assert picture[:, :middle].mean() > 1.5 * picture[:, middle:].mean()


@pytest.mark.parametrize("diameter_mm", [3.0, 10.0, 14.0])
@pytest.mark.parametrize("gel_mm", [24.0, 14.0])
def test_the_next_presses_lie_in_the_free_part_of_the_gel(diameter_mm, gel_mm):
    """One press covers its contact; others belong where their whole contacts are seen and free."""
    sensor = sensor_of()
    gel, ball_mm = replace(sensor.own_gel, width_mm=gel_mm), np.array([diameter_mm])
    pose, half_mm = np.array([[0.0, 0.0, 0.9]]), sensor.camera.seen_half_extent_mm()
    (radius_mm,), covered, places = images.coverage_of(
        sensor.camera, gel, pose, np.array([ball_mm])
    )
    half_x, half_y = min(half_mm[0], gel_mm / 2), half_mm[1]
    assert covered == pytest.approx(np.pi * radius_mm**2 / (4 * half_x * half_y), rel=0.25)
    x_mm, y_mm = np.array(places).T
    assert (np.abs(x_mm) <= half_x - radius_mm + 0.02).all()
    assert (np.abs(y_mm) <= half_y - radius_mm + 0.02).all()
    assert (np.hypot(x_mm, y_mm) > 0.9 * radius_mm).all()


def written(folder, background, frames):
    folder.mkdir()
    save(background, folder / "background.png")
    for number, frame in enumerate(frames):
        save(frame, folder / f"press_{number:02d}.png")
    return folder


def test_what_cannot_be_fitted_is_one_sentence(tmp_path):
    sensor = sensor_of()
    frames = frames_of(sensor, poses_of(9))
    folder = written(tmp_path / "frames", *frames)
    said = refused(folder, ball_mm=2.0, sensor=sensor)
    assert re.search(r"too small for the contact in press_0\d.png.* about 4.\d mm wide", said)
    assert "must be 240 wide, 320 high" in refused(folder, sensor="digit")
    assert "is a taxel array; expected a gel camera" in refused(folder, sensor="cyskin-20")
    assert "from 1 to 15.8" in refused(folder, ball_mm=17.0, sensor=sensor)
    dark = structs.replace(sensor.spec, units=None)
    with pytest.raises(T2TwinError, match=r"has no table \[units\]"):
        guess_light(folder / "background.png", sensor=GelCamera(dark))


def test_frames_of_one_place_are_in_one_part(tmp_path):
    """Twice around eight places: no place that is fitted is scored."""
    sensor, poses = sensor_of(), poses_of(8)
    again = poses + np.array([0.05, -0.05, 0.2])
    folder = written(tmp_path / "frames", *frames_of(sensor, np.concatenate([poses, again])))
    read = partial(read_presses, folder / "background.png", folder, BALL_MM)
    presses, train, test = read(None, sensor, sensor.camera, None)
    assert test == [6, 7, 14, 15]
    assert sorted([*train, *test]) == list(range(16))
    assert "press_07.png, press_15.png" in presses.notes[0]
    for index in (7, *range(9, 16)):
        (folder / f"press_{index:02d}.png").unlink()
    assert read(2, sensor, sensor.camera, None)[2] == [6]  # the other one is at a fitted place
    said = refused(folder, ball_mm=BALL_MM, sensor=sensor, held_out=3)
    assert "8 frames of presses at 7 places, of which 3" in said and "9 places would do" in said
    assert read(None, sensor, sensor.camera, None)[2] == [6]  # eight frames at seven places


def test_printed_markers_are_filled_in(tmp_path, monkeypatch):
    """The markers move with the gel; the light is that without them."""
    plain = sensor_of()
    marked = plain.with_options({"markers": Markers(2.0, 1.0), "frames": 1})
    poses, rng, shape = poses_of(9), np.random.default_rng(0), ball(BALL_MM / 2)
    commands = [PressCommand(shape.name, x, y, 0.0, 3.0 * depth) for x, y, depth in poses]
    contacts = [plain.press(shape, command) for command in commands]
    frames = [marked.image(contact, rng) for contact in (None, *contacts)]
    filled, is_marked = images.without_markers(frames, plain.camera)
    without = np.array([plain.image(contact) for contact in (None, *contacts)])
    assert is_marked and not images.without_markers(list(without), plain.camera)[1]
    assert psnr(filled, without) > psnr(np.array(frames), without) + 10
    folder = written(tmp_path / "frames", frames[0], frames[1:])
    monkeypatch.setattr(fit, "MAX_STEPS", 1)
    with pytest.warns(T2TwinWarning, match="printed markers"):
        report = calibrate(folder / "background.png", folder, BALL_MM, tolerance=None, sensor=plain)
    assert report.scores["calibrated"].psnr_db > report.scores["cut_and_paste"].psnr_db + 4
    np.testing.assert_allclose(report.optics.background, without[0], atol=30)
