"""The studio's core: presses and slides a shape on both sensors and translates the image, for one
client.

A slide is a contact that continues with friction, with its path since the press. The core has no
part of the web page.
"""

from contextlib import nullcontext
from dataclasses import astuple, dataclass, replace
from math import ceil, hypot
from threading import Lock

import numpy as np

from t2twin.core.errors import T2TwinError
from t2twin.primitives_cad import catalogue
from t2twin.primitives_cad.shape import Shape
from t2twin.sim.contact.types import PressCommand, check_force
from t2twin.sim.press import Press
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
from t2twin.studio.press_state import SENSORS, PressState
from t2twin.studio.translators import Translation, Translators
from t2twin.twin import load_shape

MAX_STEPS = 3
"""Maximum number of steps of MAX_STEP_MM or MAX_STEP_DEG in one part of a slide (assumed: about
0.3 s on two cores, so that the page remains responsive)."""

PATH_FILE = "path.csv"
"""File of a path, as `t2twin slide --path` reads it."""

_catalogue_lock = Lock()
"""Held while a shape of the catalogue is loaded, so that two sessions do not build the same one."""


@dataclass(frozen=True)
class SlidePoint:
    """One step of a slide.

    row: of the path. force_n, torque_nmm: tangential force, N, and torque, N mm, by sensor.
    limit_n: coefficient of friction times the normal force, N, by sensor; 0 for the press.
    """

    row: PathRow
    force_n: dict[str, float]
    torque_nmm: dict[str, float]
    limit_n: dict[str, float]


@dataclass(frozen=True)
class Slide:
    """A slide since its press.

    state: the requested pose and force. touch: the last one, with or without image and counts.
    points: of all steps, the press first. remaining: motion to the requested pose, mm and degrees.
    """

    state: PressState
    touch: Touch
    points: tuple[SlidePoint, ...]
    remaining: tuple[float, float] = (0.0, 0.0)

    @classmethod
    def begin(cls, state: PressState, touch: Touch) -> "Slide":
        """The slide that a press begins."""
        row = PathRow(state.x_mm, state.y_mm, state.yaw_deg, touch.command.force_n)
        return cls(state, touch, (_point(row, touch),))

    def toward(self, state: PressState, sensors: SensorPair) -> "Slide":
        """The slide, continued on a straight line towards a state by at most MAX_STEPS steps.

        The force changes evenly along the line; a state with a depth keeps the force.
        Raises T2TwinError for a slide with too many steps, and as `Twin.slide` does.
        """
        row = self.points[-1].row
        force_n = state.force_n if state.depth_mm is None else row.force_n
        target = PathRow(state.x_mm, state.y_mm, state.yaw_deg, force_n)
        if target == row:
            return replace(self, state=state, remaining=(0.0, 0.0))
        if len(self.points) + MAX_STEPS > MAX_SLIDE_STEPS:
            raise T2TwinError(
                f"the slide has {len(self.points):,} steps; lift the shape off to begin another"
            )
        check_force(force_n)
        sensors.check_over_pads(self.touch, _command(self.touch, target))
        start = np.array(astuple(row))
        change = astuple(target) - start
        distance_mm, rotation_deg = hypot(change[0], change[1]), abs(float(change[2]))
        steps = ceil(max(distance_mm / MAX_STEP_MM, rotation_deg / MAX_STEP_DEG, 1.0) - ROUNDING)
        touch, points = self.touch, list(self.points)
        for step in range(1, min(steps, MAX_STEPS) + 1):
            part = PathRow(*(start + step / steps * change).tolist()) if step < steps else target
            touch = slide_to(sensors, touch, _command(touch, part), state.friction)
            points.append(_point(part, touch))
        left = max(0.0, 1.0 - MAX_STEPS / steps)
        return Slide(state, touch, tuple(points), (left * distance_mm, left * rotation_deg))

    def path_csv(self) -> str:
        """The path as the content of PATH_FILE."""
        rows = [",".join(map(repr, astuple(point.row))) for point in self.points]
        return "\n".join([",".join(PATH_COLUMNS), *rows]) + "\n"


