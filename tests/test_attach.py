"""Sensors that are attached to MuJoCo models."""

# MuJoCo defines its names at import, where pyright does not find them.
# pyright: reportAttributeAccessIssue=false

import json
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import t2twin
from t2twin import T2TwinError
from t2twin.attachment.contacts import Pose, relative_motion
from t2twin.core.errors import T2TwinWarning

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


@pytest.mark.filterwarnings("ignore:.*tangential load")
def test_the_same_press_as_by_the_twin():
    """A mesh pressed in MuJoCo without friction, and the same shape pressed by a Twin."""
    shape = t2twin.load_shape("hemisphere-2")
    vertices, faces = shape.triangles
    expected = t2twin.press(shape, force_n=FORCE_N, x_mm=1.0, y_mm=2.0, yaw_deg=30.0)
    for sensor in ("digit", "cyskin"):
        half = np.deg2rad(30.0) / 2
        spec = scene(
            type=mujoco.mjtGeom.mjGEOM_MESH, meshname="shape", x_m=1e-3, y_m=2e-3, gap_m=0.004,
            quat=[0, np.cos(half), np.sin(half), 0], condim=1, priority=1,
        )  # fmt: skip
        mesh = spec.add_mesh(name="shape", uservert=(1e-3 * vertices).ravel())
        mesh.userface = faces.ravel()
        attached = t2twin.attach(spec, site="pad", sensor=sensor, geometry="visual")
        touch = attached.read(*simulate(spec))
        contact, truth = (each.contacts[attached.sensor] for each in (touch, expected))
        assert contact.depth_mm == pytest.approx(truth.depth_mm, rel=0.01)
        if sensor == "digit":
            error = touch.image.astype(float) - expected.image
            assert 10 * np.log10(255**2 / np.mean(error**2)) > 40
        else:
            error = touch.counts.astype(float) - expected.counts
            assert np.abs(error).max() < 0.01 * 2**16


def pushed_scene(sensor: Any = "digit", **options):
    """A ball at the sensor's side, pressed and pushed along x and y, with the sensor turned."""
    spec = scene(x_m=0.002, y_m=-0.004, gap_m=0.0041, axes="xyz")
    half = np.deg2rad(35.0) / 2
    turned = [np.cos(half), 0, 0, np.sin(half)]
    attached = t2twin.attach(spec, site="pad", sensor=sensor, quat=turned, **options)
    return attached, *simulate(spec, 1.5, 1.0, -FORCE_N)


@pytest.mark.parametrize("sensor", ["digit", "cyskin"])
def test_force_shear_and_torque_are_those_of_mujoco(sensor):
    attached, model, data = pushed_scene(sensor)
    touch = attached.read(model, data)
    assert (touch.image is None, touch.counts is None) == (sensor == "cyskin", sensor == "digit")
    assert touch.sensor_to_world is not None
    thickness_m = 1e-3 * attached.elastomer.thickness_mm
    assert touch.sensor_to_world[:3, 3] == pytest.approx([0, 0, 0.11 + thickness_m])
    contact = touch.contacts[attached.sensor]
    assert contact.settled
    force, torque = wrench(model, data, attached.pose(model, data))
    assert np.hypot(*force[:2]) > 1.0
    assert contact.force_n == pytest.approx(-force[2], rel=0.01)
    assert contact.shear_n == pytest.approx(force[:2], abs=0.01 * np.hypot(*force[:2]))
    assert contact.torque_nmm == pytest.approx(torque[2], rel=0.01)
    # the ball pushes the sensor along x and y of the world, which is turned against the sensor
    along = attached.pose(model, data)[:3, :2] @ contact.shear_n
    assert along[:2] == pytest.approx([1.5, 1.0], abs=0.05)


def test_without_contact():
    spec = scene()
    digit = t2twin.attach(spec, site="pad", sensor="digit", markers=True)
    skin = t2twin.attach(spec, body="world", sensor="cyskin", pos=[0.1, 0, 0])
    model, data = simulate(spec, 0.0, steps=1)
    touch = digit.read(model, data)
    assert not touch.contacts
    assert np.array_equal(touch.image, t2twin.Twin(markers=True).background)
    assert touch.markers is not None
    assert np.array_equal(touch.markers_mm, touch.markers.rest_mm)
    assert not skin.read(model, data).counts.any()
    touch.save("nothing")


