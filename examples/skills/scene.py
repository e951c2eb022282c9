"""The MuJoCo scene of the skills: a hand with two fingers, which have equal sensors, and a rod.

The fingers move along x; the hand moves along y (across) and z (lift) and turns about x (tilt).
Lengths are in meters, angles in radians.
"""

# pyright: reportAttributeAccessIssue=false

from typing import Any

import mujoco
import numpy as np

import t2twin
from examples.gripper_scene import GEOM, STEEL_RGBA, add_gripper
from t2twin.sim.optical.gel_camera import GelCamera
from t2twin.sim.optical.units import UnitRanges

HEIGHT_M, OPEN_M = 0.1, 0.016
"""Height of the sensors' centers, and their distance from the middle while the gripper is open."""
PLACE_M, TURN_RAD = 0.0003, 0.01
"""Standard deviations of a sensor's place on its finger (assumed)."""
SERVOS = {"across": ([0, 1, 0], 2000.0), "tilt": ([1, 0, 0], 20.0)}
"""Axes and stiffness of the hand's further joints, N/m and Nm/rad (assumed: a compliant arm)."""
BOX, JOINT = GEOM.mjGEOM_BOX, mujoco.mjtJoint


class WithoutImage(GelCamera):
    """A gel camera that is not rendered: its readings have the contact alone."""

    def image(self, contact: t2twin.Contact | None, rng: np.random.Generator | None = None) -> Any:
        return None


def add_sampled_gripper(
    spec: mujoco.MjSpec, sensor: str, rng: np.random.Generator, with_image: bool
) -> tuple[t2twin.AttachedSensor, ...]:
    """Adds the hand; returns its sensors, whose places, light and noise are sampled.

    Actuators: force of each finger, N; lift and across, m; tilt, rad.
    """
    sensors = add_gripper(spec, HEIGHT_M, (sensor, sensor))
    for name, (axis, stiffness) in SERVOS.items():
        kind = JOINT.mjJNT_HINGE if name == "tilt" else JOINT.mjJNT_SLIDE
        spec.body("hand").add_joint(name=name, type=kind, axis=axis)
        servo = spec.add_actuator(name=name, target=name, trntype=mujoco.mjtTrn.mjTRN_JOINT)
        servo.set_to_position(kp=stiffness, dampratio=1.0)
    for side, attached in zip(("left", "right"), sensors, strict=True):
        spec.body(f"{side}_finger").pos = [-OPEN_M if side == "left" else OPEN_M, 0, 0]
        mount, device = spec.body(f"{attached.name}/body"), attached.device
        mount.pos += [*rng.normal(0.0, PLACE_M, 2), 0.0]
        mount.quat = turned(rng.normal(0.0, TURN_RAD), "z")
        attached.seed = int(rng.integers(2**31))
        if isinstance(device, GelCamera) and with_image:
            attached.device = device.sampled(rng, rng, UnitRanges(), None)
        elif isinstance(device, GelCamera):
            attached.device = WithoutImage(device.spec, device.folder)
    return sensors


def turned(angle: float, axis: str) -> np.ndarray:
    """The quaternion of a rotation about an axis."""
    return np.array([np.cos(angle / 2), *np.sin(angle / 2) * np.eye(3)["xyz".index(axis)]])


def prism(spec: mujoco.MjSpec, name: str, corners: Any, half_m: float) -> dict[str, Any]:
    """A convex geom with these corners, (n, 2) along x and y, and a length along z."""
    ends = [np.column_stack([corners, np.full(len(corners), z)]) for z in (-half_m, half_m)]
    spec.add_mesh(name=name, uservert=np.concatenate(ends).ravel())
    return {"type": GEOM.mjGEOM_MESH, "meshname": name}


def add_rod(
    spec: mujoco.MjSpec, kind: str, radius_m: float, half_m: float, pose: tuple[Any, Any],
    friction: float | None = None, mass_kg: float = 0.03,
) -> float:  # fmt: skip
    """Adds the body "object", which a magnet holds at first; returns half its width along y.

    kind: "cylinder", "box", "hexagon", or "key", a thin rod with a bit to one side. pose: place and
    quaternion. friction: with the sensors; None for theirs.
    """
    body = spec.worldbody.add_body(name="object", pos=pose[0], quat=pose[1])
    body.add_freejoint()
    own = {"condim": 4, "contype": 3, "conaffinity": 3, "rgba": STEEL_RGBA}
    own |= {"friction": [friction or 0.3, 0.005, 1e-4], "priority": int(friction is not None)}
    width_m = radius_m
    if kind == "hexagon":  # its flat sides touch the sensors
        width_m = radius_m / np.cos(np.pi / 6)
        angles = (np.arange(6) + 0.5) * np.pi / 3
        corners = width_m * np.stack([np.cos(angles), np.sin(angles)], axis=1)
        geom = prism(spec, "hexagon", corners, half_m)
    elif kind == "box":
        geom = {"type": BOX, "size": [radius_m, radius_m, half_m]}
    else:
        thin_m = radius_m if kind == "cylinder" else 0.7 * radius_m
        geom = {"type": GEOM.mjGEOM_CYLINDER, "size": [thin_m, half_m, 0]}
    body.add_geom(**geom, mass=mass_kg, **own)
    if kind == "key":
        size, place = [0.5 * radius_m, radius_m, 0.3 * half_m], [0, 0, -0.7 * half_m]
        body.add_geom(type=BOX, size=size, pos=place, mass=0.0, **own)
    magnet = spec.add_equality(type=mujoco.mjtEq.mjEQ_WELD, name="magnet")
    magnet.objtype, magnet.name1, magnet.name2 = mujoco.mjtObj.mjOBJ_BODY, "world", "object"
    magnet.data[:] = [*np.zeros(10), 1.0, 0.0]  # the initial pose
    return width_m


def add_hole(spec: mujoco.MjSpec, half_m: float, depth_m: float, chamfer_m: float) -> None:
    """A square hole in a plate on the floor, of half a width, with a chamfer of 45 degrees."""
    far_m = half_m + 0.03
    corners = [
        (half_m, 0), (far_m, 0), (far_m, depth_m), (half_m + chamfer_m, depth_m),
        (half_m, depth_m - chamfer_m),
    ]  # fmt: skip
    side = prism(spec, "side", corners, far_m)
    upright, around = turned(np.pi / 2, "x"), np.zeros(4)
    for quarter in range(4):
        mujoco.mju_mulQuat(around, turned(quarter * np.pi / 2, "z"), upright)
        geom = spec.worldbody.add_geom(**side, quat=around, condim=4, priority=1)
        geom.solref, geom.friction = [0.004, 1.0], [0.5, 0.005, 1e-4]  # stiff
