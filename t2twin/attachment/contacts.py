"""Where a sensor is in a MuJoCo model, and what MuJoCo's contacts do to it."""

# MuJoCo defines its names at import, where pyright does not find them.
# pyright: reportAttributeAccessIssue=false

from collections import defaultdict
from collections.abc import Iterator, Sequence
from copy import copy
from dataclasses import dataclass, field, replace
from math import atan2
from typing import NamedTuple

import mujoco
import numpy as np
from scipy import ndimage

from t2twin.attachment.geometry import MM_PER_M, colliding, covers_square, lying_in
from t2twin.core import arguments
from t2twin.core.errors import T2TwinError
from t2twin.primitives_cad.height_map import PITCH_MM
from t2twin.primitives_cad.shape import NOTHING_MM, HeightMap, Shape
from t2twin.sim.contact.elastomer import MAX_FRICTION, Elastomer, Friction
from t2twin.sim.contact.pin_layout import SURVEY_MM, OffPadError
from t2twin.sim.contact.sliding import Load, carry, owner_of
from t2twin.sim.contact.types import FORCE_RANGE_N, SMALL, UNSETTLED, Contact
from t2twin.sim.touch import Notice

# Names of a sensor's elements in the model, after the sensor's name and a slash.
BODY, SURFACE, FRAME = "body", "surface", "frame"
# Least cosine of the angle between a contact's normal and the sensor's (assumed). A dome is at most
# 31 degrees steep; contacts at 60 degrees or more are at the sensor's side or back.
MIN_FACING = 0.5
# Steps of a woken copy whose mean force is read. MuJoCo stops a body that falls asleep, where its
# contact force differs from that at rest; after ten steps it may sleep again (mjMINAWAKE).
WAKING_STEPS = 10
# Share of MuJoCo's force, normal and tangential, and force, N, that a contact may lack without a
# notice (assumed).
READ_SHARE, READ_N = 0.01, 0.01
SIDE = "at the sensor's side"
BACK = "at the sensor's back, from behind the sensor or from inside it"
ADHESION = "pulling at the sensor"
# Places of forces that are not read.
THROUGH = "on the mount, through the soft layer; make the contact with the sensor stiffer"
UNSTEADY = (
    f"it fell asleep before it was at rest; its force is the mean of {WAKING_STEPS} steps after it "
    f"is woken, of which some differ from the mean by more than {100 * READ_SHARE:g} %"
)
"""Reason of a notice without a force."""
# Largest force of all bodies together, N: below the limit on a press by more than rounding.
MAX_FORCE_N = 0.9999 * FORCE_RANGE_N[1]
# Distance by which the outline of a body that the grid cannot resolve is moved outward, mm.
WIDER_MM = SURVEY_MM / 2
# Widths of a body, in cells of its height map (assumed). Below the first it is made wider. Below
# the second its width on the map depends on its place.
THIN_CELLS, NARROW_CELLS = 3, 4
EASED = (1.0, 0.5, 0.25, 0.0)  # shares of a tangential load that are tried (assumed)

NO_CONTACTS = mujoco.mjtDisableBit.mjDSBL_CONTACT | mujoco.mjtDisableBit.mjDSBL_CONSTRAINT

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
# Reasons of notices of geoms in the soft layer without a contact, each with what to do.
DISABLED = "MuJoCo computes no contacts, by a flag of the model; enable contact and constraint"
NO_CONTACT = "it is in the soft layer, but MuJoCo makes no contact of it with the sensor: "
FIXED = (
    f"{NO_CONTACT}neither can move; mount the sensor on the surface of its mount, and give other "
    "bodies a joint (a mocap body: a weld to a body with a joint)"
)
OWN = f"{NO_CONTACT}it is welded to it; mount the sensor on the surface of its mount"
PARENT = f"{NO_CONTACT}one is the parent of the other; disable filterparent, or add a pair"
EXCLUDED = f"{NO_CONTACT}an exclude names their bodies; remove it, or add a pair"
MASKED = f"{NO_CONTACT}collision masks differ; change contype or conaffinity, or add a pair"


