"""A gripper with a DIGIT and a CySkin grasps five tools, and a network predicts the CySkin's counts.

    python examples/gripper.py --out gripper.gif
    python examples/gripper.py --view --tools wrench

The DIGIT is in the left finger, the CySkin in the right one. The fingers close on a tool that a
magnet holds. The hand lifts and holds the tool, then the grip loosens until the tool slips.

The pretrained network predicts from the DIGIT's image what a CySkin in its place reads. The CySkin
touches the other side of the tool, but the two sides are alike. Of four tools they are mirror
images, so the network predicts the counts of mirrored taxels. Of the scissors, one side is the
other after half a turn. The table's second coverage does not need this: its truth is a virtual
CySkin in place of the DIGIT, under the same load.
"""

import argparse
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import mujoco
import numpy as np
from gripper_figure import Moment, Page, SceneRenderer, write_animation

import t2twin

GRASPS = {
    "wrench": "shank",
    "pliers": "teeth",
    "scissors": "pivot",
    "clamp": "screw",
    "allen-key": "long-arm",
}
"""The keypoint at which each tool is grasped."""

TURNED = ("scissors",)
"""Tools whose back is the front after half a turn. The others are mirror images."""

STEEL_KG_M3 = 7850.0
GEL_FRICTION, COVER_FRICTION = 0.8, 1.0  # as in t2twin.sim.contact.sliding (assumed)
GRIP_N, CLOSING_N = 8.0, 2.0
"""Force of each finger while it holds, and while it closes, N."""
LIFT_M, SLIPPED_M = 0.06, 0.012
"""Height of the lift, and distance that counts as slipped, m."""
CLOSED_S, LIFTED_S, HELD_S, END_S = 0.6, 1.6, 3.6, 6.0
"""Ends of the phases: close, lift, hold for 2 s, loosen, s."""
RATE_HZ = 25.0
OPEN_M = 0.025
"""Distance of each sensor from the middle while the gripper is open, m."""
HANG_M = 0.02
"""Height of the tool's lowest point above the floor, m."""

CELL_MM, REACH_MM, LEVEL_MM = 4.0, 28.0, 0.3
"""Side of the cells of collision boxes, reach of these boxes from the grasp, and depth below the
highest place of a cell up to which a box covers the tool, mm."""
TOOL_FRICTION = [0.1, 0.005, 0.0001]
"""MuJoCo uses the larger friction of two geoms; the sensors' is larger. The second value, m, is
for torsion."""
PALM_M, BACK_M, MAGNET_HALF_M = 0.11, 0.035, 0.008
"""Height of the palm above the sensors' centers, distance of a finger from its sensor's surface,
half side of the magnet, m."""
STEEL_RGBA, HAND_RGBA = [0.62, 0.65, 0.70, 1.0], [0.25, 0.28, 0.33, 1.0]
MAGNET_RGBA, FLOOR_RGBA = [0.75, 0.25, 0.2, 1.0], [0.88, 0.88, 0.86, 1.0]
GEOM = mujoco.mjtGeom


@dataclass(frozen=True)
class Scene:
    """A compiled scene with its two sensors."""

    model: mujoco.MjModel
    digit: t2twin.AttachedSensor
    cyskin: t2twin.AttachedSensor


def build(tool: str) -> Scene:
    """The gripper around a tool, which hangs with its center of mass below the grasp."""
    shape = t2twin.load_shape(f"{tool}/{GRASPS[tool]}")
    vertices = in_scene(shape, np.asarray(shape.mesh.vertices))
    height = HANG_M - float(vertices[:, 2].min())
    spec = mujoco.MjSpec()
    add_room(spec)
    spec.add_mesh(
        name=tool, uservert=vertices.ravel(), userface=shape.mesh.faces.ravel(),
        inertia=mujoco.mjtMeshInertia.mjMESH_INERTIA_EXACT,
    )  # fmt: skip
    body = spec.worldbody.add_body(name=tool, pos=[0, 0, height])
    body.add_freejoint()
    body.add_geom(
        type=GEOM.mjGEOM_MESH, meshname=tool, density=STEEL_KG_M3, contype=0, conaffinity=0,
        rgba=STEEL_RGBA,
    )  # fmt: skip
    for center, half in collision_boxes(tool, shape):
        body.add_geom(
            type=GEOM.mjGEOM_BOX, pos=center, size=half, quat=in_scene_quat(shape), mass=0, group=3,
            condim=4, friction=TOOL_FRICTION,
        )  # fmt: skip
    low = vertices[vertices[:, 2] < vertices[:, 2].min() + 2 * MAGNET_HALF_M]
    spec.worldbody.add_geom(
        type=GEOM.mjGEOM_BOX, size=[MAGNET_HALF_M, MAGNET_HALF_M, HANG_M / 2 + MAGNET_HALF_M],
        pos=[low[:, 0].max() + MAGNET_HALF_M, low[:, 1].mean(), HANG_M / 2 + MAGNET_HALF_M],
        contype=0, conaffinity=0, rgba=MAGNET_RGBA,
    )  # fmt: skip
    magnet = spec.add_equality(type=mujoco.mjtEq.mjEQ_WELD, name="magnet")
    magnet.objtype, magnet.name1, magnet.name2 = mujoco.mjtObj.mjOBJ_BODY, tool, "world"
    magnet.data[:] = [*np.zeros(10), 1.0, 0.0]  # the initial pose, the default torque scale
    digit, cyskin = add_gripper(spec, height)
    return Scene(spec.compile(), digit, cyskin)


