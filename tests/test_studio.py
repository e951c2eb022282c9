"""The studio without a browser: its state, its session, its translators, its cards and meshes."""

import base64
import io
import shutil
import socket
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import trimesh
from PIL import Image

import t2twin
from t2twin.cli import main
from t2twin.core.errors import T2TwinError
from t2twin.sim.contact.contact_solver import DEPTH_TOLERANCE_MM
from t2twin.sim.sampling.protocol import SCALES, indices, press_of
from t2twin.sim.sensors.pair import SensorPair
from t2twin.studio import cards, scene
from t2twin.studio.session import COMMAND_FILE, PressState, Session, protocol_press
from t2twin.studio.translators import LEVEL, Translators
from t2twin.translate.runs.config import DEFAULT_RUN

SHAPE = "hemisphere-4"
NOWHERE = Path("/nonexistent")
"""A folder that contains no runs."""


@pytest.fixture(scope="module")
def session(shape_cache):
    return Session()


@pytest.fixture(scope="module")
def result(session):
    return session.press(PressState(SHAPE, x_mm=1.5, yaw_deg=30.0, force_n=5.0))


def html(result):
    return cards.press_html(result, *cards.scales_of(result))


# State


@pytest.mark.parametrize(
    "options",
    [
        {"seed": 7, "imperfections": "all", "layout": "cyskin-63", "markers": True},
        {"depth_mm": 0.5, "target": "cyskin-63"},
    ],
)
def test_the_command_line_repeats_the_press_and_the_download_is_its_folder(
    options, session, tmp_path
):
    seen = session.press(PressState(SHAPE, x_mm=1.5, yaw_deg=30.0, **options))
    line = seen.command_line()
    main([*line.split()[1:], "--out", str(tmp_path / "press")])
    seen.save(tmp_path / "saved")
    saved = {path.name: path for path in (tmp_path / "saved").iterdir()}
    assert saved.pop(COMMAND_FILE).read_text() == line + "\n"
    assert set(saved) == {path.name for path in (tmp_path / "press").iterdir()}
    for file in ("digit.png", "tactile_image.png"):
        assert saved[file].read_bytes() == (tmp_path / "press" / file).read_bytes()


def test_the_last_of_force_and_depth_determines_the_press(session):
    deep = PressState(SHAPE, force_n=3.0).with_changes({"depth_mm": 0.5})
    assert (deep.depth_mm, deep.force_n) == (0.5, None)
    assert deep.with_changes({"x_mm": 1.0}).depth_mm == 0.5
    assert deep.with_changes({"force_n": 3.0}) == PressState(SHAPE, force_n=3.0)
    touch = session.press(deep).touch
    assert touch.digit.depth_mm == pytest.approx(0.5, abs=DEPTH_TOLERANCE_MM)
    assert np.array_equal(touch.image, t2twin.press(SHAPE, depth_mm=0.5).image)


def test_another_sensor_begins_with_its_own_options():
    state = PressState(layout="cyskin-63", markers=True, imperfections="all", seed=1)
    other = state.with_changes({"source": "cyskin-63"})
    assert other == PressState(source="cyskin-63", seed=1)
    assert not replace(other, motion="slide").continues(replace(state, motion="slide"))


def test_presses_of_the_protocol_are_found_by_their_number(shapes):
    number = indices("square-2", SCALES["small"])[5]
    command = press_of("square-2", shapes("square-2").spacing_mm, number)
    state = protocol_press(PressState("square-2", force_n=3.0), "small", 5)
    assert (state.x_mm, state.y_mm, state.force_n) == (command.x_mm, command.y_mm, 8.0)
    assert np.deg2rad(state.yaw_deg) == pytest.approx(command.yaw_rad)


# Presses


def test_any_two_sensors_are_pressed(tmp_path):
    own, file = Session(), tmp_path / "soft.toml"
    file.write_text('extends = "digit"\nname = "soft"\n[gel]\nyoung_mpa = 0.1\n')
    for state in (PressState(SHAPE, source="cyskin-63"), PressState(SHAPE, target=str(file))):
        seen = own.press(state)
        touch = t2twin.Twin(source=state.source, target=state.target).press(SHAPE)
        assert list(seen.touch.readings) == list(touch.readings)
        for name in touch.readings:
            assert seen.touch.contacts[name].depth_mm == touch.contacts[name].depth_mm
        assert all(f'data-name="{name}"' in html(seen) for name in touch.readings)


# Translators


def test_runs_are_found_below_a_folder(untrained_runs, tmp_path):
    for model, folder in zip(("resnet18", "touch2touch"), sorted(untrained_runs), strict=True):
        shutil.copytree(folder, tmp_path / "a" / model)
    shutil.copytree(tmp_path / "a/resnet18", tmp_path / "b/newer")
    (tmp_path / "b/damaged").mkdir()
    (tmp_path / "b/damaged/config.json").write_text("{")
    translators = Translators(below=tmp_path)
    assert set(translators.names) == {DEFAULT_RUN, "a/resnet18", "a/touch2touch", "b/newer"}
    assert len(translators.default_names) == 3 and "a/touch2touch" in translators.default_names
    with pytest.raises(T2TwinError, match=r"config\.json"):
        Translators([tmp_path])
    with pytest.raises(T2TwinError, match="no run"):
        translators.load("x")


