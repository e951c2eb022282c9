"""A contact in motion: the shape slides and turns while it is pressed.

The normal contact and the friction are solved in turn until the displacement by shear no longer
changes. The normal contact sees the shape over the sheared surface: a point that is displaced by u
meets the shape at its place plus u. The friction sees the new pressure. The tangential response is
linear: a neo-Hookean solid in simple shear has a stress proportional to the strain (Treloar, The
Physics of Rubber Elasticity, 1975).
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, ClassVar, NamedTuple, TypeAlias

import numpy as np

from t2twin.core.jit import compiled
from t2twin.primitives_cad.shape import NOTHING_MM, HeightMap, Shape
from t2twin.sim.contact.contact_solver import solve_bodies
from t2twin.sim.contact.displacements import is_small, means, moved, unfolded
from t2twin.sim.contact.elastomer import Elastomer, Friction
from t2twin.sim.contact.friction import (
    AT_LIMIT,
    NO_BODIES,
    PREDICTION_TOLERANCE,
    TOLERANCE,
    Bodies,
    additional_compliance,
    balance,
    solve_traction,
)
from t2twin.sim.contact.grid import Window, dilated, window_around, window_shape
from t2twin.sim.contact.heights import heights_at
from t2twin.sim.contact.layer import DomedLayer
from t2twin.sim.contact.pin_layout import OffPadError
from t2twin.sim.contact.solver_loops import anderson
from t2twin.sim.contact.types import Contact, Motion, PressCommand, SurfaceShift, limit_mpa

# Share of an error that a correction removes, before it is mixed with the earlier ones by Anderson
# acceleration. Whole steps overshoot by up to 0.45 of the error, and by several times it where a
# wide contact twists.
RELAXATION = 0.8
# Rounds with acceleration, the limit on all rounds, and the share of a change that the others make
# (assumed; most steps need one or two rounds). The change is that of the pressure, or of the
# displacement where the forces are prescribed.
ACCELERATED_ROUNDS, MAX_ROUNDS, DAMPED_RELAXATION = 16, 40, 0.2
# Rounds after ACCELERATED_ROUNDS over which the displacement may change by the tolerance: as many
# as DAMPED_RELAXATION averages the pressure over. The change is the mean error of these rounds.
# Where the smallest displacement adds or removes a cell of the contact, only a mean pressure is a
# solution.
AVERAGED_ROUNDS = 5
MAX_HALVINGS = 8  # of a change of the displacement that leaves a body without surface (assumed)
# Factor on the tolerance after ACCELERATED_ROUNDS where the forces are prescribed (assumed: less
# than a tenth of a cell). Small contacts and edges move from cell to cell.
LATE_TOLERANCE = 4.0
# Cells around the contact in which a step computes the displacement by shear, and the least number
# with which it keeps the last step's window (assumed).
WINDOW_CELLS, KEPT_CELLS = 4, 2
# Of the search for the largest torque that friction can carry (assumed): the rotation times the
# radius of gyration, mm. Below a motion of STICK_MM a cell's traction is below the limit.
TURN_MM, STICK_MM = 1.0, 1e-3
# A body whose force exceeds the limit of friction by this share slides along its prescribed motion.
# Below, its direction is between those of the force and the motion. A motion of MOTION_MM counts
# half. Both are assumed.
MOTION_EXCESS, MOTION_MM = 0.05, 0.02


class Step(NamedTuple):
    """A step within a window of the grid."""

    contact: Contact  # before
    layer: DomedLayer  # in the window
    window: Window
    axes_mm: tuple[np.ndarray, np.ndarray]  # x, (columns,), and y, (rows,)
    lateral_mm: np.ndarray  # (2, rows, columns) displacement along the surface before
    traction: np.ndarray  # (2, rows, columns) before, MPa

    def solved(
        self, normal: Contact, limit: np.ndarray, follows: np.ndarray, fields: "Fields", predicts:
        bool, bodies: Bodies = NO_BODIES,
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray, bool, np.ndarray]:  # fmt: skip
        """The traction within a limit, (rows, columns), under the pressure of a contact, and the
        results of `Slide.traction`, of a surface that would follow the shape; its displacement."""
        _, spread, dome, guess = fields
        cover, kernel = normal.equilibrium.cover[self.window].copy(), self.layer.middle.kernels[0]
        own = additional_compliance(kernel.flat[kernel.size // 2], cover, guess, limit)
        follows = follows + own * self.traction
        traction, now, converged = solve_traction(
            self.layer.middle, limit, follows - spread - dome, guess, bodies,
            PREDICTION_TOLERANCE if predicts else TOLERANCE, own,
        )  # fmt: skip
        return traction, follows, own * traction, converged, now + spread + dome


# The pressure, MPa, (rows, columns), the displacements along the surface by it and by the dome, mm,
# and a guess of the traction, MPa; each (2, rows, columns).
Fields = tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]


Drive: TypeAlias = "Slide | _Push"  # what moves the shapes in a step


@dataclass(frozen=True)
class Slide:
    """A small motion of the shape: of its origin, mm, and the rotation about it."""

    dx_mm: float
    dy_mm: float
    dyaw_rad: float
    friction: Friction
    # Whether the forces are prescribed instead of the motion. The displacement by shear then moves
    # with the contact, and whole steps do not overshoot.
    prescribed: ClassVar = False
    # Share of an error that a correction removes, with acceleration and late.
    relaxation: ClassVar = RELAXATION, 1.0

    def traction(
        self, step: Step, normal: Contact, fields: Fields, predicts: bool = False
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray, bool]:
        """The traction under the pressure of a contact, and the displacement, mm, of a surface that
        sticks to the shape. Then by how much that of the part in contact exceeds the cell's mean,
        and whether the traction converged. predicts: for the contact before."""
        limit = self.friction.limit_mpa(fields[0], normal.elastomer).astype(np.float32)
        # The motion of the shape at the displaced points of the surface.
        command, (x, y) = step.contact.command, step.axes_mm
        x = x + step.lateral_mm[0] - command.x_mm
        y = y[:, None] + step.lateral_mm[1] - command.y_mm
        cos, sin = np.cos(self.dyaw_rad) - 1, np.sin(self.dyaw_rad)
        rigid = np.stack([self.dx_mm + cos * x - sin * y, self.dy_mm + sin * x + cos * y])
        return step.solved(normal, limit, step.lateral_mm + rigid, fields, predicts)[:4]


def advance(
    contact: Contact, dx_mm: float, dy_mm: float, dyaw_rad: float, force_n: float, friction:
    Friction,
) -> Contact:  # fmt: skip
    """The contact after a small motion of the shape, see Slide, with a force.

    The given contact does not change. Raises T2TwinError as solve_contact does.
    """
    command = contact.command
    x_mm, y_mm = command.x_mm + dx_mm, command.y_mm + dy_mm
    yaw_rad = command.yaw_rad + dyaw_rad
    moved = replace(command, x_mm=x_mm, y_mm=y_mm, yaw_rad=yaw_rad, force_n=force_n)
    drive = Slide(dx_mm, dy_mm, dyaw_rad, friction)
    start = replace(contact.motion or still_motion(contact, (friction,)), friction=(friction,))
    found = step_contact(contact, start, [(contact.shape, moved)], drive)
    return replace(found, settled=contact.settled and found.settled)


def step_contact(
    contact: Contact, start: Motion, bodies: Sequence[tuple[Shape, PressCommand]], drive: Drive
) -> Contact:
    """The contact after a step, of bodies as for solve_bodies; raises as that.

    start: the motion of the contact before, with the friction of this step.
    """
    # That of the last step, if it is wide enough.
    window, loaded = start.window, contact.pressure_kpa > 0
    if window is None or _outside(dilated(loaded, KEPT_CELLS), window).any():
        window = window_around(dilated(loaded, WINDOW_CELLS))
    while True:
        found = _step(contact, start, bodies, drive, window)
        outside = _outside(found.pressure_kpa > 0, window)
        if not outside.any():
            return found
        outside[window] = True
        window = window_around(dilated(outside, WINDOW_CELLS))


def _outside(mask: np.ndarray, window: Window) -> np.ndarray:
    """A mask without its part in a window."""
    outside = mask.copy()
    outside[window] = False
    return outside


def _step(
    contact: Contact, start: Motion, bodies: Sequence[tuple[Shape, PressCommand]], drive: Drive,
    window: Window,
) -> Contact:  # fmt: skip
    """The contact after a step, unsettled if it left the window."""
    part, pitch, (rows, columns) = (slice(None), *window), contact.pitch_mm, window
    layer, shear = contact.shear_layer.window(window), start.shear_mpa[part].copy()
    pressure, kept = 1e-3 * contact.pressure_kpa[window], (start.spread_mm, start.parts_mm)
    is_same = (start.window, start.middle_mm) == (window, layer.middle_mm)
    response: Any = kept if is_same else (layer.spread_mm(pressure), layer.parts_mm(shear))
    spread, parts = response
    axes = contact.x_mm[columns].copy(), contact.y_mm[rows].copy()
    step = Step(contact, layer, window, axes, parts.sum(axis=0)[:2] + spread, shear)
    fields = pressure, spread, parts[1, :2], shear
    shear, seen, predicted, moves, travel = _predicted(step, start, drive, fields)
    normal, dome = contact, parts[1, :2]
    converged, acceleration = False, anderson(seen.size)
    possible, reference, with_mujoco = np.zeros_like(seen), seen, not seen.any()
    for number in range(MAX_ROUNDS):
        normal, seen = _press(bodies, normal, window, seen, possible, moves, with_mujoco)
        possible, moves = seen, None
        before, pressure = pressure, 1e-3 * normal.pressure_kpa[window]
        late = number - ACCELERATED_ROUNDS
        averages = late >= 0 and not drive.prescribed
        if averages:
            pressure = before + DAMPED_RELAXATION * (pressure - before)
            pressure_kpa = normal.pressure_kpa.copy()
            pressure_kpa[window] = 1e3 * pressure
            normal = replace(normal, pressure_kpa=pressure_kpa)
        spread = layer.spread_mm(pressure)
        fields = pressure, spread, dome, shear
        shear, follows, within, found = drive.traction(step, normal, fields)
        parts = layer.parts_mm(shear)
        sheared, dome = parts.sum(axis=0), parts[1, :2]
        sheared[:2] += within
        if not pressure.any() or _outside(normal.pressure_kpa > 0, window).any():
            break  # the contact left the window
        error = unfolded(sheared, pitch) - seen
        is_due = not averages or (late > 0 and late % AVERAGED_ROUNDS == 0)
        change = seen + error - reference if averages else error
        change = change / LATE_TOLERANCE if late >= 0 and drive.prescribed else change
        converged = is_due and found and is_small(change, sheared, pressure, normal.depth_mm)
        if converged and (with_mujoco or normal.equilibrium.agrees_with_mujoco()):
            break
        with_mujoco |= converged or late >= 0
        reference = seen + error if is_due or late == 0 else reference
        if drive.prescribed:
            over = _nearest_body(normal, window)
            error = moved(seen + error, -means(error[:2], pressure, over), pitch, over) - seen
        corrected = seen + drive.relaxation[late >= 0] * error
        if late < 0:
            corrected = acceleration(seen.ravel(), corrected.ravel()).reshape(seen.shape)
        seen = corrected
    slip_mm, traction = start.slip_mm.copy(), np.zeros_like(start.shear_mpa)
    slip_mm[window] += np.hypot(*(follows - sheared[:2] - spread)) * (pressure > 0)
    traction[part] = shear
    error = None if travel is None else unfolded(sheared, pitch) - predicted
    response = window, layer.middle_mm, spread, parts, travel, error
    motion = Motion(start.friction, traction, slip_mm, *response)
    return replace(normal, motion=motion, settled=bool(normal.settled and converged))


def _predicted(step: Step, start: Motion, drive: Drive, fields: Fields) -> tuple[Any, ...]:
    """The start of a step's rounds, from the contact before and its fields."""
    contact, window, pitch = step.contact, step.window, step.contact.pitch_mm
    pressure, spread, *_ = fields
    shear, follows, within, _ = drive.traction(step, contact, fields, predicts=True)
    travel = None if drive.prescribed else follows - step.lateral_mm
    seen, over = step.layer.response_mm(shear), _nearest_body(contact, window)
    seen[:2] += within
    if travel is None:
        seen = moved(seen, means(follows - seen[:2] - spread, pressure, over), pitch, over)
    predicted = seen = unfolded(seen, pitch)
    moves = means(follows - seen[:2] - spread, pressure, over)
    if travel is not None:
        more = _repeated(start, travel, pressure, window)
        seen = unfolded(seen + moved(more, moves, pitch, over), pitch)
    return shear, seen, predicted, moves, travel


