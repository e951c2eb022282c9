"""The studio's page in a real browser."""

import io
import json
import signal
import subprocess
import sys
import tempfile
import zipfile
from pathlib import Path

import numpy as np
import pytest
import trimesh
from browser import PATIENCE_MS, browser, canvas, chromium, free_port, picture
from PIL import Image
from t2twin.studio.files import MAX_BYTES
from t2twin.studio.press_state import PressState
from waiting import wait_until

import t2twin
from benchmarks.timing.studio_events import act
from t2twin.cli import main
from t2twin.studio.server import FOLDER, studio

SHAPE = "hemisphere-4"
STATE = PressState(SHAPE, x_mm=1.5, yaw_deg=30.0, force_n=5.0)
BLOCK = 20
MAX_GREYS_OFF = 24
SETTLED_AFTER = 2
SMALLEST_PX = 9
WIDE, PHONE = {"width": 1120, "height": 720}, {"width": 420, "height": 860}


@pytest.fixture(scope="module")
def served(untrained_runs):
    chromium()
    with studio(untrained_runs, port=free_port()) as served:
        yield served


@pytest.fixture(scope="module")
def chrome():
    with browser() as chrome:
        yield chrome


@pytest.fixture(scope="module")
def opened(chrome, served):
    """Opens the page on a press; waits until it shows it. Gives the browser's page, and the
    studio's."""

    def open_page(state=STATE, size=WIDE):
        known = set(served.pages)
        tab = chrome.new_page(viewport=size)
        tab.set_default_timeout(PATIENCE_MS)
        tab.asked = []
        tab.on("request", lambda request: tab.asked.append(request.url))
        tab.goto(served.link(state))
        tab.wait_for_selector('img[data-name="digit"]', state="attached")
        page = served.pages[next(iter(set(served.pages) - known))]
        drawn(tab, page)
        return tab, page

    return open_page


@pytest.fixture(scope="module")
def one_tab(opened):
    return opened()


@pytest.fixture
def desk(one_tab):
    """A page on a desk's screen, which several tests use in turn, each from STATE on."""
    tab, page = one_tab
    tab.get_by_text("Images", exact=True).click()
    if page.state != STATE:
        page.controls.apply(vars(STATE))
    drawn(tab, page)
    return tab, page


def drawn(tab, page):
    """Waits until the browser shows the page's newest state."""
    assert page.wait(60)
    wait_until(lambda: counts_on(tab) == page.result.touch.counts.tolist())
    settled(tab)  # the scene is drawn after the pictures


def settled(tab):
    """Waits until the scene no longer changes: the browser loads meshes and textures one by one.
    Gives the scene, (h, w, 3) uint8."""
    seen = [canvas(tab)]

    def unchanged():
        frames(tab)
        seen.append(canvas(tab))
        return len(seen) > SETTLED_AFTER and all(
            alike(seen[-1], seen[-1 - back]) for back in range(1, SETTLED_AFTER + 1)
        )

    wait_until(unchanged)
    return seen[-1]


def frames(tab, number=5):
    """Waits until the browser has drawn so many frames."""
    tab.evaluate(
        "(n) => new Promise((done) => { const next = () => "
        "n-- ? requestAnimationFrame(next) : done(); next(); })",
        number,
    )


def set_slider(tab, page, field, value):
    uuid = page.controls.sliders[field]._impl.uuid
    number = tab.locator(f'[id="{uuid}"]').locator("xpath=..").locator("input[type=text]")
    number.fill(str(value))
    number.press("Enter")
    wait_until(lambda: getattr(page.state, field) == value)
    drawn(tab, page)


def upload(tab, button, *paths):
    tab.locator(f'[id="file_upload_{button._impl.uuid}"]').set_input_files(list(paths))


def open_folder(tab, name):
    tab.get_by_text(name, exact=True).first.click()
    frames(tab)


def counts_on(tab):
    return [int(count) for count in tab.locator("code.counts").inner_text().split()]