def test_read_changes_no_data_and_computes_an_unchanged_state_once():
    attached, model, data = pushed_scene(seed=3)
    names = ("qpos", "qvel", "qacc", "xpos", "efc_force", "sensordata", "time")
    before = {name: np.copy(getattr(data, name)) for name in names}
    touch = attached.read(model, data)
    assert all(np.array_equal(getattr(data, name), before[name]) for name in names)
    assert attached.read(model, data) is touch
    mujoco.mj_step(model, data)
    again = attached.read(model, data)
    assert again is not touch
    assert not np.array_equal(again.image, touch.image)  # another noise
    touch.save("touch")
    saved = json.loads(Path("touch/press.json").read_text())
    assert np.array_equal(saved["sensor_to_world"], attached.pose(model, data))


def test_a_sensor_reads_at_its_rate():
    spec = scene()
    attached = t2twin.attach(spec, site="pad", sensor="cyskin", rate_hz=100)
    model, data = simulate(spec)
    touches = []
    for _ in range(20):
        mujoco.mj_step(model, data)  # 2 ms
        touches.append(attached.read(model, data))
    assert len({id(touch) for touch in touches}) in (4, 5)


def test_tractions_start_again_when_the_time_decreases():
    """A ball that slides sticks to the surface where it was before."""
    attached, model, data = pushed_scene("cyskin", seed=1)
    first = attached.read(model, data)
    data.qfrc_applied[:2] = 0.0
    for _ in range(20):
        mujoco.mj_step(model, data)
    continued = attached.read(model, data)
    data.time = 0.0
    restarted = attached.read(model, data)
    fresh, *_ = pushed_scene("cyskin", seed=1)
    first_again = fresh.read(model, data)
    assert np.array_equal(restarted.cyskin.shear_kpa, first_again.cyskin.shear_kpa)
    assert not np.allclose(continued.cyskin.shear_kpa, first_again.cyskin.shear_kpa, atol=0.1)
    attached.reset()
    assert np.array_equal(attached.read(model, data).counts, first_again.counts)
    assert first.cyskin.shear_n[0] > 0


def test_the_memory_decays_in_simulated_time():
    spec = scene()
    attached = t2twin.attach(spec, site="pad", sensor="cyskin", imperfections="recorded", seed=1)
    model, data = simulate(spec)
    pressed = attached.read(model, data)
    start_s, data.qfrc_applied[:] = data.time, FORCE_N
    mujoco.mj_step(model, data, 100)
    assert attached.read(model, data).cyskin is None
    mujoco.mj_step(model, data, 100)
    lifted = attached.read(model, data)
    decay = np.exp(-(data.time - start_s) / np.array(attached.device.flaws.memory_s))
    assert lifted.of_array.memory == pytest.approx(decay[:, None] * pressed.of_array.memory)
    attached.reset()
    rested = attached.read(model, data).of_array.memory
    assert rested is not None and not rested.any()


def test_motion_is_that_of_the_body_at_the_contact():
    rng = np.random.default_rng(5)
    before, step = (Rotation.random(rng=rng) for _ in range(2))
    step = Rotation.from_rotvec(0.05 * step.as_rotvec())
    center = np.array([3.0, -4.0, -0.5])
    position, shift = rng.normal(size=(2, 3))
    now = step.apply(position - center) + center + shift  # turned about the contact, and moved
    dx, dy, turn = relative_motion(
        Pose(before.as_matrix(), 1e-3 * position),
        Pose((step * before).as_matrix(), 1e-3 * now),
        center,
    )
    at_center = Rotation.from_rotvec([0, 0, turn]).apply(center) - center + [dx, dy, 0]
    assert at_center[:2] == pytest.approx(shift[:2])
    assert turn == pytest.approx(step.as_rotvec()[2], rel=0.05)


def test_many_states_are_read_at_the_same_time():
    """Two sensors of one model and two states, in four threads, and alone."""
    spec = scene(x_m=-0.03, axes="z")
    spec.site("pad").pos = [-0.03, 0, 0.01]
    add_ball(spec, "second", x_m=0.03)
    sensors = [
        t2twin.attach(spec, site="pad", sensor="digit", seed=1),
        t2twin.attach(spec, body="pedestal", pos=[0.03, 0, 0.01], sensor="cyskin", seed=2),
    ]
    states = [simulate(spec, -force, -2 * force) for force in (2.0, 4.0)]
    threaded = t2twin.read_all(sensors, [data for _, data in states], workers=4)
    for sensor in sensors:
        sensor.reset()
    for touches, state in zip(threaded, states, strict=True):
        for sensor, touch in zip(sensors, touches, strict=True):
            alone = sensor.read(*state)
            assert np.array_equal(alone.image, touch.image)
            assert np.array_equal(alone.counts, touch.counts)
            assert alone.contacts[sensor.sensor].force_n > 1.9
    assert t2twin.read_all(sensors[0], []) == []
    data = states[0][1]
    for of, read, message in (
        (["digit"], [], r"sensors\[0\] is"), (sensors, [data, data], "twice"), (None, [], "a list"),
        (sensors, data, "a list"), (sensors, None, "a list"), (sensors, iter([]), "a list"),
    ):  # fmt: skip
        with pytest.raises(T2TwinError, match=message):
            t2twin.read_all(of, read)  # pyright: ignore[reportArgumentType]