def _repeated(
    start: Motion, travel: np.ndarray, pressure: np.ndarray, window: Window
) -> np.ndarray:
    """(3, rows, columns) the last step's correction, mm, as far as this step repeats its motion."""
    if start.travel_mm is None or start.window is None:
        return np.zeros((3, *pressure.shape))
    whole = np.zeros((5, *start.slip_mm.shape))
    whole[:2, *start.window], whole[2:, *start.window] = start.travel_mm, start.error_mm
    before, more = whole[:2, *window], whole[2:, *window]
    square, product = ((pressure * before * each).sum() for each in (before, travel))
    return more * np.clip(product / square, 0.0, 1.0) if square > 0 else 0.0 * more


def _nearest_body(contact: Contact, window: Window) -> list[np.ndarray]:
    """For each body of a contact, (rows, columns) bool: the cells of a window nearest to it."""
    if len(contact.bodies) == 1:
        return [np.ones(window_shape(window), bool)]
    loaded, owner = contact.pressure_kpa[window] > 0, contact.owner[window]
    if loaded.any():
        from scipy import ndimage  # slow to import

        nearest = ndimage.distance_transform_edt(
            ~loaded, return_distances=False, return_indices=True
        )
        owner = owner[tuple(np.asarray(nearest))]
    return [owner == body for body in range(len(contact.bodies))]