def test_the_errors_of_given_runs_are_known(untrained_runs):
    translators = Translators(untrained_runs, NOWHERE)
    folders = {folder.name: folder for folder in untrained_runs}
    own, state = Session(translators), PressState(SHAPE)
    seen = own.press(state, translators.default_names[1:])
    for each in seen.translations:
        run = t2twin.load(folders[each.model])
        assert np.allclose(each.counts, run.predict(seen.touch.image), atol=0.5)
        off = each.counts - seen.touch.counts
        assert each.rmse_counts == pytest.approx(np.sqrt(np.mean(off**2)))
    page = html(seen)
    assert "ResNet18" in page and page.count("<img") == 6 and "interval" not in page
    other = own.press(replace(state, layout="cyskin-63"), translators.default_names[1:])
    truth = other.translations[0].truth  # at the taxels of the run
    assert truth is not None
    assert np.rint(truth).astype(int).tolist() == seen.touch.counts.tolist()


@pytest.fixture(scope="module")
def pretrained(shape_cache):
    """A session with the pretrained run, and a press with its prediction."""
    translators = Translators(below=NOWHERE)
    own = Session(translators)
    return own, own.press(PressState(SHAPE, force_n=6.0), translators.default_names)


def test_the_pretrained_run_gives_intervals_and_the_force(pretrained):
    seen = pretrained[1]
    (translation,) = seen.translations
    background = SensorPair().camera.background_frame()
    estimate = t2twin.load(DEFAULT_RUN).estimate(seen.touch.image, background)
    assert np.allclose(translation.counts, estimate.counts, atol=0.5)
    for end, same in zip(translation.interval, estimate.interval(LEVEL), strict=True):
        assert np.allclose(end, same, atol=0.5)
    value, low, high = translation.force
    assert value == pytest.approx(estimate.force_n.item(), abs=1e-3) and low < value < high
    assert translation.background_used and 10 < translation.covered <= 20
    page = html(seen)
    assert f"{low:.1f} to {high:.1f}" in page and "<td>6.00</td>" in page
    assert f"{translation.covered} of 20 taxels" in page and 'data-name="intervals"' in page


def test_another_array_has_no_true_counts_for_a_run(pretrained):
    own, first = pretrained
    for target in ("flexitac", "digit"):
        state = PressState(SHAPE, force_n=6.0, target=target)
        seen = own.press(state, own.translators.default_names)
        (translation,) = seen.translations
        assert translation.truth is None and "RMSE" not in html(seen)
        assert np.array_equal(translation.counts, first.translations[0].counts)


def test_a_frame_is_compared_with_a_background_frame(pretrained):
    own, seen = pretrained
    background = SensorPair().camera.background_frame()
    without, with_background = (
        own.translators.translate(seen.touch.image, own.translators.default_names, frame)
        for frame in (None, background)
    )
    assert np.array_equal(with_background[0].counts, seen.translations[0].counts)
    assert not np.array_equal(without[0].counts, with_background[0].counts)
    page = cards.frame_html((background, "a.png"), (background, "<b>.png"), with_background)
    assert all(
        part in page for part in ('"background"', "&lt;b&gt;.png", "Uses the background frame.")
    )


# Drawings


def test_the_page_has_the_image_and_the_notes_of_the_touch(session, result):
    page = html(result)
    source = page.partition('data-name="digit" src="')[2].partition('"')[0]

    with Image.open(io.BytesIO(base64.b64decode(source.partition(",")[2]))) as image:
        assert np.array_equal(np.asarray(image), result.touch.image)
    hard = session.press(PressState("square-1", force_n=60.0))
    assert hard.touch.notes and all(note in html(hard) for note in hard.touch.notes)


def test_the_drawn_surface_is_that_of_the_contact(result):
    contact = result.touch.digit
    part = scene.elastomer_part(contact, 400.0, (0.4, 0.4, 0.4, 1.0))
    x, y = np.meshgrid(contact.x_mm, contact.y_mm)
    rest_mm = contact.elastomer.rest_surface_mm(x, y)
    assert np.allclose(part.vertices[: x.size][:, 2], (rest_mm - contact.surface_mm).ravel())
    glb = scene.surfaces_of(result.touch, *cards.scales_of(result))["digit"]
    drawn = trimesh.load(io.BytesIO(glb), file_type="glb")
    assert isinstance(drawn, trimesh.Scene)
    assert np.allclose(drawn.to_mesh().bounds, part.bounds, atol=1e-4)


@pytest.mark.parametrize("style", ["solid", "cut open"])
def test_the_drawn_shape_touches_the_surface(style, result):
    contact = result.touch.digit
    turn, place = contact.shape_pose
    mesh = scene.drawn_mesh(result.touch.shape, style, result.touch.command).copy()
    mesh.apply_transform(trimesh.transformations.quaternion_matrix(turn))
    lowest_mm = mesh.bounds[0][2] + place[2]
    assert lowest_mm == pytest.approx(-contact.shape_depth_mm, abs=1e-3)
    if style == "cut open":
        assert mesh.bounds[0][1] == pytest.approx(0.0, abs=1e-6) and mesh.bounds[1][1] > 1.0


# Server


def test_a_taken_port_is_refused(capsys):
    with socket.create_server(("127.0.0.1", 0)) as taken, pytest.raises(SystemExit):
        main(["studio", "--port", str(taken.getsockname()[1])])
    assert "in use" in capsys.readouterr().err
