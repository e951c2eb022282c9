"""The panel of the press of one client, generated from the fields of PressState."""

import re
import tempfile
import traceback
from collections.abc import Callable
from functools import partial
from itertools import groupby
from pathlib import Path
from typing import Any, get_args

import viser

from t2twin.core.errors import T2TwinError
from t2twin.primitives_cad.catalogue import NAMES
from t2twin.primitives_cad.shape import RANDOM_PREFIX, SUFFIXES
from t2twin.primitives_cad.tilt import MAX_TILT_DEG
from t2twin.sim.sampling.plan import MAX_SHAPE_SEED
from t2twin.sim.sampling.protocol import FORCE_N, SCALES, indices
from t2twin.sim.sensors.defaults import ROLES
from t2twin.sim.sensors.files import bundled_sensors, load_sensor
from t2twin.sim.sensors.pair import SensorPair
from t2twin.sim.taxels.layout import layout_names
from t2twin.sim.taxels.reading import NONE
from t2twin.studio.session import Motion, PressResult, PressState, file_name, protocol_press
from t2twin.twin import load_shape

BUTTON_COLOR = "gray"  # less prominent than the sliders
UNEXPECTED = "an unexpected error occurred; its message is in the terminal of the studio"

GROUPS: dict[str, list[str]] = {
    group: list(names)
    for group, names in groupby(NAMES, lambda name: re.split(r"/|-\d+$", name)[0])
}
"""Shapes of the catalogue by family and by tool."""

RANDOM, OWN_FILES = "random shapes", "own files"
"""Groups of shapes in addition to the families and the tools."""

OWN, WHITE = "of the sensor", "white"
"""Names of the optics and of the layout in a sensor's file, and of the default imperfections."""

MAX_SEED = 2**53
"""Largest seed, which a browser's numbers represent exactly."""

MIN_SLIDER_N, MAX_SLIDER_N, MAX_FRICTION = 0.1, 20.0, 2.0
"""Range of the force slider, N (assumed: of fingers and grippers), and of friction (assumed: twice
that of rubber on dry solids)."""

SLIDERS = {
    # The sensors' widths and lengths replace these ranges, and half the source's thickness that of
    # the depth.
    "x_mm": ("x, mm", -10.0, 10.0, 0.1, "To the right in the image"),
    "y_mm": ("y, mm", -10.0, 10.0, 0.1, "Downwards in the image"),
    "yaw_deg": ("yaw, °", -180.0, 180.0, 1.0, "Rotation, clockwise in the image"),
    "tilt_x_deg": ("tilt x, °", -MAX_TILT_DEG, MAX_TILT_DEG, 0.5,
                   "A positive tilt lowers the side that is up in the image at yaw 0"),
    "tilt_y_deg": ("tilt y, °", -MAX_TILT_DEG, MAX_TILT_DEG, 0.5,
                   "A positive tilt lowers the side that is to the right at yaw 0"),
    "force_n": ("force, N", MIN_SLIDER_N, MAX_SLIDER_N, 0.1,
                "Commanded force; 8 N in the paper's protocol"),
    "depth_mm": ("depth, mm", 0.01, 2.0, 0.01,
                 "Depth in the elastomer of the source, instead of a force, which is computed"),
    "friction": ("friction", 0.0, MAX_FRICTION, 0.05,
                 "Coefficient of friction of both sensors; at first that of each one's file"),
}  # fmt: skip
"""Sliders by their field of PressState: label, range, step and hint."""

FILES = {"shape": SUFFIXES, "layout": (".json", ".csv"), "optics": (".npz",), "sensor": (".toml",)}
"""Suffixes of files by their kind."""


