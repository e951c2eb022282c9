"""What a page does of itself, in a real browser: files dropped on it, a depth, by night, and in
which order things come."""

import base64

import pytest
import trimesh
from browser import PATIENCE_MS, browser, chromium
from trimesh.exchange.stl import export_stl
from waiting import wait_until

import t2twin
from t2twin.sim.contact.contact_solver import DEPTH_TOLERANCE_MM
from t2twin.studio.press_state import PressState
from t2twin.studio.server import studio

SHAPE = "hemisphere-4"
WIDE = {"width": 1120, "height": 720}

SURFACES = {"GlbMessage", "SceneNodeUpdateMessage"}
"""Messages with a surface of the scene, a new one or another in its place."""

DROP = """([name, text]) => {
  const data = new DataTransfer(), bytes = Uint8Array.from(atob(text), (c) => c.charCodeAt(0));
  data.items.add(new File([bytes], name));
  const send = (kind) => document.querySelector("canvas").dispatchEvent(
    new DragEvent(kind, {bubbles: true, cancelable: true, dataTransfer: data}));
  return [send("dragover"), document.documentElement.className, send("drop")];
}"""
"""Drops a file on the scene; gives whether the browser would take it itself, and how the page was
shown while it was held."""

LISTEN = """(() => {
  window.batches = [];
  const Own = window.Worker;
  window.Worker = class extends Own {
    constructor(...given) {
      super(...given);
      this.addEventListener("message", (event) => {
        if (event.data.type !== "message_batch") return;
        window.batches.push(event.data.messages.map(
          (each) => each.updates?.content?.includes?.("data-name") ? "pictures" : each.type));
      });
    }
  };
})()"""
"""Writes down what comes with each message of the studio."""


@pytest.fixture(scope="module")
def served(untrained_runs):
    chromium()
    with studio(untrained_runs, port=0) as served:
        yield served


@pytest.fixture(scope="module")
def chrome():
    with browser() as chrome:
        yield chrome


@pytest.fixture
def opened(chrome, served):
    """Opens the page on a press, in a browser of its own that keeps nothing from another."""
    contexts = []

    def open_page(state, context=None, **like):
        known = set(served.pages)
        context = context or chrome.new_context(viewport=WIDE, **like)
        contexts.append(context)
        tab = context.new_page()
        tab.set_default_timeout(PATIENCE_MS)
        tab.add_init_script(LISTEN)
        tab.goto(served.link(state))
        tab.wait_for_selector('img[data-name="translated"]', state="attached")
        page = served.pages[next(iter(set(served.pages) - known))]
        assert page.wait(60)
        return tab, page

    yield open_page
    for context in contexts:
        context.close()


def counts_on(tab):
    return [int(count) for count in tab.locator("code.counts").inner_text().split()]


def test_a_dropped_file_is_pressed_and_another_is_refused(opened):
    tab, page = opened(PressState(SHAPE))
    ball = trimesh.creation.icosphere(subdivisions=3, radius=6.0)
    left, shown, _ = tab.evaluate(DROP, ["ball.STL", base64.b64encode(export_stl(ball)).decode()])
    assert not left and "t2-drop" in shown
    wait_until(lambda: page.state.shape.endswith("ball.stl"))
    assert page.wait(60)
    touch = t2twin.press(t2twin.load_shape(page.state.shape))
    wait_until(lambda: counts_on(tab) == touch.counts.tolist())
    tab.evaluate(DROP, ["notes.txt", ""])
    tab.get_by_text("'notes.txt' cannot be used as a shape").wait_for()
    assert "t2-drop" not in tab.evaluate("document.documentElement.className")
    assert page.state.shape.endswith("ball.stl")


def test_what_is_dropped_goes_by_its_kind(opened):
    tab, page = opened(PressState(SHAPE))
    layout = "x_mm,y_mm\n-5,-5\n5,-5\n0,5\n"
    tab.evaluate(DROP, ["taxels.csv", base64.b64encode(layout.encode()).decode()])
    wait_until(lambda: (page.state.layout or "").endswith("taxels.csv"))
    wait_until(lambda: len(counts_on(tab)) == 3)


def test_a_dropped_sensor_replaces_the_one_of_its_kind(opened):
    tab, page = opened(PressState(SHAPE, source="gelsight-mini"))
    wide = tab.locator('img[data-name="gelsight-mini"]').first.bounding_box()
    assert wide["width"] > wide["height"]
    sensor = 'extends = "cyskin-20"\nname = "soft"\n[cover]\nyoung_mpa = 0.05\nwidth_mm = 40.0\n'
    tab.evaluate(DROP, ["soft.toml", base64.b64encode(sensor.encode()).decode()])
    wait_until(lambda: page.state.target.endswith("soft.toml"))
    assert page.wait(60)
    assert page.state.source == "gelsight-mini"
    touch = t2twin.Twin(source="gelsight-mini", target=page.state.target).press(SHAPE)
    wait_until(lambda: counts_on(tab) == touch.counts.tolist())
    assert page.controls.sliders["x_mm"].max == 20.0
    broken = "kind = 'taxel-array'\n"
    tab.evaluate(DROP, ["broken.toml", base64.b64encode(broken.encode()).decode()])
    tab.get_by_text("name is missing").wait_for()
    assert page.state.target.endswith("soft.toml")
    page.controls.apply({"source": "digit", "target": "cyskin-20"})
    assert page.wait(60)
    assert page.controls.sliders["x_mm"].max == 14.0


def test_a_depth_is_pressed_and_the_force_follows(opened):
    tab, page = opened(PressState(SHAPE, depth_mm=0.5))
    depth, force = (page.controls.sliders[name] for name in ("depth_mm", "force_n"))
    touch = t2twin.press(SHAPE, depth_mm=0.5)
    wait_until(lambda: counts_on(tab) == touch.counts.tolist())
    assert force.value == pytest.approx(touch.command.force_n)
    number = tab.locator(f'[id="{depth._impl.uuid}"]').locator("xpath=..")
    number.locator("input[type=text]").fill("0.8")
    number.locator("input[type=text]").press("Enter")
    wait_until(lambda: page.state.depth_mm == 0.8)
    assert page.wait(60)
    assert page.result.touch.digit.depth_mm == pytest.approx(0.8, abs=DEPTH_TOLERANCE_MM)
    assert force.value == pytest.approx(page.result.touch.command.force_n)
    page.controls.apply({"force_n": 4.0})
    assert page.wait(60)
    assert page.state == PressState(SHAPE, force_n=4.0)
    assert depth.value == pytest.approx(page.result.touch.digit.depth_mm)


def test_pictures_come_before_the_scene_and_alone(opened):
    """With the scene in one message they would wait until it is drawn."""
    tab, page = opened(PressState(SHAPE))
    wait_until(lambda: any(SURFACES & set(batch) for batch in tab.evaluate("batches")))
    for force_n in (5.0, 6.0, 7.0):
        tab.evaluate("window.batches.length = 0")
        page.controls.apply({"force_n": force_n})
        assert page.wait(60)
        wait_until(lambda: any(SURFACES & set(batch) for batch in tab.evaluate("batches")))
        batches = tab.evaluate("batches")
        at = next(n for n, batch in enumerate(batches) if "pictures" in batch)
        assert set(batches[at]) <= {"pictures", "GuiUpdateMessage"}
        assert not any(SURFACES & set(batch) for batch in batches[: at + 1])
