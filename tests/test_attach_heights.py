"""Height maps of MuJoCo bodies, against MuJoCo's rays and closed forms."""

# pyright: reportAttributeAccessIssue=false

import mujoco
import numpy as np
import pytest
import trimesh
from scipy import ndimage
from scipy.spatial.transform import Rotation

from t2twin.attachment.geometry import Region, body_surface
from t2twin.primitives_cad.shape import NOTHING_MM
from t2twin.sim.sensors.files import load_sensor

REGION = Region(10.0, 12.0, 6.0, 0.1)
FACING = np.diag([1.0, -1.0, -1.0])
"""A sensor that looks down at the world."""

BODY = 1
PLANE = "<geom type='plane' size='.001 .001 .001'/>"
SIZES = {
    "sphere": "0.007",
    "capsule": "0.004 0.006",
    "ellipsoid": "0.009 0.006 0.004",
    "cylinder": "0.006 0.004",
    "box": "0.007 0.005 0.004",
}
ROUGH = np.random.default_rng(3).uniform(0, 1, (12, 9))


def scene(*geoms: str, world: str = "", assets: str = "") -> tuple[mujoco.MjModel, mujoco.MjData]:
    """A model with one body, number 1, and its data after forward kinematics."""
    return of_spec(
        mujoco.MjSpec.from_string(
            f"<mujoco><asset>{assets}</asset><worldbody>{world}<body>{''.join(geoms)}</body>"
            "</worldbody></mujoco>"
        )
    )


def of_spec(spec: mujoco.MjSpec) -> tuple[mujoco.MjModel, mujoco.MjData]:
    model = spec.compile()
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    return model, data


def with_mesh(mesh: trimesh.Trimesh, **options) -> tuple[mujoco.MjModel, mujoco.MjData]:
    spec = mujoco.MjSpec()
    asset = spec.add_mesh(name="mesh", **options)
    asset.uservert, asset.userface = mesh.vertices.ravel(), mesh.faces.ravel()
    body = spec.worldbody.add_body()
    body.add_geom(type=mujoco.mjtGeom.mjGEOM_MESH, meshname="mesh", pos=[0.001, 0, 0.002])
    return of_spec(spec)


def with_hfield() -> tuple[mujoco.MjModel, mujoco.MjData]:
    spec = mujoco.MjSpec()
    field = spec.add_hfield(name="field", size=[0.008, 0.006, 0.003, 0.002])
    field.nrow, field.ncol, field.userdata = *ROUGH.shape, ROUGH.ravel()
    body = spec.worldbody.add_body()
    body.add_geom(type=mujoco.mjtGeom.mjGEOM_HFIELD, hfieldname="field")
    return of_spec(spec)


def check_with_rays(model, data, rotation, position_m, region=REGION, tolerance_mm=1e-3):
    """Compares a body's surface with the first hits of rays, except next to its outline."""
    found = body_surface(model, data, BODY, rotation, position_m, region, "visual")
    assert found is not None
    surface, z_mm = found
    heights = surface.heights_mm
    assert heights.max() == 0.0
    assert (heights[[0, -1]] == NOTHING_MM).all() and (heights[:, [0, -1]] == NOTHING_MM).all()
    solid = heights > NOTHING_MM
    inside = ndimage.binary_erosion(solid)
    rows, columns = np.nonzero(np.logical_or(inside, ndimage.binary_erosion(~solid)))
    chosen = np.random.default_rng(0).choice(rows.size, 60)
    compared = 0
    for row, column in zip(rows[chosen], columns[chosen], strict=True):
        start = np.array([surface.x_mm[column], -surface.y_mm[row], -10.0])
        hit = np.zeros(1, np.int32)
        distance = mujoco.mj_ray(
            model, data, position_m + rotation @ start / 1e3, rotation[:, 2], None, 1, -1, hit
        )
        below = 1e3 * distance - 10.0 - z_mm if distance >= 0 else np.inf
        if inside[row, column]:
            assert heights[row, column] == pytest.approx(-below, abs=tolerance_mm)
            compared += 1
        else:
            assert below > region.depth_mm - tolerance_mm
    assert compared > 10


