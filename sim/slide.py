"""Touches of a shape that slides along a path, with friction.

A path has rows of PATH_COLUMNS. The first row is a press; each further row continues the one
before. A row with force 0 lifts the shape off, and the next row with a force is a new press.
"""

from collections.abc import Iterator, Sequence
from dataclasses import astuple, dataclass, fields, replace
from math import ceil, hypot
from pathlib import Path

import numpy as np

from t2twin.core import arguments
from t2twin.core.errors import T2TwinError
from t2twin.primitives_cad.shape import Shape
from t2twin.sim.contact.elastomer import Friction
from t2twin.sim.contact.types import FORCE_RANGE_N, MAX_YAW_DEG, PressCommand
from t2twin.sim.sensors.pair import SensorPair
from t2twin.sim.tables import read_rows
from t2twin.sim.touch import Touch


@dataclass(frozen=True)
class PathRow:
    """A row of a path."""

    x_mm: float  # position of the shape's origin, right and down in the image
    y_mm: float
    yaw_deg: float  # clockwise in the image
    force_n: float  # 0 lifts the shape off


PATH_COLUMNS = tuple(field.name for field in fields(PathRow))

# Largest motion between two solutions of a slide, mm and degrees. With half of it the tangential
# force of a ball on the gel changes by less than 1 %.
MAX_STEP_MM, MAX_STEP_DEG = 0.2, 2.0
ROUNDING = 1e-6  # share of a step by which a motion may exceed whole steps, for rounding errors
# Limits on the motion of one slide, mm and degrees, and on its number of touches (assumed).
MAX_MOTION, MAX_SLIDE_STEPS = 360.0, 10_000


def straight_path(
    start: PressCommand, dx_mm: float, dy_mm: float, dyaw_deg: float, steps: int, force_n: float
) -> np.ndarray:
    """(steps + 1, 4) rows of a path from a start, whose force changes evenly to force_n.

    Raises T2TwinError for numbers out of range.
    """
    motion = [
        arguments.number(value, name, -MAX_MOTION, MAX_MOTION)
        for value, name in ((dx_mm, "dx_mm"), (dy_mm, "dy_mm"), (dyaw_deg, "dyaw_deg"))
    ]
    steps = arguments.whole_number(steps, "steps", 1, MAX_SLIDE_STEPS)
    row = _row(start)
    return np.linspace(row, [*(row[:3] + motion), force_n], steps + 1)


def read_path(file: Path) -> np.ndarray:
    """(n, 4) the path in a CSV file with PATH_COLUMNS. Raises T2TwinError for another content."""
    rows = read_rows(file, PathRow)
    return np.reshape([astuple(row) for row in rows], (-1, len(PATH_COLUMNS)))


def path_commands(
    shape: str,
    path: Sequence[Sequence[float]] | np.ndarray,
    source: str = "path",
    tilt_rad: tuple[float, float] = (0.0, 0.0),
) -> list[PressCommand]:
    """The validated commands of a path, (n, 4) rows of PATH_COLUMNS; source: for messages.

    Raises T2TwinError for another shape, values out of range, and a path without contact.
    """
    rows = arguments.array(path, source)
    if rows.ndim != 2 or rows.shape[1] != len(PATH_COLUMNS):
        raise T2TwinError(
            f"{source} has shape {rows.shape}; expected (n, 4), rows of {', '.join(PATH_COLUMNS)}"
        )
    if not 1 <= len(rows) <= MAX_SLIDE_STEPS + 1:
        raise T2TwinError(f"{source} has {len(rows)} rows; expected 1 to {MAX_SLIDE_STEPS + 1:,}")
    low, high = FORCE_RANGE_N
    before = rows[0]
    for number, row in enumerate(rows, start=1):
        place, force_n = f"{source}, row {number}", row[3]
        if not np.isfinite(row).all():
            raise T2TwinError(f"{place} is {row.tolist()}; expected finite numbers")
        if force_n and not low <= force_n <= high:
            raise T2TwinError(
                f"{place}: force_n is {force_n:g}; expected 0 or a force from {low:g} to {high:g} N"
            )
        arguments.number(row[2], f"{place}: yaw_deg", -MAX_YAW_DEG, MAX_YAW_DEG)
        if force_n and before[3] and abs(row[2] - before[2]) > MAX_MOTION:
            raise T2TwinError(
                f"{place}: yaw_deg is {row[2]:g} after {before[2]:g}; expected a rotation of at "
                f"most {MAX_MOTION:g} degrees between two rows"
            )
        before = row
    if not rows[:, 3].any():
        raise T2TwinError(f"{source} has no row with contact; expected a force_n above 0 N")
    return _commands(PressCommand(shape, 0.0, 0.0, 0.0, 0.0, *tilt_rad), rows.astype(float))


def touches_along(
    sensors: SensorPair, shape: Shape, commands: Sequence[PressCommand], friction: Friction | None,
    rng: np.random.Generator | None, only: str | None = None,
) -> Iterator[Touch]:  # fmt: skip
    """The touches of a path, one for each command; rng, only: as for `SensorPair.press`.

    Raises T2TwinError as `solve_contact`, before the first slide if no part of the shape would lie
    over a pad in some row.
    """
    touch, is_checked = None, False
    for number, command in enumerate(commands, start=1):
        if touch is None or not touch.contacts or command.force_n == 0:
            touch = sensors.press(shape, command, rng, only=only, before=touch)
        else:
            moved = slide_to(sensors, touch, command, friction)
            touch = sensors.with_readings(moved, rng, before=touch)
        if touch.contacts and not is_checked:
            is_checked = True
            for later in commands[number:]:
                if later.force_n:
                    sensors.check_over_pads(touch, later)
        yield touch


def slide_to(
    sensors: SensorPair,
    touch: Touch,
    command: PressCommand,
    friction: Friction | dict[str, Friction] | None,
) -> Touch:
    """Slide the shape of a touch to another pose and force, in steps of at most MAX_STEP_MM and
    MAX_STEP_DEG; without images and counts. Raises T2TwinError as `solve_contact` does."""
    start, end = _row(touch.command), _row(command)
    change = end - start
    steps = max(hypot(change[0], change[1]) / MAX_STEP_MM, abs(change[2]) / MAX_STEP_DEG)
    parts = max(1, ceil(steps - ROUNDING))
    for part in _commands(command, np.linspace(start, end, parts + 1)[1:]):
        touch = sensors.advance(touch, part, friction)
    return touch


def _row(command: PressCommand) -> np.ndarray:
    """(4,) a command as a row of PATH_COLUMNS."""
    yaw_deg = float(np.rad2deg(command.yaw_rad))
    return np.array([command.x_mm, command.y_mm, yaw_deg, command.force_n])


def _commands(like: PressCommand, rows: np.ndarray) -> list[PressCommand]:
    """Commands of rows of PATH_COLUMNS, (n, 4), of the shape and the tilt of another command."""
    return [
        replace(like, x_mm=x_mm, y_mm=y_mm, yaw_rad=float(np.deg2rad(yaw_deg)), force_n=force_n)
        for x_mm, y_mm, yaw_deg, force_n in rows.tolist()
    ]
