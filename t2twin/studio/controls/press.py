"""One client's controls: what is pressed, where, how hard, and into which sensors."""

from collections.abc import Callable
from typing import Any

import viser

from t2twin.primitives_cad import catalogue, primitive_parameters
from t2twin.primitives_cad.random_shapes import PREFIX, seed_of
from t2twin.sim.contact.elastomer import CYSKIN_COVER
from t2twin.sim.cyskin.reading import PRESETS
from t2twin.sim.world.presses import MAX_SEED as MAX_SHAPE
from t2twin.sim.world.protocol import SCALES
from t2twin.studio.press_state import (
    PressState,
    file_name,
    is_file,
    layout_names,
    protocol_press,
    protocol_presses,
)
from t2twin.studio.session import Look

RANDOM, OWN_FILE = "random shapes", "my file"
"""Groups of shapes beside the families and the tools."""

MAX_SLIDER_N, MIN_SLIDER_N = 20.0, 0.1
"""Ends of the force's slider, N (assumed: where fingers and grippers press; a link may name any
force that can be pressed)."""

MAX_SLIDER_MM, MIN_SLIDER_MM = 2.0, 0.01
"""Ends of the depth's slider, mm: half the gel's thickness, which few shapes reach with 100 N; a
link may name any depth that can be pressed."""

STEP_MM, STEP_DEG, STEP_N, STEP_DEPTH_MM = 0.1, 1.0, 0.1, 0.01
"""Steps of the sliders."""

MAX_YAW_DEG = 180.0
"""Ends of the yaw's slider, degrees either way."""

QUIET = "gray"
"""Colour of all buttons, so that the sliders stand out."""

OWN_LIGHT = "the one that ships"
"""What the DIGIT's light is called without a calibration."""

Change = Callable[[dict[str, Any]], PressState]
"""Takes fields of PressState with their new values, and gives the state that comes of them."""

Guarded = Callable[[Callable[[], object]], object]
"""Does something, and tells the client where it cannot be done."""


