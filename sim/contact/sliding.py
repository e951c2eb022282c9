"""A contact in motion: the shape slides and turns while it is pressed.

`advance` moves a contact by one small step. The normal contact and the friction are solved in turn
until the displacement by shear no longer changes:

- The normal contact sees the shape over the sheared surface. A point of the surface that is
  displaced by u meets the shape at its place plus u, and shear has lowered or raised it.
- The friction sees the new pressure. Where the surface sticks, it has moved with the shape since
  the last step. Elsewhere the traction is at its limit.

The tangential response is linear: a neo-Hookean solid in simple shear has a stress proportional to
the strain (Treloar, The Physics of Rubber Elasticity, 1975). A press starts without tangential
traction.
"""

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
from scipy import ndimage

from t2twin.primitives_cad.shape import Shape
from t2twin.sim.contact.contact_solver import solve_bodies
from t2twin.sim.contact.displacements import is_small, means, moved, unfolded
from t2twin.sim.contact.friction import PREDICTION_TOLERANCE, TOLERANCE, solve_traction
from t2twin.sim.contact.grid import Window, dilated, window_around, window_shape
from t2twin.sim.contact.layer import DomedLayer
from t2twin.sim.contact.pin_layout import OffPadError
from t2twin.sim.contact.solver_loops import Anderson
from t2twin.sim.contact.types import Contact, Motion, PressCommand, SurfaceShift, read_only

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

# Solves the traction of a step within a window of the grid. Arguments: the contact, whose pressure
# it is; the displacements along the surface by the pressure and by the dome, mm; an initial guess
# of the traction, MPa. Returns the traction; the displacement of a surface that sticks to the
# shape, mm; whether the traction converged. All arrays are (2, rows, columns).
Traction = Callable[
    [Contact, np.ndarray, np.ndarray, np.ndarray], tuple[np.ndarray, np.ndarray, bool]
]
# What moves the shape in a step. Its arguments are the contact before, the layer in the window, the
# displacement along the surface before the step, (2, rows, columns), mm, and the window. Returns
# the expected displacement of a surface that sticks to the shape, (2, rows, columns), mm, and the
# traction of the step.
Drive = Callable[[Contact, DomedLayer, np.ndarray, Window], tuple[np.ndarray, Traction]]


def advance(
    contact: Contact, dx_mm: float, dy_mm: float, dyaw_rad: float, force_n: float, friction: float
) -> Contact:
    """The contact after a small motion of the shape, with a force.

    dx_mm, dy_mm: motion of the shape's origin. dyaw_rad: rotation about it.
    The given contact does not change. Raises T2TwinError as solve_contact does.
    """
    command, step, friction = contact.command, (dx_mm, dy_mm, dyaw_rad), float(friction)
    moved = replace(
        command,
        x_mm=command.x_mm + dx_mm,
        y_mm=command.y_mm + dy_mm,
        yaw_rad=command.yaw_rad + dyaw_rad,
        force_n=force_n,
    )

    def drive(
        contact: Contact, layer: DomedLayer, lateral_mm: np.ndarray, window: Window
    ) -> tuple[np.ndarray, Traction]:
        follows = lateral_mm + _rigid(contact, lateral_mm, step, window)
        tolerance = PREDICTION_TOLERANCE

        def solve(
            normal: Contact, spread: np.ndarray, dome: np.ndarray, guess: np.ndarray
        ) -> tuple[np.ndarray, np.ndarray, bool]:
            nonlocal tolerance
            limit = layer.limit_mpa(friction, 1e-3 * normal.pressure_kpa[window])
            traction, wanted = np.zeros_like(guess), follows - spread - dome
            if not limit.any():  # without friction
                return traction, follows, True
            near = window_around(dilated(limit > 0, 1))
            part = (slice(None), *near)
            found = solve_traction(
                layer.middle, limit[near], wanted[part], guess[part], tolerance=tolerance
            )
            traction[part] = found.q_mpa
            tolerance = TOLERANCE  # the first call predicts
            return traction, follows, found.converged

        return follows, solve

    start = replace(contact.motion or still_motion(contact, friction), friction=friction)
    found = step_contact(contact, start, [(contact.shape, moved)], drive)
    return replace(found, settled=contact.settled and found.settled)


