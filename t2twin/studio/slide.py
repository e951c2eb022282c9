"""A slide of one client: a contact that continues with friction, and its path since the press."""

from dataclasses import astuple, dataclass, replace
from math import ceil, hypot

import numpy as np

from t2twin.core.errors import T2TwinError
from t2twin.sim.contact.types import PressCommand, check_force
from t2twin.sim.sensors import SensorPair
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
from t2twin.studio.press_state import PressState

MAX_STEPS = 3
"""Maximum number of steps of MAX_STEP_MM or MAX_STEP_DEG in one part of a slide (assumed: about
0.3 s on two cores, so that the page remains responsive)."""

PATH_FILE = "path.csv"
"""File of a path, as `t2twin slide --path` reads it."""


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


def _command(touch: Touch, row: PathRow) -> PressCommand:
    yaw_rad = float(np.deg2rad(row.yaw_deg))
    return PressCommand(touch.command.shape, row.x_mm, row.y_mm, yaw_rad, row.force_n)


def _point(row: PathRow, touch: Touch) -> SlidePoint:
    contacts = touch.contacts
    return SlidePoint(
        row,
        {sensor: float(np.hypot(*contact.shear_n)) for sensor, contact in contacts.items()},
        {sensor: contact.torque_nmm for sensor, contact in contacts.items()},
        {
            sensor: 0.0 if contact.motion is None else contact.motion.friction * contact.force_n
            for sensor, contact in contacts.items()
        },
    )
