"""Forces of MuJoCo's contacts on an attached sensor: each is read, or a notice names it."""

# MuJoCo defines its names at import, where pyright does not find them.
# pyright: reportAttributeAccessIssue=false

import copy
import pickle
from contextlib import nullcontext
from typing import Any

import mujoco
import numpy as np
import pytest
import trimesh

import t2twin
from t2twin import T2TwinError
from t2twin.core.errors import T2TwinWarning

GRAVITY = 9.81
HALF = (5e-3, 4e-3, 3e-3)
"""Half sides of a box, m."""


def scene(*geoms, sensor: Any = "digit", mount="", options="", **attach):
    """A sensor at the origin, and a body that moves along z, with geoms, and with a free joint if
    the options enable sleep."""
    joint = "<freejoint/>" if "sleep" in options else "<joint type='slide' axis='0 0 1'/>"
    spec = mujoco.MjSpec.from_string(
        f"<mujoco><option timestep='.002' cone='elliptic'>{options}</option><worldbody>{mount}"
        f"<site name='pad'/><body name='load' pos='0 0 .0081'>{joint}{''.join(geoms)}</body>"
        "</worldbody></mujoco>"
    )
    return spec, t2twin.attach(spec, site="pad", sensor=sensor, **attach)


def box(half=HALF, mass=0.3, more=""):
    size = " ".join(map(str, half))
    return f"<geom name='box' type='box' size='{size}' mass='{mass}' {more}/>"


def at_rest(spec, steps=400):
    model = spec.compile()
    data = mujoco.MjData(model)
    mujoco.mj_step(model, data, steps)
    mujoco.mj_forward(model, data)
    return model, data


def force_n(model, data):
    """Sum of MuJoCo's normal forces."""
    total, force = 0.0, np.zeros(6)
    for number in range(data.ncon):
        mujoco.mj_contactForce(model, data, number, force)
        total += force[0]
    return total


@pytest.mark.parametrize(
    ("sensor", "kind", "drop_mm", "step_s"),
    [("cyskin", "box", 100, 0.001), ("digit", "capsule", 100, 0.005)],
)
def test_a_dropped_body_rests_on_the_sensor(sensor, kind, drop_mm, step_s):
    """It arrives at 0.6 or 1.4 m/s, and moves by up to 7 mm a step."""
    geom = f"<geom type='{kind}' size='.006 .006 .004' mass='.05'/>"
    spec, attached = scene(geom, sensor=sensor)
    spec.option.timestep = step_s
    spec.body("load").pos[2] = 0.0141 + 1e-3 * drop_mm
    model, data = at_rest(spec, round(1.0 / step_s))
    touch = attached.read(model, data)
    assert touch.contacts[attached.sensor].force_n == pytest.approx(0.05 * GRAVITY, rel=0.01)
    assert touch.notices == ()


def ends_mm(spec, sensor):
    """z of the lowest and of the highest point of a sensor's geom, mm."""
    model = spec.compile()
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    geom = model.geom(f"{sensor}/surface").id
    center, half = np.split(model.geom_aabb[geom], 2)
    turn = data.geom_xmat[geom].reshape(3, 3)
    middle, extent = data.geom_xpos[geom] + turn @ center, np.abs(turn) @ half
    return 1e3 * (middle - extent)[2], 1e3 * (middle + extent)[2]


@pytest.mark.parametrize("finger_mm", [3.0, 50.0])
def test_the_geom_does_not_reach_through_the_finger(finger_mm):
    finger = f"<geom type='box' size='.02 .02 {finger_mm / 2e3}' pos='0 0 {-finger_mm / 2e3}'/>"
    for sensor in ("digit", "cyskin"):
        spec, attached = scene(box(), mount=finger, sensor=sensor)
        lowest_mm, top_mm = ends_mm(spec, sensor)
        assert lowest_mm == pytest.approx(-min(finger_mm - 1.0, 20.0), abs=0.11)
        assert top_mm == pytest.approx(attached.elastomer.thickness_mm, abs=0.01)


def test_a_spec_that_is_not_complete_gets_a_sensor():
    spec = mujoco.MjSpec()
    body = spec.worldbody.add_body(name="later")  # a moving body without mass does not compile
    body.add_freejoint()
    t2twin.attach(spec, body="later", sensor="digit")
    other = spec.worldbody.add_body(name="massless")
    other.add_freejoint()
    t2twin.attach(spec, body="world", sensor="digit")
    other.add_geom(size=[0.01, 0, 0])
    assert spec.compile().nmesh == 2


