"""Controls of one client: shape, position, force and sensors of the press."""

from collections.abc import Callable
from typing import Any, get_args

import viser

from t2twin.primitives_cad import catalogue, primitive_parameters
from t2twin.primitives_cad.random_shapes import PREFIX, seed_of
from t2twin.sim.contact.elastomer import CYSKIN_COVER
from t2twin.sim.contact.sliding import COVER_FRICTION, GEL_FRICTION
from t2twin.sim.cyskin.reading import PRESETS
from t2twin.sim.world.presses import MAX_SHAPE_SEED
from t2twin.sim.world.protocol import SCALES
from t2twin.studio.controls.inputs import Inputs, markdown_safe
from t2twin.studio.press_state import (
    Motion,
    PressState,
    file_name,
    is_file,
    layout_names,
    protocol_press,
    protocol_presses,
)
from t2twin.studio.session import PressResult
from t2twin.studio.view.notices import Notices

RANDOM, OWN_FILE = "random shapes", "uploaded file"
"""Groups of shapes in addition to the families and the tools."""

MAX_SLIDER_N, MIN_SLIDER_N = 20.0, 0.1
"""Range of the force slider, N (assumed: forces of fingers and grippers). A link may contain any
valid force."""

MAX_SLIDER_MM, MIN_SLIDER_MM = 2.0, 0.01
"""Range of the depth slider, mm: up to half the gel's thickness, which few shapes reach with 100 N.
A link may contain any valid depth."""

STEP_MM, STEP_DEG, STEP_N, STEP_DEPTH_MM = 0.1, 1.0, 0.1, 0.01
"""Steps of the sliders."""

MAX_SLIDER_FRICTION, STEP_FRICTION = 2.0, 0.05
"""Range and step of the friction slider (assumed: rubber on dry solids). A link may contain any
valid coefficient."""

MAX_YAW_DEG = 180.0
"""Range of the yaw slider in both directions, degrees."""

DEFAULT_CALIBRATION = "default"
"""Name of the default calibration of the DIGIT."""

Change = Callable[[dict[str, Any]], PressState]
"""Changes fields of the state; returns the new state."""