def _press(
    bodies: Sequence[tuple[Shape, PressCommand]], near: Contact, window: Window, seen: np.ndarray,
    possible: np.ndarray, moves: np.ndarray | None, with_mujoco: bool,
) -> tuple[Contact, np.ndarray]:  # fmt: skip
    """The contact of bodies over a surface displaced by seen, halved towards the possible one."""
    rows, columns = window
    halvings = 0
    while True:
        shift = SurfaceShift(near.x_mm[columns], near.y_mm[rows], seen)
        start = (shift, near, moves) if seen.any() else (None, None, None)
        try:
            return solve_bodies(
                bodies, near.elastomer, near.pitch_mm, *start, with_mujoco=with_mujoco
            ), seen
        except OffPadError:
            if halvings == MAX_HALVINGS or not seen.any():
                raise
            seen, halvings = (possible + seen) / 2, halvings + 1


def still_motion(contact: Contact, friction: tuple[Friction, ...]) -> Motion:
    """The start of a motion: no traction."""
    shape = contact.pressure_kpa.shape
    return Motion(friction, np.zeros((2, *shape)), np.zeros(shape))


@dataclass(frozen=True)
class Load:
    """What one body does to a sensor, in the sensor frame; all values are finite."""

    shape: Shape  # the height map of its surface is that of a press at x = y = yaw = 0
    force_n: float  # normal force
    shear_n: tuple[float, float]  # tangential force on the sensor along x and y
    torque_nmm: float  # on the sensor about its z axis, clockwise in the image
    # dx_mm, dy_mm, dyaw_rad of the body's surface along the sensor since the last contact, rotated
    # about the sensor's z axis. None for a new place of contact, without traction.
    motion: tuple[float, float, float] | None
    friction: Friction