class Inputs:
    """Inputs of a client's page, whose errors are shown to the client.

    folder: of the client's files.
    """

    def __init__(self, client: viser.ClientHandle, folder: Path) -> None:
        self.gui, self.folder, self.is_closed = client.gui, folder, False
        self._client = client
        self._notice: viser.NotificationHandle | None = None

    def notify(self, *texts: str, **options: Any) -> None:
        """Replaces the notice; without texts, removes it."""
        if self._notice is not None:
            self._notice.remove()
        self._notice = self._client.add_notification(*texts, **options) if texts else None

    def guard(self, task: Callable[[], object]) -> None:
        """Runs a task and shows its error in place of an earlier notice."""
        try:
            task()
        except Exception as error:  # the page continues after any error
            if self.is_closed:
                return
            message = str(error)
            if not isinstance(error, T2TwinError | OSError):
                traceback.print_exc()
                message = UNEXPECTED
            self.notify("Not possible", message, color="red")

    def connect(
        self, register: Callable[[Any], Any], use: Callable[[Any], object], slow: bool = False
    ) -> None:
        """Calls `use` with the values that a client gives to an input, not those of the studio.

        register: such as `handle.on_update`. Calls are in their order, in viser's event loop; slow
        ones in threads, without an order.
        """

        def changed(event: Any) -> None:
            if event.client is not None:
                self.guard(lambda: use(event.target.value))

        async def changed_in_order(event: Any) -> None:
            changed(event)

        register(changed if slow else changed_in_order)

    def button(
        self, label: str, icon: viser.IconName, action: Callable[[], object], slow: bool = False
    ) -> viser.GuiButtonHandle:
        """A button with an action."""
        button = self.gui.add_button(label, icon=icon, color=BUTTON_COLOR)
        self.connect(button.on_click, lambda _: action(), slow)
        return button

    def upload(
        self, label: str, hint: str, use: Callable[[Path], object]
    ) -> viser.GuiUploadButtonHandle:
        """An upload button. use: receives a file of the uploaded name, in a new folder."""

        def store(file: viser.UploadedFile) -> None:
            path = Path(tempfile.mkdtemp(dir=self.folder)) / Path(file.name).name
            path.write_bytes(file.content)
            use(path)

        icon = viser.Icon.UPLOAD
        button = self.gui.add_upload_button(label, icon=icon, color=BUTTON_COLOR, hint=hint)
        self.connect(button.on_upload, store, slow=True)
        return button


