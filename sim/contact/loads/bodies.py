"""Several bodies on one sensor: which of them is over a cell, and one height map of all."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from t2twin.primitives_cad.shape import NOTHING_MM, HeightMap, Shape
from t2twin.sim.contact.heights import heights_at
from t2twin.sim.contact.types import Contact, Motion, PressCommand


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


def kept_traction(
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


def with_all_shapes(contact: Contact, shapes: Sequence[Shape]) -> Contact:
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
