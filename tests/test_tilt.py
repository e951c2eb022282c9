"""Tilted presses: conventions against closed forms, and what a tilt does to shapes and datasets."""

import json
import re
import warnings
from dataclasses import replace
from functools import cache
from typing import Any

import msgspec
import numpy as np
import pytest
import trimesh
from scipy import ndimage
from scipy.spatial.transform import Rotation

import t2twin
from t2twin.core.errors import T2TwinError, T2TwinWarning
from t2twin.primitives_cad.height_map import rasterize_triangles
from t2twin.primitives_cad.random_shapes import solid_under
from t2twin.primitives_cad.shape import HeightMap, Shape, ball
from t2twin.primitives_cad.tilt import MAX_TILT_DEG, rotation_of, tilted
from t2twin.sim.contact.types import TILT, PressCommand
from t2twin.sim.dataset.columns import POSE, schema_of
from t2twin.sim.dataset.store import lists, read_split
from t2twin.sim.sampling.plan import sample_tilt
from t2twin.sim.sampling.recipe import Place

TILT_DEG: dict[str, Any] = {"tilt_x_deg": 7.0, "tilt_y_deg": -4.0}
TILT_RAD = tuple(np.deg2rad(list(TILT_DEG.values())))

LOWEST_MM = -20.0
"""Height in place of no solid, mm."""


@cache
def twin():
    return t2twin.Twin()


def centers(touch):
    """x and y of the center of pressure on each sensor, mm."""
    found = []
    for contact in touch.contacts.values():
        x, y = np.meshgrid(contact.x_mm, contact.y_mm)
        share = contact.pressure_kpa / contact.pressure_kpa.sum()
        found.append(((share * x).sum(), (share * y).sum()))
    return np.array(found)


def uneven():
    """A part that equals none of its mirror images."""
    box = trimesh.creation.box((7.0, 5.0, 4.0))
    post = trimesh.creation.box((2.0, 1.5, 5.0))
    post.apply_translation((1.5, 1.0, 0.3))
    for each in (box, post):
        each.apply_translation((0.4, 0.3, 0.0))
    whole: Any = trimesh.util.concatenate([box, post])
    return whole


@pytest.mark.parametrize(
    ("pose", "side"),
    [
        ({"tilt_x_deg": 5.0}, (0, -1)),
        ({"tilt_y_deg": -5.0}, (-1, 0)),
        ({"tilt_x_deg": 5.0, "yaw_deg": 90.0}, (1, 0)),
    ],
)
def test_a_flat_punch_presses_on_the_side_that_the_tilt_lowers(pose, side):
    """Columns are right and down in the image; a yaw of 90 degrees turns up into right."""
    touch = twin().press("square-2", force_n=2.0, **pose)
    for center in centers(touch):
        assert center @ side > 1.0 and abs(center @ side[::-1]) < 0.02
    first = twin().press("square-2", force_n=0.01, **pose).cyskin  # flat
    rows, columns = np.nonzero(first.pressure_kpa)
    edge = np.array((first.x_mm[columns].mean(), first.y_mm[rows].mean())) @ side
    assert edge == pytest.approx(4.2 * np.cos(np.deg2rad(5.0)), abs=0.3)


def test_a_ball_tilted_about_its_center_is_the_same_ball():
    radius, (x_mm, y_mm) = 5.0, (0.7, -0.4)
    solid = ball(radius)
    straight = twin().press(solid, force_n=3.0, x_mm=x_mm, y_mm=y_mm)
    # The center stays: the ball's origin, its top, is moved back.
    moved = (Rotation.from_euler("xyz", [*TILT_RAD, 0.0]).as_matrix() - np.eye(3))[:, 2] * radius
    x_mm, y_mm = x_mm - moved[0], y_mm - moved[1]
    turned = twin().press(solid, force_n=3.0, x_mm=x_mm, y_mm=y_mm, **TILT_DEG)
    for sensor, contact in straight.contacts.items():
        assert turned.contacts[sensor].depth_mm == pytest.approx(contact.depth_mm, rel=5e-3)
    np.testing.assert_allclose(centers(turned), centers(straight), atol=5e-3)
    assert (
        np.abs(turned.counts.astype(float) - straight.counts).max() < 0.01 * straight.counts.max()
    )
    assert np.abs(turned.image.astype(float) - straight.image).mean() < 0.2