class Pose(NamedTuple):
    """Rotation (3, 3) and position (3,), m, of a frame in the world."""

    rotation: np.ndarray
    position_m: np.ndarray

    @property
    def matrix(self) -> np.ndarray:
        """(4, 4) homogeneous transform to the world, m."""
        matrix = np.eye(4)
        matrix[:3, :3], matrix[:3, 3] = self.rotation, self.position_m
        return matrix


class Place(NamedTuple):
    """A sensor in a state of a simulation."""

    model: "mujoco.MjModel"
    data: "mujoco.MjData"
    geom: int
    frame: Pose


def find_elements(model: "mujoco.MjModel", name: str, suffix: str = "") -> tuple[int, int]:
    """Ids of a sensor's site and geom. Raises T2TwinError for no such sensor, and for several."""
    own = f"{name}/{FRAME}{suffix}"
    site = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_SITE, own)
    if site < 0:
        names = [model.site(number).name for number in range(model.nsite)]
        found = [number for number, each in enumerate(names) if own in each]
        if not found:
            raise T2TwinError(
                f"the model has no site {own}; expected a model compiled from the spec to which "
                f"{name} was attached"
            )
        if len(found) > 1:
            there = ", ".join(names[number] for number in found)
            raise T2TwinError(
                f"the model has several sites {own}: {there}; use {name}.with_prefix(PREFIX), one "
                "for each"
            )
        site, own = found[0], names[found[0]]
    surface = own.replace(f"{name}/{FRAME}", f"{name}/{SURFACE}")
    return site, mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_GEOM, surface)


def without_contact(at: Place, elastomer: Elastomer) -> dict[int, str]:
    """Geoms of which MuJoCo makes no contacts with the geom of a sensor, and the reason; of those
    that are welded to it only what is in its layer."""
    model, data, sensor, frame = at
    bodies, collides = model.geom_bodyid, colliding(model)
    welded, is_fixed = model.body_weldid[bodies], model.body_treeid[bodies] < 0
    parents, own = model.body_weldid[model.body_parentid[welded]], welded[sensor]
    is_parent = (parents == own) | (welded == parents[sensor])
    is_parent &= (own > 0) & (welded > 0)
    if model.opt.disableflags & mujoco.mjtDisableBit.mjDSBL_FILTERPARENT:
        is_parent[:] = False
    low, high = np.minimum(bodies, bodies[sensor]), np.maximum(bodies, bodies[sensor])
    kinds, affinities = model.geom_contype, model.geom_conaffinity
    meets = (kinds & affinities[sensor]) | (kinds[sensor] & affinities) != 0
    pairs, is_paired = np.stack([model.pair_geom1, model.pair_geom2]), np.zeros(model.ngeom, bool)
    is_paired[pairs[:, (pairs == sensor).any(axis=0)]] = True
    # Geoms that are only seen are left out.
    is_seen = ~collides & ((welded == own) | np.isin(bodies, bodies[collides]))
    is_seen[sensor] = True
    is_far = welded == own
    is_far[lying_in(model, data, np.flatnonzero(is_far & ~is_seen), *frame, elastomer)] = False
    found: dict[int, str] = {}
    for reason, applies in (
        (FIXED, is_fixed & is_fixed[sensor]),
        (OWN, welded == own),
        (PARENT, is_parent & ~is_paired),
        (EXCLUDED, np.isin((low << 16) + high, model.exclude_signature) & ~is_paired),
        (MASKED, ~meets & ~is_paired),
    ):
        for geom in np.flatnonzero(applies & ~is_seen & ~is_far).tolist():
            found.setdefault(geom, reason)
    return found


def silent_notices(at: Place, geoms: dict[int, str], elastomer: Elastomer) -> list[Notice]:
    """Of those of the geoms, with a reason each, that are in the soft layer."""
    model, data, _, frame = at
    if model.opt.disableflags & NO_CONTACTS:
        return [Notice("all bodies", DISABLED)]
    return [
        Notice(
            model.geom(geom).name or model.body(model.geom_bodyid[geom]).name or f"geom {geom}",
            geoms[geom],
        )
        for geom in lying_in(model, data, np.array([*geoms], int), *frame, elastomer)
    ]


