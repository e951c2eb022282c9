"""The studio's page in a real browser."""

import io
import os
import signal
import subprocess
import sys
import zipfile

import numpy as np
import pytest
import trimesh
from browser import PATIENCE_MS, browser, canvas, chromium, picture
from PIL import Image
from waiting import wait_until

import t2twin
from t2twin.cli import main
from t2twin.studio.server import studio
from t2twin.studio.session import PressState

SHAPE = "hemisphere-4"
STATE = PressState(SHAPE, x_mm=1.5, yaw_deg=30.0, force_n=5.0)
SIZE = {"width": 1120, "height": 720}

OPEN_MS = 300_000
"""Longest wait for the first image, ms: the studio may have to compile."""


@pytest.fixture(scope="module")
def chrome():
    with browser(viewport=SIZE) as chrome:
        yield chrome


@pytest.fixture(scope="module")
def served(untrained_runs):
    chromium()
    with studio(untrained_runs, port=0) as served:
        yield served


@pytest.fixture(scope="module")
def opened(chrome, served):
    """Opens a page: the browser's, and the studio's."""

    def open_page():
        known = set(served.pages)
        tab = chrome.new_page()
        tab.set_default_timeout(PATIENCE_MS)
        tab.asked = []
        tab.on("request", lambda request: tab.asked.append(request.url))
        tab.goto(served.address)
        first = 'img[data-name="translated"]'
        tab.wait_for_selector(first, state="attached", timeout=OPEN_MS)
        return tab, served.pages[next(iter(set(served.pages) - known))]

    return open_page


@pytest.fixture(scope="module")
def one_tab(opened):
    return opened()


@pytest.fixture
def desk(one_tab):
    """A page which several tests use in turn, each from STATE on."""
    tab, page = one_tab
    tab.get_by_text("Images", exact=True).click()
    page.controls.apply(vars(STATE))
    shown(tab, page)
    return tab, page


def shown(tab, page):
    """Waits until the browser shows the latest state."""
    wait_until(lambda: page.is_idle)
    wait_until(lambda: counts_on(tab) == page.result.touch.counts.tolist())


def counts_on(tab):
    return [int(count) for count in tab.locator("code.counts").inner_text().split()]


def set_slider(tab, page, field, value):
    uuid = page.controls.handles[field]._impl.uuid
    number = tab.locator(f'[id="{uuid}"]').locator("xpath=..").locator("input[type=text]")
    number.fill(str(value))
    number.press("Enter")
    wait_until(lambda: getattr(page.state, field) == value)
    shown(tab, page)


def upload(tab, button, path):
    tab.locator(f'[id="file_upload_{button._impl.uuid}"]').set_input_files(path)


def test_the_page_shows_what_press_gives(desk, served):
    tab, page = desk
    touch = t2twin.press(SHAPE, x_mm=1.5, yaw_deg=30.0, force_n=5.0)
    assert np.array_equal(picture(tab, "digit"), touch.image)
    assert counts_on(tab) == touch.counts.tolist()
    wait_until(lambda: tab.locator('img[data-name="translated"]').count() == 3)
    text = tab.locator("body").inner_text()
    for translation in page.result.translations:
        assert f"RMSE {translation.rmse_counts:,.0f} counts" in text
    allowed = (served.address, "data:", f"blob:{served.address}")
    assert [url for url in tab.asked if not url.startswith(allowed)] == []
    assert tab.evaluate("document.documentElement.scrollWidth") <= SIZE["width"]


def test_the_scene_and_the_images_follow_the_slider(desk):
    tab, page = desk
    # The browser loads the meshes after the pictures; a blank canvas has few colors.
    wait_until(lambda: len(np.unique(canvas(tab).reshape(-1, 3), axis=0)) > 500)
    before = canvas(tab).astype(int)
    set_slider(tab, page, "force_n", 12)
    wait_until(lambda: (np.abs(canvas(tab) - before).max(axis=2) > 20).sum() > 300)
    touch = t2twin.press(SHAPE, x_mm=1.5, yaw_deg=30.0, force_n=12.0)
    assert np.array_equal(picture(tab, "digit"), touch.image)
    set_slider(tab, page, "depth_mm", 0.5)
    wait_until(lambda: page.controls.handles["force_n"].value == page.result.touch.command.force_n)


def test_the_shape_is_dragged_in_the_scene(desk):
    tab, page = desk
    page.controls.apply(vars(PressState("circle-4")))
    shown(tab, page)
    box = tab.locator("canvas").first.bounding_box()
    x, y = box["x"] + 0.245 * box["width"], box["y"] + 0.45 * box["height"]
    wait_until(lambda: len(np.unique(canvas(tab).reshape(-1, 3), axis=0)) > 500)
    tab.mouse.move(x, y)
    tab.mouse.down()
    for step in range(1, 9):
        tab.mouse.move(x + 4 * step, y)
        tab.wait_for_timeout(100)  # viser sends drags at a rate of its own
    wait_until(lambda: page.state.x_mm > 1.0)
    tab.mouse.up()
    shown(tab, page)
    assert 1.0 < page.state.x_mm < 8.0 and abs(page.state.y_mm) < 1.0


