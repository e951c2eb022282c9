"""The engine against theory, against the oracle, and against what every press must keep to."""

from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import numpy as np
import pytest
import trimesh
from kinds import COVER, COVER_PITCH_MM, GEL, GEL_PITCH_MM

from benchmarks.contact.oracle import kernel, solve
from benchmarks.contact.solids import block, formula, punch
from t2twin.core.errors import T2TwinError
from t2twin.primitives_cad import catalogue
from t2twin.primitives_cad.random_shapes import Feature, heights_mm, random_shape
from t2twin.primitives_cad.shape import NOTHING_MM, HeightMap, Shape, ball
from t2twin.sim.contact.contact_solver import solve_contact
from t2twin.sim.contact.elastomer import Elastomer
from t2twin.sim.contact.layer import cached_layer
from t2twin.sim.contact.mujoco_contact import MujocoPins
from t2twin.sim.contact.types import PressCommand
from t2twin.sim.optical.surface import surface_on
from t2twin.sim.sampling import protocol

FLAT = Elastomer("flat", 4.07, 0.5, 0.47, width_mm=18.5, length_mm=18.5, law="linear")

FLAT_TOP = {"dome_width_radius_mm": np.inf, "dome_length_radius_mm": np.inf, "dome_flat_mm": 0.0}


def pressed(shape, elastomer=FLAT, pitch=0.5, force=8.0, x=0.0, y=0.0, yaw=0.0):
    return solve_contact(shape, PressCommand(shape.name, x, y, yaw, force), elastomer, pitch)


def test_a_ball_on_a_thick_layer_is_hertz():
    force = 0.1
    thick = replace(FLAT, thickness_mm=50.0)
    contact = pressed(ball(6.0), thick, pitch=0.1, force=force)
    modulus = thick.young_mpa / (1 - thick.poisson**2)
    radius = (3 * force * 6.0 / (4 * modulus)) ** (1 / 3)
    assert contact.depth_mm == pytest.approx(radius**2 / 6.0, rel=0.05)
    peak_kpa = 1e3 * 1.5 * force / (np.pi * radius**2)
    assert contact.pressure_kpa.max() == pytest.approx(peak_kpa, rel=0.05)


def test_a_flat_punch_on_a_thick_layer_is_boussinesq():
    thick = replace(FLAT, thickness_mm=100.0)
    contact = pressed(punch(3.0), thick, pitch=0.25, force=1.0)
    modulus = thick.young_mpa / (1 - thick.poisson**2)
    assert contact.depth_mm == pytest.approx(1.0 / (2 * 3.0 * modulus), rel=0.05)


def test_depth_under_a_flat_face_is_proportional_to_force():
    """Also where the depth is a hundredth of a cell, and the face turned: its walls, which a height
    map interpolates, are no part of it."""
    ring, linear = catalogue.load("circle-empty-4"), replace(GEL, law="linear", **FLAT_TOP)
    for yaw in (0.0, 0.4):
        slope = [
            pressed(ring, linear, GEL_PITCH_MM, force, yaw=yaw).depth_mm / force
            for force in (0.25, 1.0, 8.0)
        ]
        assert slope == pytest.approx([slope[-1]] * 3, rel=0.005)


@pytest.mark.parametrize("shape", [ball(4.0), block(8.0, 8.0), block(2.0, 12.0)])
def test_the_engine_agrees_with_the_oracle(shape):
    contact = pressed(shape, pitch=0.25)
    fine = 0.125
    cells = round(FLAT.width_mm / fine)
    axis = (np.arange(cells) - (cells - 1) / 2) * fine
    x, y = np.meshgrid(axis, axis)
    gap = -np.maximum(shape.surface.sample(x, y), -10.0)
    answer = solve(
        gap, 8.0, fine, kernel(cells, cells, fine, FLAT.thickness_mm, FLAT.young_mpa, FLAT.poisson),
        tolerance=1e-3,
    )  # fmt: skip
    assert contact.depth_mm == pytest.approx(answer.depth_mm, rel=0.03)


@pytest.mark.parametrize("elastomer, pitch", [(GEL, 0.25), (COVER, 0.5)])
@pytest.mark.parametrize("name", ["hemisphere-1", "pliers/teeth"])
def test_eight_newtons_in_eight_newtons_out(name, elastomer, pitch, shapes):
    shape = shapes(name)
    for index in protocol.indices(name, protocol.SCALES["smoke"]):
        command = protocol.press_of(name, shape.spacing_mm, index)
        contact = solve_contact(shape, command, elastomer, pitch)
        assert contact.settled and not contact.bottomed
        assert contact.force_n == pytest.approx(8.0, rel=0.005)
        assert (contact.pressure_kpa >= 0).all()
        assert 0 < contact.depth_mm < elastomer.thickness_mm
        layer = cached_layer(elastomer, pitch)
        assert (contact.surface_mm < layer.thickness_mm).all()


def test_a_quarter_turn_of_the_press_turns_the_contact():
    shape = block(3.0, 10.0)
    for elastomer, pitch in ((COVER, COVER_PITCH_MM), (replace(GEL, **FLAT_TOP), GEL_PITCH_MM)):
        straight = pressed(shape, elastomer, pitch, x=2.0, y=1.0, yaw=0.3)
        turned = pressed(shape, elastomer, pitch, x=-1.0, y=2.0, yaw=0.3 + np.pi / 2)
        for name in ("surface_mm", "pressure_kpa"):
            # A turn from x to y is clockwise where rows go down: rot90 backwards.
            expected = np.rot90(middle_square(getattr(straight, name)), -1)
            assert middle_square(getattr(turned, name)) == pytest.approx(
                expected, abs=2e-3 * float(np.abs(expected).max())
            )


