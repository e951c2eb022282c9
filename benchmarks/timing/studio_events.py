"""Random changes of several clients of the studio at once."""

import gc
import time
import warnings
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import trimesh

import t2twin
from t2twin.core.errors import T2TwinError
from t2twin.studio.controls import SLIDERS
from t2twin.studio.page import Page
from t2twin.studio.session import protocol_press

WARM = 0.3
"""Part of the events after which memory is looked at first: by then all that is kept is there."""

SHAPES = ("circle-1", "circle-4", "hemisphere-4", "square-2", "line-smooth-2")
"""Shapes that are quick to make."""

KINDS = (0.6, 0.12, 0.08, 0.08, 0.12)
"""Shares of slider values, shapes, presses of the protocol, noise, and files."""


def act(pages: Sequence[Page], events: int, folder: Path) -> dict[str, Any]:
    """Sends random events to random pages.

    Returns the number of `exceptions` other than refusals, the growth of `memory` after the first
    part of the events in percent, and the number of pages with wrong final `states`. A state is
    right if it is that of the last event and has the twin's image and counts.
    """
    rng = np.random.default_rng(0)
    files, exceptions = _files(folder), []
    guard = Page.guard

    def counted(self: Page, task: Callable[[], object]) -> None:
        def run() -> None:
            try:
                task()
            except Exception as error:
                if not isinstance(error, T2TwinError | OSError):
                    exceptions.append(error)
                raise

        guard(self, run)

    Page.guard = counted
    try:
        first_bytes = 0
        for number in range(events):
            page = pages[int(rng.integers(len(pages)))]
            counted(page, lambda page=page: _event(page, rng, files))
            if number == int(WARM * events):
                first_bytes = _held(pages)
        last = {"x_mm": 1.0, "y_mm": -1.0, "yaw_deg": 30.0, "force_n": 6.0}
        for page in pages:
            page.controls.apply({"shape": SHAPES[0], "tilt_x_deg": 0.0, "tilt_y_deg": 0.0} | last)
        grown = 100.0 * (_held(pages) / first_bytes - 1.0)
    finally:
        Page.guard = guard
    return {
        "events": events,
        "exceptions": len(exceptions),
        "memory_grown_percent": grown,
        "states_wrong": sum(not _is_right(page, last) for page in pages),
    }


def _event(page: Page, rng: np.random.Generator, files: Sequence[Path]) -> None:
    """One random change of a page."""
    controls = page.controls
    kind = int(rng.choice(len(KINDS), p=KINDS))
    if kind == 0:
        name = str(rng.choice(list(SLIDERS)))
        slider = controls.handles[name]
        # One in ten is far from what a slider can give.
        far = 100.0 if rng.random() < 0.1 else 1.0
        controls.apply({name: float(rng.uniform(slider.min, slider.max) * far)})
    elif kind == 1:
        controls.apply({"shape": str(rng.choice(SHAPES)), "scale": None})
    elif kind == 2:
        number = int(rng.integers(0, 600))
        state = protocol_press(page.state, "paper", number)
        controls.apply({name: getattr(state, name) for name in SLIDERS})
    elif kind == 3:
        controls.apply({"seed": 0 if rng.random() < 0.5 else None})
    else:
        controls.use_file(files[int(rng.integers(len(files)))])


def _files(folder: Path) -> list[Path]:
    """Files that are fine, and some that are not."""
    trimesh.creation.icosphere(subdivisions=2, radius=6.0).export(folder / "ball.stl")
    for name, text in (
        ("bad.stl", "no solid"),
        ("bad.exe", "x"),
        ("empty.obj", ""),
        ("taxels.csv", "x_mm,y_mm\n-5,-5\n5,-5\n0,5\n"),
        ("far.csv", "x_mm,y_mm\n-50,-5\n5,-5\n0,5\n"),
        ("bad.csv", "a,b\n1,2\n"),
    ):
        (folder / name).write_text(text)
    return sorted(folder.iterdir())


def _is_right(page: Page, last: dict[str, float]) -> bool:
    """Whether a page shows the last state, with the image and counts of the twin."""
    state, result = page.state, page.result
    if result is None or result.state != state:
        return False
    if any(getattr(state, name) != value for name, value in last.items()):
        return False
    twin = t2twin.Twin(layout=state.layout, imperfections=state.imperfections)
    pose = {name: getattr(state, name) for name in ("tilt_x_deg", "tilt_y_deg", "seed", "scale")}
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", t2twin.T2TwinWarning)  # some shapes bottom out
        touch = twin.press(state.shape, **last, **pose)
    return bool(
        np.array_equal(touch.counts, result.touch.counts)
        and np.array_equal(touch.image, result.touch.image)
    )


def _held(pages: Sequence[Page]) -> int:
    """What this process holds when the pages are still, bytes."""
    for page in pages:
        settle(page)
    gc.collect()
    words = Path("/proc/self/statm").read_text().split()
    return int(words[1]) * 4096


def settle(page: Page) -> None:
    """Waits until a page shows its state, or for the refusal of an invalid one."""
    while not page.is_idle:
        time.sleep(0.05)
