"""Where a sensor is in a MuJoCo model, and what MuJoCo's contacts do to it."""

# MuJoCo defines its names at import, where pyright does not find them.
# pyright: reportAttributeAccessIssue=false

from copy import copy
from dataclasses import dataclass
from math import atan2
from typing import NamedTuple

import mujoco
import numpy as np

from t2twin.attachment.geometry import MM_PER_M, colliding
from t2twin.core import arguments
from t2twin.core.errors import T2TwinError

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


class Pose(NamedTuple):
    """Rotation (3, 3) and position (3,), m, of a frame in the world."""

    rotation: np.ndarray
    position_m: np.ndarray

    def in_frame(self, other: "Pose") -> "Pose":
        """This pose relative to another frame."""
        back = other.rotation.T
        return Pose(back @ self.rotation, back @ (self.position_m - other.position_m))

    @property
    def matrix(self) -> np.ndarray:
        """(4, 4) homogeneous transform to the world, m."""
        matrix = np.eye(4)
        matrix[:3, :3], matrix[:3, 3] = self.rotation, self.position_m
        return matrix


class Elements(NamedTuple):
    """Ids of a sensor's site and geom in a model."""

    site: int
    geom: int


def find_elements(model: "mujoco.MjModel", name: str, suffix: str = "") -> Elements:
    """The elements of a sensor, whose names may have got a prefix and a suffix.

    suffix: that which is known.
    Raises T2TwinError if there is no such sensor, or if there are several.
    """
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
    return Elements(site, mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_GEOM, surface))


def kept_away(model: "mujoco.MjModel", sensor: int) -> list[str]:
    """Names of moving geoms that collide with something, but not with the geom of a sensor."""
    kinds, affinities = model.geom_contype, model.geom_conaffinity
    meets = (kinds & affinities[sensor]) | (kinds[sensor] & affinities) != 0
    paired = (model.pair_geom1 == sensor) | (model.pair_geom2 == sensor)
    meets[model.pair_geom1[paired]] = meets[model.pair_geom2[paired]] = True
    welded = model.body_weldid[model.geom_bodyid]
    found = np.flatnonzero(colliding(model) & ~meets & (welded != welded[sensor]) & (welded != 0))
    return [model.geom(number).name or f"geom {number}" for number in found.tolist()]


def check_state(model: "mujoco.MjModel", data: "mujoco.MjData") -> None:
    """Raises T2TwinError for a model or data that cannot be read."""
    for value, name, kind in (
        (model, "model", mujoco.MjModel),
        (data, "data", mujoco.MjData),
    ):
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


@dataclass(frozen=True)
class Wrench:
    """Force and torque of one body on a sensor, in the sensor frame.

    body: id of the body, the first of those that are welded together. force_n: (3,).
    torque_nmm: (3,) about the sensor's origin. center_mm: (3,) mean of the places of contact,
    weighted with their normal forces. friction: coefficient, the mean weighted in the same way.
    """

    body: int
    force_n: np.ndarray
    torque_nmm: np.ndarray
    center_mm: np.ndarray
    friction: float

    @property
    def pressing_n(self) -> float:
        """The force into the sensor."""
        return -float(self.force_n[2])


class Push(NamedTuple):
    """A force on a sensor that no reading contains.

    body: as of a Wrench. reason: a clause that names the cause. force_n: (3,) in the sensor frame.
    """

    body: int
    reason: str
    force_n: np.ndarray


def contact_forces(
    model: "mujoco.MjModel", data: "mujoco.MjData", geom: int, frame: Pose
) -> tuple[list[Wrench], list[Push]]:
    """What the contacts of a sensor's geom do to it: the wrenches of the bodies that press, by body
    id, and the other forces.

    Raises T2TwinError for a flex that touches the sensor.
    """
    found: dict[int, list[tuple]] = {}
    others: list[Push] = []
    contacts = data.contact
    for index in np.flatnonzero((contacts.geom == geom).any(axis=1)):
        contact = contacts[int(index)]
        first, second = contact.geom
        sign, other = (1.0, first) if second == geom else (-1.0, second)
        if other < 0:
            raise T2TwinError(
                f"a flex touches geom {model.geom(geom).name}; sensors read rigid bodies only"
            )
        force, axes, force_n = _decoded(model, data, int(index), sign, frame)
        if force[0] == 0:
            continue
        body = int(model.body_weldid[model.geom_bodyid[other]])
        # MuJoCo's normal points from the first geom to the second, which the force acts on
        facing = -sign * axes[0, 2]
        if facing < MIN_FACING or force[0] < 0:
            reason = SIDE if facing > -MIN_FACING else BACK
            others.append(Push(body, ADHESION if force[0] < 0 else reason, force_n))
            continue
        at_mm = MM_PER_M * (contact.pos - frame.position_m) @ frame.rotation
        torque_nmm = MM_PER_M * sign * force[3:] @ axes + np.cross(at_mm, force_n)
        friction = float(contact.friction[0]) if contact.dim > 1 else 0.0
        found.setdefault(body, []).append((force_n, torque_nmm, at_mm, force[0], friction))
    others += _through(model, data, geom, frame, set(found))
    return [_sum(body, found[body]) for body in sorted(found)], others


