"""Random events from several clients of the studio at once, as messages of their pages."""

import asyncio
import gc
import warnings
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import trimesh
from viser import UploadedFile, _messages

import t2twin
from t2twin.core.errors import T2TwinError
from t2twin.studio.page import Page
from t2twin.studio.server import Studio
from t2twin.studio.tasks import Notices

WARM = 0.3
"""Part of the events after which memory is looked at first: by then all that is kept is there."""

SHAPES = ("circle-1", "circle-4", "hemisphere-4", "square-2", "line-smooth-2")
"""Shapes that are quick to make."""

KINDS = (0.6, 0.12, 0.08, 0.08, 0.12)
"""Shares of slider values, shapes, presses of the protocol, noise, and files."""


def act(served: Studio, pages: Sequence[Page], events: int, folder: Path) -> dict[str, Any]:
    """Sends random events from random pages.

    Returns the number of `exceptions` other than refusals, the growth of `memory` after the first
    part of the events in percent, and the number of pages with wrong final `states`. A state is
    right if it is that of the last event and has the twin's image and counts.
    """
    rng = np.random.default_rng(0)
    files, exceptions = _files(folder), []
    wrong = Notices.show_error

    def counted(self: Notices, error: Exception) -> None:
        if not isinstance(error, T2TwinError | OSError):
            exceptions.append(error)
        wrong(self, error)

    Notices.show_error = counted
    try:
        first_bytes = 0
        for number in range(events):
            _event(pages[int(rng.integers(len(pages)))], rng, files)
            if number == int(WARM * events):
                first_bytes = _held(pages)
        last = {"x_mm": 1.0, "y_mm": -1.0, "yaw_deg": 30.0, "force_n": 6.0}
        for page in pages:
            for name, value in last.items():
                _send(page, page.controls.sliders[name], value)
        grown = 100.0 * (_held(pages) / first_bytes - 1.0)
    finally:
        Notices.show_error = wrong
    return {
        "events": events,
        "exceptions": len(exceptions),
        "memory_grown_percent": grown,
        "states_wrong": sum(not _is_right(page, last) for page in pages),
    }


def _event(page: Page, rng: np.random.Generator, files: dict[str, bytes]) -> None:
    controls = page.controls
    kind = int(rng.choice(len(KINDS), p=KINDS))
    if kind == 0:
        name = str(rng.choice(list(controls.sliders)))
        slider = controls.sliders[name]
        # One in ten is far from what a slider can give.
        far = 100.0 if rng.random() < 0.1 else 1.0
        _send(page, slider, float(rng.uniform(slider.min, slider.max) * far))
    elif kind == 1:
        name = str(rng.choice(SHAPES))
        controls.apply({"shape": name, "scale": None})
    elif kind == 2:
        _send(page, controls.number, int(rng.integers(0, 600)))
    elif kind == 3:
        _send(page, controls.noise, bool(rng.random() < 0.5))
    else:
        name = str(rng.choice(list(files)))
        button = controls.uploads["layout" if name.endswith(".csv") else "shape"]
        _arrive(page, button, UploadedFile(name, files[name]))


def _send(page: Page, handle: Any, value: Any) -> None:
    """As if the page's browser had sent a control's new value."""
    update = _messages.GuiUpdateMessage(handle._impl.uuid, {"value": value})
    gui = handle._impl.gui_api
    coming = gui._handle_gui_updates(gui._owner.client_id, update)
    asyncio.run_coroutine_threadsafe(coming, gui._event_loop).result(30)


def _arrive(page: Page, button: Any, file: UploadedFile) -> None:
    """As if a file had come, whole."""
    callbacks: list[Callable] = list(button._impl.update_cb)

    async def arrive() -> None:
        button._impl.value = file
        for callback in callbacks:
            await callback(None)

    gui = button._impl.gui_api
    asyncio.run_coroutine_threadsafe(arrive(), gui._event_loop).result(30)


def _files(folder: Path) -> dict[str, bytes]:
    """Files that are fine, and some that are not, by name."""
    ball = trimesh.creation.icosphere(subdivisions=2, radius=6.0)
    ball.export(folder / "ball.stl")
    return {
        "ball.stl": (folder / "ball.stl").read_bytes(),
        "bad.stl": b"no solid",
        "../bad.exe": b"x",
        "": b"",
        "empty.obj": b"",
        "taxels.csv": b"x_mm,y_mm\n-5,-5\n5,-5\n0,5\n",
        "far.csv": b"x_mm,y_mm\n-50,-5\n5,-5\n0,5\n",
        "bad.csv": b"a,b\n1,2\n",
    }


def _is_right(page: Page, last: dict[str, float]) -> bool:
    result = page.result
    if result is None or result.state != page.state:
        return False
    if any(getattr(page.state, name) != value for name, value in last.items()):
        return False
    state = page.state
    twin = t2twin.Twin(layout=state.layout, imperfections=state.imperfections)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", t2twin.T2TwinWarning)  # some shapes bottom out
        touch = twin.press(
            state.shape,
            force_n=state.force_n,
            x_mm=state.x_mm,
            y_mm=state.y_mm,
            yaw_deg=state.yaw_deg,
            tilt_x_deg=state.tilt_x_deg,
            tilt_y_deg=state.tilt_y_deg,
            seed=state.seed,
            scale=state.scale,
        )
    return bool(
        np.array_equal(touch.counts, result.touch.counts)
        and np.array_equal(touch.image, result.touch.image)
    )


def _held(pages: Sequence[Page]) -> int:
    """What this process holds when the pages are still, bytes."""
    for page in pages:
        page.wait(120)
    gc.collect()
    words = Path("/proc/self/statm").read_text().split()
    return int(words[1]) * 4096
