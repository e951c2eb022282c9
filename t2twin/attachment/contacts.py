"""Where a sensor is in a MuJoCo model, and what MuJoCo's contacts do to it."""

# MuJoCo defines its names at import, where pyright does not find them.
# pyright: reportAttributeAccessIssue=false

from collections import defaultdict
from copy import copy
from dataclasses import dataclass, field
from math import atan2
from typing import NamedTuple

import mujoco
import numpy as np

from t2twin.attachment.geometry import MM_PER_M, colliding
from t2twin.core import arguments
from t2twin.core.errors import T2TwinError
from t2twin.primitives_cad.shape import Shape

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


def find_elements(model: "mujoco.MjModel", name: str, suffix: str = "") -> tuple[int, int]:
    """Ids of a sensor's site and geom, whose names may have got a prefix and a suffix.

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
    return site, mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_GEOM, surface)


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


def body_pose(data: "mujoco.MjData", body: int) -> Pose:
    """The pose of a body."""
    return Pose(data.xmat[body].reshape(3, 3).copy(), data.xpos[body].copy())


@dataclass
class Body:
    """What one body does to a sensor, in the sensor frame.

    number: its id, or that of the first of bodies that are welded together. force_n, torque_nmm:
    (3,) with which it presses, about the sensor's origin. center_mm, friction: means of the places
    (3,) and the coefficients, weighted with the normal forces, whose sum is weight_n.
    unread_n: (3,) forces that no reading contains, by reason. shape: its surface, None for none
    over the sensor. motion: as of a Load.
    """

    number: int
    name: str
    force_n: np.ndarray = field(default_factory=lambda: np.zeros(3))
    torque_nmm: np.ndarray = field(default_factory=lambda: np.zeros(3))
    center_mm: np.ndarray = field(default_factory=lambda: np.zeros(3))
    friction: float = 0.0
    weight_n: float = 0.0
    unread_n: dict[str, np.ndarray] = field(default_factory=dict)
    shape: Shape | None = None
    motion: tuple[float, float, float] | None = None

    @property
    def pressing_n(self) -> float:
        """The force into the sensor."""
        return -float(self.force_n[2])

    def press(
        self,
        force_n: np.ndarray,
        torque_nmm: np.ndarray,
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


class Bodies(dict[int, Body]):
    """Bodies by number, each made where it is first looked up."""

    def __init__(self, model: "mujoco.MjModel") -> None:
        self._model = model

    def __missing__(self, number: int) -> Body:
        name = self._model.body(number).name or f"body {number}"
        self[number] = Body(number, name)
        return self[number]

    def in_order(self) -> list[Body]:
        """By number."""
        return [self[number] for number in sorted(self)]


def contact_forces(
    model: "mujoco.MjModel", data: "mujoco.MjData", geom: int, frame: Pose
) -> list[Body]:
    """The bodies whose contacts act on a sensor's geom, by number.

    Raises T2TwinError for a flex that touches the sensor.
    """
    found = Bodies(model)
    contacts = data.contact
    for index in np.flatnonzero((contacts.geom == geom).any(axis=1)).tolist():
        contact = contacts[index]
        first, second = contact.geom
        sign, other = (1.0, first) if second == geom else (-1.0, second)
        if other < 0:
            raise T2TwinError(
                f"a flex touches geom {model.geom(geom).name}; sensors read rigid bodies only"
            )
        force, axes, force_n = _decoded(model, data, index, sign, frame)
        if force[0] == 0:
            continue
        body = found[int(model.body_weldid[model.geom_bodyid[other]])]
        # MuJoCo's normal points from the first geom to the second, which the force acts on
        facing = -sign * axes[0, 2]
        if force[0] < 0:
            body.leave_unread(ADHESION, force_n)
        elif facing < MIN_FACING:
            body.leave_unread(SIDE if facing > -MIN_FACING else BACK, force_n)
        else:
            at_mm = MM_PER_M * (contact.pos - frame.position_m) @ frame.rotation
            torque_nmm = MM_PER_M * sign * force[3:] @ axes + np.cross(at_mm, force_n)
            friction = float(contact.friction[0]) if contact.dim > 1 else 0.0
            body.press(force_n, torque_nmm, at_mm, friction, float(force[0]))
    _add_through(model, data, geom, frame, found)
    return found.in_order()


def _decoded(
    model: "mujoco.MjModel", data: "mujoco.MjData", index: int, sign: float, frame: Pose
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """A contact's force and torque, (6,), along its axes, (3, 3), and its force on the sensor."""
    force = np.zeros(6)
    mujoco.mj_contactForce(model, data, index, force)
    axes = data.contact[index].frame.reshape(3, 3) @ frame.rotation
    return force, axes, sign * force[:3] @ axes


def _add_through(
    model: "mujoco.MjModel", data: "mujoco.MjData", geom: int, frame: Pose, bodies: Bodies
) -> None:
    """Forces on geoms welded to a sensor's, inside it: a soft contact lets bodies through."""
    pressing = [body.number for body in bodies.values() if body.weight_n]
    if not pressing:
        return
    welded = model.body_weldid[model.geom_bodyid]
    is_own, is_theirs = welded == welded[geom], np.isin(welded, pressing)
    is_own[geom] = False
    contacts = data.contact
    middle, half = model.geom_aabb[geom, :3], model.geom_aabb[geom, 3:]
    rotation = data.geom_xmat[geom].reshape(3, 3)
    first, second = contacts.geom.T
    is_through = (is_own[first] & is_theirs[second]) | (is_own[second] & is_theirs[first])
    for index in np.flatnonzero(is_through & (first >= 0) & (second >= 0)).tolist():
        inside = (contacts[index].pos - data.geom_xpos[geom]) @ rotation - middle
        sign, other = (1.0, first) if is_own[second[index]] else (-1.0, second)
        force, _, force_n = _decoded(model, data, index, sign, frame)
        if force[0] > 0 and (np.abs(inside) <= half).all():
            bodies[int(welded[other[index]])].leave_unread(THROUGH, force_n)


def sleeping_forces(
    model: "mujoco.MjModel", data: "mujoco.MjData", geom: int, frame: Pose, asleep: np.ndarray
) -> list[Body]:
    """As contact_forces, of bodies that sleep, (bodies,) bool, of which MuJoCo has no contacts.

    Means over WAKING_STEPS steps of a copy of the state in which all bodies are awake.
    """
    woken = copy(data)
    woken.qvel[woken.qvel == 0] = -0.0  # any byte that is not 0 wakes a body
    found, steps_n = Bodies(model), defaultdict(lambda: np.zeros((WAKING_STEPS, 3)))
    for step in range(WAKING_STEPS):
        mujoco.mj_step(model, woken)
        for now in contact_forces(model, woken, geom, frame):
            if not asleep[now.number]:
                continue
            mean = found[now.number]
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
    return found.in_order()


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