@pytest.mark.filterwarnings("ignore:.*bottomed out:t2twin.T2TwinWarning")
def test_a_file_is_pressed_as_one_that_its_user_has_rotated(tmp_path):
    straight, turned = uneven(), uneven()
    turned.vertices = turned.vertices @ rotation_of(*TILT_RAD).T
    straight.export(tmp_path / "straight.stl")
    turned.export(tmp_path / "turned.stl")
    # A file's origin is the middle of its bounding box at its top.
    origins = [np.append(mesh.bounds[:, :2].mean(axis=0), mesh.bounds[1, 2])
               for mesh in (straight, turned)]  # fmt: skip
    right, up, _ = origins[1] - rotation_of(*TILT_RAD) @ origins[0]
    one = twin().press(tmp_path / "straight.stl", force_n=3.0, **TILT_DEG)
    other = twin().press(tmp_path / "turned.stl", force_n=3.0, x_mm=right, y_mm=-up)
    for sensor, contact in one.contacts.items():
        assert other.contacts[sensor].depth_mm == pytest.approx(contact.depth_mm, rel=0.01)
    np.testing.assert_allclose(centers(one), centers(other), atol=0.02)
    assert np.abs(one.counts.astype(float) - other.counts).max() < 0.02 * one.counts.max()


@pytest.mark.parametrize("name", ["pliers/teeth", "hemisphere-2", "circle-empty-2"])
def test_the_surface_is_the_upper_envelope_of_the_turned_solid(name):
    upright = t2twin.load_shape(name)
    shape, pitch = tilted(upright, *TILT_RAD), 0.05
    vertices, faces = upright.triangles
    corners = (vertices @ rotation_of(*TILT_RAD).T)[faces]
    exact = np.maximum(rasterize_triangles(corners, pitch, 120, 120)[1:-1, 1:-1], LOWEST_MM)
    near = np.arange(-120, 121) * pitch
    found = shape.surface.sample(*np.meshgrid(near, near)) + shape.rise_mm
    found = np.maximum(found, LOWEST_MM)
    steep = np.hypot(*np.gradient(exact, pitch)) > 3.0
    steep = np.asarray(ndimage.binary_dilation(steep, iterations=2))
    steep[:, [0, -1]] = steep[[0, -1]] = True  # an outline may lie beyond
    even = np.logical_not(steep)
    assert np.abs(found - exact)[even].max() < 0.02 and even.mean() > 0.8
    # Outlines are at the nearest point.
    assert np.isclose(found, exact, atol=0.02).mean() > 0.96


def test_a_shape_without_a_mesh_has_vertical_sides_and_says_so(tmp_path):
    solid = trimesh.creation.box((6.0, 4.0, 3.0))
    solid.export(tmp_path / "box.stl")
    full = t2twin.load_shape(tmp_path / "box.stl")
    bare = replace(full, solid=trimesh.Trimesh())
    with pytest.warns(T2TwinWarning, match="box has no mesh; its sides are taken as vertical"):
        touch = twin().press(bare, force_n=3.0, **TILT_DEG)
    expected = twin().press(full, force_n=3.0, **TILT_DEG)
    for sensor, contact in expected.contacts.items():
        assert touch.contacts[sensor].depth_mm == pytest.approx(contact.depth_mm, rel=0.01)
    np.testing.assert_allclose(centers(touch), centers(expected), atol=0.02)
    touch.save(tmp_path / "out")
    saved = json.loads((tmp_path / "out" / "press.json").read_text())
    assert "sides" in saved["notes"][-1]
    assert [saved[f"tilt_{axis}_rad"] for axis in "xy"] == pytest.approx(TILT_RAD)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        twin().press(bare, force_n=3.0)


