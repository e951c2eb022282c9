"""Contacts under prescribed forces and torques."""

from dataclasses import replace

import numpy as np
import pytest
from kinds import COVER, GEL

from t2twin.primitives_cad import catalogue
from t2twin.primitives_cad.shape import NOTHING_MM, HeightMap, Shape
from t2twin.sim.contact.contact_solver import solve_contact
from t2twin.sim.contact.elastomer import Elastomer, Friction
from t2twin.sim.contact.pin_layout import OffPadError
from t2twin.sim.contact.sliding import Load, advance, carry, owner_of
from t2twin.sim.contact.types import Contact, PressCommand

FRICTION = 0.8
FLAT = replace(COVER, width_mm=24.0, length_mm=24.0)


def ball(x_mm=0.0, y_mm=0.0, radius_mm=4.0, name="ball"):
    """A ball over a place of the sensor, x right and y down."""
    x = np.arange(-13.0, 13.05, 0.1)
    square = (x - x_mm) ** 2 + (x[:, None] + y_mm) ** 2
    heights = np.sqrt(np.maximum(radius_mm**2 - square, 0.0)) - radius_mm
    heights[square > 0.9 * radius_mm**2] = NOTHING_MM
    surface = HeightMap((heights - heights.max()).astype(np.float32), x, x)
    return Shape(name, catalogue.load("circle-1").mesh, surface, (1.0, 1.0))


def load(shape, force_n=4.0, shear_n=(0.0, 0.0), torque_nmm=0.0, motion=(0.0, 0.0, 0.0)):
    return Load(shape, force_n, shear_n, torque_nmm, motion, Friction(FRICTION))


def pressed(load, elastomer=FLAT, pitch_mm=0.5):
    command = PressCommand(load.shape.name, 0.0, 0.0, 0.0, load.force_n)
    return solve_contact(load.shape, command, elastomer, pitch_mm)


def check_wrench(contact, load, tolerance=0.01):
    assert contact.settled
    assert contact.force_n == pytest.approx(load.force_n, rel=1e-3)
    scale = float(np.hypot(*load.shear_n))
    assert contact.shear_n == pytest.approx(np.array(load.shear_n), abs=tolerance * scale)
    assert contact.torque_nmm == pytest.approx(load.torque_nmm, abs=tolerance * scale)


def test_a_load_without_shear_is_the_press():
    still = load(ball())
    expected, found = pressed(still), carry(FLAT, 0.5, [still], None)
    again = carry(FLAT, 0.5, [still], found)
    for contact in (found, again):
        assert np.array_equal(contact.pressure_kpa, expected.pressure_kpa)
        assert np.array_equal(contact.surface_mm, expected.surface_mm)
        assert not contact.shear_kpa.any() and contact.slip_share == 0.0


@pytest.mark.parametrize("elastomer, pitch_mm", [(GEL, 0.25), (COVER, 0.5)])
def test_the_forces_of_a_slide_give_its_traction(elastomer, pitch_mm):
    shape = catalogue.load("hemisphere-4")
    slid = found = pressed(load(shape), elastomer, pitch_mm)
    for x_mm in (0.1, 0.2, 0.1):
        step_mm = x_mm - slid.command.x_mm
        slid = advance(slid, step_mm, 0.0, 0.0, 4.0, Friction(FRICTION))
        surface = replace(shape.surface, x_mm=shape.surface.x_mm + x_mm)
        there = Shape("there", shape.mesh, surface, shape.spacing_mm)
        torque = slid.torque_nmm + x_mm * slid.shear_n[1]
        prescribed = load(there, 4.0, tuple(slid.shear_n), torque, (step_mm, 0.0, 0.0))
        found = carry(elastomer, pitch_mm, [prescribed], found)
        check_wrench(found, prescribed)
        difference = np.linalg.norm(found.shear_kpa - slid.shear_kpa)
        assert difference < 0.1 * np.linalg.norm(slid.shear_kpa)
        assert found.slip_share == pytest.approx(slid.slip_share, abs=0.05)


@pytest.mark.parametrize("share", [0.3, 0.8])
def test_compliance_of_a_ball(share):
    """Mindlin 1949: displacement of the middle of a contact of radius a on a half-space,
    3 mu P (2 - nu) / (16 G a) (1 - (1 - Q / mu P)^(2/3)), exact for nu = 0."""
    young, friction, force = 1.0, 0.2, 0.1
    half_space = Elastomer("thick", 100.0, young, 0.0, 12.0, 12.0, law="linear")
    pushed = Load(
        ball(), force, (share * friction * force, 0.0), 0.0, (0.0, 0.0, 0.0), Friction(friction)
    )
    contact = carry(half_space, 0.1, [pushed], None)
    radius = (0.75 * force * 4.0 / young) ** (1 / 3)
    full_mm = 3 * friction * force * 2 / (16 * young / 2 * radius)
    stuck = (contact.pressure_kpa > 0) & ~contact.slipping
    moved = np.median(contact.sheared_mm[0][stuck])
    assert moved == pytest.approx(full_mm * (1 - (1 - share) ** (2 / 3)), rel=0.04)


def test_near_the_limit_of_friction():
    """The force grows steadily up to the limit, and the contact then slides as a whole."""
    contact, slipping = None, []
    for share in (0.9, 0.97, 0.99, 0.9985, 1.0, 1.001, 1.2):
        wanted = load(ball(), 4.0, (share * FRICTION * 4.0, 0.0), motion=(0.1, 0.0, 0.0))
        contact = carry(FLAT, 0.5, [wanted], contact)
        slipping.append(contact.slip_share)
        expected = min(share, 1.0) * FRICTION * 4.0
        assert contact.settled
        assert contact.shear_n == pytest.approx([expected, 0.0], abs=2e-3 * expected)
        assert (np.hypot(*contact.shear_kpa) <= FRICTION * contact.pressure_kpa * 1.001).all()
    assert slipping[0] < 0.95 and np.all(np.diff(slipping) >= 0) and slipping[-3:] == [1.0] * 3
    path = contact.slip_mm[contact.pressure_kpa > 0]
    assert path.min() > 0.1


