"""Start time, latency and stability of the studio, and its image docs/pictures/studio.png.

    python -m benchmarks.timing.studio RUN [RUN ...]

Needs chromium. The browser draws without a GPU, on the same cores. The first run is the translator
in the timed part.
"""

import json
import os
import shutil
import statistics
import subprocess
import sys
import tempfile
import time
from argparse import Namespace
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks import ROOT
from benchmarks.evidence import Argument, Benchmark, Figure, main
from t2twin.core.cache_dir import VARIABLE
from t2twin.core.errors import T2TwinError
from t2twin.core.files import atomic_write

BENCHMARK = Benchmark(
    module="benchmarks.timing.studio",
    measures="Start time, latency and stability of the studio, and the rate of live frames.",
    minutes=5,
    sources=("primitives_cad", "sim", "t2twin/live", "t2twin/studio", "translate/inference"),
    figures=(
        Figure("start_s.first", "s", most=15.0),
        Figure("start_s.after", "s", most=5.0),
        Figure("core_median_ms", "ms", most=60.0),
        Figure("page_median_ms", "ms", most=100.0),
        Figure("events.exceptions", most=0),
        Figure("events.memory_grown_percent", "%", most=10.0),
        Figure("events.states_wrong", most=0),
        Figure("live.share_of_frames", least=0.98),
        Figure("live.latency_median_ms", "ms", most=20.0),
    ),
    arguments=(Argument("runs", "folders of t2twin train, ResNet18 first", Path, nargs="+"),),
)

PICTURE = ROOT / "docs" / "pictures" / "studio.png"
SIZE = {"width": 1400, "height": 900}

SHOWN = ("circle-empty-3", 1.0, -1.0)
"""Shape, and place in x and y, mm, of the press in the README's image."""

FORCES_N = np.linspace(4.0, 12.0, 61)
"""Where the slider is moved to, N."""

STEPS = 40
"""Steps of the slider in the browser."""

EVENTS = 1000
HZ, SECONDS = 60, 20
"""Rate and length of the video."""

ARGUMENTS = ("--no-sandbox", "--use-gl=angle", "--use-angle=swiftshader",
             "--enable-unsafe-swiftshader")  # fmt: skip

PATIENCE_MS = 120_000

WATCH = """() => { window.shown = []; new MutationObserver(() => {
  const at = document.querySelector('img[data-name="digit"]');
  if (at && at.src !== window.last) { window.last = at.src; window.shown.push(performance.now()); }
}).observe(document.body, {childList: true, subtree: true, attributes: true}); }"""
"""Writes down when the DIGIT's picture changes, ms on the page's clock."""


def measure(options: Namespace) -> dict[str, Any]:
    from benchmarks.timing.studio_events import act
    from t2twin.studio.server import studio
    from t2twin.studio.session import PressState

    shown = PressState(*SHOWN)

    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        content = {
            "start_s": {"first": _start_s(folder / "cache"), "after": _start_s(folder / "cache")},
            "core_median_ms": _core_ms(options.runs[0]),
            "live": _live(options.runs[0], folder),
        }
        with _browser() as browser, studio(options.runs, port=0) as served:
            tab, page = _opened(browser, served, shown)
            if not options.keep_nothing:
                draw(tab)
            other_tab, other = _opened(browser, served, PressState("circle-1"))
            content["events"] = act([page, other], EVENTS, folder)
            other_tab.close()
            tab.close()
        with _browser() as browser, studio(options.runs[:1], port=0) as served:
            content["page_median_ms"] = _page_ms(*_opened(browser, served, shown))
    return content


def draw(tab: Any) -> None:
    """Keeps what a page shows as the README's picture, without viser's word on a missing GPU."""
    for close in tab.locator(".mantine-Notification-closeButton").all():
        close.click()
    time.sleep(1.0)
    with atomic_write(PICTURE) as temporary:
        tab.screenshot(path=temporary)


