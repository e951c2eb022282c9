"""Inputs of a client's panels, whose errors are shown to the client."""

from collections.abc import Callable
from typing import Any

import viser

from t2twin.studio.view.notices import Notices

BUTTON_COLOR = "gray"
"""Color of all buttons, less prominent than the sliders."""


class Inputs:
    """Adds inputs to the container that is being built.

    Callbacks run in viser's event loop, which preserves their order.
    """

    def __init__(self, gui: viser.GuiApi, notices: Notices) -> None:
        self.gui, self._notices = gui, notices

    def button(
        self,
        label: str,
        icon: viser.IconName,
        action: Callable[[], object],
        hint: str | None = None,
    ) -> viser.GuiButtonHandle:
        button = self.gui.add_button(label, icon=icon, color=BUTTON_COLOR, hint=hint)

        async def clicked(event: viser.GuiEvent) -> None:
            self._notices.guard(action)

        button.on_click(clicked)
        return button

    def upload(self, label: str, hint: str) -> viser.GuiUploadButtonHandle:
        return self.gui.add_upload_button(
            label, icon=viser.Icon.UPLOAD, color=BUTTON_COLOR, hint=hint
        )

    def on(self, handle: viser.GuiInputHandle, use: Callable[[Any], object]) -> None:
        """Calls `use` with values from the client, not with values set by the studio."""

        async def changed(event: viser.GuiEvent) -> None:
            if event.client is not None:
                self._notices.guard(lambda: use(event.target.value))

        handle.on_update(changed)


def markdown_safe(text: str) -> str:
    """Text for Markdown, with special characters replaced by underscores."""
    return "".join(c if c.isalnum() or c in " .-_" else "_" for c in text)
