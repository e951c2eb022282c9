"""The contact that carries MuJoCo's forces, and what it lacks of them."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from scipy import ndimage

from t2twin.attachment.contacts import READ_N, READ_SHARE, UNSTEADY, Push, Wrench
from t2twin.attachment.geometry import covers_square
from t2twin.primitives_cad.height_map import PITCH_MM
from t2twin.primitives_cad.shape import NOTHING_MM, HeightMap, Shape
from t2twin.sim.contact.elastomer import Elastomer
from t2twin.sim.contact.friction import MAX_FRICTION, Friction
from t2twin.sim.contact.pin_layout import SURVEY_MM, OffPadError
from t2twin.sim.contact.prescribed import Load, carry, owner_of
from t2twin.sim.contact.types import FORCE_RANGE_N, SMALL, UNSETTLED, Contact
from t2twin.sim.touch import Notice

# Largest force of all bodies together, N: below the limit on a press by more than rounding.
MAX_FORCE_N = 0.9999 * FORCE_RANGE_N[1]
# Distance by which the outline of a body that the grid cannot resolve is moved outward, mm.
WIDER_MM = SURVEY_MM / 2
# Widths of a body, in cells of its height map (assumed). Below the first it is made wider. Below
# the second its width on the map depends on its place.
THIN_CELLS, NARROW_CELLS = 3, 4
EASED = (1.0, 0.5, 0.25, 0.0)  # shares of a tangential load that are tried (assumed)

# Reasons of notices.
LIMIT = f"all bodies together press with more than the limit of {FORCE_RANGE_N[1]:g} N"
NO_SURFACE = (
    "none of its surface lies over the pad where MuJoCo presses it; if its mesh is hollow, divide "
    "it into convex geoms"
)
THIN = (
    f"the sensor's grid does not resolve it, so its surface is {WIDER_MM:g} mm wider on each side; "
    "its depth and pressure are too small"
)
NARROW = (
    f"it is narrower than {NARROW_CELLS * PITCH_MM:g} mm, so its depth depends by up to a third on "
    "its place on the sensor's grid"
)
TANGENTIAL = (
    "the tangential load is more than friction and the soft layer can carry; a smaller load or a "
    "larger contact is carried"
)
LIGHT = f"it presses with less than {FORCE_RANGE_N[0]:g} N along the sensor's axis"
SHARED = "the bodies overlap, and share their pressure otherwise"


class Body(NamedTuple):
    """A body that presses: its name, its wrench, its surface (None for none over the sensor), and
    its motion as of a Load."""

    name: str
    wrench: Wrench
    shape: Shape | None
    motion: tuple[float, float, float] | None


def loaded_contact(
    elastomer: Elastomer, pitch_mm: float, bodies: Sequence[Body], before: Contact | None
) -> tuple[Contact | None, list[Notice]]:
    """The contact of pressing bodies with an elastomer, and notices of what it lacks.

    before: as for `carry`. Forces above MAX_FORCE_N are reduced, all by the same share. Tangential
    loads that leave a body without surface are reduced, and a body without a cell of the grid is
    made wider.
    """
    limit = MAX_FORCE_N / max(sum(body.wrench.pressing_n for body in bodies), MAX_FORCE_N)
    reasons = {body.name: LIMIT for body in bodies if limit < 1.0}
    choices = {
        body.name: _choices(_load(body, body.shape, limit))
        for body in bodies
        if body.shape is not None
    }
    reasons |= {body.name: NO_SURFACE for body in bodies if body.shape is None}
    chosen = {name: next(each) for name, each in choices.items()}
    contact = None
    while chosen and contact is None:
        is_new = any(share == 0.0 for _, share, _ in chosen.values())
        try:
            loads = [load for load, *_ in chosen.values()]
            contact = carry(elastomer, pitch_mm, loads, None if is_new else before)
        except OffPadError as error:
            following = next(choices[error.shape], None)
            if following is None:
                del chosen[error.shape]
                reasons[error.shape] = NO_SURFACE
            else:
                chosen[error.shape] = following
    for name, (load, share, is_wider) in chosen.items():
        lacking = np.array(load.shear_n) - _read_n(contact, name)[:2]
        is_much = _is_much(lacking, np.array(load.shear_n))
        is_eased = share < 1.0 or (is_much and (name in reasons or is_wider))
        known = reasons.get(name), TANGENTIAL if is_eased else None, THIN if is_wider else None
        if any(known):
            reasons[name] = "; ".join(filter(None, known))
    return contact, _notices(contact, bodies, reasons)


def _load(body: Body, shape: Shape, limit: float) -> Load:
    """The load of a body, whose forces are multiplied by a limit."""
    wrench = body.wrench
    along_x, along_y, _ = (limit * wrench.force_n).tolist()
    return Load(
        shape=shape,
        force_n=max(limit * wrench.pressing_n, FORCE_RANGE_N[0]),
        shear_n=(along_x, along_y),
        torque_nmm=limit * float(wrench.torque_nmm[2]),
        motion=body.motion,
        friction=Friction(min(wrench.friction, MAX_FRICTION)),
    )


def _choices(load: Load) -> Iterator[tuple[Load, float, bool]]:
    """What is tried for a body: the load, its tangential share, whether the body is wider."""
    surface = load.shape.surface
    covered_mm2 = np.count_nonzero(surface.heights_mm > NOTHING_MM / 2) * surface.pitch_mm**2
    is_thin = covered_mm2 < SURVEY_MM**2 or not covers_square(surface.heights_mm, THIN_CELLS)
    is_tangential = np.any(load.shear_n) or load.torque_nmm
    shares = EASED if is_tangential else (1.0, 0.0)  # the last begins without traction
    for is_wider in (True,) if is_thin else (False, True):
        shape = _wider(load.shape) if is_wider else load.shape
        for share in shares:
            along_x, along_y = load.shear_n
            shear_n = share * along_x, share * along_y
            eased = replace(load, shape=shape, shear_n=shear_n, torque_nmm=share * load.torque_nmm)
            yield eased, share, is_wider


def _wider(shape: Shape) -> Shape:
    """The shape with its outline WIDER_MM further out."""
    surface = shape.surface
    cells, pitch = int(np.ceil(WIDER_MM / surface.pitch_mm)), surface.pitch_mm
    heights = np.pad(surface.heights_mm, cells, constant_values=NOTHING_MM)
    x_mm, y_mm = (
        axis[0] + pitch * np.arange(-cells, axis.size + cells)
        for axis in (surface.x_mm, surface.y_mm)
    )
    wide = ndimage.grey_dilation(heights, size=2 * cells + 1, mode="nearest")
    return replace(shape, surface=HeightMap(wide, x_mm, y_mm))


def _notices(
    contact: Contact | None, bodies: Sequence[Body], reasons: dict[str, str]
) -> list[Notice]:
    """What a contact lacks of the forces of bodies. reasons: those that are known, by name."""
    found = []
    for body in bodies:
        known, force_n = reasons.get(body.name, ""), body.wrench.force_n
        lacking = force_n - _read_n(contact, body.name)
        normal, tangential = (_is_much(lacking[part], force_n[part]) for part in np.s_[2:, :2])
        unsettled = ""
        if contact is not None and not contact.settled:
            unsettled = SMALL if contact.smaller_than_grid else UNSETTLED
        if not known and ((normal and not unsettled) or tangential):
            known = SHARED if normal else TANGENTIAL
        if normal or tangential:
            reason = "; ".join(filter(None, [known, unsettled]))
            found.append(Notice(body.name, reason, tuple(lacking.tolist())))
        elif THIN in known or unsettled:
            found.append(Notice(body.name, THIN if THIN in known else unsettled))
        elif body.shape is not None and not covers_square(
            body.shape.surface.heights_mm, NARROW_CELLS
        ):
            found.append(Notice(body.name, NARROW))
    return found


def _is_much(lacking_n: np.ndarray, of_n: np.ndarray) -> bool:
    """Whether a part of a force that is not read is named."""
    return bool(np.linalg.norm(lacking_n) > max(READ_SHARE * np.linalg.norm(of_n), READ_N))


def _read_n(contact: Contact | None, name: str) -> np.ndarray:
    """(3,) force of a body on the sensor in a contact, N."""
    if contact is None or name not in contact.bodies:
        return np.zeros(3)
    if len(contact.bodies) == 1:
        return np.array([*contact.shear_n, -contact.force_n])
    cell_mm2, body = contact.pitch_mm**2, contact.bodies.index(name)
    normal = contact.equilibrium.body_pressures_mpa[body].sum() * cell_mm2
    own = owner_of(contact, contact.bodies) == body
    along = 1e-3 * contact.shear_kpa[:, own].sum(axis=1) * cell_mm2
    return np.array([*along, -normal])


def push_notices(pushes: Sequence[Push], names: Mapping[int, str]) -> list[Notice]:
    """Notices of forces that are not read, one for each body and reason.

    names: of the bodies. Light bodies are left out where all together have less than READ_N.
    """
    sums: dict[tuple[int, str], np.ndarray] = {}
    for each in pushes:
        key = each.body, each.reason
        sums[key] = sums.get(key, np.zeros(3)) + each.force_n
    light_n = np.sum([force for (_, reason), force in sums.items() if reason == LIGHT], axis=0)
    is_much = {LIGHT: bool(np.linalg.norm(light_n) > READ_N), UNSTEADY: True}
    return [
        Notice(names[body], reason, tuple(force.tolist()))
        for (body, reason), force in sums.items()
        if is_much.get(reason, np.linalg.norm(force) > READ_N)
    ]
