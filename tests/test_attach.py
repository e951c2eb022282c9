"""Sensors that are attached to MuJoCo models."""

# MuJoCo defines its names at import, where pyright does not find them.
# pyright: reportAttributeAccessIssue=false

from concurrent.futures import ThreadPoolExecutor

import mujoco
import numpy as np
import pytest

import t2twin
from t2twin import T2TwinError

RADIUS_M = 0.006
FORCE_N = 8.0
REST_STEPS = 400
"""Steps of 2 ms after which a pressed body rests."""


def scene(**ball):
    """A sensor's pedestal with a site on it, and a ball above that moves along the axes given."""
    spec = mujoco.MjSpec()
    spec.option.cone = mujoco.mjtCone.mjCONE_ELLIPTIC
    spec.option.impratio = 10
    spec.option.gravity = [0.0, 0.0, 0.0]
    base = spec.worldbody.add_body(name="pedestal", pos=[0, 0, 0.1])
    base.add_geom(type=mujoco.mjtGeom.mjGEOM_BOX, size=[0.02, 0.03, 0.01])
    base.add_site(name="pad", pos=[0, 0, 0.01])
    add_ball(spec, "ball", **ball)
    return spec


def add_ball(spec, name, x_m=0.0, y_m=0.0, gap_m=0.005, axes="z", **geom):
    body = spec.worldbody.add_body(name=name, pos=[x_m, y_m, 0.11 + gap_m + RADIUS_M])
    geom = {"type": mujoco.mjtGeom.mjGEOM_SPHERE, "size": [RADIUS_M, 0, 0], "mass": 0.1} | geom
    body.add_geom(**geom)
    for axis in axes:
        body.add_joint(
            type=mujoco.mjtJoint.mjJNT_SLIDE, axis=np.eye(3)["xyz".index(axis)], damping=20
        )


def simulate(spec, *joint_forces_n, steps=REST_STEPS):
    """Model and data after forces have acted on the joints; by default FORCE_N presses."""
    model = spec.compile()
    data = mujoco.MjData(model)
    data.qfrc_applied[:] = joint_forces_n or -FORCE_N
    for _ in range(steps):
        mujoco.mj_step(model, data)
    mujoco.mj_forward(model, data)
    return model, data


def wrench(model, data, frame):
    """Sum of MuJoCo's contact forces, N, and torques, N mm, on geom 1 or 2 in a frame (4, 4)."""
    force, torque, own = np.zeros(3), np.zeros(3), np.zeros(6)
    for number, contact in enumerate(data.contact):
        mujoco.mj_contactForce(model, data, number, own)
        sign = 1 if model.geom(contact.geom[1]).name.endswith("/surface") else -1
        axes = contact.frame.reshape(3, 3) @ frame[:3, :3]
        force += sign * own[:3] @ axes
        place = 1e3 * (contact.pos - frame[:3, 3]) @ frame[:3, :3]
        torque += 1e3 * sign * own[3:] @ axes + np.cross(place, sign * own[:3] @ axes)
    return force, torque


@pytest.mark.parametrize("sensor", ["digit", "cyskin"])
def test_a_pressed_ball_has_the_force_that_presses_it(sensor):
    spec = scene()
    attached = t2twin.attach(spec, site="pad", sensor=sensor)
    model, data = simulate(spec)
    touch = attached.read(model, data)
    contact = touch.contacts[sensor]
    assert contact.force_n == pytest.approx(FORCE_N, rel=1e-3)
    assert contact.settled
    assert list(touch.contacts) == [sensor]
    assert (touch.image is None, touch.counts is None) == (sensor == "cyskin", sensor == "digit")
    thickness_m = 1e-3 * attached.elastomer.thickness_mm
    assert touch.sensor_to_world[:3, 3] == pytest.approx([0, 0, 0.11 + thickness_m])


def test_the_same_press_as_by_the_twin():
    """A mesh pressed in MuJoCo, and the same shape pressed by a Twin."""
    shape = t2twin.load_shape("hemisphere-2")
    vertices, faces = shape.triangles
    expected = t2twin.press(shape, force_n=FORCE_N, x_mm=1.0, y_mm=2.0, yaw_deg=30.0)
    for sensor in ("digit", "cyskin"):
        half = np.deg2rad(30.0) / 2
        spec = scene(
            type=mujoco.mjtGeom.mjGEOM_MESH,
            meshname="shape",
            x_m=1e-3,
            y_m=2e-3,
            gap_m=0.004,
            quat=[0, np.cos(half), np.sin(half), 0],
        )
        mesh = spec.add_mesh(name="shape", uservert=(1e-3 * vertices).ravel())
        mesh.userface = faces.ravel()
        attached = t2twin.attach(spec, site="pad", sensor=sensor)
        touch = attached.read(*simulate(spec))
        contact, truth = touch.contacts[sensor], expected.contacts[sensor]
        assert contact.depth_mm == pytest.approx(truth.depth_mm, rel=0.01)
        if sensor == "digit":
            error = touch.image.astype(float) - expected.image
            assert 10 * np.log10(255**2 / np.mean(error**2)) > 40
        else:
            error = touch.counts.astype(float) - expected.counts
            assert np.abs(error).max() < 0.01 * 2**16
