"""Difficult shapes of the benchmark contact_cases, and small pins under small parts."""

import pytest

from benchmarks.contact import contact_cases
from benchmarks.contact.contact_shapes import make_case
from benchmarks.contact.press import SENSORS
from benchmarks.contact.solids import punch
from t2twin.primitives_cad.random_shapes import random_shape
from t2twin.primitives_cad.shape import ball
from t2twin.sim.contact.contact_solver import solve_bodies, solve_contact
from t2twin.sim.contact.types import PressCommand

NEEDLES = 142
"""Number of a case of five round needles on the CySkin."""


def smallest_pin_mm(shape, sensor):
    own = SENSORS[sensor]
    contact = solve_contact(shape, PressCommand("", 0.1, 0.2, 0.4, 0.5), own.flat, own.pitch_mm)
    return contact.pins.side_mm.min()


@pytest.mark.parametrize("sensor", SENSORS)
def test_small_parts_get_pins_of_half_the_size(sensor):
    assert smallest_pin_mm(punch(0.6), sensor) == pytest.approx(0.0625)
    assert smallest_pin_mm(punch(1.2), sensor) == pytest.approx(0.125)
    assert smallest_pin_mm(ball(6.0), sensor) >= 0.124


@pytest.mark.parametrize(
    ("seed", "force_n", "side_mm"),
    [
        pytest.param(3, 2.0, 0.125, id="ridges over the whole pad"),
        pytest.param(1, 1.0, 0.0625, id="narrow ridges that the first estimate misses in part"),
    ],
)
def test_narrow_ridges_get_small_pins(seed, force_n, side_mm):
    own, command = SENSORS["cyskin"], PressCommand("", 0.0, 0.0, 0.4, force_n)
    body = random_shape(seed), command
    contact = solve_bodies([body], own.flat, own.pitch_mm, with_mujoco=False)
    assert contact.settled and contact.pins.side_mm.min() == pytest.approx(side_mm)


def test_round_needles_have_the_depth_of_the_reference():
    case, own = make_case(NEEDLES), SENSORS["cyskin"]
    shape, top_mm = case.shape(contact_cases.FINE_MAP_MM)
    command = contact_cases.sample_command(case, NEEDLES)
    contact = contact_cases.press(shape, "cyskin", command)
    coarse, fine = (
        contact_cases.depth_on(
            pad, contact_cases.gaps(pad, case, top_mm, contact.command), contact.command
        )
        for pad in (contact_cases.flat_pad("cyskin", pitch) for pitch in contact_cases.PITCHES_MM)
    )
    assert own.flat.law == "linear" and contact.settled
    assert contact.depth_mm == pytest.approx(2 * fine - coarse, rel=0.02)
