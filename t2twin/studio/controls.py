"""Controls of one client: shape, position, force and sensors of the press, and the view.

viser passes on whatever a client sends, so the values are checked here.
"""

import re
from collections.abc import Callable
from functools import partial
from itertools import groupby
from math import inf, isfinite
from pathlib import Path
from typing import Any, get_args

import viser

from t2twin.core.errors import T2TwinError
from t2twin.primitives_cad.catalogue import NAMES
from t2twin.primitives_cad.shape import RANDOM_PREFIX, seed_of
from t2twin.primitives_cad.tilt import MAX_TILT_DEG
from t2twin.sim.sampling.presses import MAX_SHAPE_SEED
from t2twin.sim.sampling.protocol import SCALES
from t2twin.sim.sensors.defaults import ROLES
from t2twin.sim.sensors.files import bundled_sensors, load_sensor
from t2twin.sim.sensors.pair import SensorPair
from t2twin.sim.taxels.layout import layout_names
from t2twin.studio.press_state import (
    IMPERFECTIONS,
    Motion,
    PressState,
    file_name,
    is_file,
    protocol_press,
    protocol_presses,
)
from t2twin.studio.scene import Sensors
from t2twin.studio.session import PressResult
from t2twin.studio.solids import ShapeStyle
from t2twin.studio.tasks import Notices

BUTTON_COLOR = "gray"
"""Color of all buttons, less prominent than the sliders."""

ACCENT, DARK_ACCENT = (11, 83, 148), (138, 184, 240)
"""Accent color of the light and the dark theme, RGB: that of links in the reports."""

TOLERANCE = 1e-6
"""Tolerance of a slider's range, relative to its width, because a page rounds values."""

RANDOM, OWN_FILE = "random shapes", "uploaded file"
"""Groups of shapes in addition to the families and the tools."""

OWN_OPTICS, OWN_LAYOUT = "those of the sensor", "of the sensor"
"""Names of the optics and of the layout in a sensor's file."""

MAX_SEED = 2**53
"""Largest seed, which a browser's numbers represent exactly."""

MAX_SLIDER_N, MIN_SLIDER_N = 20.0, 0.1
"""Range of the force slider, N (assumed: forces of fingers and grippers)."""

SLIDERS = {
    # The sensors' widths and lengths replace these ranges, and half the source's thickness that of
    # depth_mm, which few shapes reach with 100 N.
    "x_mm": ("x, mm", -10.0, 10.0, 0.1, "To the right in the image"),
    "y_mm": ("y, mm", -10.0, 10.0, 0.1, "Downwards in the image"),
    "yaw_deg": (
        "yaw, °", -180.0, 180.0, 1.0, "Rotation about the press axis, clockwise in the image"
    ),
    "tilt_x_deg": (
        "tilt x, °", -MAX_TILT_DEG, MAX_TILT_DEG, 0.5,
        "A positive tilt lowers the side that is up in the image at yaw 0",
    ),
    "tilt_y_deg": (
        "tilt y, °", -MAX_TILT_DEG, MAX_TILT_DEG, 0.5,
        "A positive tilt lowers the side that is to the right at yaw 0",
    ),
    "force_n": (
        "force, N", MIN_SLIDER_N, MAX_SLIDER_N, 0.1,
        "Commanded force; 8 N in the paper's protocol",
    ),
    "depth_mm": (
        "depth, mm", 0.01, 2.0, 0.01,
        "Depth in the elastomer of the source, instead of a force; the force is computed",
    ),
    # Up to twice that of rubber on dry solids (assumed).
    "friction": (
        "friction", 0.0, 2.0, 0.05,
        "Coefficient of friction of both sensors; until it is moved, that of each one's file",
    ),
}  # fmt: skip
"""Sliders by their field of PressState: label, range, step and hint. A link may contain any valid
value."""

GROUPS: dict[str, tuple[str, ...]] = {
    group: tuple(names)
    for group, names in groupby(NAMES, lambda name: re.split(r"/|-\d+$", name)[0])
}
"""Shapes of the catalogue by family and by tool."""