def owner_of(contact: Contact, names: tuple[str, ...]) -> np.ndarray:
    """(ny, nx) index among the names of the body that presses most on each cell of a contact.

    0 where no body presses. -1 where the body is not among the names, unless there is only one.
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

    loads: one for each body; their shapes have different names. before: the last contact. Where a
    body with a motion was in contact, the tangential traction continues. The forces and torques of
    the result are those of the loads, as far as friction can carry them. Raises T2TwinError as
    solve_contact does.
    """
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
    frictions = tuple(load.friction for load in loads)
    start = still_motion(near, frictions)
    if before is not None:
        start = _kept_traction(before.motion or start, before, near, continuing)
    start = replace(start, friction=frictions)
    found = step_contact(near, start, bodies, _Push(loads))
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
    maps, depths_mm = [shape.surface for shape in shapes], contact.equilibrium.shape_depths_mm
    pitch = min(each.pitch_mm for each in maps)
    ends = ([getattr(each, axis)[[0, -1]] for each in maps] for axis in ("x_mm", "y_mm"))
    x, y = (np.arange(np.min(each), np.max(each) + pitch / 2, pitch) for each in ends)
    here = PressCommand("", 0.0, 0.0, 0.0, 0.0)  # y of a pressed shape points down
    highest = np.full((y.size, x.size), NOTHING_MM, np.float32)
    for each, offset in zip(maps, depths_mm - depths_mm.max(), strict=True):
        highest = np.maximum(highest, heights_at(each, here, x, -y) + np.float32(offset))
    name, force_n = " and ".join(shape.name for shape in shapes), contact.equilibrium.forces_n.sum()
    shape = Shape(name, shapes[0].solid, HeightMap(highest, x, y), shapes[0].spacing_mm)
    command = replace(contact.command, shape=name, force_n=float(force_n))
    return replace(contact, shape=shape, command=command)


