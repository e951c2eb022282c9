"""Contacts under prescribed forces and torques, as a physics engine gives them."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from t2twin.core.errors import T2TwinError
from t2twin.sim.contact.contact_solver import solve_contact
from t2twin.sim.contact.elastomer import Elastomer
from t2twin.sim.contact.loads.bodies import Bodies, kept_traction
from t2twin.sim.contact.loads.prescribed import Load, PrescribedLoads
from t2twin.sim.contact.sliding import step_contact, still_motion
from t2twin.sim.contact.types import Contact

MAX_CORRECTIONS = 12
"""Limit on the corrections of the depths of several bodies (assumed: most need one or two)."""


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
    settled = False
    for _ in range(MAX_CORRECTIONS):
        found, owner = _carried(bodies, elastomer, pitch_mm, before)
        settled = bodies.correct(found, owner)
        if settled:
            break
    if found.motion is None:
        return found
    return replace(
        found, motion=bodies.motion(found.motion, owner), settled=found.settled and settled
    )


def _carried(
    bodies: Bodies, elastomer: Elastomer, pitch_mm: float, before: Contact | None
) -> tuple[Contact, np.ndarray]:
    """The contact of bodies at their present depths, and the index of the body over each cell."""
    shape, loads = bodies.shape(), bodies.loads
    if before is None:
        before = solve_contact(shape, bodies.command, elastomer, pitch_mm)
        if len(loads) == 1 and not (np.any(loads[0].shear_n) or loads[0].torque_nmm):
            return before, bodies.owner(before)
    owner = bodies.owner(before)
    friction = np.array([load.friction for load in loads])[owner]
    start = before.motion or still_motion(before, 0.0)
    start = kept_traction(start, before.shape.name, bodies.names, owner)
    friction = loads[0].friction if len(loads) == 1 else friction
    start = replace(start, friction=friction)
    drive = PrescribedLoads(loads, owner)
    return step_contact(before, start, shape, bodies.command, drive, carried=True), owner
