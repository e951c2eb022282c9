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
from t2twin.sim.contact.types import PressCommand, check_force
from t2twin.sim.press import Press
from t2twin.sim.sampling.protocol import FORCE_N, indices, press_of, scale_of
from t2twin.sim.sensors.defaults import ROLES, SOURCE, TARGET
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
from t2twin.sim.taxels.reading import NONE
from t2twin.sim.touch import Touch
from t2twin.studio.translators import Translation, Translators
from t2twin.twin import load_shape

FIRST_SHAPE = "square-1"  # a gel camera sees it as a whole
IMPERFECTIONS = "white"  # of arrays that have none of this name, their own

Motion = Literal["jump", "slide"]
"""What a changed pose does: a press at the new pose, or sliding there with friction."""

TILT = ("tilt_x_deg", "tilt_y_deg")

CONTACT = ("shape", "scale", "optics", "motion", "friction", "source", "target", *TILT)
"""Fields whose change lifts the shape off."""

OPTIONS = ("optics", "markers", "layout", "imperfections")
"""Options of the sensors."""

MAX_STEPS = 3
"""Maximum number of steps of MAX_STEP_MM or MAX_STEP_DEG in one part of a slide (assumed: about
0.3 s on two cores, so that the page remains responsive)."""

PATH_FILE, COMMAND_FILE = "path.csv", "command.txt"
"""Files of a download beside those of `t2twin press`: a slide's path and the command line."""


@dataclass(frozen=True)
class PressState(Press):
    """A requested press with the options of its sensors.

    scale: millimeters per unit of a file, None for the unit stated in the file. source, target,
    layout, optics: names or files; None for those of the sensor. markers: printed on the gel.
    imperfections: of an array, applied with a seed. friction: as for `Twin.slide`.
    """

    shape: str = FIRST_SHAPE
    scale: float | None = None
    source: str = SOURCE
    target: str = TARGET
    layout: str | None = None
    optics: str | None = None
    markers: bool = False
    imperfections: str = IMPERFECTIONS
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

    @property
    def sensors(self) -> SensorPair:
        """The sensors, with their options. Raises T2TwinError as `SensorPair.of` does."""
        options = {name: getattr(self, name) or None for name in OPTIONS}
        if self.imperfections == IMPERFECTIONS:
            options["imperfections"] = None
        return SensorPair.of(self.source, self.target, **options)

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

    def command_line(self, path: str | None = None) -> str:
        """The command line of this press or, with a file of its path, of this slide.

        A file is represented by its name.
        """
        words, unsaid = ["t2twin", "press", file_name(self.shape)], {"shape", "motion"}
        if path is None:
            unsaid |= {"friction"}
        else:
            words[1:] = ["slide", file_name(self.shape), "--path", path]
            unsaid |= {"x_mm", "y_mm", "yaw_deg", "force_n", "depth_mm"}
        if self.seed is None:
            unsaid |= {"imperfections"}
        for name, value in vars(self).items():
            if name not in unsaid and value != getattr(PressState, name):
                words.append(f"--{name.replace('_', '-')}")
                if name != "markers":
                    words.append(file_name(str(value)))
        return shlex.join(words)


def imperfection_names(pair: SensorPair) -> tuple[str, ...]:
    """Names of the imperfections of the arrays of a pair."""
    found = [getattr(each.spec, "imperfections", {}) for each in (pair.source, pair.target)]
    return tuple(dict.fromkeys((IMPERFECTIONS, NONE, *(name for of in found for name in of))))


def protocol_press(state: PressState, scale: str, number: int) -> PressState:
    """The state with position, yaw and force of a press of the protocol.

    number: of the press at the scale, from 0. Raises T2TwinError for a shape outside the protocol
    and a number out of range.
    """
    count = protocol_presses(state.shape, scale)
    if not 0 <= number < count:
        raise T2TwinError(
            f"scale {scale} has {count} presses of {file_name(state.shape)}; press {number} is not "
            "among them"
        )
    index = indices(state.shape, scale_of(scale))[number]
    command = press_of(state.shape, catalogue.spacing_mm(state.shape), index)
    yaw_deg = float(np.rad2deg(command.yaw_rad))
    pose = {"x_mm": command.x_mm, "y_mm": command.y_mm, "yaw_deg": yaw_deg}
    return state.with_changes(pose | dict.fromkeys(TILT, 0.0) | {"force_n": command.force_n})


