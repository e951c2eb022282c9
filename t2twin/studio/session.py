"""The studio without its page: presses and slides a shape on both sensors, and translates the
image, for one client."""

import shlex
from dataclasses import astuple, dataclass, replace
from math import ceil, hypot
from pathlib import Path
from typing import Any, Literal

import numpy as np

from t2twin.core.errors import T2TwinError
from t2twin.primitives_cad import catalogue
from t2twin.primitives_cad.shape import Shape
from t2twin.sim.contact.elastomer import Friction
from t2twin.sim.contact.types import PressCommand, check_force
from t2twin.sim.press import OPTIONS, Press
from t2twin.sim.sampling.protocol import FORCE_N, SCALES, indices, press_of
from t2twin.sim.sensors.defaults import ROLES
from t2twin.sim.sensors.pair import SensorPair
from t2twin.sim.slide import (
    MAX_SLIDE_STEPS,
    MAX_STEP_DEG,
    MAX_STEP_MM,
    PATH_COLUMNS,
    ROUNDING,
    PathRow,
    slide_to,
)
from t2twin.sim.touch import Touch
from t2twin.studio.translators import Translation, Translators
from t2twin.twin import load_shape

FIRST_SHAPE = "square-1"  # a gel camera sees it as a whole

Motion = Literal["jump", "slide"]
"""What a changed pose does: a press at the new pose, or sliding there with friction."""

TILT = ("tilt_x_deg", "tilt_y_deg")

CONTACT = ("shape", "scale", "optics", "motion", "friction", *ROLES, *TILT)
"""Fields whose change lifts the shape off."""

MAX_STEPS = 3
"""Maximum number of steps of MAX_STEP_MM or MAX_STEP_DEG in one part of a slide (assumed: about
0.3 s on two cores, so that the page remains responsive)."""

PATH_FILE, COMMAND_FILE = "path.csv", "command.txt"
"""Files of a download beside those of `t2twin press`: a slide's path and the command line."""


@dataclass(frozen=True)
class PressState(Press):
    """A requested press. motion: see Motion. friction: as for `Twin.slide`."""

    shape: str = FIRST_SHAPE
    motion: Motion = "jump"
    friction: float | None = None

    def with_changes(self, changes: dict[str, Any]) -> "PressState":
        """The press with changed fields. A changed force replaces the depth, and vice versa.

        A changed sensor begins with its own options.
        """
        if any(changes.get(role, getattr(self, role)) != getattr(self, role) for role in ROLES):
            changes = {name: getattr(PressState, name) for name in OPTIONS} | changes
        if changes.get("depth_mm") is not None:
            changes = changes | {"force_n": None}
        elif "force_n" in changes:
            changes = changes | {"depth_mm": None}
        return replace(self, **changes)

    def continues(self, before: "PressState") -> bool:
        """Whether the contact of another state can slide to this one.

        A change of CONTACT or to another depth lifts the shape off. A changed pose, force, layout
        or noise continues the contact.
        """
        return (
            self.motion == "slide"
            and all(getattr(self, name) == getattr(before, name) for name in CONTACT)
            and self.depth_mm in (None, before.depth_mm)
        )


def protocol_press(state: PressState, scale: str, number: int) -> PressState:
    """The state with position, yaw and force of a press of the protocol, by its number at a scale,
    from 0."""
    index = indices(state.shape, SCALES[scale])[number]
    spacing_mm = catalogue.properties(state.shape)["spacing_mm"]
    command = press_of(state.shape, spacing_mm, index)
    yaw_deg = float(np.rad2deg(command.yaw_rad))
    pose = {"x_mm": command.x_mm, "y_mm": command.y_mm, "yaw_deg": yaw_deg}
    return state.with_changes(pose | dict.fromkeys(TILT, 0.0) | {"force_n": command.force_n})


def file_name(source: str) -> str:
    """Displayed name of a shape, a sensor, a layout or an optics file: of a file, its name."""
    return Path(source).name if Path(source).is_absolute() else source


Tangential = dict[str, tuple[float, float, float]]
"""Tangential force, N, torque, N mm, and limit of friction, N, 0 for a press, by sensor."""