@pytest.mark.parametrize("seed, kind", [*enumerate(SIZES)])
def test_geoms_at_any_tilt(seed, kind):
    geom = f"<geom type='{kind}' size='{SIZES[kind]}' pos='.001 .002 .003' euler='10 20 30'/>"
    model, data = scene(geom)
    rotation = Rotation.from_quat(np.random.default_rng(seed).normal(size=4)).as_matrix()
    check_with_rays(model, data, rotation, data.geom_xpos[0] - rotation @ (1e-3, 2e-3, 6e-3))


def test_meshes_at_any_tilt():
    mesh = trimesh.creation.annulus(0.003, 0.008, 0.006, sections=20)
    model, data = with_mesh(mesh, scale=[1.2, 0.8, 1.0])
    rotation = Rotation.from_quat(np.random.default_rng(0).normal(size=4)).as_matrix()
    check_with_rays(model, data, rotation, data.geom_xpos[0] - 6e-3 * rotation[:, 2])


@pytest.mark.parametrize("tilt", [8.0, 170.0])
def test_height_fields(tilt):
    model, data = with_hfield()
    rotation = Rotation.from_euler("xz", [tilt, 30.0], degrees=True).as_matrix() @ FACING
    check_with_rays(model, data, rotation, -6e-3 * rotation[:, 2])


def test_a_changed_height_field_is_read_again():
    model, data = with_hfield()
    place = BODY, FACING, np.array([0.0, 0.0, 4e-3]), REGION
    before = body_surface(model, data, *place)
    model.hfield_data[:] = 0.5
    after = body_surface(model, data, *place)
    assert before is not None and after is not None
    assert np.ptp(before[0].heights_mm[1:-1, 1:-1]) > 2.0
    assert np.ptp(after[0].heights_mm[1:-1, 1:-1]) < 1e-6
    assert after[1] == pytest.approx(4.0 - 0.5 * 3.0)


def test_a_ball_has_its_closed_form():
    model, data = scene("<geom size='.005' pos='.001 .002 .003'/>")
    position = np.array([0.0, 0.0, 9e-3])
    found = body_surface(
        model, data, BODY, FACING, position, Region.of(load_sensor("digit").elastomer)
    )
    assert found is not None
    surface, z_mm = found
    # The sensor's x is the world's, its y is minus the world's; a map's y is the world's again.
    x, y = np.meshgrid(surface.x_mm - 1.0, surface.y_mm - 2.0)
    inside = np.hypot(x, y) < 4.9
    expected = np.sqrt(25.0 - x[inside] ** 2 - y[inside] ** 2) - 5.0
    np.testing.assert_allclose(surface.heights_mm[inside], expected, atol=1e-5)
    assert surface.pitch_mm == pytest.approx(0.05)
    assert z_mm == pytest.approx(9.0 - 8.0, abs=1e-6)


@pytest.mark.parametrize("yaw", [6.0, 33.0])
def test_outlines_are_where_the_solid_ends(yaw):
    """A map's points are a pitch apart, and its outline is right on average."""
    for geom, area_mm2, tolerance in (
        ("type='box' size='.00237 .00418 .002'", 4 * 2.37 * 4.18, 1e-3),
        ("type='cylinder' size='.00237 .002'", np.pi * 2.37**2, 3e-3),
        # Its sides are round, without an outline that is moved.
        ("type='cylinder' size='.003 .00418' euler='90 0 0'", 4 * 3.0 * 4.18, 0.015),
    ):
        model, data = scene(f"<geom {geom} pos='.000013 .000037 0'/>")
        rotation = Rotation.from_euler("z", yaw, degrees=True).as_matrix() @ FACING
        place = BODY, rotation, np.zeros(3), Region(10.0, 12.0, 6.0, 0.05)
        found = body_surface(model, data, *place)
        assert found is not None
        solid = (found[0].heights_mm > NOTHING_MM).astype(int)
        # Cells between four points of the solid.
        cells = solid[1:, 1:] + solid[1:, :-1] + solid[:-1, 1:] + solid[:-1, :-1] == 4
        assert cells.sum() * 0.05**2 == pytest.approx(area_mm2, rel=tolerance)