def test_a_page_slides_and_lifts_off(desk):
    tab, page = desk
    page.controls.apply({"x_mm": 0.0, "motion": "slide", "friction": 0.5})
    shown(tab, page)
    set_slider(tab, page, "x_mm", 1.2)
    wait_until(lambda: not any(page.result.remaining))
    twin = t2twin.Twin()
    start = twin.press(SHAPE, yaw_deg=30.0, force_n=5.0)
    (touch,) = twin.slide(start, dx_mm=1.2, steps=1, friction=0.5)
    shear_n = page.result.touch.digit.shear_n
    assert shear_n == pytest.approx(touch.digit.shear_n, rel=1e-6, abs=1e-9)
    wait_until(lambda: tab.locator('img[data-name="slide"]').count())
    tab.get_by_text("Lift off and press again").click()
    wait_until(lambda: not page.result.has_slid)
    assert page.result.touch.digit.shear_n.tolist() == [0.0, 0.0]


def test_each_client_has_its_own_press(desk, opened):
    tab, page = desk
    other_tab, other = opened()
    set_slider(other_tab, other, "force_n", 3)
    assert (page.state, other.state.force_n) == (STATE, 3.0)
    assert counts_on(tab) == page.result.touch.counts.tolist() != counts_on(other_tab)
    known = other.folder
    assert known.exists()
    other_tab.close()
    wait_until(lambda: not known.exists())


def test_own_files_are_pressed_and_a_bad_one_is_refused_as_by_the_command(desk, tmp_path, capsys):
    tab, page = desk
    (tmp_path / "bad.stl").write_text("no solid")
    upload(tab, page.controls.upload, tmp_path / "bad.stl")
    with pytest.raises(SystemExit):
        main(["press", str(tmp_path / "bad.stl")])
    sentence = capsys.readouterr().err.partition("bad.stl")[2].strip()
    wait_until(lambda: sentence in tab.locator("body").inner_text())
    assert tab.get_by_text("Not possible").count() == 1 and page.state == STATE
    trimesh.creation.icosphere(subdivisions=3, radius=6.0).export(tmp_path / "my ball.stl")
    (tmp_path / "taxels.csv").write_text("x_mm,y_mm\n-5,-5\n5,-5\n0,5\n")
    (tmp_path / "soft.toml").write_text('extends = "cyskin-20"\nname = "soft"\n')
    for name, field in (
        ("my ball.stl", "shape"),
        ("soft.toml", "target"),
        ("taxels.csv", "layout"),
    ):
        upload(tab, page.controls.upload, tmp_path / name)
        wait_until(lambda name=name, field=field: str(getattr(page.state, field)).endswith(name))
    shown(tab, page)
    twin = t2twin.Twin(target=tmp_path / "soft.toml", layout=tmp_path / "taxels.csv")
    touch = twin.press(tmp_path / "my ball.stl", x_mm=1.5, yaw_deg=30.0, force_n=5.0)
    assert counts_on(tab) == touch.counts.tolist()
    wait_until(lambda: tab.get_by_text("Not possible").count() == 0)


def test_a_press_is_downloaded(desk):
    tab, page = desk
    tab.get_by_text("Export", exact=True).first.click()
    tab.get_by_text(page.result.command_line()).wait_for()
    with tab.expect_download() as waited:
        tab.get_by_text("Download this press (zip)").click()
    with zipfile.ZipFile(waited.value.path()) as archive:
        assert waited.value.suggested_filename == f"{SHAPE}.zip"
        with Image.open(io.BytesIO(archive.read(f"{SHAPE}/digit.png"))) as image:
            assert np.array_equal(np.asarray(image), page.result.touch.image)


def test_an_own_frame_is_translated(desk, untrained_runs, tmp_path):
    tab, page = desk
    Image.fromarray(page.result.touch.image).save(tmp_path / "mine.png")
    tab.get_by_text("Translate", exact=True).click()
    upload(tab, page.tab.upload, tmp_path / "mine.png")
    counts = t2twin.load(untrained_runs[0]).predict(page.result.touch.image)
    listed = " ".join(str(count) for count in np.rint(counts).astype(int))
    wait_until(lambda: listed in tab.locator("body").inner_text())
    assert "mine.png" in tab.locator("body").inner_text()


def test_the_source_of_the_studio_is_shown(untrained_runs, chrome, tmp_path):
    for number, grey in enumerate((50, 120, 200)):
        Image.new("RGB", (240, 320), (grey,) * 3).save(tmp_path / f"{number}.png")
    with studio(untrained_runs, port=0, source=str(tmp_path)) as own:
        tab = chrome.new_page()
        tab.goto(own.address)
        tab.get_by_text("Translate", exact=True).click(timeout=PATIENCE_MS)
        tab.get_by_text(f"Live: {tmp_path.name}").click()
        frame = tab.locator('img[data-name="frame"]')
        wait_until(lambda: frame.count() and (picture(tab, "frame") == 200).all())
        Image.new("RGB", (240, 320), (90, 90, 90)).save(tmp_path / "3.png")
        wait_until(lambda: (picture(tab, "frame") == 90).all())
        tab.close()


def test_ctrl_c_ends_the_command_and_leaves_nothing(tmp_path):
    process = subprocess.Popen(
        [sys.executable, "-m", "t2twin", "studio", "--port", "0"],
        cwd=tmp_path, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
        env=os.environ | {"TMPDIR": str(tmp_path)},
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),
    )  # fmt: skip
    assert process.stdout is not None
    assert process.stdout.readline().startswith("open http://127.0.0.1:")
    process.send_signal(signal.SIGINT)
    said = process.communicate(timeout=PATIENCE_MS / 1000)[1]
    assert process.returncode == 128 + signal.SIGINT
    assert said == "t2twin: stopped; the same command begins again\n"
    assert list(tmp_path.iterdir()) == []