def step_contact(
    contact: Contact,
    start: Motion,
    bodies: Sequence[tuple[Shape, PressCommand]],
    drive: Drive,
    prescribed: bool = False,
) -> Contact:
    """The contact after a step.

    start: the motion of the contact before, with the friction of this step. bodies: those of the
    contact after; see solve_bodies. drive: what moves the shapes. prescribed: whether the forces
    are prescribed instead of the motion. The displacement by shear then moves with the contact, and
    whole steps do not overshoot.
    Raises T2TwinError as solve_contact does.
    """
    window, found = _window(contact, start), None
    while True:
        found = _step(contact, start, bodies, drive, prescribed, window, found)
        outside = _outside(found, window)
        if not outside.any():
            return found
        outside[window] = True
        window = window_around(dilated(outside, WINDOW_CELLS))


def _outside(contact: Contact, window: Window) -> np.ndarray:
    """(ny, nx) bool: where a contact has pressure outside a window."""
    outside = contact.pressure_kpa > 0
    outside[window] = False
    return outside


def _step(
    contact: Contact,
    start: Motion,
    bodies: Sequence[tuple[Shape, PressCommand]],
    drive: Drive,
    prescribed: bool,
    window: Window,
    earlier: Contact | None,
) -> Contact:
    """The contact after a step, unsettled if it left the window. earlier: from which it starts."""
    part, pitch = (slice(None), *window), contact.pitch_mm
    layer = contact.shear_layer.window(window)
    spread, parts = _response(contact, start, layer, window)
    lateral = parts.sum(axis=0)[:2] + spread
    follows, traction_of = drive(contact, layer, lateral, window)
    travel = None if prescribed else follows - lateral
    normal, shear, seen, predicted, dome, moves = _predicted(
        contact, start, earlier, traction_of, layer, window, travel
    )
    converged, acceleration = False, Anderson(seen.size)
    possible, reference, with_mujoco = np.zeros_like(seen), seen, not seen.any()
    pressure = 1e-3 * normal.pressure_kpa[window]
    for number in range(MAX_ROUNDS):
        normal, seen = _press(bodies, normal, window, seen, possible, moves, with_mujoco)
        possible, moves = seen, None
        before, pressure = pressure, 1e-3 * normal.pressure_kpa[window]
        late = number - ACCELERATED_ROUNDS
        averages = late >= 0 and not prescribed
        if averages:
            pressure = before + DAMPED_RELAXATION * (pressure - before)
            normal = _with_pressure(normal, pressure, window)
        spread = layer.spread_mm(pressure)
        shear, follows, found = traction_of(normal, spread, dome, shear)
        parts = layer.parts_mm(shear)
        sheared, dome = parts.sum(axis=0), parts[1, :2]
        if not pressure.any() or _outside(normal, window).any():
            break  # the contact left the window
        error = unfolded(sheared, pitch) - seen
        is_due = not averages or (late > 0 and late % AVERAGED_ROUNDS == 0)
        change = seen + error - reference if averages else error
        change = change / LATE_TOLERANCE if late >= 0 and prescribed else change
        converged = is_due and found and is_small(change, sheared, pressure, normal.depth_mm)
        if converged and (with_mujoco or normal.equilibrium.agrees_with_mujoco()):
            break
        with_mujoco |= converged or late >= 0
        reference = seen + error if is_due or late == 0 else reference
        if prescribed:
            over = _nearest_body(normal, window)
            error = moved(seen + error, -means(error[:2], pressure, over), pitch, over) - seen
        seen = _corrected(seen, error, late, prescribed, acceleration)
    slip_mm, traction = start.slip_mm.copy(), np.zeros_like(start.shear_mpa)
    slip_mm[window] += np.hypot(*(follows - sheared[:2] - spread)) * (pressure > 0)
    traction[part] = shear
    motion = Motion(
        start.friction, read_only(traction), read_only(slip_mm), window, layer.middle_mm,
        spread, parts, travel, unfolded(sheared, pitch) - predicted,
    )  # fmt: skip
    return replace(normal, motion=motion, settled=bool(normal.settled and converged))


