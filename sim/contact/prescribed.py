"""Contacts under prescribed forces and torques, as a physics engine gives them.

The rigid motions of the bodies are the multipliers of Kalker's problem
(`t2twin.sim.contact.friction`) with the forces and torques as constraints. The problem stays
convex. A body slides as a whole where friction cannot carry its force and torque.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from t2twin.core import arguments
from t2twin.core.errors import T2TwinError
from t2twin.primitives_cad.shape import NOTHING_MM, HeightMap, Shape
from t2twin.sim.contact.contact_solver import solve_bodies
from t2twin.sim.contact.elastomer import Elastomer
from t2twin.sim.contact.friction import (
    AT_LIMIT,
    PREDICTION_TOLERANCE,
    TOLERANCE,
    Bodies,
    balance,
    solve_traction,
)
from t2twin.sim.contact.grid import Window, dilated, window_around
from t2twin.sim.contact.heights import heights_at
from t2twin.sim.contact.layer import DomedLayer
from t2twin.sim.contact.sliding import Drive, Traction, step_contact, still_motion
from t2twin.sim.contact.types import Contact, Motion, PressCommand

# Of the search for the largest torque that friction can carry (assumed): the rotation times the
# radius of gyration, mm. Below a motion of STICK_MM a cell's traction is below the limit.
TURN_MM, STICK_MM = 1.0, 1e-3
# A body whose force exceeds the limit of friction by this share slides along its prescribed motion.
# Below, its direction is between those of the force and the motion. A motion of MOTION_MM counts
# half. Both are assumed.
MOTION_EXCESS, MOTION_MM = 0.05, 0.02


@dataclass(frozen=True)
class Load:
    """What one body does to a sensor, in the sensor frame.

    shape: the body. The height map of its surface is that of a press at x = y = yaw = 0.
    force_n: normal force, N. shear_n: (2,) tangential force on the sensor along x and y, N.
    torque_nmm: torque on the sensor about its z axis, clockwise in the image, N mm.
    motion: (dx_mm, dy_mm, dyaw_rad) of the body's surface along the sensor since the last contact;
    the rotation is about the sensor's z axis. None for a new place of contact, without traction.
    Raises T2TwinError for values that are not finite numbers.
    """

    shape: Shape
    force_n: float
    shear_n: tuple[float, float]
    torque_nmm: float
    motion: tuple[float, float, float] | None
    friction: float

    def __post_init__(self) -> None:
        arguments.number(self.force_n, "force_n")
        arguments.number(self.torque_nmm, "torque_nmm")
        for name in ("shear_n", "motion"):
            for value in getattr(self, name) or ():
                arguments.number(float(value), name)


def owner_of(contact: Contact, names: tuple[str, ...]) -> np.ndarray:
    """(ny, nx) index among the names of the body that presses most on each cell of a contact.

    0 where no body presses. -1 where the body is not among the names, unless both the contact and
    the names are of one body.
    """
    before = contact.bodies
    if len(before) == len(names) == 1:
        return np.zeros(contact.pressure_kpa.shape, int)
    indices = np.array([names.index(name) if name in names else -1 for name in before])
    return np.where(contact.pressure_kpa > 0, indices[contact.owner], 0)


def carry(
    elastomer: Elastomer, pitch_mm: float, loads: Sequence[Load], before: Contact | None
) -> Contact:
    """The contact of bodies with an elastomer, on a grid of pitch_mm.

    loads: one for each body; their shapes have different names. before: the last contact, None for
    none. Where a body with a motion was in contact, the tangential traction continues. The given
    contact does not change.
    The normal forces, tangential forces and torques of the result are those of the loads, as far as
    friction can carry them. A body whose force and torque it cannot carry slides as a whole.
    Raises T2TwinError as solve_contact does.
    """
    if not loads:
        raise T2TwinError("there is no load; expected at least one")
    shapes = [load.shape for load in loads]
    names = tuple(shape.name for shape in shapes)
    commands = [PressCommand(load.shape.name, 0.0, 0.0, 0.0, load.force_n) for load in loads]
    bodies = list(zip(shapes, commands, strict=True))
    near = before
    continuing = [load.shape.name for load in loads if load.motion is not None]
    if before is None or (len(loads) > 1 and not set(names) <= {*before.bodies} & {*continuing}):
        near = solve_bodies(bodies, elastomer, pitch_mm, before and before.shift)
    assert near is not None
    if before is None and not any(np.any(load.shear_n) or load.torque_nmm for load in loads):
        return _with_all_shapes(near, shapes)
    frictions = [load.friction for load in loads]
    start = still_motion(near, frictions[0])
    if before is not None:
        start = _kept_traction(before.motion or start, before, near, continuing)
    start = replace(start, friction=frictions[0])
    found = step_contact(near, start, bodies, _drive(loads), prescribed=True)
    if len(loads) > 1 and found.motion is not None:
        friction = np.array(frictions)[owner_of(found, names)]
        found = replace(found, motion=replace(found.motion, friction=friction))
    return _with_all_shapes(found, shapes)


def _kept_traction(
    motion: Motion, before: Contact, now: Contact, continuing: Sequence[str]
) -> Motion:
    """The motion of a contact before, whose traction is zero where a cell has another body now."""
    if len(before.bodies) == len(now.bodies) == 1:
        return motion
    owner = owner_of(before, now.bodies)
    kept = np.isin(np.array(now.bodies), continuing)[owner] & (owner >= 0)
    kept &= (owner == owner_of(now, now.bodies)) | ~(now.pressure_kpa > 0)
    # The response to the traction before is no longer that of the motion.
    return Motion(motion.friction, motion.shear_mpa * kept, motion.slip_mm)


def _with_all_shapes(contact: Contact, shapes: Sequence[Shape]) -> Contact:
    """A contact of several bodies with the highest of their maps as its shape."""
    if len(shapes) == 1:
        return contact
    depths_mm = contact.equilibrium.shape_depths_mm
    maps = _on_one_grid([shape.surface for shape in shapes])
    heights = [
        each.heights_mm + np.float32(offset)
        for each, offset in zip(maps, depths_mm - depths_mm.max(), strict=True)
    ]
    highest = np.maximum(np.maximum.reduce(heights), np.float32(NOTHING_MM))
    surface = HeightMap(highest, maps[0].x_mm, maps[0].y_mm)
    name = " and ".join(shape.name for shape in shapes)
    shape = Shape(name, shapes[0].solid, surface, shapes[0].spacing_mm)
    force_n = float(contact.equilibrium.forces_n.sum())
    return replace(
        contact, shape=shape, command=replace(contact.command, shape=name, force_n=force_n)
    )


def _on_one_grid(maps: Sequence[HeightMap]) -> list[HeightMap]:
    """Height maps on the same axes: those of the finest pitch that reach as far as all maps."""
    first = maps[0]
    if all(
        np.array_equal(each.x_mm, first.x_mm) and np.array_equal(each.y_mm, first.y_mm)
        for each in maps
    ):
        return list(maps)
    pitch = min(each.pitch_mm for each in maps)
    x, y = (
        np.arange(
            min(getattr(each, axis)[0] for each in maps),
            max(getattr(each, axis)[-1] for each in maps) + pitch / 2,
            pitch,
        )
        for axis in ("x_mm", "y_mm")
    )
    here = PressCommand("", 0.0, 0.0, 0.0, 0.0)  # y of a pressed shape points down
    return [HeightMap(heights_at(each, here, x, -y), x, y) for each in maps]


def _drive(loads: Sequence[Load]) -> Drive:
    """What moves bodies with prescribed forces and torques in a step."""

    def drive(
        contact: Contact, layer: DomedLayer, lateral_mm: np.ndarray, window: Window
    ) -> tuple[np.ndarray, Traction]:
        axes = contact.x_mm[window[1]], contact.y_mm[window[0]]
        names = tuple(load.shape.name for load in loads)
        predicts = True

        def solve(
            normal: Contact, spread: np.ndarray, dome: np.ndarray, guess: np.ndarray
        ) -> tuple[np.ndarray, np.ndarray, bool]:
            nonlocal predicts
            owner = owner_of(normal, names)[window]
            pressure = 1e-3 * normal.pressure_kpa[window] * (owner >= 0)
            is_first, predicts = predicts, False
            if is_first:  # a prediction, from the pressure of the contact before
                pressure = _rescaled(loads, pressure, owner, contact.pitch_mm)
            friction = np.array([load.friction for load in loads])[owner]
            limit = layer.limit_mpa(friction, pressure)
            traction, follows = np.zeros_like(guess), lateral_mm.copy()
            if not limit.any():
                return traction, follows, True
            near = window_around(dilated(pressure > 0, 1))
            part = (slice(None), *near)
            bodies = _Bodies(
                loads, owner[near], pressure[near], limit[near],
                (axes[0][near[1]], axes[1][near[0]]), contact.pitch_mm,
            )  # fmt: skip
            found = solve_traction(
                layer.middle, bodies.limit, lateral_mm[part] - spread[part] - dome[part],
                guess[part], bodies.arrays, PREDICTION_TOLERANCE if is_first else TOLERANCE,
            )  # fmt: skip
            traction[part] = found.q_mpa
            sheared = found.displacement_mm + spread[part] + dome[part]
            if is_first:  # the contact moves with the bodies, less the change of the shear
                follows[part] = bodies.with_motion_mm(bodies.motions, lateral_mm[part])
            else:
                follows[part] = bodies.follows_mm(lateral_mm[part], sheared)
            return traction, follows, found.converged

        return lateral_mm, solve

    return drive


def _rescaled(
    loads: Sequence[Load], pressure: np.ndarray, owner: np.ndarray, pitch_mm: float
) -> np.ndarray:
    """The pressure with the bodies' forces, where it is not zero."""
    totals = [pressure[owner == body].sum() * pitch_mm**2 for body in range(len(loads))]
    shares = [
        load.force_n / total if total > 0 else 1.0
        for load, total in zip(loads, totals, strict=True)
    ]
    return pressure * np.array(shares)[owner]