def test_a_plane_is_a_half_space():
    model, data = scene("<geom size='.001' pos='.1 0 0'/>", world=PLANE)
    rotation = Rotation.from_euler("y", 8.0, degrees=True).as_matrix() @ FACING
    found = body_surface(model, data, 0, rotation, np.array([0.0, 0.0, 2e-3]), REGION)
    assert found is not None
    surface, z_mm = found
    inner = surface.heights_mm[1:-1, 1:-1]
    assert inner.shape == (241, 201)
    slope = np.diff(inner[:100], axis=1) / surface.pitch_mm
    np.testing.assert_allclose(slope, np.tan(np.radians(8.0)), atol=1e-4)
    middle = float(surface.sample(np.zeros(1), np.full(1, -5.0))[0])
    assert z_mm - middle == pytest.approx(2.0 / np.cos(np.radians(8.0)), abs=1e-4)
    assert body_surface(model, data, 0, np.eye(3), np.zeros(3), REGION) is None


def test_geoms_of_welded_bodies_are_one_surface():
    model, data = scene(
        "<freejoint/><geom size='.003' pos='-.004 0 0'/>",
        "<body pos='.004 0 .001'><geom size='.002'/></body>",
        "<body pos='0 .008 0'><joint/><geom size='.002'/></body>",
    )
    check_with_rays(model, data, FACING, np.array([0.0, 3e-3, 4e-3]), Region(10.0, 6.0, 4.0, 0.1))
    place = BODY, FACING, np.array([0.0, 0.0, 4e-3]), REGION
    both = body_surface(model, data, *place)
    assert both is not None
    assert both[0].x_mm[-2] == pytest.approx(6.0)
    assert both[0].y_mm[-2] == pytest.approx(3.0)  # the third body has a joint


def test_geometry_is_selected():
    model, data = scene(
        "<geom size='.004'/>", "<geom size='.006' contype='0' conaffinity='0' mass='0'/>"
    )
    place = BODY, FACING, np.zeros(3), REGION
    collision = body_surface(model, data, *place, geometry="collision")
    visual = body_surface(model, data, *place, geometry="visual")
    assert collision is not None and visual is not None
    assert (collision[1], visual[1]) == (pytest.approx(-4.0), pytest.approx(-6.0))
    only, its_data = scene("<geom size='.004'/>")
    assert body_surface(only, its_data, *place, geometry="visual") is not None


def test_nothing_over_the_pad():
    model, data = scene("<geom size='.004'/>")
    for position in ([0.02, 0.0, 5e-3], [0.0, -0.02, 5e-3], [0.0, 0.0, -20e-3]):
        assert body_surface(model, data, BODY, FACING, np.array(position), REGION) is None


def test_other_parts_behind_the_sensor_are_left_out():
    shelf = "<geom type='box' size='.02 .02 .001' pos='0 0 {}'/>"
    model, data = scene(shelf.format(0.0), shelf.format(0.03))
    found = body_surface(model, data, BODY, FACING, np.array([0.0, 0.0, 2e-3]), REGION)
    assert found is not None and found[1] == pytest.approx(1.0, abs=1e-5)


def test_an_open_mesh_is_seen_from_both_sides():
    sheet = trimesh.Trimesh(
        [[-5, -5, 0], [5, -5, 1], [0, 5, 2], [-5, 5, 3]], [[0, 1, 2], [0, 2, 3]]
    )
    sheet.apply_scale(1e-3)
    model, data = with_mesh(sheet, inertia=mujoco.mjtMeshInertia.mjMESH_INERTIA_SHELL)
    for rotation in (FACING, np.eye(3)):
        check_with_rays(model, data, rotation, data.geom_xpos[0] - 3e-3 * rotation[:, 2])


def test_a_signed_distance_field_has_its_mesh():
    model, data = scene(
        "<geom type='sdf' mesh='ball'/>",
        assets="<mesh name='ball' builtin='sphere' params='3' scale='.006 .006 .006'/>",
    )
    found = body_surface(model, data, BODY, FACING, data.geom_xpos[0], REGION)
    assert found is not None and found[1] == pytest.approx(-6.0, abs=0.05)
