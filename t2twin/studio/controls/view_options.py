"""View options of one client: visible sensors, style of the shape, light or dark theme."""

from collections.abc import Callable
from threading import Thread
from typing import get_args

import viser

from t2twin.studio.controls.file_drop import run_script
from t2twin.studio.view.scene import Sensors
from t2twin.studio.view.solids import ShapeStyle

ACCENT, DARK_ACCENT = (11, 83, 148), (138, 184, 240)
"""Accent color of the light and the dark theme, RGB: that of links in the reports."""

CHOICE, THEME = "t2twin-dark", "t2twin-dark-wanted"
"""Keys of the browser's local storage, with values "true" or "false": the user's choice of the dark
theme, and the theme to use: the choice or, without one, the browser's preference."""

STORE_THEME = f"""
try {{
  const key = (name) => "viser-user:" + name;  // prefix of viser's storage
  const preferred = matchMedia("(prefers-color-scheme: dark)").matches;
  const theme = localStorage.getItem(key("{CHOICE}")) ?? String(preferred);
  localStorage.setItem(key("{THEME}"), theme);
}} catch {{}}
"""
"""Script that stores the theme to use; without local storage the page remains light."""

STORAGE_TIMEOUT_S = 30.0
"""Maximum wait for the browser's reply, s (assumed: until the page is rendered)."""


class ViewOptions:
    """The folder of view options. arrange: called with the visible sensors. redraw: called after a
    change of shape_style."""

    def __init__(
        self,
        client: viser.ClientHandle,
        arrange: Callable[[Sensors], None],
        redraw: Callable[[], None],
    ) -> None:
        self.shape_style: ShapeStyle = "glass"
        self._client = client
        with client.gui.add_folder("View", expand_by_default=False):
            sensors = client.gui.add_dropdown("Sensors", get_args(Sensors))
            shape_style = client.gui.add_dropdown("Shape as", get_args(ShapeStyle))
            self.arrows = client.gui.add_checkbox(
                "Traction arrows",
                True,
                hint="Tangential traction of a slide: stick blue, slip orange",
            )
            self._dark = client.gui.add_checkbox("Dark", False, hint="Stored in this browser")

        @sensors.on_update
        async def _(event: viser.GuiEvent) -> None:
            if sensors.value in get_args(Sensors):
                arrange(sensors.value)

        @shape_style.on_update
        async def _(event: viser.GuiEvent) -> None:
            if shape_style.value in get_args(ShapeStyle):
                self.shape_style = shape_style.value
                redraw()

        @self.arrows.on_update
        async def _(event: viser.GuiEvent) -> None:
            redraw()

        @self._dark.on_update
        async def _(event: viser.GuiEvent) -> None:
            self._set_theme(self._dark.value)
            if event.client is not None:
                client.local_storage.set_item(CHOICE, "true" if self._dark.value else "false")

        self._set_theme(False)
        arrange("both")
        run_script(client, STORE_THEME)
        Thread(target=self._use_stored_theme, daemon=True).start()

    def _use_stored_theme(self) -> None:
        try:
            theme = self._client.local_storage.get_item(THEME, STORAGE_TIMEOUT_S)
        except (RuntimeError, TimeoutError):
            return  # disconnected, or without local storage
        if theme == "true":
            self._dark.value = True

    def _set_theme(self, dark: bool) -> None:
        self._client.gui.configure_theme(
            dark_mode=dark,
            brand_color=DARK_ACCENT if dark else ACCENT,
            control_width="large",
            show_logo=False,
            show_share_button=False,
        )
