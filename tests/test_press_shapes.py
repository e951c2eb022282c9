"""Shapes that a user might bring: the pressing surface is found, and the contact is right."""

import re

import numpy as np
import pytest
import trimesh
from kinds import COVER, COVER_PITCH_MM, GEL, GEL_PITCH_MM

import t2twin
from t2twin.cli.press import contact_summary
from t2twin.core.errors import T2TwinError
from t2twin.primitives_cad import catalogue
from t2twin.sim.contact.contact_solver import solve_contact
from t2twin.sim.contact.pin_layout import OffPadError
from t2twin.sim.contact.types import PressCommand
from t2twin.sim.touch import BOTTOMED

SENSORS = ((GEL, GEL_PITCH_MM), (COVER, COVER_PITCH_MM))


def box(sides, at):
    solid = trimesh.creation.box(sides)
    solid.apply_translation(at)
    return solid


@pytest.fixture
def solid(tmp_path):
    def made(*parts):
        path = tmp_path / "my.stl"
        trimesh.util.concatenate(parts).export(path)
        return catalogue.load(path, tmp_path)

    return made


# A solid's outline is known to half a point of its height map, 0.025 mm: a ring of 1 mm may lose
# 5 % of its area, and a turned block 1.5 % of its depth.
def pressed(shape, elastomer, pitch, force=8.0, x=0.0, y=0.0, yaw=0.0):
    contact = solve_contact(shape, PressCommand(shape.name, x, y, yaw, force), elastomer, pitch)
    assert contact.settled
    assert contact.force_n == pytest.approx(force, rel=0.005)
    return contact


def center(contact):
    """Centre of pressure, mm."""
    weights = contact.pressure_kpa / contact.pressure_kpa.sum()
    return float(weights.sum(0) @ contact.x_mm), float(weights.sum(1) @ contact.y_mm)


@pytest.mark.parametrize("elastomer, pitch", SENSORS)
def test_a_hollow_shape_leaves_its_middle_free(solid, elastomer, pitch):
    ring = trimesh.creation.annulus(r_min=2.5, r_max=3.5, height=6.0, sections=128)
    contact = pressed(solid(ring), elastomer, pitch)
    distance = np.hypot(*np.meshgrid(contact.x_mm, contact.y_mm))
    assert not contact.pressure_kpa[distance < 2.0].any()
    assert contact.contact_area_mm2 == pytest.approx(np.pi * (3.5**2 - 2.5**2), rel=0.08)
    assert contact.surface_mm[distance < 0.4].max() < contact.depth_mm


@pytest.mark.parametrize("elastomer, pitch", SENSORS)
def test_only_the_higher_of_two_steps_touches_until_pushed_harder(solid, elastomer, pitch):
    shape = solid(box((3, 6, 6.3), (-2, 0, 3.15)), box((3, 6, 6), (2, 0, 3)))
    light = pressed(shape, elastomer, pitch, 0.5)
    assert light.contact_area_mm2 < 18.6 and not light.bottomed
    hard = pressed(shape, elastomer, pitch, 20.0)
    assert hard.contact_area_mm2 > 20.0
    assert hard.bottomed


def test_a_part_off_center_presses_where_it_stands(solid):
    # The box around both parts is centerd: the post stands 6 mm to the right of its middle.
    plate, post = box((14, 4, 1), (0, 0, 0)), box((2, 2, 9), (6, 0, 5))
    contact = pressed(solid(plate, post), COVER, COVER_PITCH_MM, x=1.0, y=-3.0)
    assert center(contact) == pytest.approx((7.0, -3.0), abs=0.1)
    turned = pressed(solid(plate, post), COVER, COVER_PITCH_MM, x=1.0, y=-3.0, yaw=np.pi / 2)
    assert center(turned) == pytest.approx((1.0, 3.0), abs=0.1)


@pytest.mark.parametrize("elastomer, pitch", SENSORS)
@pytest.mark.parametrize("side, resolved", [(0.1, False), (0.25, False), (0.5, True)])
def test_a_contact_smaller_than_the_grid_is_not_settled(solid, elastomer, pitch, side, resolved):
    """4 N on a needle: tens of MPa."""
    shape = solid(box((20, 20, 1), (0, 0, 0)), box((side, side, 6), (0, 0, 3)))
    contact = solve_contact(shape, PressCommand("my", 0.0, 0.0, 0.0, 4.0), elastomer, pitch)
    assert contact.contact_area_mm2 == pytest.approx(side**2, rel=0.01)
    assert contact.settled is resolved and contact.smaller_than_grid is not resolved
    assert ("smaller than the grid" in contact_summary("digit", contact)) is not resolved
    assert ("narrower than 0.5 x 0.2 mm" in "".join(shape.notes)) is not resolved


