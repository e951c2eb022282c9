"""The MuJoCo scene of examples/gripper.py: a gripper with a DIGIT and a CySkin, and a tool.

The DIGIT is in the left finger, the CySkin in the right one. The fingers move along x, the hand
along z.
"""

# MuJoCo defines its names at import, where pyright does not find them.
# pyright: reportAttributeAccessIssue=false

from collections.abc import Iterator
from dataclasses import dataclass

import mujoco
import numpy as np

import t2twin
from t2twin.sim.sensors.files import load_sensor

GRASPS = {
    "wrench": "shank",
    "pliers": "teeth",
    "scissors": "ring",
    "clamp": "screw",
    "allen-key": "long-arm",
}
"""The keypoint at which each tool is grasped. The two sides of a tool are mirror images there."""

OPEN_M, HANG_M = 0.025, 0.02
"""Distance of each sensor from the middle while the gripper is open, and height of the tool's
lowest point above the floor, m."""
PALM_M, HOUSING_M, MAGNET_M = 0.11, 0.009, 0.008
"""Height of the palm above the sensors' centers, half the thickness of a sensor's housing, and half
the width of the magnet, m."""
CELL_MM, REACH_MM, LEVEL_MM, THINNEST_MM = 4.0, 28.0, 0.3, 0.1
"""Side of the cells of collision boxes, their reach from the grasp, depth below the highest place
of a cell up to which a box covers the tool, and least side of a box, mm."""
STEEL_KG_M3 = 7850.0
TOOL_FRICTION = [0.1, 0.005, 0.0001]
"""MuJoCo uses the larger friction of two geoms, which is the sensor's. The second value is that of
torsion, m (assumed)."""
PANEL_PX = (120, 160)
"""Width and height of each sensor's image in MuJoCo's viewer."""
CAMERA_AT_M = [0.0, 0.0, 0.16]
STEEL_RGBA, HAND_RGBA = [0.62, 0.65, 0.70, 1.0], [0.25, 0.28, 0.33, 1.0]
MAGNET_RGBA, FLOOR_RGBA = [0.75, 0.25, 0.2, 1.0], [0.88, 0.88, 0.86, 1.0]
SKY_RGB = [1.0, 1.0, 1.0]
GEOM, NO_CONTACT = mujoco.mjtGeom, {"contype": 0, "conaffinity": 0}


@dataclass(frozen=True)
class Scene:
    """A compiled scene with its two sensors."""

    model: mujoco.MjModel
    digit: t2twin.AttachedSensor
    cyskin: t2twin.AttachedSensor


def build(tool: str, has_image: bool = False) -> Scene:
    """The gripper around a tool, which hangs with its center of mass below the grasp.

    has_image: whether the model has a user sensor for an image of both sensors, which MuJoCo's
    viewer shows.
    """
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
        type=GEOM.mjGEOM_MESH, meshname=tool, density=STEEL_KG_M3, **NO_CONTACT,
        rgba=STEEL_RGBA,
    )  # fmt: skip
    for center, half in collision_boxes(shape):
        body.add_geom(
            type=GEOM.mjGEOM_BOX, pos=center, size=half, quat=in_scene_quat(shape), mass=0, group=3,
            condim=4, friction=TOOL_FRICTION,
        )  # fmt: skip
    low = vertices[vertices[:, 2] < vertices[:, 2].min() + 2 * MAGNET_M]
    spec.worldbody.add_geom(
        type=GEOM.mjGEOM_BOX, size=[MAGNET_M, MAGNET_M, HANG_M / 2 + MAGNET_M],
        pos=[low[:, 0].max() + MAGNET_M, low[:, 1].mean(), HANG_M / 2 + MAGNET_M],
        **NO_CONTACT, rgba=MAGNET_RGBA,
    )  # fmt: skip
    magnet = spec.add_equality(type=mujoco.mjtEq.mjEQ_WELD, name="magnet")
    magnet.objtype, magnet.name1, magnet.name2 = mujoco.mjtObj.mjOBJ_BODY, tool, "world"
    magnet.data[:] = [*np.zeros(10), 1.0, 0.0]  # the initial pose, the default torque scale
    digit, cyskin = add_gripper(spec, height)
    if not has_image:  # a sky would hide the image
        spec.add_texture(
            type=mujoco.mjtTexture.mjTEXTURE_SKYBOX, builtin=mujoco.mjtBuiltin.mjBUILTIN_FLAT,
            rgb1=SKY_RGB, width=8, height=48,
        )  # fmt: skip
    else:
        image = spec.add_sensor(name="image", type=mujoco.mjtSensor.mjSENS_USER)
        image.dim, image.intprm = 6 * PANEL_PX[0] * PANEL_PX[1], [2 * PANEL_PX[0], PANEL_PX[1], 0]
    return Scene(spec.compile(), digit, cyskin)


