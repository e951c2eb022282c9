"""Tab that translates frames of the user by all selected runs."""

import shutil
from collections.abc import Callable
from functools import partial
from pathlib import Path
from threading import Event, Thread

import numpy as np
import viser

from t2twin.core.errors import T2TwinError
from t2twin.studio.cards import frame_html
from t2twin.studio.controls import Inputs, markdown_safe
from t2twin.studio.session import PressResult
from t2twin.studio.shared import FrameSource, NamedFrame, SharedState, read_frame
from t2twin.studio.tasks import LatestOnlyWorker, Notices

MAX_SHOWN_HZ = 15.0
"""Maximum rate at which a page receives frames of a live source (assumed)."""

NO_BACKGROUND = "Background frame: **none**; field runs use the mean of their training"
"""Text without a background frame."""


class TranslateTab:
    """Created inside the container of the tab.

    get_result: returns the shown press. uploads: buttons by kind of file.
    """

    def __init__(
        self,
        client: viser.ClientHandle,
        shared: SharedState,
        notices: Notices,
        get_result: Callable[[], PressResult | None],
    ) -> None:
        self._translators, self._notices = shared.translators, notices
        self._get_result = get_result
        self._runs: tuple[str, ...] = ()
        self._get_frame: Callable[[], NamedFrame | None] = lambda: None
        self._live: Event | None = None  # set to stop following the source
        self._worker = LatestOnlyWorker(lambda: notices.guard(self._translate))
        gui, inputs = client.gui, Inputs(client.gui, notices)
        gui.add_markdown(
            "Predicts counts from an upright frame of the gel camera that a run was trained on."
        )
        self.uploads = {"frame": inputs.upload("Upload a frame", "PNG or JPEG of any size")}
        inputs.button("Current image, with noise", viser.Icon.PHOTO, self._show_current)
        self._background_name = gui.add_markdown("")
        self.uploads["background"] = inputs.upload(
            "Upload a background frame", "Frame of the same sensor without contact, PNG or JPEG"
        )
        self._no_background = inputs.button(
            "Remove the background frame", viser.Icon.X, lambda: self._set_background(None)
        )
        self._set_background(shared.background)
        if shared.frame_source is not None:
            self._add_source(inputs, shared.frame_source)
        self._shown = gui.add_html("")

    def close(self) -> None:
        """Stops the work for a disconnected client."""
        if self._live is not None:
            self._live.set()
        self._worker.stop()

    def use_runs(self, runs: tuple[str, ...]) -> None:
        """Translates by these runs, including the frame that is shown."""
        self._runs = runs
        self._worker.request()

    def show_file(self, path: Path) -> None:
        """Translates a stored file and removes it. Raises T2TwinError if it is not an image."""
        self._show(_read_and_remove(path))

    def use_background(self, path: Path) -> None:
        """Uses a stored file as the background frame of field runs and removes it.

        Raises T2TwinError if it is not an image.
        """
        self._set_background(_read_and_remove(path))

    def _set_background(self, frame: NamedFrame | None) -> None:
        self._background = frame
        self._no_background.visible = frame is not None
        self._background_name.content = (
            NO_BACKGROUND if frame is None else f"Background frame: **{markdown_safe(frame[1])}**"
        )
        self._worker.request()

    def _add_source(self, inputs: Inputs, source: FrameSource) -> None:
        files = source.files()
        if len(files) > 1:
            slider = inputs.gui.add_slider(
                "Frame", 0, len(files) - 1, 1, 0, hint="Number of the file, sorted by name"
            )
            inputs.on(slider, lambda number: self._request(lambda: read_frame(files[number])))
        live = inputs.gui.add_checkbox(
            f"Live: {source.name}", False, hint="Translate frames as they arrive"
        )
        inputs.on(live, lambda is_on: self._set_live(source, is_on))

    def _set_live(self, source: FrameSource, is_on: bool) -> None:
        if self._live is not None:
            self._live.set()
        self._live = ended = Event() if is_on else None
        if ended is not None:
            follow = partial(self._show_live, source, ended)
            Thread(target=self._notices.guard, args=(follow,), daemon=True).start()

    def _show_live(self, source: FrameSource, ended: Event) -> None:
        latest, last = source.latest(), -1
        while not ended.is_set():
            frame = latest.take(last, timeout_s=1.0)
            if frame is None and latest.ended:
                return
            if frame is not None:
                last = frame.number
                self._show((frame.image, f"frame {frame.number}"))
                ended.wait(1.0 / MAX_SHOWN_HZ)

    def _show_current(self) -> None:
        result = self._get_result()
        if result is not None:
            reading = result.touch.of_camera
            if reading is None:
                raise T2TwinError("neither sensor is a gel camera, so there is no image")
            noisy = reading.sensor.image(reading.contact, np.random.default_rng())
            self._show((noisy, f"{result.touch.shape.name}, one frame with noise"))

    def _show(self, frame: NamedFrame) -> None:
        self._request(lambda: frame)

    def _request(self, get_frame: Callable[[], NamedFrame | None]) -> None:
        self._get_frame = get_frame
        self._worker.request()

    def _translate(self) -> None:
        frame = self._get_frame()
        if frame is not None:
            background = None if self._background is None else self._background[0]
            translations = self._translators.translate(frame[0], self._runs, background)
            self._shown.content = frame_html(frame, self._background, translations)


def _read_and_remove(path: Path) -> NamedFrame:
    """Reads an uploaded image and removes its folder."""
    try:
        return read_frame(path)
    finally:
        shutil.rmtree(path.parent, ignore_errors=True)
