"""MuJoCo scenes with a sensor on a pedestal, for the benchmarks `attach_forces` and `pushed`."""

# MuJoCo defines its names at import, where pyright does not find them.
# pyright: reportAttributeAccessIssue=false

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import mujoco
import numpy as np
from scipy.spatial.transform import Rotation

import t2twin
from t2twin.attachment.geometry import Geometry
from t2twin.attachment.sensor import AttachedSensor
from t2twin.primitives_cad.shape import Shape
from t2twin.sim.touch import Touch

FACE_DOWN = Rotation.from_euler("x", 180.0, degrees=True)
"""From the shape frame to the sensor frame of a press without yaw."""

GAP_M = 5e-5
"""Distance of a body's bounding box from the plane through the sensor's apex, m."""

SLIDES = np.eye(3)
MASS_KG, DAMPING = 0.05, 20.0
"""Of a body, and in N s/m of each of its joints (assumed: it rests within SETTLE_STEPS)."""

FREE = ""
"""Axes of the joints of a body that no joint holds."""

SETTLE_STEPS = 400
"""Steps of 2 ms."""


@dataclass
class Body:
    """A body over the sensor; lengths in mm.

    geoms: arguments of add_geom, sizes in m. place_mm: (2,) on the pad. turn: from the body frame
    to the sensor frame. force_n: (3,) that moves it, along the sensor's axes. It can move along the
    axes of joints. Where it cannot, the joint carries the contact's force. joints is FREE for a
    body without joints, which also turns. mass_kg: of all geoms.
    """

    geoms: list[dict[str, Any]]
    place_mm: Sequence[float] = (0.0, 0.0)
    turn: Rotation = FACE_DOWN
    force_n: Sequence[float] = (0.0, 0.0, -8.0)
    joints: str = "xyz"
    shape: Shape | None = None
    mass_kg: float = MASS_KG


def contact_of(touch: Touch) -> Any:
    """The contact of the sensor in a touch; None without one."""
    return next(iter(touch.contacts.values()), None)


def geom(kind: str, *size_mm: float, **options: Any) -> dict[str, Any]:
    """Arguments of add_geom."""
    size = [1e-3 * each for each in (*size_mm, 0.0, 0.0)][:3]
    return {"type": getattr(mujoco.mjtGeom, f"mjGEOM_{kind.upper()}"), "size": size, **options}


def mesh_body(shape: Shape, **options: Any) -> Body:
    """A body with the mesh of a shape."""
    name = shape.name.replace("/", "-")
    return Body([{"type": mujoco.mjtGeom.mjGEOM_MESH, "meshname": name}], shape=shape, **options)


def compile_scene(
    sensor: str,
    bodies: list[Body],
    geometry: Geometry = "collision",
    change: Callable[["mujoco.MjSpec"], object] = lambda spec: None,
    **options: Any,
) -> tuple[AttachedSensor, "mujoco.MjModel", "mujoco.MjData"]:
    """A sensor and bodies just above it, body-0 and so on, whose geoms are body-0-0 and so on.

    geometry: as for `attach`. change: of the spec, before it is compiled. options: of all geoms,
    such as solref.
    """
    spec = mujoco.MjSpec()
    spec.option.gravity = [0.0, 0.0, 0.0]
    spec.option.cone = mujoco.mjtCone.mjCONE_ELLIPTIC
    spec.option.impratio = 10
    spec.worldbody.add_body(name="pedestal").add_site(name="pad")
    forces = []
    for number, body in enumerate(bodies):
        forces += _add(spec, body, f"body-{number}", options)
    attached = t2twin.attach(spec, site="pad", sensor=sensor, geometry=geometry)
    change(spec)
    model = spec.compile()
    data = mujoco.MjData(model)
    data.qfrc_applied[:] = forces
    _lower_to_sensor(model, data, attached)
    return attached, model, data


def _add(spec: "mujoco.MjSpec", body: Body, name: str, options: dict[str, Any]) -> list[float]:
    """Add a body with its mesh and joints. Returns the forces on the joints."""
    x, y, z, w = body.turn.as_quat()
    position = [1e-3 * body.place_mm[0], 1e-3 * body.place_mm[1], 0.1]
    added = spec.worldbody.add_body(name=name, pos=position, quat=[w, x, y, z])
    if body.shape is not None:
        vertices, faces = body.shape.triangles
        mesh_name = body.shape.name.replace("/", "-")
        if spec.mesh(mesh_name) is None:
            mesh = spec.add_mesh(name=mesh_name, uservert=(1e-3 * vertices).ravel())
            mesh.userface = faces.ravel()
    for number, each in enumerate(body.geoms):
        mass = body.mass_kg / len(body.geoms)
        added.add_geom(name=f"{name}-{number}", mass=mass, **(options | each))
    if body.joints == FREE:
        added.add_freejoint()
        return [*body.force_n, 0.0, 0.0, 0.0]
    axes = ["xyz".index(axis) for axis in body.joints]
    for axis in axes:
        along = body.turn.inv().apply(SLIDES[axis])
        added.add_joint(type=mujoco.mjtJoint.mjJNT_SLIDE, axis=along, damping=DAMPING)
    return [body.force_n[axis] for axis in axes]


def _lower_to_sensor(model: "mujoco.MjModel", data: "mujoco.MjData", attached: AttachedSensor):
    """Move each body along z until its bounding box is GAP_M above the sensor's apex."""
    mujoco.mj_forward(model, data)
    level = attached.pose(model, data)[2, 3] + GAP_M
    for joint in range(model.njnt):
        body = model.jnt_bodyid[joint]
        if joint + 1 < model.njnt and model.jnt_bodyid[joint + 1] == body:
            continue  # the last joint of a body is along z
        own = np.flatnonzero(model.geom_bodyid == body)
        lowest = min(_lowest(model, data, int(each)) for each in own)
        is_free = model.jnt_type[joint] == mujoco.mjtJoint.mjJNT_FREE
        data.qpos[model.jnt_qposadr[joint] + 2 * is_free] += level - lowest
    mujoco.mj_forward(model, data)


def _lowest(model: "mujoco.MjModel", data: "mujoco.MjData", number: int) -> float:
    """Lowest z of a geom's bounding box, m."""
    turn = data.geom_xmat[number].reshape(3, 3)
    center, half = np.split(model.geom_aabb[number], 2)
    return float(data.geom_xpos[number, 2] + turn[2] @ center - np.abs(turn[2]) @ half)


def settle(model: "mujoco.MjModel", data: "mujoco.MjData", steps: int = SETTLE_STEPS) -> None:
    mujoco.mj_step(model, data, nstep=steps)
    mujoco.mj_forward(model, data)