class Inputs:
    """Adds inputs to the container that is being built, whose errors are shown to the client.

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
                self._notices.guard(lambda: use(_valid_value(handle)))

        handle.on_update(changed)


def _valid_value(handle: Any) -> Any:
    """The value of a control. Raises T2TwinError for one that its page cannot send."""
    value, allowed = handle.value, "true or false"
    if isinstance(handle, viser.GuiDropdownHandle):
        valid, allowed = value in handle.options, "one of its options"
    elif isinstance(handle, viser.GuiSliderHandle | viser.GuiNumberHandle):
        low = -inf if handle.min is None else handle.min
        high = inf if handle.max is None else handle.max
        is_range = isinstance(value, float) and isfinite(high - low)
        tolerance = TOLERANCE * (high - low) if is_range else 0.0
        valid = isfinite(value) and low - tolerance <= value <= high + tolerance
        allowed = f"{low:g} to {high:g}"
    else:
        valid = isinstance(value, bool)
    if not valid:
        raise T2TwinError(f"{handle.label!r} is {str(value)[:40]!r}; expected {allowed}")
    return value


def markdown_safe(text: str) -> str:
    """Text for Markdown, with special characters replaced by underscores."""
    return "".join(c if c.isalnum() or c in " .-_" else "_" for c in text)


class Controls:
    """The panel of the press. Inputs of the client are passed to `change`, which changes fields of
    the state and returns the new state.

    state: that is shown. sliders: by their field of PressState. uploads: buttons by kind of file.
    number: of the protocol's press. noise: checkbox. A state may contain values between the steps
    of a slider, such as those of the protocol's presses; they remain until the slider is moved.
    lift_off: called before a press without tangential traction.
    """

    def __init__(
        self,
        client: viser.ClientHandle,
        state: PressState,
        change: Callable[[dict[str, Any]], PressState],
        lift_off: Callable[[], None],
        notices: Notices,
    ) -> None:
        self._inputs, self._change, self._lift_off = Inputs(client.gui, notices), change, lift_off
        self.state, gui = state, client.gui
        self._shown_for: tuple[str, str] | None = None  # source and target
        self._handles: dict[str, Any] = {}  # by their field of PressState
        self.uploads: dict[str, viser.GuiUploadButtonHandle] = {}
        with gui.add_folder("Shape"):
            self._add_shape(gui)
        with gui.add_folder("Press"):
            self._add_press(gui)
        with gui.add_folder("Press of the paper's protocol", expand_by_default=False):
            self._add_protocol(gui)
        with gui.add_folder("Sensors", expand_by_default=False):
            self._add_sensors(gui)
        self.show(state)

    def show(self, state: PressState) -> None:
        """Shows a state in all controls, without a call of `change`."""
        self.state = state
        self._show_sensors(state)
        group, has_noise = group_of(state.shape), state.seed is not None
        for name, handle in self._handles.items():
            _show_value(handle, getattr(state, name))
        if state.friction is None:
            self.sliders["friction"].value = self._own_friction
        self._group.options = (*GROUPS, RANDOM, *([OWN_FILE] if group == OWN_FILE else []))
        self._group.value = group
        self._shape.visible = group in GROUPS
        if group in GROUPS:
            self._shape.options, self._shape.value = GROUPS[group], state.shape
        elif group == RANDOM:
            self._random.value = int(state.shape.removeprefix(RANDOM_PREFIX))
        self._random.visible = group == RANDOM
        self._own.visible = self._handles["scale"].visible = group == OWN_FILE
        self._own.content = f"**{markdown_safe(file_name(state.shape))}**, +z side pressed"
        self.sliders["friction"].visible = self._lift.visible = state.motion == "slide"
        layout = OWN_LAYOUT if state.layout is None else _choice(state.layout)
        self._layout.options = tuple(dict.fromkeys((OWN_LAYOUT, *layout_names(), layout)))
        self._layout.value = layout
        optics = markdown_safe(file_name(state.optics or OWN_OPTICS))
        self._optics.content = f"Optics: **{optics}**"
        self.noise.value = has_noise
        self._handles["imperfections"].visible = self._handles["seed"].visible = has_noise
        presses = protocol_presses(state.shape, self._scale_name.value)
        self.number.max = max(presses - 1, 1)
        self.number.disabled = self._scale_name.disabled = presses == 0

    def _show_sensors(self, state: PressState) -> None:
        """Shows the sensors of a state, and what depends on them alone."""
        if self._shown_for == (state.source, state.target):
            return
        self._shown_for = state.source, state.target
        for role in ROLES:
            chosen = _choice(getattr(state, role))
            self._roles[role].options = tuple(dict.fromkeys((*bundled_sensors(), chosen)))
            self._roles[role].value = chosen
        pair = SensorPair.of(state.source, state.target)
        layers = pair.source.elastomer, pair.target.elastomer
        for name, side in (("x_mm", "width_mm"), ("y_mm", "length_mm")):
            half_mm = max(getattr(each, side) for each in layers) / 2
            self.sliders[name].min, self.sliders[name].max = -half_mm, half_mm
        self.sliders["depth_mm"].max = max(round(layers[0].thickness_mm / 2, 1), 0.1)
        self._own_friction = pair.source.friction
        self._handles["imperfections"].options = state.imperfection_names
        options = {name for each in (pair.source, pair.target) for name in each.OPTIONS}
        for name, handles in (
            ("layout", (self._layout, self.uploads["layout"])),
            ("optics", (self._optics, self.uploads["optics"], self._no_optics)),
            ("markers", (self._handles["markers"],)),
        ):
            for handle in handles:
                handle.visible = name in options

    def show_solved_values(self, result: PressResult) -> None:
        """Shows the depth of a given force, or the force of a given depth, of the current state."""
        if result.state != self.state:
            return
        if result.state.depth_mm is None:
            _show_value(
                self.sliders["depth_mm"], next(iter(result.touch.contacts.values())).depth_mm
            )
        else:
            _show_value(self.sliders["force_n"], result.touch.command.force_n)

    def apply(self, changes: dict[str, Any]) -> None:
        """Applies changes and shows them in the controls."""
        self.show(self._change(changes))

    def _bind(self, **handles: Any) -> None:
        """Connects controls to their fields of PressState, whose changes they already show."""
        for name, handle in handles.items():
            self._handles[name] = handle
            self._inputs.on(handle, lambda value, name=name: self._set(name, value))

    def _set(self, name: str, value: Any) -> None:
        self.state = self._change({name: value})

    def _add_shape(self, gui: viser.GuiApi) -> None:
        self._group = gui.add_dropdown(
            "Kind", (*GROUPS, RANDOM), hint="Primitive families, tools, random shapes"
        )
        self._shape = gui.add_dropdown(
            "Shape", next(iter(GROUPS.values())), hint="Version or keypoint"
        )
        self._random = gui.add_number(
            "Number", 17, min=0, max=MAX_SHAPE_SEED, step=1, hint="Seed of the random shape"
        )
        self._own = gui.add_markdown("")
        scale = gui.add_number(
            "mm per unit", 1.0, min=1e-6, hint="25.4 for inches, 1000 for meters"
        )
        self._bind(scale=scale)
        self.uploads["shape"] = self._inputs.upload(
            "Upload a shape",
            "STL, STEP, OBJ, PLY, 3MF or GLB, pressing side up (+z); at most 64 MB",
        )
        self._inputs.on(self._group, self._group_changed)
        self._inputs.on(self._shape, lambda name: self.apply({"shape": name, "scale": None}))
        self._inputs.on(self._random, lambda number: self._set("shape", f"{RANDOM_PREFIX}{number}"))

    def _add_press(self, gui: viser.GuiApi) -> None:
        motion = gui.add_dropdown(
            "Motion", get_args(Motion),
            hint="jump: each pose is a new press; slide: the contact moves there with friction",
        )  # fmt: skip
        self.sliders = {
            name: gui.add_slider(label, low, high, step, initial_value=max(low, 0.0), hint=hint)
            for name, (label, low, high, step, hint) in SLIDERS.items()
        }
        self._lift = self._inputs.button(
            "Lift off and press again", viser.Icon.ARROW_UP, self._lift_off
        )
        self._inputs.button("Reset to the center, 8 N", viser.Icon.REFRESH, self._reset)
        self._bind(**self.sliders)
        self._handles["motion"] = motion
        self._inputs.on(motion, lambda motion: self.apply({"motion": motion}))

    def _add_protocol(self, gui: viser.GuiApi) -> None:
        gui.add_markdown("Presses of the simulated datasets.")
        self._scale_name = gui.add_dropdown("Scale", tuple(SCALES), initial_value="paper")
        self.number = gui.add_slider(
            "Press", 0, 1, 1, 0, hint="Number among the shape's presses at this scale"
        )
        self._inputs.on(self._scale_name, lambda _: self.show(self.state))
        self._inputs.on(self.number, self._number_changed)

    def _add_sensors(self, gui: viser.GuiApi) -> None:
        self._roles = {
            role: gui.add_dropdown(role.capitalize(), bundled_sensors(), hint="Sensor to press")
            for role in ROLES
        }
        for role, handle in self._roles.items():
            self._inputs.on(handle, partial(self._sensor_changed, role))
        self.uploads["sensor"] = self._inputs.upload(
            "Upload a sensor",
            "TOML file of a gel camera or a taxel array, which replaces the sensor of its kind",
        )
        layouts = OWN_LAYOUT, *layout_names()
        self._layout = gui.add_dropdown("Taxels", layouts, hint="Taxel layout")
        self.uploads["layout"] = self._inputs.upload(
            "Upload a layout", "JSON or CSV with x_mm and y_mm"
        )
        self._optics = gui.add_markdown("")
        self.uploads["optics"] = self._inputs.upload(
            "Upload an optics file",
            "The .npz file of t2twin calibrate, for the light of your unit",
        )
        self._no_optics = self._inputs.button(
            "Default optics", viser.Icon.REFRESH, lambda: self.apply({"optics": None})
        )
        markers = gui.add_checkbox("Markers", False, hint="Markers printed on the gel")
        self.noise = gui.add_checkbox(
            "Noise", False, hint="Camera noise and imperfections of the array"
        )
        imperfections = gui.add_dropdown(
            "Array", self.state.imperfection_names, initial_value=IMPERFECTIONS,
            hint="Imperfections in the file of the array, applied with noise",
        )  # fmt: skip
        seed = gui.add_number("Seed", 0, min=0, max=MAX_SEED, step=1, hint="Seed of the noise")
        self._bind(markers=markers, imperfections=imperfections, seed=seed)
        self._inputs.on(self._layout, self._layout_changed)
        self._inputs.on(self.noise, lambda on: self.apply({"seed": seed.value if on else None}))

    def _reset(self) -> None:
        self._lift_off()
        self.apply({name: getattr(PressState(), name) for name in self.sliders})

    def _group_changed(self, group: str) -> None:
        if group == RANDOM:
            self.apply({"shape": f"{RANDOM_PREFIX}{self._random.value}", "scale": None})
        elif group != OWN_FILE:
            self.apply({"shape": GROUPS[group][0], "scale": None})

    def _layout_changed(self, name: str) -> None:
        if name != OWN_FILE:
            self._set("layout", None if name == OWN_LAYOUT else name)

    def _sensor_changed(self, role: str, name: str) -> None:
        if name != OWN_FILE:
            self.apply({role: name})

    def use_sensor(self, path: Path) -> None:
        """Use a sensor file for the sensor of its kind, the source unless only the target is."""
        kind = load_sensor(path).spec.kind
        kinds = [load_sensor(getattr(self.state, role)).spec.kind for role in ROLES]
        role = "target" if kinds[0] != kind and kinds[1] == kind else "source"
        self.apply({role: str(path)})

    def _number_changed(self, number: int) -> None:
        state = protocol_press(self.state, self._scale_name.value, number)
        self.apply({name: getattr(state, name) for name in self.sliders})


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
            dark = self._gui.add_checkbox("Dark", False)
        inputs.on(sensors, arrange)
        inputs.on(self.shape_style, lambda _: redraw())
        inputs.on(self.arrows, lambda _: redraw())
        inputs.on(dark, self._set_theme)
        self._set_theme(False)

    def _set_theme(self, dark: bool) -> None:
        self._gui.configure_theme(
            dark_mode=dark,
            brand_color=DARK_ACCENT if dark else ACCENT,
            control_width="large",
            show_logo=False,
            show_share_button=False,
        )


def group_of(shape: str) -> str:
    """The group of a shape; an uploaded file is a group of its own."""
    for group, names in GROUPS.items():
        if shape in names:
            return group
    return OWN_FILE if is_file(shape) or seed_of(shape) is None else RANDOM


def _choice(source: str) -> str:
    """A name in a dropdown; OWN_FILE for a file."""
    return OWN_FILE if is_file(source) else source


def _show_value(handle: Any, value: Any) -> None:
    """Sets a control, of a slider clipped to its range. A value of None leaves it unchanged."""
    if isinstance(handle, viser.GuiSliderHandle):
        value = None if value is None else min(max(value, handle.min), handle.max)
    if value is not None:
        handle.value = value
