"""Presses to a depth instead of with a force."""

import pytest

import t2twin
from t2twin.cli import main
from t2twin.core.errors import T2TwinError
from t2twin.sim.contact.contact_solver import DEPTH_TOLERANCE_MM, force_at_depth
from t2twin.sim.contact.types import PressCommand
from t2twin.sim.sensors.files import load_sensor


@pytest.mark.parametrize("sensor", [load_sensor("digit"), load_sensor("cyskin-20")])
@pytest.mark.parametrize(("name", "force"), [("hemisphere-2", 0.7), ("square-2", 8.0)])
def test_a_forces_depth_gives_the_force_back(shapes, sensor, name, force):
    command = PressCommand(name, 0.5, 1.0, 0.3, force)

    def press(at):
        return sensor.press(shapes(name), at)

    depth = press(command).depth_mm
    found = force_at_depth(press, command, depth)
    # the force is as exact as the depth: the gel's stiffness here is some N in a tenth of a mm
    assert found == pytest.approx(force, rel=0.02)
    assert press(PressCommand(name, 0.5, 1.0, 0.3, found)).depth_mm == pytest.approx(
        depth, abs=2 * DEPTH_TOLERANCE_MM
    )


def test_deeper_needs_more_force(shapes):
    digit = load_sensor("digit")
    command = PressCommand("hemisphere-3", 0.0, 0.0, 0.0, 8.0)
    forces = [
        force_at_depth(lambda at: digit.press(shapes("hemisphere-3"), at), command, depth)
        for depth in (0.1, 0.3, 0.9)
    ]
    assert forces == sorted(forces) and forces[2] > 5 * forces[1]


def test_of_the_public_press_it_is_the_digits_depth():
    touch = t2twin.press("hemisphere-2", depth_mm=0.8)
    assert touch.digit.depth_mm == pytest.approx(0.8, abs=2e-3)
    assert touch.command.force_n == touch.cyskin.command.force_n
    assert touch.cyskin.force_n == pytest.approx(touch.command.force_n, rel=0.005)
    with pytest.raises(T2TwinError, match="both given"):
        t2twin.press("hemisphere-2", depth_mm=0.8, force_n=2.0)


def test_alone_the_cyskin_is_pressed_to_the_depth(tmp_path, capsys):
    main(["press", "hemisphere-2", "--sensor", "cyskin", "--depth-mm", "1", "--out", str(tmp_path)])
    assert " at 1.00" in capsys.readouterr().out