def test_far_beyond_the_limit_the_motion_gives_the_direction():
    wanted = load(ball(), 4.0, (6.0, 0.0), motion=(0.3, 0.3, 0.0))
    contact = carry(FLAT, 0.5, [wanted], None)
    assert contact.slip_share == 1.0
    along_x, along_y = contact.shear_n
    assert np.hypot(along_x, along_y) == pytest.approx(FRICTION * 4.0, rel=2e-3)
    assert along_x == pytest.approx(along_y, rel=0.15)


def test_too_large_a_torque_leaves_the_force():
    wanted = load(ball(2.0), 4.0, (1.0, 0.0), 100.0)
    contact = carry(replace(FLAT, young_mpa=0.5), 0.5, [wanted], None)
    assert contact.settled and contact.slip_share == 1.0
    assert contact.shear_n == pytest.approx([1.0, 0.0], abs=1e-3)
    assert 1.0 < contact.torque_nmm < 20.0


def test_no_friction_and_tiny_forces():
    slick = replace(load(ball(), 4.0, (1.0, 0.0), 2.0, (0.1, 0.0, 0.0)), friction=Friction(0.0))
    contact = carry(FLAT, 0.5, [slick], carry(FLAT, 0.5, [slick], None))
    assert contact.settled and not contact.shear_kpa.any()
    light = load(ball(), 0.01, (1e-9, 0.0), -1e-9)
    for _ in range(2):
        contact = carry(FLAT, 0.5, [light], contact)
        assert contact.settled and contact.force_n == pytest.approx(0.01, rel=1e-3)
        assert contact.shear_n == pytest.approx([1e-9, 0.0], abs=2e-10)


def shares(contact: Contact):
    """Normal force and tangential force, N, of each body."""
    names = contact.equilibrium.names
    owner = owner_of(contact, names)
    return [
        1e-3 * contact.pitch_mm**2 * (field * (owner == body)).sum(axis=(-2, -1))
        for body in range(len(names))
        for field in (contact.pressure_kpa, contact.shear_kpa)
    ]


def test_two_bodies_carry_their_own_forces():
    one = load(ball(-4.0, radius_mm=3.0, name="one"), 2.0, (0.3, 0.0))
    two = load(ball(4.0, radius_mm=3.0, name="two"), 5.0, (0.0, -0.5), -2.0)
    contact = None
    for _ in range(2):
        contact = carry(FLAT, 0.5, [one, two], contact)
        assert contact.settled
        force, shear, other_force, other_shear = shares(contact)
        assert force == pytest.approx(2.0, rel=0.01) and other_force == pytest.approx(5.0, rel=0.01)
        assert shear == pytest.approx([0.3, 0.0], abs=3e-3)
        assert other_shear == pytest.approx([0.0, -0.5], abs=5e-3)
    assert contact is not None
    alone = carry(FLAT, 0.5, [one], contact)  # the other one is lifted off
    check_wrench(alone, one)
    assert not alone.pressure_kpa[:, alone.x_mm > 2].any()


def slab(first_mm, last_mm, name):
    """A flat face from first_mm to last_mm along x, 4 mm wide."""
    x = np.arange(-13.0, 13.05, 0.1)
    inside = (x >= first_mm) & (x <= last_mm) & (np.abs(x[:, None]) <= 2.0)
    surface = HeightMap(np.where(inside, 0.0, NOTHING_MM).astype(np.float32), x, x)
    return Shape(name, catalogue.load("circle-1").mesh, surface, (1.0, 1.0))


def test_overlapping_faces_share_the_pressure():
    """Two faces at the same height, half of which overlap, press as one face does."""
    loads = [load(slab(-4.0, 2.0, "left"), 3.0), load(slab(-2.0, 4.0, "right"), 3.0)]
    contact, one = carry(FLAT, 0.5, loads, None), pressed(load(slab(-4.0, 4.0, "one"), 6.0))
    assert contact.settled and contact.depth_mm == pytest.approx(one.depth_mm, rel=0.02)
    forces = contact.equilibrium.body_pressures_mpa.sum(axis=(1, 2)) * contact.pitch_mm**2
    assert forces == pytest.approx([3.0, 3.0], rel=1e-3)
    difference = np.abs(contact.pressure_kpa - one.pressure_kpa).sum()
    assert difference < 0.05 * one.pressure_kpa.sum()


def test_a_body_at_a_new_place_starts_without_traction():
    still = load(ball(-6.0, name="still"), 2.0, (0.3, 0.0))
    first, elsewhere = (load(ball(x, name="other"), 2.0, (1.0, 0.0)) for x in (2.0, 7.0))
    before = carry(FLAT, 0.5, [still, first], None)
    moved = replace(elsewhere, motion=None)
    found = carry(FLAT, 0.5, [still, moved], before)
    fresh = carry(FLAT, 0.5, [still, moved], None)
    assert found.settled
    there = found.x_mm > 2.0
    shear, expected = found.shear_kpa[:, :, there], fresh.shear_kpa[:, :, there]
    assert np.linalg.norm(shear - expected) < 0.1 * np.linalg.norm(expected)


def test_body_beside_the_pad():
    with pytest.raises(OffPadError, match="does not lie over"):
        carry(replace(FLAT, width_mm=8.0), 0.5, [load(ball(9.0))], None)
