"""A contact in motion: the shape slides and turns while it is pressed.

`advance` moves a contact by one small step. The normal contact and the friction are solved in turn
until the traction no longer changes:

- The normal contact sees the shape over the sheared surface. A point of the surface that is
  displaced by u meets the shape at its place plus u, and shear has lowered or raised it.
- The friction sees the new pressure. Where the surface sticks, it has moved with the shape since
  the last step. Elsewhere the traction is at its limit.

The tangential response is linear: a neo-Hookean solid in simple shear has a stress proportional to
the strain (Treloar, The Physics of Rubber Elasticity, 1975). The layer has the thickness at the
middle of the contact. A press starts without tangential traction.
"""

from dataclasses import replace

import numpy as np

from t2twin.sim.contact.contact_solver import solve_contact
from t2twin.sim.contact.grid import dilated, window_around
from t2twin.sim.contact.tangential.traction import ShearLayer, cached_shear_layer, solve_traction
from t2twin.sim.contact.types import Contact, Motion, SurfaceShift

COUPLING_TOLERANCE = 1e-2
"""Change of the traction in a round, over friction times the force, below which a step has
converged. The pressure of the normal contact has a tolerance of half of it."""

RELAXATION = (1.0,) + (0.7,) * 7 + (0.3,) * 12
"""Share of the new sheared surface that the normal contact of each round sees; the rest is the one
of the round before. Full steps overshoot by 0.45 of the change; at a sharp edge two solutions may
alternate, which small steps prevent."""

GEL_FRICTION = 0.8
"""Coefficient of friction of the DIGIT's gel (assumed, range 0.4 to 1.5)."""

COVER_FRICTION = 1.0
"""Coefficient of friction of the CySkin's cover (assumed, range 0.5 to 1.5)."""

MAX_FRICTION = 5.0
"""Largest allowed coefficient of friction (assumed: above any rubber's on a dry solid)."""

THICKNESS_STEP_MM = 0.25
"""Thicknesses are rounded to this, mm, so that few kernels are computed (assumed)."""


def advance(
    contact: Contact,
    dx_mm: float,
    dy_mm: float,
    dyaw_rad: float,
    force_n: float,
    friction: float,
) -> Contact:
    """The contact after a small motion of the shape, with a force.

    dx_mm, dy_mm: motion of the shape's origin. dyaw_rad: rotation about it. friction: coefficient
    of friction. The given contact does not change. Raises T2TwinError as solve_contact does.
    """
    command = contact.command
    moved = replace(
        command,
        x_mm=command.x_mm + dx_mm,
        y_mm=command.y_mm + dy_mm,
        yaw_rad=command.yaw_rad + dyaw_rad,
        force_n=force_n,
    )
    start = contact.motion or _still(contact, friction)
    follows = start.displacement_mm + _rigid(contact, start, dx_mm, dy_mm, dyaw_rad)
    normal, seen, converged = contact, start.sheared_mm, False
    shear, sheared, spread, _ = _sheared(normal, follows, friction, start.shear_mpa)
    for share in RELAXATION:
        seen = seen + share * (sheared - seen)
        shift = SurfaceShift(contact.x_mm, contact.y_mm, seen) if shear.any() else None
        near = normal if shear.any() else None
        normal = solve_contact(
            contact.shape, moved, contact.elastomer, contact.pitch_mm, shift, near
        )
        before = shear
        shear, sheared, spread, found = _sheared(normal, follows, friction, before)
        change = np.abs(shear - before).sum() * normal.pitch_mm**2
        converged = found and change <= COUPLING_TOLERANCE * friction * force_n
        if converged:
            break
    pressure = normal.pressure_kpa
    displacement = sheared[:2] + spread
    slip = np.hypot(*(follows - displacement)) * (pressure > 0)
    motion = Motion(friction, shear, sheared, displacement, start.slip_mm + slip)
    return replace(normal, motion=motion, settled=normal.settled and converged)


def _sheared(
    normal: Contact, follows_mm: np.ndarray, friction: float, start_mpa: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray, bool]:
    """Friction under a pressure.

    follows_mm: (2, ny, nx) displacement of the surface where it sticks. start_mpa: initial guess.
    Returns the traction, (2, ny, nx), MPa, the displacement by it, (3, ny, nx), mm, that by the
    pressure, (2, ny, nx), mm, and whether the solution converged.
    """
    pressure, layer = 1e-3 * normal.pressure_kpa.astype(float), _layer(normal)
    window = window_around(dilated(pressure > 0, 1))
    inside = (slice(None), *window)
    spread = layer.spread_mm(pressure)
    found = solve_traction(
        layer, friction * pressure[window], (follows_mm - spread)[inside], start_mpa[inside]
    )
    shear = np.zeros_like(start_mpa)
    shear[inside] = found.q_mpa
    sheared = np.stack([*layer.displacement_mm(shear), layer.deflection_mm(shear)])
    return shear, sheared, spread, found.converged


def _still(contact: Contact, friction: float) -> Motion:
    """The start of a motion: no traction, and the surface displaced by the pressure alone."""
    shape = contact.pressure_kpa.shape
    spread = _layer(contact).spread_mm(1e-3 * contact.pressure_kpa.astype(float))
    return Motion(friction, np.zeros((2, *shape)), np.zeros((3, *shape)), spread, np.zeros(shape))


def _rigid(
    contact: Contact, motion: Motion, dx_mm: float, dy_mm: float, dyaw_rad: float
) -> np.ndarray:
    """(2, ny, nx) motion of the shape at the displaced points of the surface."""
    command = contact.command
    x = contact.x_mm + motion.displacement_mm[0] - command.x_mm
    y = contact.y_mm[:, None] + motion.displacement_mm[1] - command.y_mm
    cos, sin = np.cos(dyaw_rad) - 1, np.sin(dyaw_rad)
    return np.stack([dx_mm + cos * x - sin * y, dy_mm + sin * x + cos * y])


def _layer(contact: Contact) -> ShearLayer:
    """The tangential layer of a contact, of the thickness at its middle."""
    pressure, elastomer = contact.pressure_kpa, contact.elastomer
    share = pressure / pressure.sum()
    middle = (contact.x_mm * share).sum(), (contact.y_mm[:, None] * share).sum()
    thickness = float(elastomer.thickness_at_mm(*np.array(middle)[:, None])[0])
    if abs(thickness - elastomer.thickness_mm) > THICKNESS_STEP_MM / 2:
        thickness = round(thickness / THICKNESS_STEP_MM) * THICKNESS_STEP_MM
    else:
        thickness = elastomer.thickness_mm
    return cached_shear_layer(elastomer, thickness, contact.pitch_mm, pressure.shape)