def test_contacts_at_the_side_are_named():
    spec = scene(x_m=-0.016, gap_m=-0.004, axes="x")
    attached = t2twin.attach(spec, site="pad", sensor="digit")
    model, data = simulate(spec, FORCE_N)
    assert model.geom("digit/surface").id in data.contact.geom
    with pytest.warns(T2TwinWarning, match="8 N of ball not read: at the sensor's side"):
        touch = attached.read(model, data)
    assert not touch.contacts
    assert touch.unread_n == pytest.approx(FORCE_N, rel=0.01)
    attached.reset()
    assert attached.read(model, data).unread_n == touch.unread_n  # warned of once


def test_several_sensors_have_names_of_their_own():
    spec = scene()
    sensors = [
        t2twin.attach(spec, site="pad", sensor="digit", pos=[x_m, 0, 0]) for x_m in (0.0, 0.03)
    ]
    named = t2twin.attach(spec, body="pedestal", sensor="digit", name="left")
    assert [each.name for each in (*sensors, named)] == ["digit", "digit-2", "left"]
    model = spec.compile()
    assert model.site("left/frame").id >= 0
    with pytest.raises(T2TwinError, match="already has elements named left/"):
        t2twin.attach(spec, site="pad", sensor="digit", name="left")
    with pytest.raises(T2TwinError, match="the sensor digit is already mounted there"):
        t2twin.attach(spec, site="pad", sensor="cyskin")
    spec.worldbody.add_body(name="hand/body", pos=[0, 1, 0])  # no sensor
    assert t2twin.attach(spec, body="hand/body", sensor="digit").name == "digit-3"


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"site": "pat"}, "no site 'pat'; expected one of pad"),
        ({"site": "pad", "body": "ball"}, "both given"),
        ({}, "both missing"),
        ({"site": "pad", "layout": "cyskin-20"}, "it has optics and markers"),
        ({"site": "pad", "sensor": "cyskin", "markers": True}, "it has layout and imperfections"),
        ({"site": "pad", "quat": [0, 0, 0, 0]}, "not zero"),
        ({"site": "pad", "friction": -1}, "friction is -1"),
        ({"site": "pad", "rate_hz": 0}, "rate_hz is 0"),
        ({"site": "pad", "geometry": "hull"}, "one of collision, visual"),
    ],
)
def test_wrong_arguments(arguments, message):
    spec = scene()
    with pytest.raises(T2TwinError, match=message):
        t2twin.attach(spec, **{"sensor": "digit"} | arguments)
    assert spec.body("digit/body") is None
    with pytest.raises(T2TwinError, match=r"expected a mujoco\.MjSpec"):
        t2twin.attach("gripper.xml", **{"sensor": "digit"} | arguments)


def test_wrong_models():
    spec = scene()
    other = spec.compile()
    attached = t2twin.attach(spec, site="pad", sensor="digit", quat=[1e300, 0, 0, 1e300])
    model = spec.compile()
    for wrong, data, message in (
        (other, mujoco.MjData(other), "no site digit/frame"),
        (model, mujoco.MjData(other), "of another model"),
        (model, mujoco.MjData(model), "mj_forward"),
    ):
        with pytest.raises(T2TwinError, match=message):
            attached.read(wrong, data)
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    data.qpos[0] = np.nan
    with pytest.raises(T2TwinError, match="not finite"):
        attached.read(model, data)
    data.qpos[0] = 0.0
    for data.time in (np.nan, np.inf):
        with pytest.raises(T2TwinError, match=r"data\.time is not finite"):
            attached.read(model, data)


def test_a_flex_is_refused():
    spec = mujoco.MjSpec.from_string("""<mujoco><option gravity="0 0 -10"/><worldbody>
      <site name="pad"/>
      <body name="cloth" pos="0 0 .006"><freejoint/><geom size=".001" pos="0 0 .1"/>
      <flexcomp name="cloth" type="grid" count="3 3 1" spacing=".01 .01 .01" radius=".001"
        mass=".01" rigid="true"/></body>
    </worldbody></mujoco>""")
    attached = t2twin.attach(spec, site="pad", sensor="cyskin")
    model = spec.compile()
    data = mujoco.MjData(model)
    mujoco.mj_step(model, data, 20)
    assert data.ncon
    with pytest.raises(T2TwinError, match="a flex touches geom cyskin/surface"):
        attached.read(model, data)


