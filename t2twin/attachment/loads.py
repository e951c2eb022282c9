"""The contact that carries MuJoCo's forces, and what it lacks of them."""

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np
from scipy import ndimage

from t2twin.attachment.contacts import READ_N, READ_SHARE, UNSTEADY, Body
from t2twin.attachment.geometry import covers_square
from t2twin.primitives_cad.height_map import PITCH_MM
from t2twin.primitives_cad.shape import NOTHING_MM, HeightMap, Shape
from t2twin.sim.contact.elastomer import MAX_FRICTION, Elastomer
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


def loaded_contact(
    elastomer: Elastomer, pitch_mm: float, bodies: Sequence[Body], before: Contact | None
) -> tuple[Contact | None, list[Notice]]:
    """The contact of pressing bodies with an elastomer, and notices of what it lacks.

    before: as for `carry`. Forces above MAX_FORCE_N are reduced, all by the same share. Tangential
    loads that leave a body without surface are reduced, and a body without a cell of the grid is
    made wider.
    """
    limit = MAX_FORCE_N / max(sum(body.pressing_n for body in bodies), MAX_FORCE_N)
    reasons = {body.name: [LIMIT] if limit < 1.0 else [] for body in bodies}
    choices, chosen = {}, {}
    for body in bodies:
        if body.shape is None:
            reasons[body.name] = [NO_SURFACE]
        else:
            choices[body.name] = _choices(_load(body, body.shape, limit))
            chosen[body.name] = next(choices[body.name])
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
                reasons[error.shape] = [NO_SURFACE]
            else:
                chosen[error.shape] = following
    notices = [_notice(contact, body, reasons[body.name], chosen.get(body.name)) for body in bodies]
    return contact, [each for each in notices if each is not None]


def _load(body: Body, shape: Shape, limit: float) -> Load:
    """The load of a body, whose forces are multiplied by a limit."""
    along_x, along_y, _ = (limit * body.force_n).tolist()
    return Load(
        shape=shape,
        force_n=max(limit * body.pressing_n, FORCE_RANGE_N[0]),
        shear_n=(along_x, along_y),
        torque_nmm=limit * float(body.torque_nmm[2]),
        motion=body.motion,
        friction=min(body.friction, MAX_FRICTION),
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


def _notice(
    contact: Contact | None, body: Body, known: list[str], chosen: tuple[Load, float, bool] | None
) -> Notice | None:
    """What a contact lacks of a body's force. known: reasons so far. chosen: see `_choices`."""
    read_n = _read_n(contact, body.name)
    lacking = body.force_n - read_n
    if chosen is not None:
        load, share, is_wider = chosen
        is_less = _is_much(load.shear_n - read_n[:2], np.array(load.shear_n))
        if share < 1.0 or (is_less and (known or is_wider)):
            known = [*known, TANGENTIAL]
        known = [*known, THIN] if is_wider else known
    unsettled = []
    if contact is not None and not contact.settled:
        unsettled = [SMALL if contact.smaller_than_grid else UNSETTLED]
    normal, tangential = (_is_much(lacking[part], body.force_n[part]) for part in np.s_[2:, :2])
    if normal or tangential:
        if not known and (tangential or not unsettled):
            known = [SHARED if normal else TANGENTIAL]
        return Notice(body.name, "; ".join(known + unsettled), tuple(lacking.tolist()))
    if THIN in known or unsettled:
        return Notice(body.name, THIN if THIN in known else unsettled[0])
    if body.shape is not None and not covers_square(body.shape.surface.heights_mm, NARROW_CELLS):
        return Notice(body.name, NARROW)
    return None


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


def unread_notices(bodies: Sequence[Body]) -> list[Notice]:
    """Notices of forces that no reading contains.

    Light bodies are left out where all together have less than READ_N.
    """
    light_n = np.linalg.norm(sum(body.unread_n.get(LIGHT, 0.0) for body in bodies))
    return [
        Notice(body.name, reason, tuple(force_n.tolist()))
        for body in bodies
        for reason, force_n in body.unread_n.items()
        if reason == UNSTEADY or (light_n if reason == LIGHT else np.linalg.norm(force_n)) > READ_N
    ]