def _predicted(
    contact: Contact,
    start: Motion,
    earlier: Contact | None,
    traction_of: Traction,
    layer: DomedLayer,
    window: Window,
    travel: np.ndarray | None,
) -> tuple[Contact, np.ndarray, np.ndarray, np.ndarray, np.ndarray, np.ndarray | None]:
    """The start of a step's rounds, from the contact before or an earlier result."""
    near, motion = contact, start
    if earlier is not None and earlier.motion is not None:
        near, motion = earlier, earlier.motion
    (spread, parts), pressure = _response(near, motion, layer, window), near.pressure_kpa[window]
    pressure, dome = 1e-3 * pressure, parts[1, :2]
    shear, follows, _ = traction_of(near, spread, dome, motion.shear_mpa[:, *window])
    seen, over, moves = layer.response_mm(shear), _nearest_body(near, window), None
    if near is contact and travel is None:
        by_mm = means(follows - seen[:2] - spread, pressure, over)
        seen = moved(seen, by_mm, near.pitch_mm, over)
    predicted = seen = unfolded(seen, near.pitch_mm)
    if near is contact:
        moves = means(follows - seen[:2] - spread, pressure, over)
        if travel is not None:
            more = _repeated(start, travel, pressure, window)
            seen = unfolded(seen + moved(more, moves, near.pitch_mm, over), near.pitch_mm)
    return near, shear, seen, predicted, dome, moves


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
        nearest = ndimage.distance_transform_edt(
            ~loaded, return_distances=False, return_indices=True
        )
        owner = owner[tuple(np.asarray(nearest))]
    return [owner == body for body in range(len(contact.bodies))]


def _press(
    bodies: Sequence[tuple[Shape, PressCommand]],
    near: Contact,
    window: Window,
    seen: np.ndarray,
    possible: np.ndarray,
    moves: np.ndarray | None,
    with_mujoco: bool,
) -> tuple[Contact, np.ndarray]:
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


def _corrected(
    seen: np.ndarray, error: np.ndarray, late: int, prescribed: bool, acceleration: Anderson
) -> np.ndarray:
    """The displacement that the normal contact sees next; late: rounds after ACCELERATED_ROUNDS."""
    if late >= 0:
        return seen + (DAMPED_RELAXATION if prescribed else 1.0) * error
    corrected = seen + (1.0 if prescribed else RELAXATION) * error
    return acceleration.next(seen.ravel(), corrected.ravel()).reshape(seen.shape)


def _with_pressure(contact: Contact, pressure_mpa: np.ndarray, window: Window) -> Contact:
    """The contact with another pressure in a window."""
    pressure_kpa = contact.pressure_kpa.copy()
    pressure_kpa[window] = 1e3 * pressure_mpa
    return replace(contact, pressure_kpa=read_only(pressure_kpa))


def _window(contact: Contact, start: Motion) -> Window:
    """The window of a step: that of the last one, if it is wide enough."""
    loaded = contact.pressure_kpa > 0
    if start.window is not None:
        outside = dilated(loaded, KEPT_CELLS)
        outside[start.window] = False
        if not outside.any():
            return start.window
    return window_around(dilated(loaded, WINDOW_CELLS))


def _response(
    contact: Contact, motion: Motion, layer: DomedLayer, window: Window
) -> tuple[np.ndarray, np.ndarray]:
    """Displacement by pressure and by traction at the start, the last step's in the same window."""
    spread, parts = motion.spread_mm, motion.parts_mm
    known = motion.window == window and motion.middle_mm == layer.middle_mm
    if spread is None or parts is None or not known:
        return layer.spread_mm(1e-3 * contact.pressure_kpa[window]), layer.parts_mm(
            motion.shear_mpa[:, *window]
        )
    return spread, parts


def still_motion(contact: Contact, friction: float) -> Motion:
    """The start of a motion: no traction."""
    shape = contact.pressure_kpa.shape
    return Motion(friction, np.zeros((2, *shape)), np.zeros(shape))


def _rigid(
    contact: Contact, lateral_mm: np.ndarray, step: tuple[float, float, float], window: Window
) -> np.ndarray:
    """(2, rows, columns) motion of the shape at the displaced points of the surface."""
    (dx_mm, dy_mm, dyaw_rad), command, (rows, columns) = step, contact.command, window
    x = contact.x_mm[columns] + lateral_mm[0] - command.x_mm
    y = contact.y_mm[rows, None] + lateral_mm[1] - command.y_mm
    cos, sin = np.cos(dyaw_rad) - 1, np.sin(dyaw_rad)
    return np.stack([dx_mm + cos * x - sin * y, dy_mm + sin * x + cos * y])
