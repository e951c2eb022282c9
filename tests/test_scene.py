"""The scene that a press leaves: MuJoCo, given only that file, finds the same press."""

# pyright: reportAttributeAccessIssue=false

import mujoco
import numpy as np
import pytest
from kinds import COVER, GEL

from benchmarks.contact.solids import punch
from t2twin.sim.contact.contact_solver import solve_contact
from t2twin.sim.contact.types import PressCommand
from t2twin.sim.scene import mesh_name, scene


@pytest.mark.parametrize(
    "name, elastomer, pitch", [("line-smooth-2", COVER, 0.5), ("wrench/ring", GEL, 0.25)]
)
def test_the_scene_stays_at_rest_under_the_force(name, elastomer, pitch, shapes, tmp_path):
    shape = shapes(name)
    command = PressCommand(name, 1.0, -2.0, 0.5, 8.0)
    contact = solve_contact(shape, command, elastomer, pitch)
    shape.mesh.export(tmp_path / "shape.stl")
    (tmp_path / "scene.xml").write_text(scene(contact, mesh_name(shape)))
    model = mujoco.MjModel.from_xml_path(str(tmp_path / "scene.xml"))
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, 0)
    for _ in range(20):
        mujoco.mj_step(model, data)
    carried, one = 0.0, np.zeros(6)
    for index in range(data.ncon):
        mujoco.mj_contactForce(model, data, index, one)
        carried += one[0]
    assert carried == pytest.approx(8.0, rel=1e-4)
    assert -data.qpos[0] == pytest.approx(contact.depth_mm, abs=1e-3)

    # The solid stands where it presses: its highest corner at the shape's depth.
    mesh = model.geom("over0").bodyid[0]
    solid = next(g for g in range(model.ngeom) if model.geom_type[g] == mujoco.mjtGeom.mjGEOM_MESH)
    assert model.geom_bodyid[solid] == mesh
    start = model.mesh_vertadr[0]
    corners = model.mesh_vert[start : start + model.mesh_vertnum[0]]
    turned = corners @ data.geom_xmat[solid].reshape(3, 3).T + data.geom_xpos[solid]
    inside = np.hypot(turned[:, 0] - 1.0, turned[:, 1] + 2.0) < 40
    assert turned[inside, 2].min() == pytest.approx(-contact.shape_depth_mm, abs=0.03)


def test_a_shape_without_a_mesh_leaves_it_out():
    shape, command = punch(3.0), PressCommand("punch", 0.0, 0.0, 0.0, 2.0)
    contact = solve_contact(shape, command, GEL, 0.25)
    model = mujoco.MjModel.from_xml_string(scene(contact, mesh_name(shape)))
    assert model.nmesh == 0