def check_state(model: "mujoco.MjModel", data: "mujoco.MjData") -> None:
    """Raises T2TwinError for a model or data that cannot be read."""
    for value, name, kind in ((model, "model", mujoco.MjModel), (data, "data", mujoco.MjData)):
        if not isinstance(value, kind):
            raise T2TwinError(
                f"{name} is {arguments.describe(value)}; expected a mujoco.{kind.__name__} "
                "(mjx.get_data copies a state of MJX into one)"
            )
    if model.signature != data.signature:
        raise T2TwinError("data is of another model; expected a mujoco.MjData of this model")
    for name in ("time", "qpos", "qvel", "xpos", "xmat", "efc_force"):
        if not np.isfinite(getattr(data, name)).all():
            raise T2TwinError(
                f"data.{name} is not finite: the simulation has diverged; take a smaller time "
                "step, or reset the state"
            )


def frame_of(data: "mujoco.MjData", site: int) -> Pose:
    """The sensor frame. Raises T2TwinError for data without poses."""
    rotation = data.site_xmat[site].reshape(3, 3).copy()
    if not rotation.any():
        raise T2TwinError(
            "data has no poses yet; call mujoco.mj_forward(model, data) before the first read"
        )
    return Pose(rotation, data.site_xpos[site].copy())


def body_pose(at: Place, body: int) -> Pose:
    """The pose of a body in the sensor frame."""
    back, rotation = at.frame.rotation.T, at.data.xmat[body].reshape(3, 3)
    return Pose(back @ rotation, back @ (at.data.xpos[body] - at.frame.position_m))


@dataclass
class Body:
    """What one body does to a sensor, in the sensor frame."""

    number: int  # its id, or that of the first of bodies that are welded together
    name: str
    # Force with which it presses, N, and torque about the sensor's axis, N mm.
    force_n: np.ndarray = field(default_factory=lambda: np.zeros(3))
    torque_nmm: float = 0.0
    # Means over the contacts, weighted with their normal forces, whose sum is weight_n.
    center_mm: np.ndarray = field(default_factory=lambda: np.zeros(3))
    friction: float = 0.0
    weight_n: float = 0.0
    unread_n: dict[str, np.ndarray] = field(default_factory=dict)  # (3,) by reason
    shape: Shape | None = None  # its surface; None for none over the sensor
    motion: tuple[float, float, float] | None = None  # as of a Load

    @property
    def pressing_n(self) -> float:
        """The force into the sensor."""
        return -float(self.force_n[2])

    def press(
        self,
        force_n: np.ndarray,
        torque_nmm: float,
        center_mm: np.ndarray,
        friction: float,
        weight_n: float,
    ) -> None:
        """Add a force that presses."""
        self.force_n = self.force_n + force_n
        self.torque_nmm = self.torque_nmm + torque_nmm
        self.weight_n += weight_n
        share = weight_n / self.weight_n
        self.center_mm = self.center_mm + share * (center_mm - self.center_mm)
        self.friction += share * (friction - self.friction)

    def leave_unread(self, reason: str, force_n: np.ndarray) -> None:
        """Add a force that no reading contains."""
        self.unread_n[reason] = self.unread_n.get(reason, 0.0) + force_n


def _body(model: "mujoco.MjModel", found: dict[int, Body], number: int) -> Body:
    """The body of a number among those found, added where it is missing."""
    return found.setdefault(number, Body(number, model.body(number).name or f"body {number}"))


def contact_forces(at: Place) -> list[Body]:
    """The bodies whose contacts act on a sensor's geom. Raises T2TwinError for a flex."""
    found: dict[int, Body] = {}
    (model, _, geom, frame), contacts = at, at.data.contact
    for index in np.flatnonzero((contacts.geom == geom).any(axis=1)).tolist():
        contact = contacts[index]
        first, second = contact.geom
        sign, other = (1.0, first) if second == geom else (-1.0, second)
        if other < 0:
            raise T2TwinError(
                f"a flex touches geom {model.geom(geom).name}; sensors read rigid bodies only"
            )
        force, axes, force_n = _decoded(at, index, sign)
        if force[0] == 0:
            continue
        body = _body(model, found, int(model.body_weldid[model.geom_bodyid[other]]))
        # MuJoCo's normal points from the first geom to the second, which the force acts on
        facing = -sign * axes[0, 2]
        if force[0] < 0:
            body.leave_unread(ADHESION, force_n)
        elif facing < MIN_FACING:
            body.leave_unread(SIDE if facing > -MIN_FACING else BACK, force_n)
        else:
            at_mm = MM_PER_M * (contact.pos - frame.position_m) @ frame.rotation
            torque_nmm = MM_PER_M * sign * float(force[3:] @ axes[:, 2])
            torque_nmm += float(at_mm[0] * force_n[1] - at_mm[1] * force_n[0])
            friction = float(contact.friction[0]) if contact.dim > 1 else 0.0
            body.press(force_n, torque_nmm, at_mm, friction, float(force[0]))
    _add_through(at, found)
    return [found[number] for number in sorted(found)]