def test_a_body_sinks_in_as_deep_as_into_the_layer():
    """With the fitted parameters the resting place of a ball is that of the soft layer."""
    spec = scene()
    attached = t2twin.attach(spec, site="pad", sensor="digit")
    model = spec.compile()
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    with pytest.raises(T2TwinError, match="no body 'bal'"):
        attached.set_stiffness(model, data, "bal")
    error_mm = attached.set_stiffness(model, data, "ball")
    assert error_mm < 0.05
    for force_n in (1.0, FORCE_N):
        data.qfrc_applied[:] = -force_n
        mujoco.mj_step(model, data, REST_STEPS)
        touch = attached.read(model, data)
        sunk_mm = -1e3 * data.contact.dist[0]
        assert sunk_mm == pytest.approx(touch.digit.depth_mm, abs=error_mm + 0.01)


def test_a_fit_for_several_points_is_named():
    spec = scene(axes="z", gap_m=0.004)
    box = {"type": mujoco.mjtGeom.mjGEOM_BOX, "size": [0.003, 0.003, RADIUS_M]}
    spec.body("ball").add_geom(**box, mass=0.1)
    attached = t2twin.attach(spec, site="pad", sensor="cyskin")
    model, data = simulate(spec)
    assert data.ncon > 1
    with pytest.warns(T2TwinWarning, match="points, but the fit is for one"):
        attached.set_stiffness(model, data, "ball")


@pytest.mark.filterwarnings("ignore:cyskin. counts are clipped:t2twin.T2TwinWarning")
def test_a_force_through_the_layer_onto_the_mount_is_named():
    """Beyond its forces a fitted contact is too soft: a ball sinks through the layer."""
    spec, force_n = scene(), 40.0
    attached = t2twin.attach(spec, site="pad", sensor="cyskin")
    model, data = simulate(spec, -force_n)
    attached.set_stiffness(model, data, "ball")
    mujoco.mj_step(model, data, REST_STEPS)
    with pytest.warns(T2TwinWarning, match="of ball not read: on the mount, through the soft"):
        touch = attached.read(model, data)
    (notice,) = touch.notices
    assert notice.body == "ball" and notice.force_n[2] < -1.0
    assert touch.cyskin.force_n - notice.force_n[2] == pytest.approx(force_n, rel=1e-3)


@pytest.mark.filterwarnings("ignore:cyskin. counts are clipped:t2twin.T2TwinWarning")
def test_a_force_above_the_largest_is_limited():
    spec = scene(mass=5.0)
    attached = t2twin.attach(spec, site="pad", sensor="cyskin")
    with pytest.warns(T2TwinWarning, match="50 N of ball not read: .* limit of 100 N"):
        touch = attached.read(*simulate(spec, -150.0))
    contact = touch.cyskin
    assert touch.unread_n == pytest.approx(50.0, rel=1e-2)
    assert contact.force_n == pytest.approx(100.0, rel=1e-3)
    assert contact.settled


def test_a_sensor_file_gives_mass_color_and_depth_and_the_names(tmp_path):
    (tmp_path / "thumb.toml").write_text(
        'extends = "digit"\nname = "soft-thumb"\n[gel]\nyoung_mpa = 0.2\n'
        "[mount]\nmass_kg = 0.07\ndepth_mm = 3.0\ncolor = [1.0, 0.5, 0.0, 0.75]\n"
    )
    spec = scene()
    attached = t2twin.attach(spec, site="pad", sensor=tmp_path / "thumb.toml")
    assert (attached.name, attached.sensor) == ("thumb", "soft-thumb")
    model, data = simulate(spec)
    geom = model.geom("thumb/surface")
    assert model.body("thumb/body").mass == pytest.approx(0.07)
    assert geom.rgba == pytest.approx([1.0, 0.5, 0.0, 0.75])
    height_mm = 2e3 * model.geom_aabb[geom.id][3:].min()  # the geom is lower than it is wide
    assert height_mm == pytest.approx(attached.elastomer.thickness_mm + 3.0, abs=0.01)
    touch = attached.read(model, data)
    assert touch.image.shape == (320, 240, 3)
    assert touch.contacts["soft-thumb"].force_n == pytest.approx(FORCE_N, rel=1e-3)
