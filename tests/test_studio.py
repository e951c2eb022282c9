"""The studio without a browser: its state, its session, its translators, its files."""

import io
import json
import shutil
import zipfile
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
from t2twin.sim.sampling.protocol import indices, press_at, scale_of
from t2twin.sim.sensors.files import SPECS
from t2twin.sim.sensors.pair import SensorPair
from t2twin.studio import cards, files, solids
from t2twin.studio.colors import color_table, color_values
from t2twin.studio.files import COMMAND_FILE, zip_press
from t2twin.studio.press_state import PressState, protocol_press, read_query
from t2twin.studio.session import Session
from t2twin.studio.translators import LEVEL, TRAIN_COMMAND, Translators
from t2twin.translate.runs.config import DEFAULT_RUN

SHAPE = "hemisphere-4"
NOWHERE = Path("/nonexistent")
"""A folder that contains no runs."""


@pytest.fixture(scope="module")
def session(shape_cache):
    return Session(Translators())


@pytest.fixture(scope="module")
def result(session):
    return session.press(PressState(SHAPE, x_mm=1.5, yaw_deg=30.0, force_n=5.0))


# Presses as asked for


@pytest.mark.parametrize(
    "state, line",
    [
        (PressState(), "t2twin press square-1"),
        (
            PressState("pliers/teeth", x_mm=1.5, yaw_deg=-30.0, force_n=4.0),
            "t2twin press pliers/teeth --x-mm 1.5 --yaw-deg -30 --force-n 4",
        ),
        (
            PressState(seed=3, imperfections="all", layout="cyskin-63"),
            "t2twin press square-1 --layout cyskin-63 --imperfections all --seed 3",
        ),
        (
            PressState("/tmp/a/my part.stl", scale=25.4),
            "t2twin press 'my part.stl' --scale 25.4",
        ),
        (PressState(depth_mm=0.25), "t2twin press square-1 --depth-mm 0.25"),
        (
            PressState(source="cyskin-63", target="/tmp/a/mine.toml"),
            "t2twin press square-1 --source cyskin-63 --target mine.toml",
        ),
    ],
)
def test_a_press_has_a_line_that_makes_it_again(state, line):
    assert state.command_line() == line


@pytest.mark.parametrize(
    "asked", [{"force_n": 5.0}, {"seed": 7, "imperfections": "all"}, {"depth_mm": 0.5}]
)
def test_the_line_makes_the_same_press(asked, session, tmp_path):
    seen = session.press(PressState(SHAPE, x_mm=1.5, yaw_deg=30.0, **asked))
    line = seen.state.command_line().split()
    main([*line[1:], "--out", str(tmp_path / "out")])
    counts = json.loads((tmp_path / "out/cyskin-20.json").read_text())["counts"]
    assert counts == seen.touch.counts.tolist()
    with Image.open(tmp_path / "out/digit.png") as image:
        assert np.array_equal(np.asarray(image), seen.touch.image)


def test_of_force_and_depth_the_last_counts(session):
    deep = PressState(SHAPE, force_n=3.0).with_changes({"depth_mm": 0.5})
    assert (deep.depth_mm, deep.force_n) == (0.5, PressState().force_n)
    assert deep.with_changes({"x_mm": 1.0}).depth_mm == 0.5
    hard = deep.with_changes({"force_n": 3.0})
    assert hard == PressState(SHAPE, force_n=3.0)
    assert read_query(deep.query()) == deep and read_query(hard.query()) == hard
    touch = session.press(deep).touch
    assert touch.digit.depth_mm == pytest.approx(0.5, abs=DEPTH_TOLERANCE_MM)
    assert np.array_equal(touch.image, t2twin.press(SHAPE, depth_mm=0.5).image)


def test_a_link_holds_the_press_to_the_last_bit():
    state = PressState(
        "random-17", 1 / 3, -2.1, 123.45678901234567, 0.1 + 0.2, None, "cyskin-63", None, "all", 5
    )
    assert read_query(state.query()) == state
    assert read_query("") == PressState()