class Controls:
    """The panel of the press.

    state: the requested press. handles: controls by their field of PressState. A state may contain
    values between the steps of a slider, such as those of the protocol's presses; they remain until
    the slider is moved. changed: called after a change of the state. lift_off: called before a
    press without tangential traction.
    """

    def __init__(
        self, inputs: Inputs, changed: Callable[[], object], lift_off: Callable[[], object]
    ) -> None:
        self.state, self.handles = PressState(), dict[str, Any]()
        self._inputs, self._changed, self._lift_off = inputs, changed, lift_off
        self._shown_for: tuple[str, str] | None = None  # source and target
        self._choices: dict[str, dict[str, str | None]] = {
            "shape": {},
            "source": {name: name for name in bundled_sensors()},
            "target": {name: name for name in bundled_sensors()},
            "layout": {OWN: None} | {name: name for name in layout_names()},
            "optics": {OWN: None},
            "imperfections": {WHITE: None},
        }  # values by label; of shapes, own files only
        gui = inputs.gui
        with gui.add_folder("Shape"):
            self._add_shape(gui)
        with gui.add_folder("Press"):
            self._add_press(gui)
        with gui.add_folder("Press of the paper's protocol", expand_by_default=False):
            gui.add_markdown("Presses of the simulated datasets.")
            self._scale_name = gui.add_dropdown("Scale", tuple(SCALES), initial_value="paper")
            self.number = gui.add_slider(
                "Press", 0, 1, 1, 0, hint="Number among the shape's presses at this scale"
            )
        inputs.connect(self._scale_name.on_update, lambda _: self._show())
        inputs.connect(self.number.on_update, self._number_changed)
        with gui.add_folder("Sensors", expand_by_default=False):
            self._add_sensors(gui)
        self.apply({})

    def apply(self, changes: dict[str, Any]) -> None:
        """Applies changes, shows them in the controls and reports the change."""
        self.state = self.state.with_changes(changes)
        self._show()
        self._changed()

    def show_solved_values(self, result: PressResult) -> None:
        """Shows the depth of a given force, or the force of a given depth, of the current state."""
        if result.state == self.state and result.state.depth_mm is None:
            depth_mm = next(iter(result.touch.contacts.values())).depth_mm
            _show_value(self.handles["depth_mm"], depth_mm)
        elif result.state == self.state:
            _show_value(self.handles["force_n"], result.touch.command.force_n)

    def use_file(self, path: Path) -> None:
        """Press with a file of any kind of FILES, if it is readable.

        A sensor file replaces the sensor of its kind, the source unless only the target is.
        """
        suffix = path.suffix.lower()
        field = next((kind for kind, known in FILES.items() if suffix in known), None)
        if field is None:
            known = ", ".join(each for suffixes in FILES.values() for each in suffixes)
            raise T2TwinError(f"{path.name} cannot be used; expected a file of {known}")
        if field == "sensor":
            kind = load_sensor(path).spec.kind
            kinds = [load_sensor(getattr(self.state, role)).spec.kind for role in ROLES]
            field = "target" if kinds[0] != kind == kinds[1] else "source"
        changes: dict[str, Any] = {field: str(path)}
        if field == "shape":
            load_shape(path)  # raises the error of an unreadable file, as the sensors do
            changes["scale"] = None
        state = self.state.with_changes(changes)
        SensorPair.of(state.source, state.target, **state.options)
        self._choices[field][path.name] = str(path)
        self.apply(changes)

    def _bind(self, **handles: Any) -> None:
        """Connects controls to their fields."""
        self.handles |= handles
        for name, handle in handles.items():
            self._inputs.connect(handle.on_update, partial(self._use_value, name))

    def _use_value(self, name: str, value: Any) -> None:
        """Changes a field; of a dropdown, controls that depend on it change too."""
        if isinstance(self.handles[name], viser.GuiDropdownHandle):
            self.apply({name: self._choices[name][value] if name in self._choices else value})
        else:
            self.state = self.state.with_changes({name: value})
            self._changed()

    def _add_shape(self, gui: viser.GuiApi) -> None:
        self._group = gui.add_dropdown(
            "Kind", (*GROUPS, RANDOM), hint="Primitive families, tools, random shapes"
        )
        shapes: tuple[str, ...] = (self.state.shape,)
        self._shape = gui.add_dropdown("Shape", shapes, hint="Version or keypoint")
        self._random = gui.add_number(
            "Number", 17, min=0, max=MAX_SHAPE_SEED, step=1, hint="Seed of the random shape"
        )
        self._bind(scale=gui.add_number("mm per unit", 1.0, min=1e-6, hint="25.4 for inches"))
        self.upload = self._inputs.upload(
            "Upload a file",
            "A shape (STL, STEP, OBJ, PLY, 3MF or GLB, pressing side up), a sensor (TOML), a taxel "
            "layout (JSON or CSV) or optics (NPZ of t2twin calibrate)",
            self.use_file,
        )
        self._inputs.connect(self._group.on_update, self._group_changed)
        self._inputs.connect(self._shape.on_update, self._shape_changed)
        self._inputs.connect(self._random.on_update, lambda _: self._group_changed(RANDOM))

    def _add_press(self, gui: viser.GuiApi) -> None:
        motion = gui.add_dropdown(
            "Motion", get_args(Motion),
            hint="jump: each pose is a new press; slide: the contact moves there with friction",
        )  # fmt: skip
        sliders = {
            name: gui.add_slider(label, low, high, step, max(low, 0.0), hint=hint)
            for name, (label, low, high, step, hint) in SLIDERS.items()
        }
        self._bind(motion=motion, **sliders)
        button, icons = self._inputs.button, viser.Icon
        self._lift = button("Lift off and press again", icons.ARROW_UP, self._lift_off)
        button("Reset to the center, 8 N", icons.REFRESH, self._reset)

    def _add_sensors(self, gui: viser.GuiApi) -> None:
        choices = {
            name: gui.add_dropdown(label, tuple(self._choices[name]))
            for name, label in (("source", "Source"), ("target", "Target"),
                                ("layout", "Taxels"), ("optics", "Optics"))
        }  # fmt: skip
        markers = gui.add_checkbox("Markers", False, hint="Markers printed on the gel")
        self.noise = gui.add_checkbox(
            "Noise", False, hint="Camera noise and imperfections of the array"
        )
        imperfections = gui.add_dropdown(
            "Array", (WHITE,), hint="Imperfections of the array, with noise"
        )
        seed = gui.add_number("Seed", 0, min=0, max=MAX_SEED, step=1, hint="Seed of the noise")
        self._bind(**choices, markers=markers, imperfections=imperfections, seed=seed)
        self._inputs.connect(
            self.noise.on_update, lambda on: self.apply({"seed": seed.value if on else None})
        )

    def _reset(self) -> None:
        self._lift_off()
        self.apply({name: getattr(PressState, name) for name in SLIDERS})

    def _group_changed(self, group: str) -> None:
        if group == RANDOM:
            self._shape_changed(f"{RANDOM_PREFIX}{self._random.value}")
        else:
            self._shape_changed(next(iter(GROUPS.get(group, self._choices["shape"]))))

    def _shape_changed(self, label: str) -> None:
        self.apply({"shape": self._choices["shape"].get(label, label), "scale": None})

    def _number_changed(self, number: int) -> None:
        state = protocol_press(self.state, self._scale_name.value, number)
        self.apply({name: getattr(state, name) for name in SLIDERS})

    def _show(self) -> None:
        """Shows the state in all controls."""
        state, own_files = self.state, self._choices["shape"]
        if self._shown_for != (state.source, state.target):
            self._show_sensors(SensorPair.of(state.source, state.target))
        group, names = next(
            ((group, names) for group, names in GROUPS.items() if state.shape in names),
            (OWN_FILES, list(own_files)) if state.shape in own_files.values() else (RANDOM, []),
        )
        self._group.options = (*GROUPS, RANDOM, *([OWN_FILES] if own_files else []))
        self._group.value = group
        if names:
            self._shape.options, self._shape.value = names, file_name(state.shape)
        else:
            self._random.value = int(state.shape.removeprefix(RANDOM_PREFIX))
        self._shape.visible, self._random.visible = bool(names), not names
        self.handles["scale"].visible = group == OWN_FILES
        for name, handle in self.handles.items():
            value = getattr(state, name)
            if name in self._choices:
                handle.options = tuple(self._choices[name])
                value = next(iter(handle.options)) if value is None else file_name(value)
            _show_value(handle, value)
        if state.force_n is None and state.depth_mm is None:
            self.handles["force_n"].value = FORCE_N
        if state.friction is None:
            self.handles["friction"].value = self._own_friction
        self.handles["friction"].visible = self._lift.visible = state.motion == "slide"
        self.noise.value = has_noise = state.seed is not None
        self.handles["imperfections"].visible = self.handles["seed"].visible = has_noise
        scale = SCALES[self._scale_name.value]
        presses = len(indices(state.shape, scale)) if state.shape in NAMES else 0
        self.number.max = max(presses - 1, 1)
        self.number.disabled = self._scale_name.disabled = presses == 0

    def _show_sensors(self, pair: SensorPair) -> None:
        """Shows what depends on the sensors alone."""
        self._shown_for = self.state.source, self.state.target
        sensors = pair.source, pair.target
        for name, side in (("x_mm", "width_mm"), ("y_mm", "length_mm")):
            half_mm = max(getattr(each.elastomer, side) for each in sensors) / 2
            self.handles[name].min, self.handles[name].max = -half_mm, half_mm
        thickness_mm = pair.source.elastomer.thickness_mm
        self.handles["depth_mm"].max = max(round(thickness_mm / 2, 1), 0.1)
        self._own_friction = pair.source.friction.coefficient
        names = [
            NONE,
            *(name for each in sensors for name in getattr(each.spec, "imperfections", ())),
        ]
        self._choices["imperfections"] = {WHITE: None} | {n: n for n in names if n != WHITE}
        options = {name for each in sensors for name in each.OPTIONS}
        for name in ("layout", "optics", "markers"):
            self.handles[name].visible = name in options


def _show_value(handle: Any, value: Any) -> None:
    """Sets a control, of a slider clipped to its range. A value of None leaves it unchanged."""
    if value is not None and isinstance(handle, viser.GuiSliderHandle):
        value = min(max(value, handle.min), handle.max)
    if value is not None:
        handle.value = value