def protocol_presses(shape: str, scale: str) -> int:
    """Number of presses of a shape at a scale; 0 for a shape outside the protocol."""
    return len(indices(shape, scale_of(scale))) if shape in catalogue.NAMES else 0


def file_name(source: str) -> str:
    """Displayed name of a shape, a sensor, a layout or an optics file: of a file, its name."""
    return Path(source).name if Path(source).is_absolute() else source


@dataclass(frozen=True)
class PressResult:
    """The result of one press, or of a slide so far.

    touch: the last one. rows: the path since the press. tangential: at each row, by sensor: force,
    N, torque, N mm, and limit of friction, N, 0 for the press. remaining: motion to the requested
    pose, mm and degrees.
    """

    state: PressState
    touch: Touch
    rows: tuple[PathRow, ...]
    tangential: tuple[dict[str, tuple[float, float, float]], ...]
    remaining: tuple[float, float] = (0.0, 0.0)
    translations: tuple[Translation, ...] = ()

    @property
    def has_slid(self) -> bool:
        """Whether the contact has moved since its press."""
        return len(self.rows) > 1

    def command_line(self) -> str:
        """The command line of this press, or of this slide with its path in PATH_FILE."""
        return self.state.command_line(PATH_FILE if self.has_slid else None)

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
        force_n = row.force_n if state.depth_mm is not None else state.force_n or FORCE_N
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
        for step in range(1, min(steps, MAX_STEPS) + 1):
            part = PathRow(*(start + step / steps * change).tolist()) if step < steps else target
            touch = slide_to(sensors, touch, _command(touch, part), state.friction)
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


def _tangential(touch: Touch) -> dict[str, tuple[float, float, float]]:
    """Tangential force, torque and limit of friction by sensor."""
    return {
        sensor: (
            float(np.hypot(*contact.shear_n)),
            contact.torque_nmm,
            0.0 if motion is None else float(motion.friction * contact.force_n),
        )
        for sensor, contact in touch.contacts.items()
        for motion in [contact.motion]
    }


class Session:
    """One client's shape, sensors and contact; a press rebuilds only those that changed.

    sensors: the default ones, which sessions may share. Not thread-safe.
    """

    def __init__(self, translators: Translators, sensors: SensorPair | None = None) -> None:
        self.translators = translators
        self._sensors = sensors or SensorPair()
        self._made_for = PressState()
        self._shape: tuple[tuple[str, float | None], Shape] | None = None
        self._last: PressResult | None = None

    def lift_off(self) -> None:
        """Ends the slide: the next contact is a press, without tangential traction."""
        self._last = None

    def press(self, state: PressState, runs: tuple[str, ...] = ()) -> PressResult:
        """Press or slide, and translate the image with the runs of these names.

        In the motion "slide" a contact continues towards the state, see `PressState.continues`.
        One call moves it by at most MAX_STEPS steps; then `remaining` of the result is not 0.
        Raises T2TwinError with the messages of `t2twin press` and `t2twin slide`.
        """
        sensors, before = self._sensors_for(state), self._last
        if before is not None and state.continues(before.state):
            result = before.toward(state, sensors)
            touch = sensors.with_readings(result.touch, state.rng, before.touch)
            result = replace(result, touch=touch)
        else:
            self._last = None
            touch = self._press(state, sensors)
            row = PathRow(state.x_mm, state.y_mm, state.yaw_deg, touch.command.force_n)
            result = PressResult(state, touch, (row,), (_tangential(touch),))
        self._last = result
        if not runs or touch.of_camera is None:
            return result
        background = touch.of_camera.sensor.background_frame()
        translations = self.translators.translate(touch.image, runs, background, touch)
        return replace(result, translations=translations)

    def _press(self, state: PressState, sensors: SensorPair) -> Touch:
        source = (state.shape, state.scale)
        if self._shape is None or self._shape[0] != source:
            self._shape = (source, load_shape(*source))
        shape = self._shape[1]
        return sensors.press(shape, state.command(shape, sensors.source), state.rng)

    def _sensors_for(self, state: PressState) -> SensorPair:
        """The sensors of a state; one that did not change keeps what it has computed."""
        if any(
            getattr(state, name) != getattr(self._made_for, name) for name in (*ROLES, *OPTIONS)
        ):
            new, known = state.sensors, (self._sensors.source, self._sensors.target)
            kept = (
                next((old for old in known if old == each), each)
                for each in (new.source, new.target)
            )
            self._sensors = SensorPair(*kept)
        self._made_for = state
        return self._sensors