def coarse(pixels):
    """Means over blocks: viser draws edges finer or coarser as it has time."""
    rows, columns = (size // BLOCK * BLOCK for size in pixels.shape[:2])
    blocks = pixels[:rows, :columns].reshape(rows // BLOCK, BLOCK, columns // BLOCK, BLOCK, 3)
    return blocks.mean(axis=(1, 3))


def alike(one, other):
    """Whether two pictures of the scene show the same."""
    return np.abs(coarse(one) - coarse(other)).max() < MAX_GREYS_OFF


def test_the_page_shows_what_press_gives(desk, tmp_path):
    tab, page = desk
    main([*STATE.command_line().split()[1:], "--out", str(tmp_path / "out")])
    with Image.open(tmp_path / "out/digit.png") as image:
        assert np.array_equal(picture(tab, "digit"), np.asarray(image))
    assert counts_on(tab) == json.loads((tmp_path / "out/cyskin-20.json").read_text())["counts"]
    assert page.state == STATE


def test_the_page_asks_for_nothing_from_elsewhere(desk, served):
    allowed = (served.address, "data:", f"blob:{served.address}")
    assert [url for url in desk[0].asked if not url.startswith(allowed)] == []


def test_the_scene_follows_the_slider(desk):
    tab, page = desk
    before, seen = settled(tab), picture(tab, "digit")
    assert len(np.unique(before.reshape(-1, 3), axis=0)) > 500  # and no blank canvas
    set_slider(tab, page, "force_n", 12)
    assert page.state.force_n == 12.0
    moved = np.abs(canvas(tab).astype(int) - before).max(axis=2) > 20
    assert moved.sum() > 300
    touch = t2twin.press(SHAPE, x_mm=1.5, yaw_deg=30.0, force_n=12.0)
    assert np.array_equal(picture(tab, "digit"), touch.image)
    assert counts_on(tab) == touch.counts.tolist()
    set_slider(tab, page, "force_n", 5)
    assert np.array_equal(picture(tab, "digit"), seen)
    wait_until(lambda: alike(canvas(tab), before))


def test_each_translator_has_its_picture_and_error(desk):
    tab, page = desk
    assert tab.locator('img[data-name="translated"]').count() == 3
    for translation in page.result.translations:
        assert f"RMSE {translation.rmse_counts:,.0f} counts" in tab.locator("body").inner_text()


def test_the_shape_is_dragged_in_the_scene(desk):
    tab, page = desk
    page.controls.apply(vars(PressState("circle-4")))
    drawn(tab, page)
    box = tab.locator("canvas").first.bounding_box()
    x, y = box["x"] + 0.245 * box["width"], box["y"] + 0.45 * box["height"]
    tab.mouse.move(x, y)
    tab.mouse.down()
    for step in range(1, 9):
        tab.mouse.move(x + 4 * step, y)
        frames(tab, 4)  # viser sends drags at a rate of its own
    wait_until(lambda: page.state.x_mm > 1.0)
    tab.mouse.up()
    drawn(tab, page)
    assert 1.0 < page.state.x_mm < 8.0 and abs(page.state.y_mm) < 1.0
    touch = t2twin.press("circle-4", x_mm=page.state.x_mm, y_mm=page.state.y_mm)
    assert counts_on(tab) == touch.counts.tolist()


def test_on_a_phone_all_of_it_fits_and_each_client_has_its_own_press(desk, opened):
    tab, page = desk
    other_tab, other = opened(PressState("circle-1"), PHONE)
    fits(other_tab, PHONE)
    set_slider(other_tab, other, "force_n", 3)
    assert (page.state, other.state.force_n) == (STATE, 3.0)
    assert counts_on(tab) == page.result.touch.counts.tolist()
    assert counts_on(other_tab) == other.result.touch.counts.tolist()
    known = other.files.folder
    assert known.exists()
    other_tab.close()
    wait_until(lambda: not known.exists())


def test_a_file_is_pressed_and_a_bad_one_is_refused_as_by_the_command(desk, tmp_path, capsys):
    tab, page = desk
    (tmp_path / "bad.stl").write_text("no solid")
    upload(tab, page.controls.uploads["shape"], tmp_path / "bad.stl")
    with pytest.raises(SystemExit):
        main(["press", str(tmp_path / "bad.stl")])
    sentence = capsys.readouterr().err.removeprefix("t2twin: ").strip()
    sentence = sentence.replace(str(tmp_path / "bad.stl"), "bad.stl")
    wait_until(lambda: sentence in tab.locator("body").inner_text())
    assert tab.get_by_text("Not possible").count()
    assert page.state == STATE
    trimesh.creation.icosphere(subdivisions=3, radius=6.0).export(tmp_path / "my ball.stl")
    upload(tab, page.controls.uploads["shape"], tmp_path / "my ball.stl")
    wait_until(lambda: page.state.shape.endswith("my_ball.stl"))
    drawn(tab, page)
    touch = t2twin.press(tmp_path / "my ball.stl", x_mm=1.5, yaw_deg=30.0, force_n=5.0)
    assert counts_on(tab) == touch.counts.tolist()
    wait_until(lambda: tab.get_by_text("Not possible").count() == 0)


def test_a_file_that_is_too_large_is_dropped_as_it_comes(desk, tmp_path):
    tab, page = desk
    with (tmp_path / "large.stl").open("wb") as file:
        file.truncate(MAX_BYTES + 1)
    upload(tab, page.controls.uploads["shape"], tmp_path / "large.stl")
    tab.get_by_text("at most 64 MB are allowed").wait_for()
    assert page._client.gui._current_file_upload_states == {}
    assert page.state == STATE


def test_a_press_is_downloaded(desk):
    tab, page = desk
    open_folder(tab, "Export")
    assert page.state.command_line() in tab.locator("body").inner_text()
    with tab.expect_download() as waited:
        tab.get_by_text("Download this press (zip)").click()
    with zipfile.ZipFile(waited.value.path()) as archive:
        assert waited.value.suggested_filename == f"{SHAPE}.zip"
        with Image.open(io.BytesIO(archive.read(f"{SHAPE}/digit.png"))) as image:
            assert np.array_equal(np.asarray(image), page.result.touch.image)


def test_a_frame_of_ones_own_is_translated(desk, untrained_runs, tmp_path):
    tab, page = desk
    Image.fromarray(page.result.touch.image).save(tmp_path / "mine.png")
    tab.get_by_text("Translate", exact=True).click()
    upload(tab, page._tab.uploads["frame"], tmp_path / "mine.png")
    counts = t2twin.load(untrained_runs[0]).predict(page.result.touch.image)
    listed = " ".join(str(count) for count in np.rint(counts).astype(int))
    wait_until(lambda: listed in tab.locator("body").inner_text())
    assert "mine.png" in tab.locator("body").inner_text()


def test_dark_is_dark(desk):
    tab, _ = desk
    open_folder(tab, "View")
    tab.get_by_text("Dark", exact=True).click()
    wait_until(lambda: np.median(canvas(tab)) < 60)
    tab.get_by_text("Dark", exact=True).click()
    wait_until(lambda: np.median(canvas(tab)) > 200)


def test_on_a_desk_all_of_it_fits(desk):
    fits(desk[0], WIDE)


def fits(tab, size):
    """Fails where something is wider than the screen, or too small to be read."""
    assert tab.evaluate("document.documentElement.scrollWidth") <= size["width"]
    for name in ("digit", "cyskin-20", "translated"):
        tab.locator(f'img[data-name="{name}"]').first.scroll_into_view_if_needed()
        box = tab.locator(f'img[data-name="{name}"]').first.bounding_box()
        assert box["width"] >= 100 and 0 <= box["x"] <= size["width"] - box["width"]
        assert 1.2 < box["height"] / box["width"] < 1.8
    small = tab.evaluate(
        "[...document.querySelectorAll('.t2 *')].filter(e => e.children.length === 0 &&"
        " e.textContent.trim()).map(e => parseFloat(getComputedStyle(e).fontSize))"
    )
    assert min(small) >= SMALLEST_PX


@pytest.mark.exhaustive
def test_two_busy_clients_end_with_the_right_state(desk, opened, served, tmp_path):
    """A tenth of what benchmarks/timing/studio.py does; its figure for memory needs all of it."""
    tab, page = desk
    other_tab, other = opened(PressState("circle-1"))
    done = act(served, [page, other], 100, tmp_path)
    assert (done["exceptions"], done["states_wrong"]) == (0, 0)
    for each_tab, each in ((tab, page), (other_tab, other)):
        drawn(each_tab, each)
        assert np.array_equal(picture(each_tab, "digit"), each.result.touch.image)
    other_tab.close()


def test_the_studio_s_own_source_is_shown(untrained_runs, chrome, tmp_path):
    for number, grey in enumerate((50, 120, 200)):
        Image.new("RGB", (240, 320), (grey,) * 3).save(tmp_path / f"{number}.png")
    with studio(untrained_runs, port=0, source=str(tmp_path)) as own:
        tab = chrome.new_page(viewport=WIDE)
        tab.goto(own.address)
        tab.get_by_text("Translate", exact=True).click(timeout=PATIENCE_MS)
        tab.get_by_text(f"Live: {tmp_path.name}").click()
        shown(tab, 200)
        Image.new("RGB", (240, 320), (90, 90, 90)).save(tmp_path / "3.png")
        shown(tab, 90)
        tab.close()


def shown(tab, grey):
    """Waits until the frame that is shown is of one grey."""
    frame = tab.locator('img[data-name="frame"]')
    wait_until(lambda: frame.count() and (picture(tab, "frame") == grey).all())


def test_a_link_that_no_page_made_is_said_on_the_page(chrome, served):
    tab = chrome.new_page(viewport=WIDE)
    tab.goto(served.link(STATE).replace("hemisphere-4", "hemisphere-9"))
    tab.get_by_text("there is no shape 'hemisphere-9'").wait_for(timeout=PATIENCE_MS)
    tab.close()


def test_ctrl_c_ends_it_at_once_and_leaves_nothing(tmp_path, chrome):
    port = free_port()
    process = subprocess.Popen(
        [sys.executable, "-m", "t2twin", "studio", "--port", str(port)],
        cwd=tmp_path, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),
    )  # fmt: skip
    assert process.stdout is not None
    assert process.stdout.readline() == f"open http://127.0.0.1:{port} (Ctrl-C ends it)\n"
    tab = chrome.new_page()
    tab.goto(f"http://127.0.0.1:{port}")
    tab.locator("canvas").first.wait_for(timeout=PATIENCE_MS)  # the first press may be under way
    process.send_signal(signal.SIGINT)
    said = process.communicate(timeout=PATIENCE_MS / 1000)[1]
    assert process.returncode == 128 + signal.SIGINT
    assert said == "t2twin: stopped; the same command begins again\n"
    left = Path(tempfile.gettempdir()).glob(f".{FOLDER}-*.{process.pid}.part")
    assert list(left) == [] and list(tmp_path.iterdir()) == []
    tab.close()