def add_room(spec: mujoco.MjSpec) -> None:
    """Floor, light and camera, and MuJoCo's options."""
    spec.option.cone = mujoco.mjtCone.mjCONE_ELLIPTIC
    spec.option.impratio = 20.0  # reduces the creep of contacts that stick
    spec.visual.headlight.ambient = spec.visual.headlight.diffuse = [0.4, 0.4, 0.4]
    spec.visual.map.znear = 0.02
    spec.worldbody.add_geom(
        type=GEOM.mjGEOM_PLANE, size=[0.4, 0.4, 0.01], contype=0, conaffinity=0, rgba=FLOOR_RGBA
    )
    spec.worldbody.add_light(pos=[-0.3, -0.4, 0.8], dir=[0.3, 0.4, -0.8], castshadow=True)


def axes_of(shape: t2twin.Shape) -> np.ndarray:
    """(3, 3) the scene's axes in the shape frame: the center of mass is below the grasp, and the
    shape's pressing side faces -x."""
    up = -np.array([*shape.mesh.center_mass[:2], 0.0])
    up /= np.linalg.norm(up)
    out = np.array([0.0, 0.0, 1.0])
    return np.stack([-out, np.cross(out, up), up])


def in_scene(shape: t2twin.Shape, points_mm: np.ndarray) -> np.ndarray:
    """Points of the shape frame, (n, 3) mm, in the frame of the tool's body, m.

    The body's origin is in the middle of the grasp.
    """
    middle = [0.0, 0.0, shape.mesh.bounds[:, 2].mean()]
    return 1e-3 * (points_mm - middle) @ axes_of(shape).T


def in_scene_quat(shape: t2twin.Shape) -> np.ndarray:
    quat = np.zeros(4)
    mujoco.mju_mat2Quat(quat, axes_of(shape).ravel())
    return quat


def collision_boxes(tool: str, shape: t2twin.Shape) -> Iterator[tuple[np.ndarray, np.ndarray]]:
    """Centers and half sides, m, of boxes that fill the tool where the sensors can touch it.

    Each box has the height of the tool's highest place in a square cell, on both sides.
    """
    middle = shape.mesh.bounds[:, 2].mean()
    inside = (np.arange(16) + 0.5) / 16 * CELL_MM
    corners = np.arange(-REACH_MM, REACH_MM, CELL_MM)
    for x_mm, y_mm in np.stack(np.meshgrid(corners, corners), -1).reshape(-1, 2):
        x, y = np.meshgrid(x_mm + inside, y_mm + inside)
        front = shape.surface.sample(x, y) - middle
        back = shape.surface.sample(-x, y) - middle if tool in TURNED else front
        filled = (front > front.max() - LEVEL_MM) & (front > 0.0)
        if filled.any():
            low = [x[filled].min(), y[filled].min(), middle - max(back.max(), 0.0)]
            high = [x[filled].max(), y[filled].max(), middle + front.max()]
            center, half = np.add(low, high) / 2, np.subtract(high, low) / 2
            yield in_scene(shape, center), 1e-3 * np.maximum(half, LEVEL_MM)


def add_gripper(spec: mujoco.MjSpec, height: float) -> tuple[t2twin.AttachedSensor, ...]:
    """A hand that moves up and down, two coupled fingers, and a sensor in each: DIGIT, CySkin.

    Actuators: force of the left and of the right finger, N, and height above the start, m.
    height: of the sensors' centers, m.
    """
    hand = spec.worldbody.add_body(name="hand", pos=[0, 0, height], gravcomp=1)
    hand.add_joint(name="lift", type=mujoco.mjtJoint.mjJNT_SLIDE, axis=[0, 0, 1])
    hand.add_geom(
        type=GEOM.mjGEOM_BOX, size=[0.07, 0.016, 0.012], pos=[0, 0, PALM_M], mass=0.5, contype=0,
        conaffinity=0, rgba=HAND_RGBA,
    )  # fmt: skip
    sensors = []
    for side, sign, sensor, friction in (
        ("left", -1.0, "digit", GEL_FRICTION),
        ("right", 1.0, "cyskin", COVER_FRICTION),
    ):
        finger = hand.add_body(name=f"{side}_finger", pos=[sign * OPEN_M, 0, 0], gravcomp=1)
        finger.add_joint(
            name=side, type=mujoco.mjtJoint.mjJNT_SLIDE, axis=[-sign, 0, 0], damping=60.0
        )
        finger.add_geom(
            type=GEOM.mjGEOM_BOX, size=[0.005, 0.014, PALM_M / 2 + 0.012], mass=0.1, contype=0,
            conaffinity=0, pos=[sign * BACK_M, 0, PALM_M / 2 - 0.012], rgba=HAND_RGBA,
        )  # fmt: skip
        # The sensor's x and y axes: right and down in its image. Its z axis points out of it.
        finger.add_site(name=f"{side}_pad", xyaxes=[0, sign, 0, 0, 0, -1])
        sensors.append(t2twin.attach(spec, site=f"{side}_pad", sensor=sensor, friction=friction))
        force = spec.add_actuator(name=f"{side}_force", target=side)
        force.trntype = mujoco.mjtTrn.mjTRN_JOINT
    coupling = spec.add_equality(type=mujoco.mjtEq.mjEQ_JOINT, name="coupling")
    coupling.name1, coupling.name2, coupling.data[:2] = "left", "right", [0.0, 1.0]
    lift = spec.add_actuator(name="height", target="lift", trntype=mujoco.mjtTrn.mjTRN_JOINT)
    lift.set_to_position(kp=8000.0, dampratio=1.0)
    return tuple(sensors)
