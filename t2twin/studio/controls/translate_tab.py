"""A frame of one's own, through every chosen translator."""

import shutil
from collections.abc import Callable
from pathlib import Path
from threading import Event, Thread

import numpy as np
import viser

from t2twin.sim.digit.optics import NOISE_GREY
from t2twin.studio.controls.notices import Notices
from t2twin.studio.controls.press import QUIET, plain
from t2twin.studio.frame_source import Frames, Named, read_frame
from t2twin.studio.session import Look
from t2twin.studio.translators import Translators
from t2twin.studio.view.cards import frame_html
from t2twin.studio.worker import LatestOnlyWorker

SHOWN_HZ = 15.0
"""Most frames of a live source that a page is sent in a second (assumed: enough to look at)."""

NO_BACKGROUND = "Background frame: **none**; field runs take the mean one of their training"
"""Shown where no background frame was given."""


class TranslateTab:
    """Made within the tab's container. frames: the studio's own source, if it has one.
    background: the frame of its DIGIT with nothing touching it, if one was given."""

    def __init__(
        self,
        client: viser.ClientHandle,
        translators: Translators,
        notices: Notices,
        frames: Frames | None,
        background: Named | None,
        look: Callable[[], Look | None],
    ) -> None:
        self._translators, self._notices, self._look = translators, notices, look
        self._runs: tuple[str, ...] = ()
        self._background = background
        self._wanted: Callable[[], Named | None] = lambda: None
        self._live: Event | None = None  # set when the frames are to be followed no longer
        self._worker = LatestOnlyWorker(lambda: notices.guarded(self._show_wanted), lambda: None)
        gui = client.gui
        gui.add_markdown(
            "A frame of a DIGIT, upright (rows along its length), becomes what a CySkin would have "
            "felt."
        )
        self.upload = gui.add_upload_button(
            "A frame of mine", icon=viser.Icon.UPLOAD, color=QUIET, hint="PNG or JPEG of any size"
        )
        current = gui.add_button(
            "The current picture, with noise", icon=viser.Icon.PHOTO, color=QUIET
        )

        @current.on_click
        async def _(event: viser.GuiEvent) -> None:
            notices.guarded(self._show_current)

        self._add_background(gui)
        if frames is not None:
            self._add_frames(gui, frames)
        self._shown = gui.add_html("")

    def close(self) -> None:
        """The client is gone."""
        if self._live is not None:
            self._live.set()
        self._worker.end()

    def use(self, runs: tuple[str, ...]) -> None:
        """From here on these translate, also what is shown already."""
        self._runs = runs
        self._worker.ask()

    def show_file(self, path: Path) -> None:
        """Translates a kept file, which is removed. Raises T2TwinError where it is no image."""
        named = _read_and_remove(path)
        self._show(lambda: named)

    def take_background(self, path: Path) -> None:
        """From here on field runs compare frames with a kept file, which is removed. Raises
        T2TwinError where it is no image."""
        self._set_background(_read_and_remove(path))

    def _add_background(self, gui: viser.GuiApi) -> None:
        self._background_name = gui.add_markdown("")
        self.upload_background = gui.add_upload_button(
            "A background frame", icon=viser.Icon.UPLOAD, color=QUIET,
            hint="A frame of the same DIGIT with nothing touching it, PNG or JPEG",
        )  # fmt: skip
        self._no_background = gui.add_button(
            "Without a background frame", icon=viser.Icon.X, color=QUIET
        )

        @self._no_background.on_click
        async def _(event: viser.GuiEvent) -> None:
            self._notices.guarded(lambda: self._set_background(None))

        self._set_background(self._background)

    def _set_background(self, named: Named | None) -> None:
        self._background = named
        self._no_background.visible = named is not None
        self._background_name.content = (
            NO_BACKGROUND if named is None else f"Background frame: **{plain(named[1])}**"
        )
        self._worker.ask()

    def _add_frames(self, gui: viser.GuiApi, frames: Frames) -> None:
        files = frames.files()
        if len(files) > 1:
            leaf = gui.add_slider(
                "Frame", 0, len(files) - 1, 1, 0, hint="Leaf through the folder, sorted by name"
            )

            @leaf.on_update
            async def _(event: viser.GuiEvent) -> None:
                if 0 <= leaf.value < len(files):
                    self._show(lambda: read_frame(files[leaf.value]))

        live = gui.add_checkbox(f"Live: {frames.name}", False, hint="Frames as they arrive")

        @live.on_update
        async def _(event: viser.GuiEvent) -> None:
            if self._live is not None:
                self._live.set()
            self._live = Event() if live.value else None
            if self._live is not None:
                Thread(target=self._follow, args=(frames, self._live), daemon=True).start()

    def _follow(self, frames: Frames, ended: Event) -> None:
        self._notices.guarded(lambda: self._show_live(frames, ended))

    def _show_live(self, frames: Frames, ended: Event) -> None:
        newest, last = frames.newest(), -1
        while not ended.is_set():
            frame = newest.take(last, timeout_s=1.0)
            if frame is None and newest.ended:
                return
            if frame is not None:
                last, named = frame.number, (frame.image, f"frame {frame.number}")
                self._show(lambda named=named: named)
                ended.wait(1.0 / SHOWN_HZ)

    def _show_current(self) -> None:
        look = self._look()
        if look is None:
            return
        noise = np.random.default_rng().normal(0.0, NOISE_GREY, look.touch.image.shape)
        noisy = np.clip(np.rint(look.touch.image + noise), 0, 255).astype(np.uint8)
        self._show(lambda: (noisy, f"{look.touch.shape.name}, one frame with noise"))

    def _show(self, wanted: Callable[[], Named | None]) -> None:
        self._wanted = wanted
        self._worker.ask()

    def _show_wanted(self) -> None:
        named = self._wanted()
        if named is not None:
            background = None if self._background is None else self._background[0]
            translations = self._translators.of_image(named[0], self._runs, background)
            self._shown.content = frame_html(named, self._background, translations)


def _read_and_remove(path: Path) -> Named:
    """A kept image, of which nothing else is needed."""
    try:
        return read_frame(path)
    finally:
        shutil.rmtree(path.parent, ignore_errors=True)