@pytest.mark.parametrize(
    "query, words",
    [
        ("shape=/etc/passwd.stl", "no shape"),
        ("shape=square-9", "no shape"),
        ("shape=random-x", "random-x"),
        ("layout=/etc/passwd.csv", "no taxel layout"),
        ("imperfections=some", "imperfections"),
        ("source=/etc/passwd.toml", "no source"),
        ("target=none", "no target"),
        ("x_mm=nan", "finite"),
        ("force_n=1e9", "0.01 to 100 N"),
        ("depth_mm=deep", "depth_mm"),
        ("seed=-1", "seed"),
        ("shape=" + "x" * 5000, "longer"),
    ],
)
def test_a_link_that_no_page_made_is_refused(query, words):
    with pytest.raises(T2TwinError, match=words):
        read_query(query)


def test_a_link_holds_no_files():
    with pytest.raises(T2TwinError, match=r"my.stl"):
        PressState("/tmp/x/my.stl").query()


def test_presses_of_the_protocol_are_found_by_their_number(shapes):
    index = indices("square-2", scale_of("small"))[5]
    command = press_at(shapes("square-2"), index)
    state = protocol_press(PressState("square-2", force_n=3.0), "small", 5)
    assert (state.x_mm, state.y_mm, state.force_n) == (command.x_mm, command.y_mm, 8.0)
    assert np.deg2rad(state.yaw_deg) == pytest.approx(command.yaw_rad)
    with pytest.raises(T2TwinError, match="0 to 31"):
        protocol_press(PressState("square-2"), "small", 32)
    with pytest.raises(T2TwinError, match="not a shape of the protocol"):
        protocol_press(PressState("random-3"), "small", 0)


# Looks


def test_a_look_is_what_the_twin_gives(result):
    touch = t2twin.press(SHAPE, x_mm=1.5, yaw_deg=30.0, force_n=5.0)
    assert np.array_equal(result.touch.image, touch.image)
    assert np.array_equal(result.touch.counts, touch.counts)
    assert np.array_equal(result.touch.tactile_image, touch.tactile_image)


def test_noise_and_layout_are_those_of_the_twin(session):
    state = PressState(SHAPE, seed=3, imperfections="all", layout="cyskin-63")
    twin = t2twin.Twin(layout="cyskin-63", imperfections="all")
    touch = twin.press(SHAPE, seed=3)
    seen = session.press(state)
    assert np.array_equal(seen.touch.counts, touch.counts)
    assert np.array_equal(seen.touch.image, touch.image)
    assert np.array_equal(session.press(replace(state, seed=None)).touch.counts,
                          t2twin.Twin(layout="cyskin-63").press(SHAPE).counts)  # fmt: skip


def test_what_cannot_be_pressed_says_what_the_command_says(session, capsys):
    with pytest.raises(T2TwinError) as refused:
        session.press(PressState(SHAPE, x_mm=60.0))
    with pytest.raises(SystemExit):
        main(["press", SHAPE, "--x-mm", "60"])
    assert capsys.readouterr().err == f"t2twin: {refused.value}\n"


def test_a_layout_on_a_line_has_counts_and_no_tactile_image(session, tmp_path):
    file = tmp_path / "line.csv"
    file.write_text("x_mm,y_mm\n0,-5\n0,0\n0,5\n")
    seen = session.press(PressState(SHAPE, layout=str(file)))
    with pytest.raises(T2TwinError, match="line") as no_image:
        _ = seen.touch.tactile_image
    assert str(no_image.value) in cards.press_html(seen, cards.scales_of(seen), has_runs=True)


# Sensors


def test_the_first_shape_lies_in_the_image(session):
    touch = session.press(PressState()).touch
    pressed = touch.digit.pressure_kpa > 0
    half_x, half_y = touch.of_camera.sensor.camera.seen_half_extent_mm()
    assert np.abs(touch.digit.x_mm[pressed.any(axis=0)]).max() < half_x - 1.0
    assert np.abs(touch.digit.y_mm[pressed.any(axis=1)]).max() < half_y - 1.0


def test_any_two_sensors_are_pressed(tmp_path):
    own, file = Session(Translators()), tmp_path / "soft.toml"
    file.write_text('extends = "digit"\nname = "soft"\n[gel]\nyoung_mpa = 0.1\n')
    arrays = PressState(SHAPE, source="cyskin-63")
    for state in (arrays, PressState(SHAPE, target=str(file))):
        seen = own.press(state)
        touch = t2twin.Twin(source=state.source, target=state.target).press(SHAPE)
        assert list(seen.touch.readings) == list(touch.readings)
        for name in touch.readings:
            assert seen.touch.contacts[name].depth_mm == touch.contacts[name].depth_mm
        page = cards.press_html(seen, cards.scales_of(seen), has_runs=True)
        assert all(f'data-name="{name}"' in page for name in touch.readings)
    assert read_query(arrays.query()) == arrays