@dataclass(frozen=True)
class PressResult:
    """The result of one press, or of a slide so far."""

    state: PressState
    touch: Touch  # the last one
    rows: tuple[PathRow, ...]  # the path since the press
    tangential: tuple[Tangential, ...]  # at each row
    remaining: tuple[float, float] = (0.0, 0.0)  # motion to the requested pose, mm and degrees
    translations: tuple[Translation, ...] = ()

    @property
    def has_slid(self) -> bool:
        """Whether the contact has moved since its press."""
        return len(self.rows) > 1

    def command_line(self) -> str:
        """The command line of this press, or of this slide with its path in PATH_FILE.

        A file is represented by its name.
        """
        state = self.state
        words, unsaid = ["t2twin", "press", file_name(state.shape)], {"shape", "motion", "friction"}
        if self.has_slid:
            words[1:] = ["slide", file_name(state.shape), "--path", PATH_FILE]
            unsaid = {"shape", "motion", "x_mm", "y_mm", "yaw_deg", "force_n", "depth_mm"}
        if state.seed is None:
            unsaid |= {"imperfections"}
        for name, value in vars(state).items():
            if name not in unsaid and value != getattr(PressState, name):
                words.append(f"--{name.replace('_', '-')}")
                if name != "markers":
                    words.append(file_name(str(value)))
        return shlex.join(words)

    def save(self, folder: Path) -> None:
        """Writes the folder of `t2twin press` with the command line and, of a slide, its path."""
        self.touch.save(folder)
        (folder / COMMAND_FILE).write_text(self.command_line() + "\n")
        if self.has_slid:
            rows = [",".join(map(repr, astuple(row))) for row in self.rows]
            (folder / PATH_FILE).write_text("\n".join([",".join(PATH_COLUMNS), *rows]) + "\n")

    def toward(self, state: PressState, sensors: SensorPair) -> "PressResult":
        """The slide, continued on a straight line towards a state by at most MAX_STEPS steps.

        The touch has no image and no counts, unless nothing moves. The force changes evenly; a
        state with a depth keeps the force. Raises T2TwinError for a slide with too many steps, and
        as `Twin.slide` does.
        """
        row = self.rows[-1]
        wanted_n = FORCE_N if state.force_n is None else state.force_n
        force_n = row.force_n if state.depth_mm is not None else wanted_n
        target = PathRow(state.x_mm, state.y_mm, state.yaw_deg, force_n)
        if target == row:
            return replace(self, state=state, remaining=(0.0, 0.0))
        if len(self.rows) + MAX_STEPS > MAX_SLIDE_STEPS:
            raise T2TwinError(
                f"the slide has {len(self.rows):,} steps; lift the shape off to begin another"
            )
        check_force(force_n)
        sensors.check_over_pads(self.touch, _command(self.touch, target))
        start = np.array(astuple(row))
        change = astuple(target) - start
        distance_mm, rotation_deg = hypot(change[0], change[1]), abs(float(change[2]))
        steps = ceil(max(distance_mm / MAX_STEP_MM, rotation_deg / MAX_STEP_DEG, 1.0) - ROUNDING)
        touch, rows, tangential = self.touch, list(self.rows), list(self.tangential)
        friction = None if state.friction is None else Friction(state.friction)
        for step in range(1, min(steps, MAX_STEPS) + 1):
            part = PathRow(*(start + step / steps * change).tolist()) if step < steps else target
            touch = slide_to(sensors, touch, _command(touch, part), friction)
            rows.append(part)
            tangential.append(_tangential(touch))
        left = max(0.0, 1.0 - MAX_STEPS / steps)
        remaining = left * distance_mm, left * rotation_deg
        return PressResult(state, touch, tuple(rows), tuple(tangential), remaining)


def _command(touch: Touch, row: PathRow) -> PressCommand:
    """The command of a row of the path of a touch, whose tilt stays."""
    yaw_rad = float(np.deg2rad(row.yaw_deg))
    pose = {"x_mm": row.x_mm, "y_mm": row.y_mm, "yaw_rad": yaw_rad}
    return replace(touch.command, **pose, force_n=row.force_n)


def _tangential(touch: Touch) -> Tangential:
    """Tangential force, torque and limit of friction by sensor."""
    return {
        sensor: (
            float(np.hypot(*contact.shear_n)),
            contact.torque_nmm,
            0.0 if motion is None else motion.friction[0].limit_n(contact.force_n),
        )
        for sensor, contact in touch.contacts.items()
        for motion in [contact.motion]
    }


class Session:
    """One client's shape, sensors and contact; a press rebuilds only those that changed.

    translators: None for presses without translations. Not thread-safe, except `lift_off`.
    """

    def __init__(self, translators: Translators | None = None) -> None:
        self.translators = translators
        self._sensors, self._made_for = SensorPair(), dict[str, Any]()
        self._shape: tuple[tuple[str, float | None], Shape] | None = None
        self._last: PressResult | None = None
        self._is_lifted = False

    def lift_off(self) -> None:
        """Ends the slide: the next contact is a press, without tangential traction."""
        self._is_lifted = True

    def press(self, state: PressState, runs: tuple[str, ...] = ()) -> PressResult:
        """Press or slide, and translate the image with the runs of these names.

        In the motion "slide" a contact continues towards the state, see `PressState.continues`.
        One call moves it by at most MAX_STEPS steps; then `remaining` of the result is not 0.
        Raises T2TwinError with the messages of `t2twin press` and `t2twin slide`.
        """
        sensors = self._sensors_for(state)
        before, self._is_lifted = None if self._is_lifted else self._last, False
        if before is not None and state.continues(before.state):
            result = before.toward(state, sensors)
            touch = sensors.with_readings(result.touch, state.rng, before.touch)
            result = replace(result, touch=touch)
        else:
            self._last = None
            source = (state.shape, state.scale)
            if self._shape is None or self._shape[0] != source:
                self._shape = (source, load_shape(*source))
            shape = self._shape[1]
            touch = sensors.press(shape, state.command(shape, sensors.source), state.rng)
            row = PathRow(state.x_mm, state.y_mm, state.yaw_deg, touch.command.force_n)
            result = PressResult(state, touch, (row,), (_tangential(touch),))
        self._last = result
        if self.translators is None or not runs or touch.of_camera is None:
            return result
        background = touch.of_camera.sensor.background_frame()
        translations = self.translators.translate(touch.image, runs, background, touch)
        return replace(result, translations=translations)

    def _sensors_for(self, state: PressState) -> SensorPair:
        """The sensors of a state; one that did not change keeps what it has computed."""
        wanted = {"source": state.source, "target": state.target, **state.options}
        if wanted != self._made_for:
            new, known = SensorPair.of(**wanted), (self._sensors.source, self._sensors.target)
            kept = [next((old for old in known if old == each), each)
                    for each in (new.source, new.target)]  # fmt: skip
            self._sensors, self._made_for = SensorPair(*kept), wanted
        return self._sensors