def test_a_random_shape_is_the_solid_under_its_surface():
    upright = t2twin.load_shape("random-3")
    assert upright.is_under_surface and not tilted(upright, *TILT_RAD).notes
    middle = slice(240, 403)
    heights, axis = upright.surface.heights_mm[middle, middle], upright.surface.x_mm[middle]
    part = HeightMap(heights, axis, axis)
    by_map = tilted(Shape("map", trimesh.Trimesh(), part, (1.0, 1.0)), *TILT_RAD)
    by_mesh = tilted(
        Shape("mesh", trimesh.Trimesh(*solid_under(part)), part, (1.0, 1.0)), *TILT_RAD
    )
    near = np.meshgrid(*2 * [np.arange(-6.0, 6.0, 0.13)])
    difference = by_map.surface.sample(*near) - by_mesh.surface.sample(*near)
    assert by_map.rise_mm == pytest.approx(by_mesh.rise_mm, abs=1e-3)
    assert np.isclose(difference, 0.0, atol=2e-3).mean() > 0.97


def test_a_plate_that_a_tilt_lowers_onto_a_sensor_is_reported():
    """The plate is 23 mm wide to each side, 6 mm below the punch; the gel ends before it."""
    with pytest.warns(T2TwinWarning, match="cyskin-20: the shape bottomed out"):
        touch = twin().press("square-2", force_n=2.0, tilt_x_deg=MAX_TILT_DEG)
    assert touch.cyskin.bottomed and not touch.digit.bottomed
    touch = twin().press("square-2", force_n=2.0, tilt_x_deg=10.0)
    assert not touch.cyskin.bottomed and not touch.digit.bottomed


@pytest.mark.filterwarnings("ignore:.*bottomed out:t2twin.T2TwinWarning")
def test_a_tilted_shape_off_the_pad_is_refused_with_a_place_that_is_not(tmp_path):
    uneven().export(tmp_path / "part.stl")
    with pytest.raises(T2TwinError, match="does not lie over") as error:
        twin().press(tmp_path / "part.stl", x_mm=60.0, tilt_y_deg=20.0)
    x_mm, y_mm = map(float, re.findall(r"[xy]_mm ([-\d.]+)", str(error.value)))
    pressed = twin().press(tmp_path / "part.stl", x_mm=x_mm, y_mm=y_mm, tilt_y_deg=20.0)
    assert np.hypot(*centers(pressed).T).max() < 1.0


@pytest.mark.parametrize("value", [30.1, np.nan, "5"])
def test_larger_tilts_are_refused(value):
    with pytest.raises(T2TwinError, match="tilt_y_deg"):
        twin().press("square-1", tilt_y_deg=value)
    with pytest.raises(T2TwinError, match=r"tilt_x_rad is 0\.6; expected a number"):
        PressCommand("square-1", 0.0, 0.0, 0.0, 1.0, 0.6)


def test_a_slide_keeps_the_tilt_of_its_press():
    start = twin().press("square-2", force_n=2.0, **TILT_DEG)
    end = twin().slide(start, dx_mm=0.4, dyaw_deg=3.0, steps=2, friction=0.0)[-1]
    fresh = twin().press("square-2", force_n=2.0, x_mm=0.4, yaw_deg=3.0, **TILT_DEG)
    assert end.command.tilt_rad == fresh.command.tilt_rad == TILT_RAD
    np.testing.assert_allclose(centers(end), centers(fresh), atol=0.02)
    path = [(0, 0, 0, 2), (0.4, 0, 3, 2)]
    followed = twin().follow("square-2", path, friction=0.0, **TILT_DEG)[-1]
    assert followed.command.tilt_rad == TILT_RAD
    np.testing.assert_allclose(centers(followed), centers(end), atol=1e-6)