def test_the_contact_of_an_explicit_pair_is_read():
    spec, attached = scene(box(more="contype='0' conaffinity='0'"))
    spec.add_pair(geomname1="digit/surface", geomname2="box")
    touch = attached.read(*at_rest(spec))
    assert touch.digit.force_n == pytest.approx(0.3 * GRAVITY, rel=0.01)


BALL = "<geom name='ball' size='.005' mass='.1'/>"
IN_LAYER = f"<body pos='0 0 .0081'>{BALL}</body>"
MOCAP = IN_LAYER.replace("<body", "<body mocap='true'")
HAND = "<body name='hand'><joint/><geom size='.001' mass='.1' pos='0 0 -.01'/></body>"
MASKS = BALL.replace("/", " contype='{0}' conaffinity='{0}'/")


@pytest.mark.parametrize(
    ("geoms", "world", "mount", "reason"),
    [
        (MASKS.format(2), "", None, "collision masks differ"),
        (MASKS.format(0), "", None, "collision masks differ"),
        (BALL, "", None, "an exclude names their bodies"),
        (BALL, "", None, "by a flag of the model"),
        (box(), IN_LAYER, None, "neither can move"),
        (box(), MOCAP, None, "a mocap body: a weld"),
        (box(), "<geom name='ball' type='plane' size='1 1 1' pos='0 0 .01'/>", None, "can move"),
        (BALL, "", "load", "it is welded to it"),
        (BALL + HAND, "", "hand", "one is the parent of the other"),
        (BALL, "", None, ""),
        (box(), "<geom type='plane' size='1 1 1'/>" + MOCAP.replace(".0081", ".02"), None, ""),
        (box(more="pos='0 0 -.003'") + MASKS.format(0), "", "load", ""),
    ],
)
def test_a_geom_in_the_layer_without_contact_is_named_once(geoms, world, mount, reason):
    spec, attached = scene(geoms, mount=world)
    if mount is not None:
        spec.body("load").pos = [0, 0, 0.1]
        attached = t2twin.attach(spec, body=mount, sensor="digit")
    if "exclude" in reason:
        spec.add_exclude(bodyname1="load", bodyname2="digit/body")
    if "flag" in reason:
        spec.option.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONTACT
    model = spec.compile()
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    with pytest.warns(T2TwinWarning, match=reason) if reason else nullcontext():
        touch = attached.read(model, data)
    name = "all bodies" if "flag" in reason else "ball"
    assert [each.body for each in touch.notices] == ([name] if reason else [])
    assert not (touch.contacts and reason)
    mujoco.mj_step(model, data)
    assert attached.read(model, data) is not touch  # without another warning


def test_a_hollow_mesh_is_read_as_the_hull_that_collides():
    """A ring of 50 mm inner diameter: MuJoCo's hull covers the pad, the ring does not."""
    spec, attached = scene("<geom type='mesh' mesh='ring' mass='.2'/>", geometry="collision")
    ring = trimesh.creation.annulus(0.025, 0.04, 0.008)
    mesh = spec.add_mesh(name="ring", uservert=ring.vertices.ravel())
    mesh.userface = ring.faces.ravel()
    contact = attached.read(*at_rest(spec)).digit
    assert contact.force_n == pytest.approx(0.2 * GRAVITY, rel=0.01)
    middle = contact.pressure_kpa.shape[0] // 2, contact.pressure_kpa.shape[1] // 2
    assert contact.pressure_kpa[middle] > 0
    visual, attached = scene("<geom type='mesh' mesh='ring' mass='.2'/>", geometry="visual")
    mesh = visual.add_mesh(name="ring", uservert=ring.vertices.ravel())
    mesh.userface = ring.faces.ravel()
    with pytest.warns(T2TwinWarning, match="none of its surface lies over the pad"):
        touch = attached.read(*at_rest(visual))
    assert touch.digit is None
    assert touch.unread_n == pytest.approx(0.2 * GRAVITY, rel=0.01)


def test_a_sleeping_body_keeps_its_force():
    spec, attached = scene(box(), options="<flag sleep='enable'/>")
    model, data = at_rest(spec, 1500)
    assert not data.ncon and (data.tree_asleep >= 0).all()
    awake = data.tree_asleep.copy()
    touch = attached.read(model, data)
    assert touch.digit.force_n == pytest.approx(0.3 * GRAVITY, rel=0.005)
    assert np.array_equal(data.tree_asleep, awake)
    mujoco.mj_step(model, data)
    assert attached.read(model, data).digit.force_n == touch.digit.force_n