class Controls:
    """The panel of the press. Inputs of the client are passed to `change` as fields of PressState.

    sliders: by their field of PressState. number: of the protocol's press. noise: checkbox. A state
    may contain values between the steps of a slider, such as those of the protocol's presses; they
    remain until the slider is moved. lift_off: called before a press without tangential traction.
    """

    def __init__(
        self,
        client: viser.ClientHandle,
        state: PressState,
        change: Change,
        lift_off: Callable[[], None],
        notices: Notices,
    ) -> None:
        self._inputs, self._change, self._lift_off = Inputs(client.gui, notices), change, lift_off
        self._state, gui = state, client.gui
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
        self._state = state
        group = group_of(state.shape)
        self._group.options = groups(state.shape)
        self._group.value = group
        self._shape.visible = group not in (RANDOM, OWN_FILE)
        self._random.visible = group == RANDOM
        self._own.visible = self._scale.visible = group == OWN_FILE
        self._own.content = f"**{markdown_safe(file_name(state.shape))}**, +z side pressed"
        if self._shape.visible:
            self._shape.options = GROUPS[group]
            self._shape.value = state.shape
        if group == RANDOM:
            self._random.value = int(state.shape.removeprefix(PREFIX))
        if state.scale is not None:
            self._scale.value = state.scale
        for name, slider in self.sliders.items():
            if getattr(state, name) is not None:
                _set_clipped(slider, getattr(state, name))
        self.motion.value = state.motion
        self.friction.visible = self._lift.visible = state.motion == "slide"
        _set_clipped(self.friction, GEL_FRICTION if state.friction is None else state.friction)
        self._layout.options = (*layout_names(), *([OWN_FILE] if is_file(state.layout) else []))
        self._layout.value = OWN_FILE if is_file(state.layout) else state.layout
        calibration = markdown_safe(file_name(state.calibration or DEFAULT_CALIBRATION))
        self._calibration.content = f"Calibration: **{calibration}**"
        self._markers.value = state.markers
        self.noise.value = state.seed is not None
        self._imperfections.value = state.imperfections
        self._imperfections.visible = self._seed.visible = state.seed is not None
        if state.seed is not None:
            self._seed.value = state.seed
        presses = protocol_presses(state.shape, self._scale_name.value)
        self.number.max = max(presses - 1, 1)
        self.number.disabled = self._scale_name.disabled = presses == 0

    def show_solved_values(self, result: PressResult) -> None:
        """Shows the depth of a given force, or the force of a given depth, of the current state."""
        if result.state != self._state:
            return
        if result.state.depth_mm is None:
            _set_clipped(self.sliders["depth_mm"], result.touch.digit.depth_mm)
        else:
            _set_clipped(self.sliders["force_n"], result.touch.command.force_n)

    def _add_shape(self, gui: viser.GuiApi) -> None:
        self._group = gui.add_dropdown(
            "Kind", groups(self._state.shape), hint="Primitive families, tools, random shapes"
        )
        self._shape = gui.add_dropdown(
            "Shape", next(iter(GROUPS.values())), hint="Version or keypoint"
        )
        self._random = gui.add_number(
            "Number", 17, min=0, max=MAX_SHAPE_SEED, step=1, hint="Seed of the random shape"
        )
        self._own = gui.add_markdown("")
        self._scale = gui.add_number(
            "mm per unit", 1.0, min=1e-6, hint="25.4 for inches, 1000 for meters"
        )
        self.upload_shape = self._inputs.upload(
            "Upload a shape",
            "STL, STEP, OBJ, PLY, 3MF or GLB, pressing side up (+z); at most 64 MB",
        )
        self._inputs.on(self._group, self._group_changed)
        self._inputs.on(self._shape, lambda name: self.apply({"shape": name, "scale": None}))
        self._inputs.on(self._random, lambda number: self._set(shape=f"{PREFIX}{number}"))
        self._inputs.on(self._scale, lambda scale: self._set(scale=scale))

    def _add_press(self, gui: viser.GuiApi) -> None:
        across, along = CYSKIN_COVER.width_mm / 2, CYSKIN_COVER.length_mm / 2
        self.motion = gui.add_dropdown(
            "Motion", get_args(Motion),
            hint="jump: each pose is a new press; slide: the contact moves there with friction",
        )  # fmt: skip
        self.sliders = {
            name: gui.add_slider(label, low, high, step, initial_value=max(low, 0.0), hint=hint)
            for name, label, low, high, step, hint in (
                ("x_mm", "x, mm", -across, across, STEP_MM, "To the right in the image"),
                ("y_mm", "y, mm", -along, along, STEP_MM, "Downwards in the image"),
                ("yaw_deg", "yaw, °", -MAX_YAW_DEG, MAX_YAW_DEG, STEP_DEG,
                 "Rotation about the press axis, clockwise in the image"),
                ("force_n", "force, N", MIN_SLIDER_N, MAX_SLIDER_N, STEP_N,
                 "Commanded force; 8 N in the paper's protocol"),
                ("depth_mm", "depth, mm", MIN_SLIDER_MM, MAX_SLIDER_MM, STEP_DEPTH_MM,
                 "Depth in the DIGIT's gel, instead of a force; the force is computed"),
            )
        }  # fmt: skip
        self.friction = gui.add_slider(
            "friction", 0.0, MAX_SLIDER_FRICTION, STEP_FRICTION, GEL_FRICTION,
            hint=f"Coefficient of friction of both sensors; until it is moved, {GEL_FRICTION} for "
            f"the gel and {COVER_FRICTION} for the cover",
        )  # fmt: skip
        self._lift = self._inputs.button(
            "Lift off and press again", viser.Icon.ARROW_UP, self._lift_off
        )
        self._inputs.button("Reset to the center, 8 N", viser.Icon.REFRESH, self._reset)
        self._inputs.on(self.motion, lambda motion: self.apply({"motion": motion}))
        for name, slider in (*self.sliders.items(), ("friction", self.friction)):
            self._inputs.on(slider, lambda value, name=name: self._set(**{name: value}))

    def _add_protocol(self, gui: viser.GuiApi) -> None:
        gui.add_markdown("Presses of the simulated datasets.")
        self._scale_name = gui.add_dropdown("Scale", tuple(SCALES), initial_value="paper")
        self.number = gui.add_slider(
            "Press", 0, 1, 1, 0, hint="Number among the shape's presses at this scale"
        )
        self._inputs.on(self._scale_name, lambda _: self.show(self._state))
        self._inputs.on(self.number, self._number_changed)

    def _add_sensors(self, gui: viser.GuiApi) -> None:
        self._layout = gui.add_dropdown("Taxels", layout_names(), hint="Taxel layout")
        self.upload_layout = self._inputs.upload(
            "Upload a layout", "JSON or CSV with x_mm and y_mm"
        )
        self._calibration = gui.add_markdown("")
        self.upload_calibration = self._inputs.upload(
            "Upload a calibration", "The .npz file of t2twin calibrate, for the light of your DIGIT"
        )
        self._inputs.button(
            "Default calibration", viser.Icon.REFRESH, lambda: self.apply({"calibration": None})
        )
        self._markers = gui.add_checkbox(
            "Markers", False, hint="Markers printed on the gel of the DIGIT"
        )
        self.noise = gui.add_checkbox(
            "Noise", False, hint="Camera noise and imperfections of the array"
        )
        self._imperfections = gui.add_dropdown(
            "Array", tuple(PRESETS), initial_value="white",
            hint="white: reading noise; baseline: also drift; all: also hysteresis and gain; "
            "recorded: as in real recordings",
        )  # fmt: skip
        self._seed = gui.add_number("Seed", 0, min=0, max=2**53, step=1, hint="Seed of the noise")
        self._inputs.on(self._layout, self._layout_changed)
        self._inputs.on(self._markers, lambda on: self._set(markers=on))
        self._inputs.on(
            self.noise, lambda on: self.apply({"seed": self._seed.value if on else None})
        )
        self._inputs.on(self._seed, lambda seed: self._set(seed=seed))
        self._inputs.on(self._imperfections, lambda name: self._set(imperfections=name))

    def _set(self, **changes: Any) -> None:
        """Applies changes that the client's controls already show."""
        self._state = self._change(changes)

    def apply(self, changes: dict[str, Any]) -> None:
        """Applies changes and shows them in the controls."""
        self.show(self._change(changes))

    def _reset(self) -> None:
        default = PressState()
        self._lift_off()
        self.apply({name: getattr(default, name) for name in (*self.sliders, "friction")})

    def _group_changed(self, group: str) -> None:
        if group == RANDOM:
            self.apply({"shape": f"{PREFIX}{self._random.value}", "scale": None})
        elif group != OWN_FILE:
            self.apply({"shape": GROUPS[group][0], "scale": None})

    def _layout_changed(self, name: str) -> None:
        if name != OWN_FILE:
            self._set(layout=name)

    def _number_changed(self, number: int) -> None:
        state = protocol_press(self._state, self._scale_name.value, number)
        self.apply({name: getattr(state, name) for name in self.sliders})


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
    """Groups of shapes; an uploaded file is a group while it is pressed."""
    return (*GROUPS, RANDOM, *([OWN_FILE] if group_of(shape) == OWN_FILE else []))


def group_of(shape: str) -> str:
    """The group of a shape."""
    for group, names in GROUPS.items():
        if shape in names:
            return group
    return OWN_FILE if is_file(shape) or seed_of(shape) is None else RANDOM


def _set_clipped(slider: viser.GuiSliderHandle, value: float) -> None:
    """Sets a slider to a value, clipped to its range."""
    slider.value = min(max(value, slider.min), slider.max)
