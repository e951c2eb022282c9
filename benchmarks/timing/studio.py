"""Start time and latency of the studio, and its image docs/pictures/studio.png.

    python -m benchmarks studio RUN [RUN ...]

Needs chromium. The browser draws without a GPU, on the same cores. The first run is the translator
in the timed part.
"""

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

from benchmarks import ROOT
from benchmarks.evidence import Argument, Benchmark, Figure
from t2twin.core.cache_dir import VARIABLE
from t2twin.core.errors import T2TwinError
from t2twin.core.files import atomic_write

BENCHMARK = Benchmark(
    module="benchmarks.timing.studio",
    minutes=2,
    sources=("primitives_cad", "sim", "t2twin/studio", "translate/inference"),
    figures=(
        Figure("start_s.first", "s", most=15.0),
        Figure("start_s.after", "s", most=5.0),
        Figure("page_median_ms", "ms", most=100.0),
    ),
    arguments=(Argument("runs", "folders of t2twin train, ResNet18 first", Path, nargs="+"),),
)

PICTURE = ROOT / "docs" / "pictures" / "studio.png"
SIZE = {"width": 1400, "height": 900}

SHOWN = ("circle-empty-3", 1.0, -1.0)
"""Shape, and place in x and y, mm, of the press in the README's image."""

STEPS = 40
"""Steps of the slider in the browser."""

ARGUMENTS = ("--no-sandbox", "--use-gl=angle", "--use-angle=swiftshader",
             "--enable-unsafe-swiftshader")  # fmt: skip

PATIENCE_MS = 120_000

WATCH = """() => { window.shown = []; new MutationObserver(() => {
  const at = document.querySelector('img[data-name="digit"]');
  if (at && at.src !== window.last) { window.last = at.src; window.shown.push(performance.now()); }
}).observe(document.body, {childList: true, subtree: true, attributes: true}); }"""
"""Writes down when the DIGIT's picture changes, ms on the page's clock."""


def measure(options: Namespace) -> dict[str, Any]:
    from t2twin.studio.server import studio

    with tempfile.TemporaryDirectory() as name:
        cache = Path(name) / "cache"
        content: dict[str, Any] = {"start_s": {"first": _start_s(cache), "after": _start_s(cache)}}
    if not options.keep_nothing:
        with _browser() as browser, studio(options.runs, port=0) as served:
            draw(_opened(browser, served)[0])
    with _browser() as browser, studio(options.runs[:1], port=0) as served:
        content["page_median_ms"] = _page_ms(*_opened(browser, served))
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


def _opened(browser: Any, served: Any) -> tuple[Any, Any]:
    """The browser's page and the studio's, when they show the press SHOWN."""
    from t2twin.studio.session import PressState

    tab = browser.new_page(viewport=SIZE)
    tab.goto(served.address)
    tab.wait_for_selector('img[data-name="translated"]', state="attached", timeout=PATIENCE_MS)
    (page,) = served.pages.values()
    page.controls.apply(vars(PressState(*SHOWN)))
    while not page.is_idle:
        time.sleep(0.05)
    time.sleep(3.0)  # viser draws it finely once nothing moves
    return tab, page
