"""A frame of one's own, through every chosen translator."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import viser

from t2twin.sim.digit.optics import NOISE_GREY
from t2twin.studio.cards import frame_html
from t2twin.studio.controls import QUIET
from t2twin.studio.notices import Notices
from t2twin.studio.session import Look
from t2twin.studio.translators import Translators


class TranslateTab:
    """Made within the tab's container. runs: the names of those that translate."""

    def __init__(
        self, client: viser.ClientHandle, translators: Translators, notices: Notices
    ) -> None:
        self._translators, self._notices = translators, notices
        self.runs: tuple[str, ...] = ()
        gui = client.gui
        gui.add_markdown(
            "A frame of a DIGIT, upright (rows along its length), becomes what a CySkin would have "
            "felt."
        )
        self.upload = gui.add_upload_button(
            "A frame of mine", icon=viser.Icon.UPLOAD, color=QUIET, hint="PNG or JPEG of any size"
        )
        self._current = gui.add_button(
            "The current picture, with noise", icon=viser.Icon.PHOTO, color=QUIET
        )
        self._shown = gui.add_html("")

    def on_current(self, look: Callable[[], Look | None]) -> None:
        """Where the current picture comes from."""

        @self._current.on_click
        def _(event: viser.GuiEvent) -> None:
            self._notices.guarded(lambda: self._show_current(look()))

    def show_file(self, path: Path) -> None:
        """Translates an image file. Raises T2TwinError where it is none."""
        from t2twin.translate.data.images import open_image

        self._show(np.asarray(open_image(path)), path.name)

    def _show_current(self, look: Look | None) -> None:
        if look is None:
            return
        noise = np.random.default_rng().normal(0.0, NOISE_GREY, look.touch.image.shape)
        noisy = np.clip(np.rint(look.touch.image + noise), 0, 255).astype(np.uint8)
        self._show(noisy, f"{look.touch.shape.name}, one frame with noise")

    def _show(self, image: np.ndarray, name: str) -> None:
        translations = self._translators.of_image(image, self.runs)
        self._shown.content = frame_html(image, name, translations)