@dataclass(frozen=True)
class PressResult:
    """The results of one press or of one part of a slide.

    slide: the slide so far, None in the motion "jump".
    """

    state: PressState
    touch: Touch
    translations: tuple[Translation, ...]
    slide: Slide | None = None

    @property
    def has_slid(self) -> bool:
        """Whether the contact has moved since its press."""
        return self.slide is not None and len(self.slide.points) > 1

    @property
    def is_behind(self) -> bool:
        """Whether a part of the slide remains."""
        return self.slide is not None and any(self.slide.remaining)

    def command_line(self) -> str:
        """The command line of this press, or of this slide with its path in PATH_FILE."""
        return self.state.command_line(PATH_FILE if self.has_slid else None)


class Session:
    """One client's shape, sensors and slide; a press rebuilds only those that changed.

    sensors: the default ones, which sessions may share. Not thread-safe.
    """

    def __init__(self, translators: Translators, sensors: SensorPair | None = None) -> None:
        self.translators = translators
        self._sensors = sensors or SensorPair()
        self._made_for = PressState()
        self._shape: tuple[tuple[str, float | None], Shape] | None = None
        self._slide: Slide | None = None

    def lift_off(self) -> None:
        """Ends the slide: the next contact is a press, without tangential traction."""
        self._slide = None

    def press(self, state: PressState, runs: tuple[str, ...] = ()) -> PressResult:
        """Press or slide, and translate the image with the runs of these names.

        In the motion "slide" a contact continues towards the state, if the state allows it, see
        `PressState.continues`. One call moves it by at most MAX_STEPS steps; `is_behind` of
        the result states whether the same call would move it further.
        Raises T2TwinError with the messages of `t2twin press` and `t2twin slide`.
        """
        sensors = self._sensors_for(state)
        rng = None if state.seed is None else np.random.default_rng(state.seed)
        if self._slide is not None and state.continues(self._slide.state):
            before, self._slide = self._slide.touch, self._slide.toward(state, sensors)
            touch = sensors.with_readings(self._slide.touch, rng, before)
            self._slide = replace(self._slide, touch=touch)
        else:
            self._slide = None
            touch = self._press(state, sensors, rng)
            self._slide = Slide.begin(state, touch) if state.motion == "slide" else None
        translations: tuple[Translation, ...] = ()
        if runs and touch.of_camera is not None:
            background = touch.of_camera.sensor.background_frame()
            translations = self.translators.translate(touch.image, runs, background, touch)
        return PressResult(state, touch, translations, self._slide)

    def _press(
        self, state: PressState, sensors: SensorPair, rng: np.random.Generator | None
    ) -> Touch:
        source = (state.shape, state.scale)
        if self._shape is None or self._shape[0] != source:
            with _catalogue_lock if state.shape in catalogue.NAMES else nullcontext():
                self._shape = (source, load_shape(*source))
        shape = self._shape[1]
        force_n = state.force_n if state.depth_mm is None else None
        pose = state.x_mm, state.y_mm, state.yaw_deg, state.tilt_x_deg, state.tilt_y_deg
        press = Press(shape.name, *pose, force_n, state.depth_mm)
        command = press.command(shape, sensors.source)
        return sensors.press(shape, command, rng)

    def _sensors_for(self, state: PressState) -> SensorPair:
        before = self._made_for
        if any(getattr(state, name) != getattr(before, name) for name in SENSORS):
            # A sensor that did not change keeps what it has computed.
            new, known = state.sensors, self._sensors.by_name.values()
            kept = (
                next((old for old in known if old == each), each)
                for each in (new.source, new.target)
            )
            self._sensors = SensorPair(*kept)
        self._made_for = state
        return self._sensors


def _command(touch: Touch, row: PathRow) -> PressCommand:
    """The command of a row of the path of a touch, whose tilt stays."""
    yaw_rad = float(np.deg2rad(row.yaw_deg))
    pose = {"x_mm": row.x_mm, "y_mm": row.y_mm, "yaw_rad": yaw_rad}
    return replace(touch.command, **pose, force_n=row.force_n)


def _point(row: PathRow, touch: Touch) -> SlidePoint:
    contacts = touch.contacts
    return SlidePoint(
        row,
        {sensor: float(np.hypot(*contact.shear_n)) for sensor, contact in contacts.items()},
        {sensor: contact.torque_nmm for sensor, contact in contacts.items()},
        {
            sensor: 0.0 if motion is None else float(motion.friction.limit_n(contact.force_n))
            for sensor, contact in contacts.items()
            for motion in [contact.motion]
        },
    )