class _Bodies:
    """Bodies with prescribed wrenches on a window; see `balance` for wrenches and motions."""

    def __init__(
        self,
        loads: Sequence[Load],
        owner: np.ndarray,
        pressure: np.ndarray,
        limit: np.ndarray,
        axes: tuple[np.ndarray, np.ndarray],
        pitch_mm: float,
    ) -> None:
        self.limit = np.ascontiguousarray(limit, np.float32)
        self.owner = np.ascontiguousarray(owner, np.int64)
        self.x, self.y = (axis.copy() for axis in axes)
        self.levers = np.array(
            [self._lever(pressure * (owner == body), pitch_mm) for body in range(len(loads))]
        )
        self.wrenches = np.array(
            [_wrench(*pair, pitch_mm) for pair in zip(loads, self.levers, strict=True)]
        )
        self.rigid = np.zeros((len(loads), 3))
        self.slides = np.zeros(len(loads), bool)
        self.motions = np.array([_motion(*pair) for pair in zip(loads, self.levers, strict=True)])
        for body in range(len(loads)):
            self._find_slide(body)

    def _lever(self, pressure: np.ndarray, pitch_mm: float) -> tuple[float, float, float]:
        """Center and radius of gyration of a pressure, mm."""
        total = pressure.sum()
        if total == 0:
            return 0.0, 0.0, 1.0
        down, across = pressure.sum(axis=1) / total, pressure.sum(axis=0) / total
        x, y = float(across @ self.x), float(down @ self.y)
        square = float(across @ (self.x - x) ** 2 + down @ (self.y - y) ** 2)
        return x, y, max(np.sqrt(square), pitch_mm)

    def _find_slide(self, body: int) -> None:
        """Set whether a body slides as a whole, and along which motion; the force has priority."""
        limit = np.where(self.owner == body, self.limit, np.float32(0.0))
        capacity, wrench = float(limit.sum(dtype=float)), self.wrenches[body]
        if capacity == 0:
            self.slides[body], self.rigid[body] = True, self.motions[body]
            return
        force = float(np.hypot(*wrench[:2])) / capacity
        if force >= 1 - AT_LIMIT:
            along, motion = np.array([*wrench[:2], 0.0]) / (force * capacity), self.motions[body]
            length = max(float(np.linalg.norm(motion)), 1e-30)
            share = min(max(force - 1.0, 0.0) / MOTION_EXCESS, 1.0) * length / (length + MOTION_MM)
            ahead = max(float(along @ motion), 0.0) / length
            self.slides[body] = True
            self.rigid[body] = (1 - share) * along + share * ahead * motion / length
        elif wrench[2]:
            none, found = np.zeros((2, *limit.shape), np.float32), np.zeros(3)
            found[2] = np.copysign(TURN_MM, wrench[2])
            balance(
                none, none, float(limit.max()) / STICK_MM, limit, self.arrays, body, capacity,
                False, found,
            )  # fmt: skip
            self.slides[body] = abs(wrench[2]) >= (1 - AT_LIMIT) * self._torque(limit, found, body)
            self.rigid[body] = self.slides[body] * found

    def _torque(self, limit: np.ndarray, rigid: np.ndarray, body: int) -> float:
        """Size of the torque of a body that slides along a rigid motion, see `balance`."""
        turn_x, turn_y = (
            (self.levers[body, 1] - self.y[:, None]) / self.levers[body, 2],
            (self.x - self.levers[body, 0]) / self.levers[body, 2],
        )
        along_x, along_y = rigid[0] + turn_x * rigid[2], rigid[1] + turn_y * rigid[2]
        sizes = np.maximum(np.hypot(along_x, along_y), STICK_MM)
        return abs(float((limit / sizes * (turn_x * along_x + turn_y * along_y)).sum()))

    @property
    def arrays(self) -> Bodies:
        """Arguments of the compiled loops."""
        return (
            self.x, self.y, self.owner, self.levers, self.wrenches, self.slides, self.rigid
        )  # fmt: skip

    def follows_mm(self, before_mm: np.ndarray, now_mm: np.ndarray) -> np.ndarray:
        """(2, rows, columns) displacement, mm, of a surface that sticks to the bodies."""
        rigid = np.where(self.slides[:, None], self.motions, self.rigid)
        return self.with_motion_mm(rigid, np.where(self.slides[self.owner], now_mm, before_mm))

    def with_motion_mm(self, rigid: np.ndarray, displacement_mm: np.ndarray) -> np.ndarray:
        """A displacement, (2, rows, columns), mm, and rigid motions, (bodies, 3), together."""
        found = displacement_mm.copy()
        for body, (along_x, along_y, turn) in enumerate(rigid):
            (x, y, radius), here = self.levers[body], self.owner == body
            found[0] += here * (along_x - turn / radius * (self.y[:, None] - y))
            found[1] += here * (along_y + turn / radius * (self.x - x))
        return found


def _wrench(load: Load, lever: np.ndarray, pitch_mm: float) -> np.ndarray:
    """(3,) the wrench of a load about a lever, see `balance`."""
    (along_x, along_y), (x, y, radius) = load.shear_n, lever
    torque = load.torque_nmm - (x * along_y - y * along_x)
    return np.array([along_x, along_y, torque / radius]) / pitch_mm**2


def _motion(load: Load, lever: np.ndarray) -> np.ndarray:
    """(3,) the rigid motion of a load about a lever, see `balance`."""
    (dx_mm, dy_mm, turn), (x, y, radius) = load.motion or (0.0, 0.0, 0.0), lever
    return np.array([dx_mm - turn * y, dy_mm + turn * x, turn * radius])