def test_a_body_that_falls_asleep_before_it_rests_has_its_mean_force_and_a_notice():
    spec, attached = scene(box(), options="<flag sleep='enable'/>")
    spec.option.sleep_tolerance = 0.1  # m/s
    model, data = at_rest(spec, 100)
    with pytest.warns(T2TwinWarning, match="asleep before it was at rest"):
        touch = attached.read(model, data)
    assert touch.digit.force_n == pytest.approx(0.3 * GRAVITY, rel=0.005)
    assert [each.body for each in touch.notices] == ["load"] and touch.unread_n == 0.0


@pytest.mark.parametrize(
    "half_mm, named", [(0.15, []), (0.05, ["narrower than 0.2 mm"]), (0.02, ["0.25 mm wider"])]
)
@pytest.mark.filterwarnings("ignore:.*wider on each side", "ignore:.*narrower than 0.2 mm")
def test_a_blade_is_read_alike_everywhere(half_mm, named):
    """Its place between the points of the grid hardly matters."""
    depths = []
    for x_mm in (0.0, 0.16):
        spec, attached = scene(f"<geom type='box' size='{1e-3 * half_mm} .005 .004' mass='.5'/>")
        spec.body("load").pos = [1e-3 * x_mm, 0.0, 0.0082]
        touch = attached.read(*at_rest(spec))
        reasons = [each.reason for each in touch.notices]
        assert len(reasons) == len(named)
        assert all(words in reason for words, reason in zip(named, reasons, strict=True))
        contact, pressure = touch.digit, touch.digit.pressure_kpa.sum(axis=0)
        assert contact.force_n == pytest.approx(0.5 * GRAVITY, rel=0.01)
        assert pressure @ contact.x_mm / pressure.sum() == pytest.approx(x_mm, abs=0.1)
        depths.append(contact.depth_mm)
    assert max(depths) < (1.15 if half_mm == 0.02 else 1.02) * min(depths)


@pytest.mark.filterwarnings(
    "ignore:cyskin. counts are clipped:t2twin.T2TwinWarning", "ignore:.*sheared beyond"
)
def test_a_tangential_load_that_the_layer_cannot_carry_is_named():
    """MuJoCo carries three times the normal force along x, on a ball that sinks in deeply."""
    spec, attached = scene(
        "<joint type='slide' axis='1 0 0'/>",
        "<geom type='sphere' size='.003' mass='1.2' friction='3 .01 .0001'/>",
        sensor="cyskin",
    )
    spec.option.gravity = [0, 0, 0]
    model = spec.compile()
    data = mujoco.MjData(model)
    data.qpos[0] = 0.0025 + 0.003 - 0.0005 - 0.0081
    data.qvel[1] = 5.0
    mujoco.mj_forward(model, data)
    normal, tangential = np.zeros(6), 0.0
    mujoco.mj_contactForce(model, data, 0, normal)
    tangential = float(np.hypot(*normal[1:3]))
    assert tangential > 2 * normal[0] > 20
    with pytest.warns(T2TwinWarning, match="tangential load is more than"):
        touch = attached.read(model, data)
    read_n = min(normal[0], 99.99)
    assert touch.cyskin.force_n == pytest.approx(read_n, rel=0.01)
    (notice,) = touch.notices
    lacking = np.array([tangential - touch.cyskin.shear_n[0], 0.0, normal[0] - read_n])
    assert np.abs(notice.force_n) == pytest.approx(np.abs(lacking), rel=0.02, abs=0.2)


def test_a_body_inside_the_sensor_is_named():
    """MuJoCo pushes a body out at the back, from where it is inside the sensor."""
    spec, attached = scene(box(half=(2e-3, 2e-3, 2e-3)))
    model = spec.compile()
    data = mujoco.MjData(model)
    data.qpos[0] = -0.0081 - 0.018
    mujoco.mj_forward(model, data)
    assert force_n(model, data) > 0
    with pytest.warns(T2TwinWarning, match="of load not read: at the sensor's back"):
        touch = attached.read(model, data)
    assert touch.digit is None and touch.unread_n == pytest.approx(force_n(model, data), rel=0.1)


def test_many_light_bodies_are_named():
    spec, attached = scene(box(mass=0.0009))
    spec.body("load").pos = [0.006, 0, 0.0061]
    for number in range(3):
        body = spec.worldbody.add_body(name=f"grain-{number}", pos=[-0.003 * number, 0, 0.0051])
        body.add_joint(type=mujoco.mjtJoint.mjJNT_SLIDE, axis=[0, 0, 1])
        body.add_geom(size=[1e-3, 0, 0], mass=0.0009)
    with pytest.warns(T2TwinWarning, match="less than 0.01 N"):
        touch = attached.read(*at_rest(spec))
    assert touch.digit is None
    assert touch.unread_n == pytest.approx(4 * 0.0009 * GRAVITY, rel=0.02)