def test_the_shown_solid_touches_the_surface_where_the_contact_does():
    contact = twin().press("hemisphere-2", force_n=2.0, yaw_deg=40.0, **TILT_DEG).digit
    quaternion, place = contact.shape_pose
    command = contact.command
    about = Rotation.from_euler("xyz", [*command.tilt_rad, command.yaw_rad])
    turn = Rotation.from_quat(quaternion, scalar_first=True).as_matrix()
    np.testing.assert_allclose(turn, about.as_matrix() @ np.diag([1.0, -1.0, -1.0]), atol=1e-12)
    points = contact.shape.triangles[0] @ turn.T + place
    deepest = points[points[:, 2].argmin()]
    row, column = divmod(int(contact.surface_mm.argmax()), contact.x_mm.size)
    assert deepest[2] == pytest.approx(-contact.shape_depth_mm, abs=2e-3)
    assert deepest[:2] == pytest.approx((contact.x_mm[column], contact.y_mm[row]), abs=0.15)


def test_recipes_sample_a_uniform_angle_in_a_uniform_direction():
    rng, place = np.random.default_rng(0), Place(normal_mm=1.0, tilt_deg=(10.0, 30.0))
    samples = np.array([sample_tilt(rng, place) for _ in range(2000)])
    axes = np.array([rotation_of(*tilt)[2] for tilt in samples])  # the press axis in the shape
    angles = np.degrees(np.arccos(axes[:, 2]))
    assert 10.0 <= angles.min() < 10.2 and 29.8 < angles.max() <= 30.0 + 1e-9
    assert angles.mean() == pytest.approx(20.0, abs=0.5)
    assert np.abs(axes[:, :2].mean(axis=0)).max() < 0.02
    assert np.abs(samples).max() <= np.deg2rad(MAX_TILT_DEG)
    assert sample_tilt(rng, Place(normal_mm=1.0)) == (0.0, 0.0)
    with pytest.raises(T2TwinError, match=r"tilt_deg of place is \[3, 2\]"):
        Place(normal_mm=1.0, tilt_deg=(3.0, 2.0))


RECIPE = """
name = "tilts"
[[parts]]
shapes = "random"
count = 2
presses = 2
place = { uniform_mm = 0.5, tilt_deg = 12.0 }
force_n = 2.0
"""


def test_a_dataset_of_tilted_presses_has_their_tilt(tmp_path):
    (tmp_path / "tilts.toml").write_text(RECIPE)
    folder = tmp_path / "data"
    info = t2twin.make_dataset(folder, recipe=tmp_path / "tilts.toml", workers=1)
    assert t2twin.verify_dataset(folder) == []
    table = read_split(folder, "train")
    pose = np.array([table[name].to_numpy() for name in (*POSE, *TILT)]).T
    angles = np.degrees(np.arccos(np.cos(pose[:, 4]) * np.cos(pose[:, 5])))
    assert len(pose) == 4 and angles.max() <= 12.0 and len(set(angles)) == 4
    assert "tilt_x_rad" in (folder / "README.md").read_text()
    row = {name: table[name][0].as_py() for name in ("shape", *POSE, *TILT)}
    touch = twin()._pair.press(t2twin.load_shape(row["shape"]), PressCommand(**row))
    assert table["target_depth_mm"][0].as_py() == touch.cyskin.depth_mm
    np.testing.assert_array_equal(lists(table, "target_dense_counts")[0], touch.dense_counts)
    assert info.recipe is not None and info.recipe.has_tilt
    straight = t2twin.load_recipe("open")
    place = msgspec.json.decode(msgspec.json.encode(straight.parts[0].place))
    assert not straight.has_tilt and set(place) == {"normal_mm", "uniform_mm"}
    assert not {*TILT} & {*schema_of(info.values, straight).names}
