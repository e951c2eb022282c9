"""Contacts under prescribed forces and torques, as a physics engine gives them."""

from collections.abc import Sequence
from dataclasses import replace
from functools import partial

import numpy as np

from t2twin.core.errors import T2TwinError
from t2twin.primitives_cad.shape import Shape
from t2twin.sim.contact.contact_solver import solve_contact
from t2twin.sim.contact.elastomer import Elastomer
from t2twin.sim.contact.loads.bodies import SHARE_TOLERANCE, Bodies, kept_traction
from t2twin.sim.contact.loads.prescribed import Load, PrescribedLoads
from t2twin.sim.contact.sliding import step_contact, still_motion
from t2twin.sim.contact.solver_loops import Anderson
from t2twin.sim.contact.types import Contact, PressCommand

MAX_ROUNDS, RELAXATION = 8, 0.6
"""Limit on the rounds in which the depths of several bodies and the shear are found in turn, and
the share of a later correction that is made (assumed)."""

LATE_ROUND, LATE_SHARE = 2, 0.02
"""Round from which the force of a body may differ by this share of the force of all (assumed: the
tolerance of large shear changes forces by up to 1 %)."""


def carry(
    elastomer: Elastomer, pitch_mm: float, loads: Sequence[Load], before: Contact | None
) -> Contact:
    """The contact of bodies with an elastomer, on a grid of pitch_mm.

    loads: one for each body; their shapes have different names. before: the last contact, None for
    none. Where a body of the same name was in contact, the tangential traction continues. The given
    contact does not change.
    The normal forces, tangential forces and torques of the result are those of the loads, as far as
    friction can carry them. A body whose force and torque it cannot carry slides as a whole.
    Raises T2TwinError as solve_contact does.
    """
    if not loads:
        raise T2TwinError("there is no load; expected at least one")
    bodies = Bodies(loads, elastomer, pitch_mm, None if before is None else before.motion)
    found, settled, acceleration = before, False, Anderson(len(loads))
    for number in range(MAX_ROUNDS):
        if len(loads) > 1:
            relative_mm = bodies.depths_mm - bodies.depths_mm[0]
            bodies.balance(partial(_press, bodies.command, elastomer, pitch_mm, found))
            if number > 0:
                change_mm = bodies.depths_mm - bodies.depths_mm[0] - relative_mm
                relaxed_mm = relative_mm + (RELAXATION if number > 1 else 1.0) * change_mm
                bodies.depths_mm = acceleration.next(relative_mm, relaxed_mm)
        found = _solve(bodies, elastomer, pitch_mm, before, found)
        settled = bodies.carries(found, LATE_SHARE if number >= LATE_ROUND else SHARE_TOLERANCE)
        if settled:
            break
    assert found is not None
    if found.motion is None:
        return found
    return replace(
        found,
        motion=bodies.motion(found.motion, bodies.owner(found)),
        settled=found.settled and settled,
    )


def _press(
    command: PressCommand, elastomer: Elastomer, pitch_mm: float, near: Contact | None, shape: Shape
) -> Contact:
    """The contact of a shape over a surface with the shear of another contact."""
    shift = None if near is None else near.shift
    return solve_contact(shape, command, elastomer, pitch_mm, shift)


def _solve(
    bodies: Bodies,
    elastomer: Elastomer,
    pitch_mm: float,
    before: Contact | None,
    near: Contact | None,
) -> Contact:
    """The contact of bodies at their present depths.

    near: a contact in which the same bodies are over the same cells; None for the one before.
    """
    shape, loads = bodies.shape(), bodies.loads
    if before is None:
        before = solve_contact(shape, bodies.command, elastomer, pitch_mm)
        if len(loads) == 1 and not (np.any(loads[0].shear_n) or loads[0].torque_nmm):
            return before
    owner = bodies.owner(before if near is None else near)
    drive = PrescribedLoads(loads, owner)
    start = before.motion or still_motion(before, 0.0)
    start = kept_traction(start, before.shape.name, bodies.names, owner)
    start = replace(start, friction=loads[0].friction if len(loads) == 1 else drive.friction)
    return step_contact(before, start, shape, bodies.command, drive, prescribed=True)