@pytest.mark.parametrize("sensor", ["digit", "cyskin"])
def test_a_plate_is_gripped_with_the_force_of_both_fingers(sensor):
    fingers = "".join(
        f"<body pos='{-0.04 * side} 0 0'><joint type='slide' axis='{side} 0 0' name='{name}'/>"
        f"<geom type='box' size='.004 .015 .02' pos='{-0.004 * side} 0 0' mass='.05'/>"
        f"<site name='{name}' quat='.7071 0 {0.7071 * side} 0'/></body>"
        for name, side in (("a", 1), ("b", -1))
    )
    spec = mujoco.MjSpec.from_string(
        "<mujoco><option timestep='.004' cone='elliptic' impratio='10' gravity='0 0 0'/><worldbody>"
        f"{fingers}<body><freejoint/><geom type='box' size='.002 .012 .02' mass='.05'/></body>"
        "</worldbody><actuator><position joint='a' kp='1000' kv='20'/>"
        "<position joint='b' kp='1000' kv='20'/></actuator></mujoco>"
    )
    pair = [t2twin.attach(spec, site=site, sensor=sensor) for site in "ab"]
    model = spec.compile()
    data = mujoco.MjData(model)
    for step in range(250):
        data.ctrl[:] = min(0.04, 0.08 * step * 0.004)
        mujoco.mj_step(model, data)
    expected = data.actuator_force
    assert (expected > 1.0).all()
    forces = [each.read(model, data).contacts[each.sensor].force_n for each in pair]
    assert forces == pytest.approx(expected, rel=0.02)


def gripper():
    spec = mujoco.MjSpec.from_string(
        "<mujoco><worldbody><body name='finger'><geom size='.01'/><site name='pad' pos='0 0 .01'/>"
        "</body></worldbody></mujoco>"
    )
    return spec, t2twin.attach(spec, site="pad", sensor="digit", seed=1)


def arm(*prefixes, suffix=""):
    """An arm with grippers, and a ball on the sensor of each."""
    spec = mujoco.MjSpec()
    spec.option.gravity = [0, 0, -GRAVITY]
    for number, prefix in enumerate(prefixes):
        own, attached = gripper()
        site = spec.worldbody.add_site(name=f"wrist-{number}", pos=[0.1 * number, 0, 0])
        spec.attach(own, site=site, prefix=prefix, suffix=suffix)
        ball = spec.worldbody.add_body(name=f"ball-{number}", pos=[0.1 * number, 0, 0.0202])
        ball.add_joint(type=mujoco.mjtJoint.mjJNT_SLIDE, axis=[0, 0, 1])
        ball.add_geom(size=[6e-3, 0, 0], mass=0.1 * (number + 1))
    return spec, attached


def test_a_model_that_is_attached_to_another_has_its_sensor():
    spec, attached = arm("a/", suffix="-b")
    model, data = at_rest(spec)
    assert attached.read(model, data).digit.force_n == pytest.approx(0.1 * GRAVITY, rel=0.01)
    assert attached.pose(model, data)[2, 3] == pytest.approx(0.01 + 0.00407)


def test_a_model_that_is_attached_twice_has_two_sensors():
    spec, attached = arm("left_", "right_")
    model, data = at_rest(spec)
    with pytest.raises(T2TwinError, match=r"left_digit/frame, right_digit/frame.*with_prefix"):
        attached.read(model, data)
    forces = [
        attached.with_prefix(prefix).read(model, data).digit.force_n
        for prefix in ("left_", "right_")
    ]
    assert forces == pytest.approx([0.1 * GRAVITY, 0.2 * GRAVITY], rel=0.01)


def test_copies_of_a_sensor_read_the_same():
    spec, attached = scene(box(), seed=3, rate_hz=100)
    model, data = at_rest(spec)
    image = attached.read(model, data).image
    for other in (copy.copy(attached), copy.deepcopy(attached)):
        assert np.array_equal(other.read(model, data).image, image)
    sent = pickle.loads(pickle.dumps((attached, model)))
    again = mujoco.MjData(sent[1])
    mujoco.mj_step(sent[1], again, 400)
    mujoco.mj_forward(sent[1], again)
    assert np.array_equal(sent[0].read(sent[1], again).image, image)
    assert np.array_equal(attached.read(copy.copy(model), copy.copy(data)).image, image)
