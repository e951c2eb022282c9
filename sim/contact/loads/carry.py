"""Contacts under prescribed forces and torques, as a physics engine gives them."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from t2twin.core.errors import T2TwinError
from t2twin.sim.contact.contact_solver import solve_contact
from t2twin.sim.contact.elastomer import Elastomer
from t2twin.sim.contact.loads.prescribed import Load, PrescribedLoads
from t2twin.sim.contact.sliding import step_contact, still_motion
from t2twin.sim.contact.types import Contact, PressCommand


def carry(
    elastomer: Elastomer, pitch_mm: float, loads: Sequence[Load], before: Contact | None
) -> Contact:
    """The contact of bodies with an elastomer, on a grid of pitch_mm.

    before: the last contact of the same bodies, None for none. The tangential traction continues
    from it. The given contact does not change.
    Raises T2TwinError as solve_contact does.
    """
    if not loads:
        raise T2TwinError("there is no load; expected at least one")
    (load,) = loads
    shape = load.shape
    command = PressCommand(shape.name, 0.0, 0.0, 0.0, load.force_n)
    if before is None:
        before = solve_contact(shape, command, elastomer, pitch_mm)
        if not np.any(load.shear_n) and load.torque_nmm == 0:
            return before
    owner = np.zeros(before.pressure_kpa.shape, int)
    start = before.motion or still_motion(before, load.friction)
    start = replace(start, friction=load.friction, last=(0.0, 0.0, 0.0))
    drive = PrescribedLoads(loads, owner)
    return step_contact(before, start, shape, command, drive, carried=True)