def _decoded(
    model: "mujoco.MjModel", data: "mujoco.MjData", index: int, sign: float, frame: Pose
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """A contact's force and torque along its own axes, (6,); these axes in the sensor frame, (3, 3)
    rows; and its force on the sensor, (3,), N.

    index: of the contact. sign: 1 where its second geom is the sensor's, else -1.
    """
    force = np.zeros(6)
    mujoco.mj_contactForce(model, data, index, force)
    axes = data.contact[index].frame.reshape(3, 3) @ frame.rotation
    return force, axes, sign * force[:3] @ axes


def _through(
    model: "mujoco.MjModel", data: "mujoco.MjData", geom: int, frame: Pose, bodies: set[int]
) -> list[Push]:
    """Forces on geoms welded to a sensor's, inside it: a soft contact lets bodies through."""
    if not bodies:
        return []
    welded = model.body_weldid[model.geom_bodyid]
    is_own, is_theirs = welded == welded[geom], np.isin(welded, list(bodies))
    is_own[geom] = False
    contacts, found = data.contact, []
    middle, half = model.geom_aabb[geom, :3], model.geom_aabb[geom, 3:]
    rotation = data.geom_xmat[geom].reshape(3, 3)
    first, second = contacts.geom.T
    is_through = (is_own[first] & is_theirs[second]) | (is_own[second] & is_theirs[first])
    for index in np.flatnonzero(is_through & (first >= 0) & (second >= 0)).tolist():
        contact = contacts[index]
        inside = (contact.pos - data.geom_xpos[geom]) @ rotation - middle
        sign, other = (1.0, first) if is_own[second[index]] else (-1.0, second)
        force, _, force_n = _decoded(model, data, index, sign, frame)
        if force[0] <= 0 or (np.abs(inside) > half).any():
            continue
        found.append(Push(int(welded[other[index]]), THROUGH, force_n))
    return found


def sleeping_forces(
    model: "mujoco.MjModel", data: "mujoco.MjData", geom: int, frame: Pose, asleep: np.ndarray
) -> tuple[list[Wrench], list[Push]]:
    """As contact_forces, of bodies that sleep, of which MuJoCo computes no contacts.

    Means over WAKING_STEPS steps of a copy of the state in which all bodies are awake.
    asleep: (bodies,) whether each sleeps.
    """
    woken = copy(data)
    woken.qvel[woken.qvel == 0] = -0.0  # any byte that is not 0 wakes a body
    wrenches: dict[int, list[Wrench]] = {}
    pushes: dict[tuple[int, str], np.ndarray] = {}
    for _ in range(WAKING_STEPS):
        mujoco.mj_step(model, woken)
        pressing, others = contact_forces(model, woken, geom, frame)
        for wrench in pressing:
            if asleep[wrench.body]:
                wrenches.setdefault(wrench.body, []).append(wrench)
        for body, reason, force_n in others:
            if asleep[body]:
                mean_n = force_n / WAKING_STEPS
                pushes[body, reason] = pushes.get((body, reason), np.zeros(3)) + mean_n
    unread = [Push(*key, force_n) for key, force_n in pushes.items()]
    return (
        [_mean(wrenches[body]) for body in sorted(wrenches)],
        unread
        + [Push(body, UNSTEADY, np.zeros(3)) for body in wrenches if _is_unsteady(wrenches[body])],
    )


def _mean(steps: list[Wrench]) -> Wrench:
    """The mean wrench of a body in WAKING_STEPS steps, of which some may lack its contact."""
    share = np.array([each.pressing_n for each in steps])
    share /= share.sum()
    return Wrench(
        steps[0].body,
        np.sum([each.force_n for each in steps], axis=0) / WAKING_STEPS,
        np.sum([each.torque_nmm for each in steps], axis=0) / WAKING_STEPS,
        share @ [each.center_mm for each in steps],
        float(share @ [each.friction for each in steps]),
    )


def _is_unsteady(steps: list[Wrench]) -> bool:
    """Whether the force of a body differs between the steps by more than that of one at rest."""
    forces = np.zeros((WAKING_STEPS, 3))
    forces[: len(steps)] = [each.force_n for each in steps]
    mean_n = forces.mean(axis=0)
    differences_n = np.linalg.norm(forces - mean_n, axis=1)
    return bool(differences_n.max() > max(READ_SHARE * np.linalg.norm(mean_n), READ_N))


def _sum(body: int, parts: list) -> Wrench:
    """The wrench of a body's contacts: force, torque, place, normal force and friction of each."""
    forces, torques, places, normal, friction = (
        np.array(part) for part in zip(*parts, strict=True)
    )
    share = normal / normal.sum()
    return Wrench(
        body, forces.sum(axis=0), torques.sum(axis=0), share @ places, float(share @ friction)
    )


def relative_motion(
    before: Pose | None, now: Pose, center_mm: np.ndarray
) -> tuple[float, float, float]:
    """Motion of a body's surface along the sensor, between two poses in the sensor frame.

    center_mm: (3,) the place of contact, whose motion is exact; a rolling body has none there.
    Returns dx and dy, mm, and the angle of the rotation about the sensor's z axis.
    """
    if before is None:
        return 0.0, 0.0, 0.0
    turn = now.rotation @ before.rotation.T
    there = turn @ (center_mm - MM_PER_M * before.position_m) + MM_PER_M * now.position_m
    dyaw = atan2(turn[1, 0] - turn[0, 1], turn[0, 0] + turn[1, 1])
    cos, sin, (x, y, _) = np.cos(dyaw), np.sin(dyaw), center_mm
    return float(there[0] - cos * x + sin * y), float(there[1] - sin * x - cos * y), dyaw
