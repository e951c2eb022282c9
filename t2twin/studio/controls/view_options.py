"""View options of one client: visible sensors, style of the shape, light or dark theme."""

from collections.abc import Callable
from typing import get_args

import viser

from t2twin.studio.controls.inputs import Inputs
from t2twin.studio.view.notices import Notices
from t2twin.studio.view.scene import Sensors
from t2twin.studio.view.solids import ShapeStyle

ACCENT, DARK_ACCENT = (11, 83, 148), (138, 184, 240)
"""Accent color of the light and the dark theme, RGB: that of links in the reports."""


class ViewOptions:
    """The folder of view options. arrange: called with the visible sensors. redraw: called after a
    change of shape_style or arrows."""

    def __init__(
        self,
        client: viser.ClientHandle,
        notices: Notices,
        arrange: Callable[[Sensors], None],
        redraw: Callable[[], None],
    ) -> None:
        self._gui, inputs = client.gui, Inputs(client.gui, notices)
        with self._gui.add_folder("View", expand_by_default=False):
            sensors = self._gui.add_dropdown("Sensors", get_args(Sensors))
            self.shape_style = self._gui.add_dropdown("Shape as", get_args(ShapeStyle))
            self.arrows = self._gui.add_checkbox(
                "Traction arrows",
                True,
                hint="Tangential traction of a slide: stick blue, slip orange",
            )
            self.dark = self._gui.add_checkbox("Dark", False)
        inputs.on(sensors, arrange)
        inputs.on(self.shape_style, lambda _: redraw())
        inputs.on(self.arrows, lambda _: redraw())
        inputs.on(self.dark, self._set_theme)
        self._set_theme(False)

    def _set_theme(self, dark: bool) -> None:
        self._gui.configure_theme(
            dark_mode=dark,
            brand_color=DARK_ACCENT if dark else ACCENT,
            control_width="large",
            show_logo=False,
            show_share_button=False,
        )