def _decoded(at: Place, index: int, sign: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """A contact's force and torque, (6,), along its axes, (3, 3), and its force on the sensor."""
    force = np.zeros(6)
    mujoco.mj_contactForce(at.model, at.data, index, force)
    axes = at.data.contact[index].frame.reshape(3, 3) @ at.frame.rotation
    return force, axes, sign * force[:3] @ axes


def _add_through(at: Place, bodies: dict[int, Body]) -> None:
    """Forces on geoms welded to a sensor's, inside it: a soft contact lets bodies through."""
    (model, data, geom, _), contacts = at, at.data.contact
    welded, (first, second) = model.body_weldid[model.geom_bodyid], contacts.geom.T
    is_own = welded == welded[geom]
    is_own[geom] = False
    pressing = [body.number for body in bodies.values() if body.weight_n]
    if not pressing or not (is_own[first] | is_own[second]).any():
        return
    is_theirs, rotation = np.isin(welded, pressing), data.geom_xmat[geom].reshape(3, 3)
    middle, half = model.geom_aabb[geom, :3], model.geom_aabb[geom, 3:]
    is_through = (is_own[first] & is_theirs[second]) | (is_own[second] & is_theirs[first])
    for index in np.flatnonzero(is_through & (first >= 0) & (second >= 0)).tolist():
        inside = (contacts[index].pos - data.geom_xpos[geom]) @ rotation - middle
        sign, other = (1.0, first) if is_own[second[index]] else (-1.0, second)
        force, _, force_n = _decoded(at, index, sign)
        if force[0] > 0 and (np.abs(inside) <= half).all():
            bodies[int(welded[other[index]])].leave_unread(THROUGH, force_n)


def sleeping_forces(at: Place, asleep: np.ndarray) -> list[Body]:
    """As contact_forces, of bodies that sleep, (bodies,) bool, of which MuJoCo has no contacts:
    means over WAKING_STEPS steps of a copy of the state in which all bodies are awake."""
    woken = copy(at.data)
    woken.qvel[woken.qvel == 0] = -0.0  # any byte that is not 0 wakes a body
    found: dict[int, Body] = {}
    steps_n: dict[int, np.ndarray] = defaultdict(lambda: np.zeros((WAKING_STEPS, 3)))
    for step in range(WAKING_STEPS):
        mujoco.mj_step(at.model, woken)
        for now in contact_forces(at._replace(data=woken)):
            if not asleep[now.number]:
                continue
            mean = _body(at.model, found, now.number)
            if now.weight_n:
                steps_n[now.number][step] = now.force_n
                force_n, torque_nmm = now.force_n / WAKING_STEPS, now.torque_nmm / WAKING_STEPS
                mean.press(force_n, torque_nmm, now.center_mm, now.friction, now.pressing_n)
            for reason, unread_n in now.unread_n.items():
                mean.leave_unread(reason, unread_n / WAKING_STEPS)
    for number, forces_n in steps_n.items():
        mean_n = forces_n.mean(axis=0)
        differences_n = np.linalg.norm(forces_n - mean_n, axis=1)
        if differences_n.max() > max(READ_SHARE * np.linalg.norm(mean_n), READ_N):
            found[number].leave_unread(UNSTEADY, np.zeros(3))
    return [found[number] for number in sorted(found)]


def relative_motion(
    before: Pose | None, now: Pose, center_mm: np.ndarray
) -> tuple[float, float, float]:
    """dx, dy, mm, and rotation of a body's surface along the sensor between two poses in its frame.

    center_mm: (3,) the place of contact, whose motion is exact; a rolling body has none there.
    """
    if before is None:
        return 0.0, 0.0, 0.0
    turn = now.rotation @ before.rotation.T
    there = turn @ (center_mm - MM_PER_M * before.position_m) + MM_PER_M * now.position_m
    dyaw = atan2(turn[1, 0] - turn[0, 1], turn[0, 0] + turn[1, 1])
    cos, sin, (x, y, _) = np.cos(dyaw), np.sin(dyaw), center_mm
    return float(there[0] - cos * x + sin * y), float(there[1] - sin * x - cos * y), dyaw


def loaded_contact(
    elastomer: Elastomer, pitch_mm: float, bodies: Sequence[Body], before: Contact | None
) -> tuple[Contact | None, list[Notice]]:
    """The contact of pressing bodies with an elastomer, and notices of what it lacks.

    Forces above MAX_FORCE_N are reduced, all by the same share, as are tangential loads that leave
    a body without surface. A body without a cell of the grid is made wider. before: as for `carry`.
    """
    limit = MAX_FORCE_N / max(sum(body.pressing_n for body in bodies), MAX_FORCE_N)
    trials = {body.name: _trials(body, limit) for body in bodies}
    chosen = {name: next(each, None) for name, each in trials.items()}
    contact = None
    while contact is None and (left := [each for each in chosen.values() if each is not None]):
        is_new = any(share == 0.0 for _, share, _ in left)
        try:
            loads = [load for load, *_ in left]
            contact = carry(elastomer, pitch_mm, loads, None if is_new else before)
        except OffPadError as error:
            chosen[error.shape] = next(trials[error.shape], None)
    notices = [_notice(contact, body, chosen[body.name], limit < 1.0) for body in bodies]
    return contact, [each for each in notices if each is not None]


def _trials(body: Body, limit: float) -> Iterator[tuple[Load, float, bool]]:
    """What is tried for a body: a load, its share of the tangential one, whether it is wider."""
    if body.shape is None:
        return
    along_x, along_y, _ = (limit * body.force_n).tolist()
    force_n, torque_nmm = limit * body.pressing_n, limit * body.torque_nmm
    friction, surface = Friction(min(body.friction, MAX_FRICTION)), body.shape.surface
    covered_mm2 = np.count_nonzero(surface.heights_mm > NOTHING_MM / 2) * surface.pitch_mm**2
    is_thin = covered_mm2 < SURVEY_MM**2 or not covers_square(surface.heights_mm, THIN_CELLS)
    # The last begins without traction.
    shares = EASED if along_x or along_y or torque_nmm else (1.0, 0.0)
    for is_wider in (True,) if is_thin else (False, True):
        shape = _wider(body.shape) if is_wider else body.shape
        for share in shares:
            load = Load(
                shape, max(force_n, FORCE_RANGE_N[0]), (share * along_x, share * along_y),
                share * torque_nmm, body.motion, friction,
            )  # fmt: skip
            yield load, share, is_wider


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
    contact: Contact | None, body: Body, chosen: tuple[Load, float, bool] | None, is_limited: bool
) -> Notice | None:
    """What a contact lacks of a body's force. chosen: see `_trials`; None for no load."""
    read_n = _read_n(contact, body.name)
    lacking, known = body.force_n - read_n, [NO_SURFACE] if chosen is None else []
    if chosen is not None:
        known = [LIMIT] if is_limited else []
        load, share, is_wider = chosen
        is_less = _is_much(load.shear_n - read_n[:2], np.array(load.shear_n))
        if share < 1.0 or (is_less and (known or is_wider)):
            known.append(TANGENTIAL)
        known += [THIN] if is_wider else []
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
    """Of forces that no reading contains; not of light bodies with less than READ_N together."""
    light_n = np.linalg.norm(sum(body.unread_n.get(LIGHT, 0.0) for body in bodies))
    return [
        Notice(body.name, reason, tuple(force_n.tolist()))
        for body in bodies
        for reason, force_n in body.unread_n.items()
        if reason == UNSTEADY or (light_n if reason == LIGHT else np.linalg.norm(force_n)) > READ_N
    ]