class Controls:
    """The panel that says what is pressed. What a client changes goes to `change`, as fields of
    PressState; `show` sets the panel to a state without doing so, `show_found` to what came of it.

    sliders: by their fields of PressState. number: of the protocol's press. noise: whether there is
    any. guarded: does what may fail, and says so. A state may hold numbers that no slider stands
    at, as those of the protocol's presses: they stay what they are until the slider is moved.
    """

    def __init__(
        self, client: viser.ClientHandle, state: PressState, change: Change, guarded: Guarded
    ) -> None:
        self._gui, self._change, self._guarded = client.gui, change, guarded
        self._state = state
        with self._gui.add_folder("Shape"):
            self._add_shape()
        with self._gui.add_folder("Press"):
            self._add_press()
        with self._gui.add_folder("A press of the paper's protocol", expand_by_default=False):
            self._add_protocol()
        with self._gui.add_folder("Sensors", expand_by_default=False):
            self._add_sensors()
        self.show(state)

    def show(self, state: PressState) -> None:
        """Sets all controls to a state."""
        self._state = state
        group = group_of(state.shape)
        self._group.options = groups(state.shape)
        self._group.value = group
        self._shape.visible = group not in (RANDOM, OWN_FILE)
        self._random.visible = group == RANDOM
        self._own.visible = self._scale.visible = group == OWN_FILE
        self._own.content = f"**{plain(file_name(state.shape))}**, pressed with its +z side"
        if self._shape.visible:
            self._shape.options = shapes_of(group)
            self._shape.value = state.shape
        if group == RANDOM:
            self._random.value = int(state.shape.removeprefix(PREFIX))
        if state.scale is not None:
            self._scale.value = state.scale
        for name, slider in self.sliders.items():
            if getattr(state, name) is not None:
                _put(slider, getattr(state, name))
        self._layout.options = (*layout_names(), *([OWN_FILE] if is_file(state.layout) else []))
        self._layout.value = OWN_FILE if is_file(state.layout) else state.layout
        self._light.content = f"Light: **{plain(file_name(state.calibration or OWN_LIGHT))}**"
        self.noise.value = state.seed is not None
        self._imperfections.value = state.imperfections
        self._imperfections.visible = self._seed.visible = state.seed is not None
        if state.seed is not None:
            self._seed.value = state.seed
        presses = protocol_presses(state.shape, self._scale_name.value)
        self.number.max = max(presses - 1, 1)
        self.number.disabled = self._scale_name.disabled = presses == 0

    def show_found(self, look: Look) -> None:
        """Sets force and depth to what a press came to, unless another is asked for by now."""
        if look.state != self._state:
            return
        if look.state.depth_mm is None:
            _put(self.sliders["depth_mm"], look.touch.digit.depth_mm)
        else:
            _put(self.sliders["force_n"], look.touch.command.force_n)

    def _add_shape(self) -> None:
        gui = self._gui
        self._group = gui.add_dropdown(
            "Kind", groups(self._state.shape), hint="Families of primitives, tools, and more"
        )
        self._shape = gui.add_dropdown(
            "Shape", shapes_of(catalogue.NAMES[0].rsplit("-", 1)[0]), hint="Version or keypoint"
        )
        self._random = gui.add_number(
            "Number", 17, min=0, max=MAX_SHAPE, step=1, hint="Each number is another random shape"
        )
        self._own = gui.add_markdown("")
        self._scale = gui.add_number(
            "mm per unit", 1.0, min=1e-6, hint="25.4 for inches, 1000 for meters"
        )
        self.upload_shape = gui.add_upload_button(
            "A file of mine",
            icon=viser.Icon.UPLOAD,
            color=QUIET,
            hint="STL, STEP, OBJ, PLY, 3MF or GLB, pressing side up (+z); at most 64 MB",
        )
        self._on(self._group, self._new_group)
        self._on(self._shape, self._new_shape)
        self._on(self._random, lambda number: self._set(shape=f"{PREFIX}{number}"))
        self._on(self._scale, lambda scale: self._set(scale=scale))

    def _add_press(self) -> None:
        across, along = CYSKIN_COVER.width_mm / 2, CYSKIN_COVER.length_mm / 2
        add = self._gui.add_slider
        self.sliders = {
            "x_mm": add("x, mm", -across, across, STEP_MM, 0.0, hint="To the right in the picture"),
            "y_mm": add("y, mm", -along, along, STEP_MM, 0.0, hint="Down the picture"),
            "yaw_deg": add(
                "yaw, °", -MAX_YAW_DEG, MAX_YAW_DEG, STEP_DEG, 0.0,
                hint="Turn about the press axis, clockwise in the picture",
            ),
            "force_n": add(
                "force, N", MIN_SLIDER_N, MAX_SLIDER_N, STEP_N, 8.0,
                hint="How hard; 8 N in the paper's protocol",
            ),
            "depth_mm": add(
                "depth, mm", MIN_SLIDER_MM, MAX_SLIDER_MM, STEP_DEPTH_MM, MIN_SLIDER_MM,
                hint="Or how deep into the DIGIT's gel; the force that gives it is found",
            ),
        }  # fmt: skip
        for name, slider in self.sliders.items():
            self._on(slider, lambda value, name=name: self._set(**{name: value}))
        reset = self._gui.add_button(
            "Back to the middle, 8 N", icon=viser.Icon.REFRESH, color=QUIET
        )
        fresh = PressState()
        self._on_click(reset, lambda: self.take({n: getattr(fresh, n) for n in self.sliders}))

    def _add_protocol(self) -> None:
        gui = self._gui
        gui.add_markdown("The presses that datasets are made of, one by one.")
        self._scale_name = gui.add_dropdown("Scale", tuple(SCALES), initial_value="paper")
        self.number = gui.add_slider(
            "Press", 0, 1, 1, 0, hint="Its number among the shape's presses at this scale"
        )
        self._on(self._scale_name, lambda _: self.show(self._state))
        self._on(self.number, self._new_number)

    def _add_sensors(self) -> None:
        gui = self._gui
        self._layout = gui.add_dropdown("Taxels", layout_names(), hint="Where the taxels lie")
        self.upload_layout = gui.add_upload_button(
            "Taxels of mine",
            icon=viser.Icon.UPLOAD,
            color=QUIET,
            hint="JSON or CSV with x_mm and y_mm",
        )
        self._light = gui.add_markdown("")
        self.upload_light = gui.add_upload_button(
            "A calibration of mine", icon=viser.Icon.UPLOAD, color=QUIET,
            hint="The .npz file of t2twin calibrate: the picture in your DIGIT's light",
        )  # fmt: skip
        own_light = gui.add_button(
            "Back to the light that ships", icon=viser.Icon.REFRESH, color=QUIET
        )
        self.noise = gui.add_checkbox(
            "Noise", False, hint="The camera's noise, and the array's imperfections"
        )
        self._imperfections = gui.add_dropdown(
            "Array", tuple(PRESETS), initial_value="white",
            hint="white: reading noise; baseline: drift too; all: hysteresis, gain too",
        )  # fmt: skip
        self._seed = gui.add_number("Seed", 0, min=0, max=2**53, step=1, hint="Another, same noise")
        # A page may send any text; only names that it was offered are taken.
        self._on(self._layout, lambda name: self._set(layout=name) if name in layout_names() else 0)
        self._on_click(own_light, lambda: self.take({"calibration": None}))
        self._on(self.noise, lambda on: self.take({"seed": self._seed.value if on else None}))
        self._on(self._seed, lambda seed: self._set(seed=seed))
        self._on(
            self._imperfections,
            lambda name: self._set(imperfections=name) if name in PRESETS else 0,
        )

    def _on(self, handle: viser.GuiInputHandle, then: Callable[[Any], object]) -> None:
        """Calls `then` with the value that a client gives, not with one set here. It runs in
        viser's own loop, so that values come in their order."""

        async def changed(event: viser.GuiEvent) -> None:
            if event.client is not None:
                self._guarded(lambda: then(event.target.value))

        handle.on_update(changed)

    def _on_click(self, button: viser.GuiButtonHandle, then: Callable[[], None]) -> None:
        async def clicked(event: viser.GuiEvent) -> None:
            self._guarded(then)

        button.on_click(clicked)

    def _set(self, **changes: Any) -> None:
        """What the client has changed and already sees."""
        self._state = self._change(changes)

    def take(self, changes: dict[str, Any]) -> None:
        """The same of what it does not see yet."""
        self.show(self._change(changes))

    def _new_group(self, group: str) -> None:
        if group == RANDOM:
            self.take({"shape": f"{PREFIX}{self._random.value}", "scale": None})
        elif group in GROUPS:
            self.take({"shape": shapes_of(group)[0], "scale": None})

    def _new_shape(self, name: str) -> None:
        if name in shapes_of(self._group.value):
            self.take({"shape": name, "scale": None})

    def _new_number(self, number: int) -> None:
        state = protocol_press(self._state, self._scale_name.value, number)
        self.take({name: getattr(state, name) for name in self.sliders})


