"""A headless browser for the studio's tests."""

import base64
import io
import os
import shutil
from collections.abc import Iterator
from contextlib import contextmanager

import numpy as np
import pytest
from PIL import Image

CHROMIUM = "chromium"

ARGUMENTS = (
    "--no-sandbox",
    "--use-gl=angle",
    "--use-angle=swiftshader",
    # Without it there is no WebGL, the canvas stays blank, and what looks at it sees nothing.
    "--enable-unsafe-swiftshader",
)

PATIENCE_MS = 60_000

FEW_FRAMES = """{
const draw = requestAnimationFrame;
requestAnimationFrame = (next) => setTimeout(draw, 100, next);
cancelAnimationFrame = clearTimeout;
}"""
"""Pages draw ten frames a second at most: without a GPU the scene would take a core."""


def chromium() -> str:
    """Where the browser is. Skips without one, and fails where CI has none."""
    path = shutil.which(CHROMIUM)
    if path is None:
        assert not os.environ.get("CI"), "there is no chromium; `make browser` installs it"
        pytest.skip("THE STUDIO'S PAGE IS NOT TESTED: there is no chromium, `make browser`")
    return path


@contextmanager
def browser(**options) -> Iterator:
    """A playwright context of a browser of its own."""
    path = chromium()
    from playwright.sync_api import sync_playwright

    with sync_playwright() as playwright:
        running = playwright.chromium.launch(executable_path=path, args=list(ARGUMENTS))
        try:
            context = running.new_context(**options)
            context.add_init_script(FEW_FRAMES)
            yield context
        finally:
            running.close()


def picture(page, name: str) -> np.ndarray:
    """A picture of a page by its name, (h, w, 3) uint8, pixel for pixel."""
    address = page.locator(f'img[data-name="{name}"]').first.get_attribute("src")
    with Image.open(io.BytesIO(base64.b64decode(address.partition(",")[2]))) as image:
        return np.asarray(image.convert("RGB"))


def canvas(page) -> np.ndarray:
    """What the scene shows, (h, w, 3) uint8."""
    png = page.locator("canvas").first.screenshot()
    with Image.open(io.BytesIO(png)) as image:
        return np.asarray(image.convert("RGB"))
