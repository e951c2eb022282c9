"""How one client looks at the scene: which sensors, how the shape is drawn, by day or by night."""

from collections.abc import Callable
from threading import Thread
from typing import get_args

import viser

from t2twin.studio.controls.drop import run_script
from t2twin.studio.view.scene import Sensors
from t2twin.studio.view.solids import ShownAs

ACCENT, ACCENT_BY_NIGHT = (11, 83, 148), (138, 184, 240)
"""The page's one color, red, green, blue, by day and by night: that of links in the project's
reports."""

CHOSEN, WANTED = "t2twin-dark", "t2twin-dark-wanted"
"""What the browser keeps: whether the page is to be dark, "true" or "false", as it was chosen, and
with that or, where nothing was, as the browser itself would have it."""

ASK = f"""
try {{
  const kept = (name) => "viser-user:" + name;  // as viser's storage names them
  const asked = matchMedia("(prefers-color-scheme: dark)").matches;
  const wanted = localStorage.getItem(kept("{CHOSEN}")) ?? String(asked);
  localStorage.setItem(kept("{WANTED}"), wanted);
}} catch {{}}
"""
"""Writes down what is wanted; a browser that keeps nothing stays light."""

ANSWER_S = 30.0
"""How long a browser is waited for to say it, s (assumed: until it has drawn the page)."""


class ViewOptions:
    """The folder of the panel. arrange: called with the sensors to be shown. redraw: called when
    the shape is to be drawn in another way. shown_as: which."""

    def __init__(
        self,
        client: viser.ClientHandle,
        arrange: Callable[[Sensors], None],
        redraw: Callable[[], None],
    ) -> None:
        self.shown_as: ShownAs = "glass"
        self._client = client
        with client.gui.add_folder("ViewOptions", expand_by_default=False):
            sensors = client.gui.add_dropdown("Sensors", get_args(Sensors))
            shown_as = client.gui.add_dropdown("Shape as", get_args(ShownAs))
            self._dark = client.gui.add_checkbox("Dark", False, hint="Remembered by this browser")

        @sensors.on_update
        async def _(event: viser.GuiEvent) -> None:
            if sensors.value in get_args(Sensors):
                arrange(sensors.value)

        @shown_as.on_update
        async def _(event: viser.GuiEvent) -> None:
            if shown_as.value in get_args(ShownAs):
                self.shown_as = shown_as.value
                redraw()

        @self._dark.on_update
        async def _(event: viser.GuiEvent) -> None:
            self._dress(self._dark.value)
            if event.client is not None:
                client.local_storage.set_item(CHOSEN, "true" if self._dark.value else "false")

        self._dress(False)
        arrange("both")
        run_script(client, ASK)
        Thread(target=self._dress_as_wanted, daemon=True).start()

    def _dress_as_wanted(self) -> None:
        try:
            wanted = self._client.local_storage.get_item(WANTED, ANSWER_S)
        except (RuntimeError, TimeoutError):
            return  # it is gone, or keeps nothing
        if wanted == "true":
            self._dark.value = True

    def _dress(self, dark: bool) -> None:
        self._client.gui.configure_theme(
            dark_mode=dark,
            brand_color=ACCENT_BY_NIGHT if dark else ACCENT,
            control_width="large",
            show_logo=False,
            show_share_button=False,
        )