def middle_square(field):
    """The square of whole columns in the middle of a longer pad."""
    rows, columns = field.shape
    return field[(rows - columns) // 2 : (rows + columns) // 2]


def test_the_shape_is_turned_over_about_x():
    # Higher at its own +x and +y corner: at yaw 0 that corner lies at +x and -y of the sensor.
    wedge = formula(lambda x, y: np.where((x > 1) & (y > 1) & (x < 4) & (y < 4), 0.0, NOTHING_MM))
    contact = pressed(wedge, force=1.0)
    x, y = np.meshgrid(contact.x_mm, contact.y_mm)
    touched = contact.pressure_kpa > 0
    assert (x[touched] > 0).all() and (y[touched] < 0).all()


def test_the_fine_surface_follows_the_shape(shapes):
    shape = shapes("square-2")
    command = PressCommand("square-2", 0.0, 0.0, 0.2, 8.0)
    contact = solve_contact(shape, command, GEL, GEL_PITCH_MM)
    axis = np.linspace(-2, 2, 21)
    fine = surface_on(contact, axis, axis)
    x, y = np.meshgrid(axis, axis)
    expected = contact.shape_depth_mm + GEL.rest_surface_mm(x, y)
    assert fine == pytest.approx(expected, abs=0.02)


def test_through_a_linear_layer_is_an_error():
    with pytest.raises(T2TwinError, match="through the flat layer"):
        pressed(ball(2.0), replace(FLAT, thickness_mm=1.0), force=20.0)


@pytest.mark.parametrize("force", [-3.0, 0.0, 5000.0, float("nan")])
def test_an_impossible_force_is_an_error(force):
    with pytest.raises(T2TwinError, match=r"0\.01 to 100 N"):
        pressed(ball(4.0), force=force)


def test_presses_in_threads_are_those_of_one_after_another(shapes):
    """A solver owns its bed: several at once share layers and nothing that changes."""
    names = ("square-2", "circle-empty-2", "line-smooth-2", "hemisphere-1")
    commands = [
        (PressCommand(name, 0.3 * turn, -0.2, 0.5 * turn, 4.0 + turn), sensor)
        for turn in range(2)
        for name in names
        for sensor in ((GEL, GEL_PITCH_MM), (COVER, COVER_PITCH_MM))
    ]

    def pressed(task):
        command, (elastomer, pitch) = task
        contact = solve_contact(shapes(command.shape), command, elastomer, pitch)
        return contact.surface_mm.tobytes(), contact.pressure_kpa.tobytes(), contact.depth_mm

    in_turn = [pressed(task) for task in commands]
    with ThreadPoolExecutor(4) as pool:
        assert list(pool.map(pressed, commands)) == in_turn


def test_a_thin_layer_is_as_thin_as_it_says():
    """Wide punch, thin layer: confined compression, p h (1 - 2 nu)(1 + nu) / ((1 - nu) E)."""
    thin = replace(FLAT, thickness_mm=0.1, poisson=0.3)
    contact = pressed(block(8.0, 8.0), thin, pitch=0.25, force=8.0)
    pressure, nu = 8.0 / 64.0, 0.3
    confined = pressure * 0.1 * (1 - 2 * nu) * (1 + nu) / ((1 - nu) * thin.young_mpa)
    assert contact.depth_mm == pytest.approx(confined, rel=0.05)


def test_a_tip_that_is_pressed_almost_through_settles():
    """Where the cover is stiffened hundredfold, the pins' springs have to stiffen with it."""
    disc = Feature("disc", "flat", 1.1177252166700975, -0.1939833513668679, 0.0, 0.5259123882416146)
    axis = np.arange(-321, 322) * 0.1
    heights = heights_mm(([disc], [], [], (0.0, 0.0)), axis, axis)
    heights = np.maximum(heights, np.float32(-8.0))
    heights[[0, -1]] = heights[:, [0, -1]] = NOTHING_MM
    surface = HeightMap(heights, axis, axis)
    tip = Shape("tip", trimesh.Trimesh(), surface, spacing_mm=(1.0, 1.0))
    command = PressCommand("tip", -2.5791143539617805, 2.8193609113121365, 1.0150796254785088, 8.0)
    contact = solve_contact(tip, command, COVER, COVER_PITCH_MM)
    assert contact.settled
    assert contact.force_n == pytest.approx(8.0, rel=0.005)
    assert 2.0 < contact.depth_mm < COVER.thickness_mm


def test_a_face_that_comes_down_behind_a_rim_is_pressed_whole():
    """A rim touches first, of which many fine pins are expected, and then almost all the pad."""
    command = PressCommand("random-1047", -2.900380, -3.448314, 5.413441, 0.652571)
    contact = solve_contact(random_shape(1047), command, COVER, COVER_PITCH_MM)
    assert contact.settled
    assert contact.force_n == pytest.approx(command.force_n, rel=0.005)
    assert contact.contact_area_mm2 > 40.0


def test_mujoco_solves_the_last_step(monkeypatch):
    """Were its contacts to find other springs pressed, nothing would have settled."""
    shape, command = ball(4.0), PressCommand("ball", 0.0, 0.0, 0.0, 8.0)
    assert solve_contact(shape, command, GEL, GEL_PITCH_MM).settled
    step = MujocoPins.step

    def every_other(model, *springs):
        depth, deflection = step(model, *springs)
        deflection[::2] = 0.0
        return depth, deflection

    monkeypatch.setattr(MujocoPins, "step", every_other)
    assert not solve_contact(shape, command, GEL, GEL_PITCH_MM).settled