def test_another_sensor_begins_with_its_own_options():
    state = PressState(layout="cyskin-63", markers=True, imperfections="all", seed=1)
    other = state.with_changes({"source": "cyskin-63"})
    assert other == PressState(source="cyskin-63", seed=1)
    assert not replace(other, motion="slide").continues(replace(state, motion="slide"))


@pytest.mark.parametrize(
    "text, words",
    [
        ("extends = 5", "extends"),
        ('extends = "../digit.toml"', "names the file"),
        ('extends = "digit"\nname = "x"\n[light]\noptics = "/etc/passwd"', "names the file"),
        ('extends = "cyskin-20"\nname = "x"\n[layout]\nfile = "a.csv"', "names the file"),
        ('extends = "cyskin-20"\nname = "x"\n[layout]\nfile = "/etc/passwd"', "names the file"),
        ("kind = ", "not TOML"),
        ("light = 3", "kind is missing"),
    ],
)
def test_an_uploaded_sensor_is_checked_and_reads_no_files_of_this_machine(text, words, tmp_path):
    (tmp_path / "mine.toml").write_text(text)
    with pytest.raises(T2TwinError, match=words):
        files.check_sensor(tmp_path / "mine.toml")


# Translators


def test_runs_are_found_and_their_errors_are_known(untrained_runs, tmp_path):
    translators = Translators()
    folders = {folder.name: folder for folder in untrained_runs}
    translators.search(untrained_runs, tmp_path)
    assert len(translators.names) == 3 and translators.default_names == translators.names
    assert translators.names[0] == DEFAULT_RUN
    own = Session(translators)
    seen = own.press(PressState(SHAPE), translators.default_names[1:])
    for each in seen.translations:
        run = t2twin.load(folders[each.model])
        assert np.allclose(each.counts, run.predict(seen.touch.image), atol=0.5)
        off = each.counts - seen.touch.counts
        assert each.rmse_counts == pytest.approx(np.sqrt(np.mean(off**2)))
    page = cards.press_html(seen, cards.scales_of(seen), has_runs=True)
    assert "ResNet18" in page and (page.count("<img"), page.count("<svg")) == (4, 2)


def test_the_truth_of_another_layout_is_that_at_the_runs_own_taxels(untrained_runs):
    translators = Translators()
    translators.search([untrained_runs[1]], NOWHERE)
    seen = Session(translators).press(
        PressState(SHAPE, layout="cyskin-63"), translators.default_names[1:]
    )
    truth = seen.translations[0].truth
    assert truth is not None
    assert np.rint(truth).astype(int).tolist() == t2twin.press(SHAPE).counts.tolist()


def test_a_run_is_loaded_apart_from_its_first_use(untrained_runs):
    translators = Translators()
    assert not translators.is_searched
    translators.search([untrained_runs[0]], NOWHERE)
    assert translators.is_searched and not translators.are_loaded(translators.default_names)
    translators.load(translators.default_names)
    assert translators.are_loaded(translators.default_names)
    with pytest.raises(T2TwinError, match="no run"):
        translators.load(["x"])


def test_what_is_to_come_is_said_until_it_has(result):
    said = {
        (known, come): cards.press_html(result, cards.scales_of(result), known, come)
        for known in (False, True) for come in (False, True)
    }  # fmt: skip
    assert all((cards.LOADING in page) == come for (_, come), page in said.items())
    assert [key for key, page in said.items() if TRAIN_COMMAND in page] == [(False, False)]


def test_runs_are_found_below_a_folder(untrained_runs, tmp_path):
    for model, folder in zip(("resnet18", "touch2touch"), sorted(untrained_runs), strict=True):
        shutil.copytree(folder, tmp_path / "a" / model)
    shutil.copytree(tmp_path / "a/resnet18", tmp_path / "b/newer")
    (tmp_path / "b/damaged").mkdir()
    (tmp_path / "b/damaged/config.json").write_text("{")
    translators = Translators()
    translators.search(below=tmp_path)
    assert set(translators.names) == {DEFAULT_RUN, "a/resnet18", "a/touch2touch", "b/newer"}
    assert len(translators.default_names) == 3 and "a/touch2touch" in translators.default_names
    assert translators.default_names[0] == DEFAULT_RUN


