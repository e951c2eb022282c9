"""Contacts under prescribed forces and torques, as a physics engine gives them."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from t2twin.core.errors import T2TwinError
from t2twin.primitives_cad.shape import NOTHING_MM, HeightMap, Shape
from t2twin.sim.contact.contact_solver import solve_bodies
from t2twin.sim.contact.elastomer import Elastomer
from t2twin.sim.contact.heights import heights_at
from t2twin.sim.contact.loads.prescribed import Load, PrescribedLoads, owner_of
from t2twin.sim.contact.sliding import step_contact, still_motion
from t2twin.sim.contact.types import Contact, Motion, PressCommand


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
    drive = PrescribedLoads(loads)
    start = still_motion(near, 0.0)
    if before is not None:
        start = _kept_traction(before.motion or start, before, near, continuing)
    start = replace(start, friction=loads[0].friction)
    found = step_contact(near, start, bodies, drive, prescribed=True)
    if len(loads) > 1 and found.motion is not None:
        friction = drive.friction[owner_of(found, names)]
        found = replace(found, motion=replace(found.motion, friction=friction))
    return _with_all_shapes(found, shapes)


def _kept_traction(
    motion: Motion, before: Contact, now: Contact, continuing: Sequence[str]
) -> Motion:
    """The motion of a contact, whose traction is zero where a cell has another body now.

    before: the contact of the motion. now: a contact after. continuing: names of the bodies whose
    traction continues.
    """
    if len(before.bodies) == len(now.bodies) == 1:
        return motion
    owner = owner_of(before, now.bodies)
    kept = np.isin(np.array(now.bodies), continuing)[owner] & (owner >= 0)
    kept &= (owner == owner_of(now, now.bodies)) | ~(now.pressure_kpa > 0)
    return replace(motion, shear_mpa=motion.shear_mpa * kept, response=None)


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
    shape = Shape(name, shapes[0].mesh, surface, shapes[0].spacing_mm)
    force_n = float(contact.equilibrium.solution.forces_n.sum())
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