def _start_s(cache: Path) -> float:
    """From the command to the DIGIT's picture on a page."""
    started = time.perf_counter()
    with _browser() as browser:
        process = subprocess.Popen(
            [sys.executable, "-m", "t2twin", "studio", "--port", "0"],
            cwd=ROOT, stdout=subprocess.PIPE, text=True,
            env=os.environ | {VARIABLE: str(cache)},
        )  # fmt: skip
        try:
            assert process.stdout is not None
            tab = browser.new_page(viewport=SIZE)
            tab.goto(process.stdout.readline().split()[1])
            tab.wait_for_selector('img[data-name="digit"]', state="attached", timeout=PATIENCE_MS)
            return time.perf_counter() - started
        finally:
            process.terminate()
            process.wait()


def _core_ms(run: Path) -> float:
    """A new force to all that is sent to a page, without one."""
    from t2twin.studio.cards import press_html, scales_of
    from t2twin.studio.scene import surfaces_of
    from t2twin.studio.session import PressState, Session
    from t2twin.studio.translators import Translators

    translators = Translators()
    translators.search([run])
    session, times = Session(translators), []
    for force_n in FORCES_N:
        started = time.perf_counter()
        result = session.press(PressState(force_n=float(force_n)), translators.default_names)
        scales = scales_of(result)
        surfaces_of(result.touch, *scales)
        press_html(result, *scales)
        times.append(1e3 * (time.perf_counter() - started))
    return statistics.median(times[1:])


def _page_ms(tab: Any, page: Any) -> float:
    """From a key on the force's slider to the DIGIT's picture on the page; the CySkin's and the
    translator's come with it."""
    slider = f'[id="{page.controls.handles["force_n"]._impl.uuid}"] [role=slider]'
    tab.evaluate(WATCH)
    tab.locator(slider).focus()
    times = []
    for _ in range(STEPS):
        known = tab.evaluate("window.shown.length")
        pressed = tab.evaluate("performance.now()")
        tab.keyboard.press("ArrowRight")
        tab.wait_for_function(f"window.shown.length > {known}", timeout=PATIENCE_MS)
        times.append(tab.evaluate("window.shown.at(-1)") - pressed)
        time.sleep(0.3)
    return statistics.median(times)


def _live(run: Path, folder: Path) -> dict[str, float]:
    """A video at 60 Hz on one core: the share of frames that get a line, and their latency."""
    import cv2

    path = folder / "video.avi"
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*"MJPG"), HZ, (240, 320))
    rng = np.random.default_rng(0)
    for _ in range(HZ * SECONDS):
        writer.write(rng.integers(0, 256, (320, 240, 3), dtype=np.uint8))
    writer.release()
    done = subprocess.run(
        [sys.executable, "-m", "t2twin", "live", "--run", str(run), str(path)],
        capture_output=True, text=True, check=True, cwd=ROOT,
        preexec_fn=lambda: os.sched_setaffinity(0, {min(os.sched_getaffinity(0))}),
    )  # fmt: skip
    records = [json.loads(line) for line in done.stdout.splitlines()]
    return {
        "share_of_frames": len(records) / (HZ * SECONDS),
        "latency_median_ms": statistics.median(record["latency_ms"] for record in records),
    }


@contextmanager
def _browser() -> Iterator[Any]:
    """A headless browser. Raises T2TwinError where there is none."""
    from playwright.sync_api import sync_playwright

    path = shutil.which("chromium")
    if path is None:
        raise T2TwinError("there is no chromium; `make browser` installs it")
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=path, args=list(ARGUMENTS))
        yield browser
        browser.close()


def _opened(browser: Any, served: Any, state: Any) -> tuple[Any, Any]:
    """The browser's page and the studio's, when they show a press."""
    from benchmarks.timing.studio_events import settle

    known = set(served.pages)
    tab = browser.new_page(viewport=SIZE)
    tab.goto(served.address)
    tab.wait_for_selector('img[data-name="translated"]', state="attached", timeout=PATIENCE_MS)
    page = served.pages[next(iter(set(served.pages) - known))]
    page.controls.apply(vars(state))
    settle(page)
    time.sleep(3.0)  # viser draws it finely once nothing moves
    return tab, page


if __name__ == "__main__":
    main(BENCHMARK)
