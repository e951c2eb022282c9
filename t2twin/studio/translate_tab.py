"""A frame of one's own, through every chosen translator."""

import shutil
import time
from collections.abc import Callable
from pathlib import Path
from threading import Thread

import numpy as np
import viser

from t2twin.sim.digit.optics import NOISE_GREY
from t2twin.studio.cards import frame_html
from t2twin.studio.controls import QUIET
from t2twin.studio.frames import Frames
from t2twin.studio.notices import Notices
from t2twin.studio.session import Look
from t2twin.studio.translators import Translators
from t2twin.studio.worker import NewestFirst

SHOWN_HZ = 15.0
"""Most frames of a live source that a page is sent in a second (assumed: enough to look at)."""

Named = tuple[np.ndarray, str]
"""A frame, (h, w, 3) or (h, w) uint8, and what it is called."""


class TranslateTab:
    """Made within the tab's container. frames: the studio's own source, if it has one."""

    def __init__(
        self,
        client: viser.ClientHandle,
        translators: Translators,
        notices: Notices,
        frames: Frames | None,
        look: Callable[[], Look | None],
    ) -> None:
        self._translators, self._notices, self._look = translators, notices, look
        self._runs: tuple[str, ...] = ()
        self._wanted: Callable[[], Named | None] = lambda: None
        self._is_live = False
        self._worker = NewestFirst(lambda: notices.guarded(self._show_wanted), lambda: None)
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
        current.on_click(lambda _: self._show_current())
        if frames is not None:
            self._add_frames(gui, frames)
        self._shown = gui.add_html("")

    def close(self) -> None:
        """The client is gone."""
        self._is_live = False
        self._worker.end()

    def use(self, runs: tuple[str, ...]) -> None:
        """From here on these translate, also what is shown already."""
        self._runs = runs
        self._worker.ask()

    def show_file(self, path: Path) -> None:
        """Translates a kept file, which is removed. Raises T2TwinError where it is no image."""
        from t2twin.translate.data.images import open_image

        try:
            image = np.asarray(open_image(path))
        finally:
            shutil.rmtree(path.parent, ignore_errors=True)  # what is needed of it is read
        self._show(lambda: (image, path.name))

    def _add_frames(self, gui: viser.GuiApi, frames: Frames) -> None:
        files = frames.files()
        if len(files) > 1:
            leaf = gui.add_slider(
                "Frame", 0, len(files) - 1, 1, 0, hint="Leaf through the folder, sorted by name"
            )

            @leaf.on_update
            async def _(event: viser.GuiEvent) -> None:
                if 0 <= leaf.value < len(files):
                    self._show(lambda: frames.read(files[leaf.value]))

        live = gui.add_checkbox(f"Live: {frames.name}", False, hint="Frames as they arrive")

        @live.on_update
        async def _(event: viser.GuiEvent) -> None:
            self._is_live = live.value
            if live.value:
                Thread(target=self._follow, args=(frames,), daemon=True).start()

    def _follow(self, frames: Frames) -> None:
        self._notices.guarded(lambda: self._show_live(frames))

    def _show_live(self, frames: Frames) -> None:
        newest, last = frames.newest(), -1
        while self._is_live:
            frame = newest.take(last, timeout_s=1.0)
            if frame is None and newest.ended:
                return
            if frame is not None:
                last, named = frame.number, (frame.image, f"frame {frame.number}")
                self._show(lambda named=named: named)
                time.sleep(1.0 / SHOWN_HZ)

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
            image, name = named
            translations = self._translators.of_image(image, self._runs)
            self._shown.content = frame_html(image, name, translations)