def add_room(spec: mujoco.MjSpec) -> None:
    """Floor, light and camera, and MuJoCo's options."""
    spec.option.cone = mujoco.mjtCone.mjCONE_ELLIPTIC
    spec.option.impratio = 20.0  # reduces the creep of contacts that stick
    spec.visual.headlight.ambient = spec.visual.headlight.diffuse = [0.4, 0.4, 0.4]
    spec.visual.map.znear = 0.02
    spec.worldbody.add_geom(
        type=GEOM.mjGEOM_CYLINDER, size=[0.14, 0.005, 0.0], pos=[0, 0, -0.005],
        **NO_CONTACT, rgba=FLOOR_RGBA,
    )  # fmt: skip
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


def collision_boxes(shape: t2twin.Shape) -> Iterator[tuple[np.ndarray, np.ndarray]]:
    """Centers and half sides, m, of boxes that fill the tool where the sensors can touch it.

    Each box has the height of the tool's highest place in a square cell, on both sides, as the two
    sides of the tool are alike.
    """
    middle = shape.mesh.bounds[:, 2].mean()
    inside = (np.arange(16) + 0.5) / 16 * CELL_MM
    corners = np.arange(-REACH_MM, REACH_MM, CELL_MM)
    for x_mm, y_mm in np.stack(np.meshgrid(corners, corners), -1).reshape(-1, 2):
        x, y = np.meshgrid(x_mm + inside, y_mm + inside)
        front = shape.surface.sample(x, y) - middle
        filled = (front > front.max() - LEVEL_MM) & (front > 0.0)
        if filled.any():
            low = np.array([x[filled].min(), y[filled].min(), middle - front.max()])
            high = np.array([x[filled].max(), y[filled].max(), middle + front.max()])
            yield in_scene(shape, (low + high) / 2), 1e-3 * np.maximum(high - low, THINNEST_MM) / 2


def add_gripper(
    spec: mujoco.MjSpec, height: float, names: tuple[str, str] = ("digit", "cyskin")
) -> tuple[t2twin.AttachedSensor, ...]:
    """A hand that moves up and down, two coupled fingers, and in each a sensor, of these names.

    Actuators: force of the left and of the right finger, N, and height above the start, m.
    height: of the sensors' centers, m.
    """
    hand = spec.worldbody.add_body(name="hand", pos=[0, 0, height], gravcomp=1)
    hand.add_joint(name="lift", type=mujoco.mjtJoint.mjJNT_SLIDE, axis=[0, 0, 1])
    hand.add_geom(
        type=GEOM.mjGEOM_BOX, size=[0.07, 0.016, 0.012], pos=[0, 0, PALM_M + 0.012], mass=0.5,
        **NO_CONTACT, rgba=HAND_RGBA,
    )  # fmt: skip
    sensors: list[t2twin.AttachedSensor] = []
    for side, sign, sensor in zip(("left", "right"), (-1.0, 1.0), names, strict=True):
        device = load_sensor(sensor)
        thickness_mm = device.elastomer.thickness_mm
        finger = hand.add_body(name=f"{side}_finger", pos=[sign * OPEN_M, 0, 0], gravcomp=1)
        finger.add_joint(
            name=side, type=mujoco.mjtJoint.mjJNT_SLIDE, axis=[-sign, 0, 0], damping=60.0
        )
        back_m = sign * (1e-3 * thickness_mm + HOUSING_M)
        for size, pos in (
            ([HOUSING_M, 0.014, 0.023], [back_m, 0, 0]),
            ([HOUSING_M / 2, 0.012, PALM_M / 2], [back_m * 1.3, 0, PALM_M / 2]),
        ):
            finger.add_geom(
                type=GEOM.mjGEOM_BOX, size=size, pos=pos, mass=0.1, **NO_CONTACT,
                rgba=HAND_RGBA,
            )  # fmt: skip
        # The sensor's x and y axes: right and down in its image. Its z axis points out of it.
        finger.add_site(name=f"{side}_pad", xyaxes=[0, sign, 0, 0, 0, -1])
        sensors.append(
            t2twin.attach(
                spec, sensor=sensor, site=f"{side}_pad", pos=(0.0, 0.0, -1e-3 * thickness_mm),
                friction=device.friction.coefficient, geometry="visual", seed=0,
            )
        )  # fmt: skip
        force = spec.add_actuator(name=f"{side}_force", target=side)
        force.trntype = mujoco.mjtTrn.mjTRN_JOINT
    coupling = spec.add_equality(type=mujoco.mjtEq.mjEQ_JOINT, name="coupling")
    coupling.name1, coupling.name2, coupling.data[:2] = "left", "right", [0.0, 1.0]
    lift = spec.add_actuator(name="height", target="lift", trntype=mujoco.mjtTrn.mjTRN_JOINT)
    lift.set_to_position(kp=8000.0, dampratio=1.0)
    return tuple(sensors)


def set_camera(camera: mujoco.MjvCamera) -> None:
    camera.lookat[:], camera.distance, camera.azimuth, camera.elevation = CAMERA_AT_M, 0.56, 60, -10