GROUPS = {
    **{
        family: tuple(
            n for n in primitive_parameters.PRIMITIVES if primitive_parameters.family(n) == family
        )
        for family in primitive_parameters.FAMILIES
    },
    **{
        tool: tuple(f"{tool}/{keypoint}" for keypoint in keypoints)
        for tool, keypoints in catalogue.KEYPOINTS.items()
    },
}
"""Shapes of the catalogue by family and by tool."""


def groups(shape: str) -> tuple[str, ...]:
    """Kinds of shapes to choose from; a user's file is one while it is pressed."""
    return (*GROUPS, RANDOM, *([OWN_FILE] if group_of(shape) == OWN_FILE else []))


def group_of(shape: str) -> str:
    """The kind of a shape."""
    for group, names in GROUPS.items():
        if shape in names:
            return group
    return OWN_FILE if is_file(shape) or seed_of(shape) is None else RANDOM


def shapes_of(group: str) -> tuple[str, ...]:
    """Shapes of a kind, none of random ones and files."""
    return GROUPS.get(group, ())


def _put(slider: viser.GuiSliderHandle, value: float) -> None:
    """Sets a slider as far as it goes."""
    slider.value = min(max(value, slider.min), slider.max)


def plain(text: str) -> str:
    """Text within Markdown, as text: what is no letter, digit or usual sign goes."""
    return "".join(c if c.isalnum() or c in " .-_" else "_" for c in text)
