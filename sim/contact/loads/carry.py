"""Contacts under prescribed forces and torques, as a physics engine gives them."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from t2twin.core.errors import T2TwinError
from t2twin.sim.contact.contact_solver import solve_bodies
from t2twin.sim.contact.elastomer import Elastomer
from t2twin.sim.contact.loads.bodies import kept_traction, owner_of, with_all_shapes
from t2twin.sim.contact.loads.prescribed import Load, PrescribedLoads
from t2twin.sim.contact.sliding import step_contact, still_motion
from t2twin.sim.contact.types import Contact, PressCommand


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
        return with_all_shapes(near, shapes)
    drive = PrescribedLoads(loads)
    start = still_motion(near, 0.0)
    if before is not None:
        start = kept_traction(before.motion or start, before, near, continuing)
    start = replace(start, friction=loads[0].friction)
    found = step_contact(near, start, bodies, drive, prescribed=True)
    if len(loads) > 1 and found.motion is not None:
        friction = drive.friction[owner_of(found, names)]
        found = replace(found, motion=replace(found.motion, friction=friction))
    return with_all_shapes(found, shapes)