def test_a_folder_that_is_no_run_is_refused(tmp_path):
    with pytest.raises(T2TwinError, match=r"config\.json"):
        Translators().search([tmp_path])
    translators = Translators()
    translators.search(below=tmp_path)
    assert translators.names == (DEFAULT_RUN,)
    with pytest.raises(T2TwinError, match="no run"):
        translators.translate(np.zeros((320, 240, 3), np.uint8), ["x"])


@pytest.fixture(scope="module")
def pretrained(session):
    """A press and what the pretrained run predicts of it."""
    translators = Translators()
    translators.search(below=NOWHERE)
    return Session(translators).press(PressState(SHAPE, force_n=6.0), translators.default_names)


def test_the_pretrained_run_gives_intervals_and_the_force(pretrained):
    (translation,) = pretrained.translations
    background = SensorPair().camera.background_frame()
    estimate = t2twin.load(DEFAULT_RUN).estimate(pretrained.touch.image, background)
    assert np.allclose(translation.counts, estimate.counts, atol=0.5)
    for end, same in zip(translation.interval, estimate.interval(LEVEL), strict=True):
        assert np.allclose(end, same, atol=0.5)
    value, low, high = translation.force
    assert estimate.force_n is not None
    assert value == pytest.approx(estimate.force_n.item(), abs=1e-3)
    assert low < value < high
    assert translation.background_used and 10 < translation.covered <= 20


def test_another_array_has_no_true_counts_for_a_run(pretrained):
    translators = Translators()
    translators.search(below=NOWHERE)
    for target in ("flexitac", "digit"):
        state = PressState(SHAPE, force_n=6.0, target=target)
        seen = Session(translators).press(state, translators.default_names)
        (translation,) = seen.translations
        assert translation.truth is None
        assert np.array_equal(translation.counts, pretrained.translations[0].counts)
        assert "RMSE" not in cards.press_html(seen, cards.scales_of(seen), has_runs=True)


def test_intervals_and_force_are_on_the_card(pretrained):
    (translation,) = pretrained.translations
    page = cards.press_html(pretrained, cards.scales_of(pretrained), has_runs=True)
    for low, high in zip(*translation.interval, strict=True):
        assert f"interval {low:,.0f} to {high:,.0f}" in page
    _, low, high = translation.force
    assert f"{low:.1f} to {high:.1f}" in page and "<td>6.00</td>" in page
    assert f"{translation.covered} of 20 taxels" in page
    assert page.count('data-name="intervals"') == 1


def test_a_run_without_intervals_has_a_card_without_them(untrained_runs):
    translators = Translators()
    translators.search(untrained_runs, NOWHERE)
    seen = Session(translators).press(PressState(SHAPE), translators.default_names[1:])
    page = cards.press_html(seen, cards.scales_of(seen), has_runs=True)
    assert 'data-name="intervals"' not in page and "interval" not in page


def test_a_frame_is_compared_with_a_background_frame(pretrained):
    translators = Translators()
    translators.search(below=NOWHERE)
    background = SensorPair().camera.background_frame()
    without, with_background = (
        translators.translate(pretrained.touch.image, translators.default_names, frame)
        for frame in (None, background)
    )
    assert with_background[0].background_used and not without[0].background_used
    assert np.array_equal(with_background[0].counts, pretrained.translations[0].counts)
    assert not np.array_equal(without[0].counts, with_background[0].counts)
    page = cards.frame_html((background, "a.png"), (background, "<b>.png"), with_background)
    assert (
        'data-name="background"' in page
        and "&lt;b&gt;.png" in page
        and cards.BACKGROUND_USED in page
    )


# What is drawn


def test_colors_go_from_one_end_of_the_map_to_the_other():
    table = color_table()
    assert np.array_equal(color_values(np.array([0.0, 5.0, 9.0]), 5.0), table[[0, 255, 255]])


@pytest.mark.parametrize(
    "largest, end", [(0.0, 100.0), (101.0, 120.0), (8_001, 10_000), (346, 400)]
)
def test_a_bar_ends_at_a_number_that_can_be_read(largest, end):
    assert cards.nice_end(largest, 100.0) == pytest.approx(end)