@dataclass(frozen=True)
class _Push:
    """Bodies with prescribed forces and torques."""

    loads: Sequence[Load]
    prescribed: ClassVar = True  # see Slide
    relaxation: ClassVar = 1.0, DAMPED_RELAXATION

    def traction(
        self, step: Step, normal: Contact, fields: Fields, predicts: bool = False
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray, bool]:
        """See Slide. A prediction starts from the pressure of the contact before."""
        contact, loads, (x, y) = step.contact, self.loads, step.axes_mm
        owner = owner_of(normal, tuple(load.shape.name for load in loads))[step.window].copy()
        pressure = np.where(owner >= 0, fields[0], 0.0)
        if predicts:  # with the forces of the loads
            for body, load in enumerate(loads):
                total_n = (pressure * (owner == body)).sum() * contact.pitch_mm**2
                pressure[owner == body] *= load.force_n / total_n if total_n > 0 else 1.0
        frictions = [load.friction for load in loads]
        limit = limit_mpa(frictions, owner, pressure, contact.elastomer).astype(np.float32)
        still = (0.0, 0.0, 0.0)
        given = np.array(
            [(*each.shear_n, each.torque_nmm, *(each.motion or still)) for each in loads]
        )
        levers, wrenches, motions, rigid = np.zeros((4, len(loads), 3))
        bodies = x, y, owner, levers, wrenches, np.zeros(len(loads), bool), rigid
        _place(given, pressure, limit, contact.pitch_mm, bodies, motions)
        traction, follows, within, converged, now = step.solved(
            normal, limit, step.lateral_mm, fields, predicts, bodies
        )
        # In a prediction, the contact moves with the bodies, less the change of the shear.
        for body, slides in enumerate(bodies[5]):
            (center_x, center_y, radius), is_known = levers[body], predicts or slides
            along_x, along_y, turn = motions[body] if is_known else rigid[body]
            start, turn = (now if slides and not predicts else follows), turn / radius
            along_x = start[0] + along_x + (center_y - y[:, None]) * turn
            along_y = start[1] + along_y + (x - center_x) * turn
            follows = np.where(owner == body, np.stack([along_x, along_y]), follows)
        return traction, follows, within, converged