def test_a_twin_warns_of_what_limits_a_contact(solid):
    """A post of 0.4 mm on a plate, which touches too; then the same in a slide."""
    low, twin = solid(box((12, 12, 1), (0, 0, 0)), box((2, 2, 0.4), (0, 0, 0.7))), t2twin.Twin()
    with pytest.warns(t2twin.T2TwinWarning) as said:
        touch = twin.press(low, force_n=20.0)
    found = [str(each.message) for each in said]
    bottomed = {name for name, each in touch.contacts.items() if each.bottomed}
    assert found == touch.notes == [f"{name}: {BOTTOMED}" for name in touch.contacts]
    assert bottomed == set(touch.contacts)
    with pytest.warns(t2twin.T2TwinWarning, match="bottomed out") as said:
        twin.slide(touch, dx_mm=0.2, steps=2)
    assert len(said) == len(bottomed)


@pytest.mark.parametrize(
    ("command", "note"),
    [
        ({"force_n": 100.0}, "cyskin-20: counts are clipped at full scale, 40,000"),
        ({"y_mm": 12.2, "force_n": 1.0}, "digit: the contact lies outside the camera's view"),
        ({"x_mm": 10.0}, "digit: the shape's middle lies off the sensor, whose soft layer reaches"),
        ({"x_mm": 2.0}, ""),
    ],
)
def test_a_touch_names_what_limits_it(command, note):
    own = {"x_mm": 0.0, "y_mm": 0.0, "force_n": 4.0} | command
    touch = t2twin.Twin(imperfections="recorded")._pair.press(  # noise leaves clipped ones lower
        catalogue.load("hemisphere-4"),
        PressCommand("hemisphere-4", **own, yaw_rad=0.0),
        np.random.default_rng(5),
    )
    assert any(each.startswith(note) for each in touch.notes) == bool(note), touch.notes


@pytest.mark.parametrize("yaw", [0.0, 1.0, -2.5])
def test_a_shape_off_the_middle_is_told_where_it_lies(solid, yaw):
    """A ring around the pad: the position in the sentence presses it, and so does centering."""
    ring = solid(trimesh.creation.annulus(r_min=20.0, r_max=24.0, height=6.0))
    with pytest.raises(OffPadError, match="does not lie over the digit pad") as caught:
        solve_contact(ring, PressCommand("my", 0.0, 0.0, yaw, 4.0), *SENSORS[0])
    found = re.search(r"option center .* x_mm (\S+) and y_mm (\S+)", str(caught.value))
    assert found
    x, y = map(float, found.groups())
    assert np.hypot(x, y) == pytest.approx(22.0, abs=0.5)
    contact = pressed(ring, *SENSORS[0], force=4.0, x=x, y=y, yaw=yaw)
    assert np.hypot(*center(contact)) < 4.0


def test_positions_beyond_the_height_map_are_not_recommended(solid):
    """Of a large shape the pad would reach parts that are not in the map; a press there names
    them."""
    ring = solid(trimesh.creation.annulus(r_min=26.0, r_max=60.0, height=6.0))
    with pytest.raises(OffPadError, match="option center") as caught:
        solve_contact(ring, PressCommand("my", 0.0, 0.0, 0.0, 4.0), *SENSORS[0])
    assert "x_mm" not in str(caught.value)
    for x, cut in ((25.0, True), (15.0, False)):
        contact = pressed(ring, *SENSORS[0], force=4.0, x=x)
        assert ("beyond 32 mm" in contact_summary("digit", contact)) is cut


@pytest.mark.parametrize("radius", [22.0, 100.0])
def test_a_shape_may_be_pressed_at_its_highest_part(radius, tmp_path):
    ring = trimesh.creation.annulus(r_min=radius - 3.0, r_max=radius + 3.0, height=6.0)
    pad = box((4, 4, 2), (0, radius, 4))  # 2 mm above the ring, at y = radius
    trimesh.util.concatenate([ring, pad]).export(tmp_path / "ring.stl")
    if radius > 32.0:
        with pytest.raises(T2TwinError, match=r"no surface within 32 mm.*center presses"):
            catalogue.load(tmp_path / "ring.stl", tmp_path / "kept")
    shape = catalogue.load(tmp_path / "ring.stl", tmp_path / "kept", center=True)
    contact = pressed(shape, COVER, COVER_PITCH_MM, force=1.0)
    assert center(contact) == pytest.approx((0.0, 0.0), abs=0.1)
    assert contact.contact_area_mm2 == pytest.approx(16.0, rel=0.03)
    with pytest.raises(T2TwinError, match="center are for files only"):
        catalogue.load("square-2", center=True)