def test_the_drawn_surface_is_the_contact_s(result):
    part = solids.elastomer_part(result.touch.digit, 400.0)
    contact = result.touch.digit
    x, y = np.meshgrid(contact.x_mm, contact.y_mm)
    top = part.vertices[: x.size]
    assert np.allclose(
        top[:, 2], (contact.elastomer.rest_surface_mm(x, y) - contact.surface_mm).ravel()
    )
    scene = trimesh.load(io.BytesIO(solids.as_glb([part])), file_type="glb")
    assert isinstance(scene, trimesh.Scene)
    mesh = scene.to_mesh()
    assert np.allclose(
        mesh.bounds, [part.vertices.min(axis=0), part.vertices.max(axis=0)], atol=1e-4
    )


def test_the_drawn_shape_touches_the_surface(result):
    """In its pose the solid's lowest point is where the contact says."""
    turn, place = result.touch.digit.shape_pose
    mesh = solids.near_mesh(result.touch.shape).copy()
    mesh.apply_transform(trimesh.transformations.quaternion_matrix(turn))
    assert (mesh.vertices[:, 2] + place[2]).min() == pytest.approx(
        -result.touch.digit.shape_depth_mm, abs=1e-3
    )


def test_a_cut_leaves_the_half_behind(result):
    half = solids.cut_open(solids.near_mesh(result.touch.shape), result.touch.command).copy()
    turn, _ = result.touch.digit.shape_pose
    half.apply_transform(trimesh.transformations.quaternion_matrix(turn))
    assert half.bounds[0][1] == pytest.approx(0.0, abs=1e-6) and half.bounds[1][1] > 1.0


def test_what_a_user_names_is_escaped(result):
    state = replace(result.state, shape="/tmp/<img src=x onerror=alert(1)>.stl")
    page = cards.press_html(replace(result, state=state), cards.scales_of(result), has_runs=False)
    assert "onerror" not in page


# Files


def test_a_file_keeps_a_harmless_name_in_its_own_folder(tmp_path):
    path = files.save_upload("shape", "../../e vil$.STL", b"x", tmp_path)
    assert path.read_bytes() == b"x" and path.name == "e_vil.stl"
    assert path.resolve().is_relative_to(tmp_path)
    again = files.save_upload("shape", "..\\..\\$.stl", b"y", tmp_path)
    assert again.read_bytes() == b"y" and again.resolve().is_relative_to(tmp_path)
    files.remove_uploads("shape", tmp_path, all_but=[again])
    assert again.exists() and not path.exists()


@pytest.mark.parametrize(
    "kind, name, size, words",
    [
        ("shape", "a.exe", 3, r"\.stl"),
        ("frame", "a.npz", 3, r"\.png"),
        ("optics", "a.pkl", 3, r"\.npz"),
        ("layout", "", 3, r"\.csv"),
        ("shape", "a.stl", files.MAX_BYTES + 1, "64 MB"),
    ],
)
def test_a_file_of_another_kind_or_too_large_is_refused(kind, name, size, words, tmp_path):
    with pytest.raises(T2TwinError, match=words):
        files.save_upload(kind, name, bytes(size), tmp_path)
    assert list(tmp_path.iterdir()) == []


def test_taken_away_it_is_the_folder_that_press_writes(result, tmp_path):
    (tmp_path / "zip").mkdir()
    name, content = zip_press(result, tmp_path / "zip")
    assert name == f"{SHAPE}.zip"
    with zipfile.ZipFile(io.BytesIO(content)) as archive:
        archive.extractall(tmp_path / "out")
    main([*result.state.command_line().split()[1:], "--out", str(tmp_path / "press")])
    taken = {path.name: path for path in (tmp_path / "out" / SHAPE).iterdir()}
    assert taken.pop(COMMAND_FILE).read_text().strip() == result.state.command_line()
    made = {path.name: path for path in (tmp_path / "press").iterdir()}
    assert set(taken) == set(made)
    for file in ("digit.png", "cyskin-20.json", "tactile_image.png", "tactile_picture.png"):
        assert taken[file].read_bytes() == made[file].read_bytes()


def test_no_path_of_this_machine_is_taken_away(session, result, tmp_path):
    shutil.copy(SPECS / "digit.npz", tmp_path / "mine.npz")
    seen = session.press(replace(result.state, optics=str(tmp_path / "mine.npz")))
    _, content = zip_press(seen, tmp_path)
    with zipfile.ZipFile(io.BytesIO(content)) as archive:
        summary = archive.read(f"{SHAPE}/press.json").decode()
    assert json.loads(summary)["digit"]["optics"] == "mine.npz"
    assert str(tmp_path) not in summary