@compiled(nogil=True)
def _place(loads, pressure, limit, pitch, bodies, motions):
    """Write levers, wrenches and motions of loads, (bodies, 6): force, torque, motion. Writes also
    which bodies slide as a whole, and along which motion; the force has priority."""
    x, y, owner, levers, wrenches, slides, rigid = bodies
    none, found = np.zeros((2, *limit.shape), np.float32), np.zeros(3)
    for body in range(levers.shape[0]):
        total, across, down, square, capacity, most = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
        for i in range(y.size):
            for j in range(x.size):
                if owner[i, j] == body:
                    total += pressure[i, j]
                    across += pressure[i, j] * x[j]
                    down += pressure[i, j] * y[i]
                    square += pressure[i, j] * (x[j] * x[j] + y[i] * y[i])
                    capacity += np.float64(limit[i, j])
                    most = max(most, np.float64(limit[i, j]))
        lever, wrench, motion = levers[body], wrenches[body], motions[body]
        lever[2] = 1.0
        if total > 0.0:  # the center of the pressure and its radius of gyration
            lever[0], lever[1] = across / total, down / total
            square = max(square / total - lever[0] ** 2 - lever[1] ** 2, 0.0)
            lever[2] = max(np.sqrt(square), pitch)
        along_x, along_y, torque, dx, dy, turn = loads[body]
        torque -= lever[0] * along_y - lever[1] * along_x
        wrench[0], wrench[1] = along_x / pitch**2, along_y / pitch**2
        wrench[2] = torque / lever[2] / pitch**2
        motion[0], motion[1] = dx - turn * lever[1], dy + turn * lever[0]
        motion[2] = turn * lever[2]
        force, share, ahead = np.hypot(wrench[0], wrench[1]), 0.0, 1.0
        found[0] = found[1] = found[2] = 0.0
        if capacity == 0.0:
            slides[body], share = True, 1.0
        elif force >= (1 - AT_LIMIT) * capacity:
            length = max(np.sqrt(motion[0] ** 2 + motion[1] ** 2 + motion[2] ** 2), 1e-30)
            share = min(max(force / capacity - 1.0, 0.0) / MOTION_EXCESS, 1.0)
            share *= length / (length + MOTION_MM)
            ahead = max(wrench[0] * motion[0] + wrench[1] * motion[1], 0.0) / (force * length)
            ahead /= length
            slides[body], found[0], found[1] = True, wrench[0] / force, wrench[1] / force
        elif wrench[2] != 0.0:
            found[2] = np.copysign(TURN_MM, wrench[2])
            balance(none, none, most / STICK_MM, limit, bodies, body, capacity, False, found)
            most_torque = 0.0
            for i in range(y.size):
                turn_x = (lever[1] - y[i]) / lever[2]
                for j in range(x.size):
                    if owner[i, j] == body:
                        turn_y = (x[j] - lever[0]) / lever[2]
                        a, b = found[0] + turn_x * found[2], found[1] + turn_y * found[2]
                        size = max(np.hypot(a, b), STICK_MM)
                        most_torque += limit[i, j] / size * (turn_x * a + turn_y * b)
            slides[body] = abs(wrench[2]) >= (1 - AT_LIMIT) * abs(most_torque)
        for k in range(3):
            if slides[body]:
                rigid[body, k] = (1 - share) * found[k] + share * ahead * motion[k]
