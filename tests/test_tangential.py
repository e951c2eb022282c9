"""Shear of a bonded layer and friction, against closed forms."""

from dataclasses import replace

import numpy as np
import pytest

import t2twin
from benchmarks.contact.solids import block
from benchmarks.motion.slides_closed_forms import (
    FORCE_N,
    loop,
    pushed_ball,
    stuck_punches,
    torsion,
    twisted_ball,
)
from t2twin.core.errors import T2TwinError
from t2twin.primitives_cad import catalogue
from t2twin.primitives_cad.shape import ball
from t2twin.sim.contact.closed_forms import shear_kernels, spectra
from t2twin.sim.contact.contact_solver import solve_contact
from t2twin.sim.contact.displacements import MAX_SHORTENING, unfolded
from t2twin.sim.contact.elastomer import Elastomer, Friction
from t2twin.sim.contact.friction import solve_traction
from t2twin.sim.contact.layer import DomedLayer, cached_shear_layer, domed_layer
from t2twin.sim.contact.sliding import advance
from t2twin.sim.contact.types import PressCommand, SurfaceShift
from t2twin.sim.optical.surface import surface_on
from t2twin.sim.sensors.files import load_sensor
from t2twin.sim.taxels.pads import pad_pressure_mpa
from t2twin.sim.touch import FAR_SHEARED, contact_notes

GEL, COVER = load_sensor("digit").elastomer, load_sensor("cyskin-20").elastomer

YOUNG, THICK = 1.0, 200.0
"""Modulus, MPa, and thickness of a layer that is a half-space for contacts of 1 mm."""


def elastomer(poisson, thickness_mm=THICK):
    return Elastomer("test", thickness_mm, YOUNG, poisson, 20.0, 20.0, law="linear")


def shear_modulus(poisson):
    return YOUNG / 2 / (1 + poisson)


def grid(half_mm, pitch_mm):
    n = 2 * round(half_mm / pitch_mm)
    x = (np.arange(n) - (n - 1) / 2) * pitch_mm
    return np.meshgrid(x, x)


# The layer


@pytest.mark.parametrize("poisson", [0.0, 0.3, 0.47])
def test_limits_of_the_spectra(poisson):
    h, shear = 2.0, shear_modulus(poisson)
    long, short = (spectra(np.array([k]), h, YOUNG, poisson) for k in (1e-5, 100.0))
    lame = 2 * shear * poisson / (1 - 2 * poisson)
    assert long.transverse == pytest.approx(h / shear, rel=1e-5)
    assert long.longitudinal == pytest.approx(h / shear, rel=1e-5)
    assert long.normal == pytest.approx(h / (lame + 2 * shear), rel=1e-5)
    assert abs(long.coupling) < 1e-3 * long.normal
    assert short.normal == pytest.approx((1 - poisson) / (100 * shear))
    assert abs(short.base_pressure) < 1e-6
    assert short.transverse == pytest.approx(1 / (100 * shear))
    assert short.longitudinal == pytest.approx((1 - poisson) / (100 * shear))
    assert short.coupling == pytest.approx(-(1 - 2 * poisson) / (2 * 100 * shear), abs=1e-12)
    assert long.base_pressure == pytest.approx(1.0, rel=1e-5)
    assert abs(long.base_shear) < 1e-3


def test_kernels_are_the_inverse_transform_of_the_spectra():
    pitch, n, over, period = 0.5, 16, 8, 96
    cover = COVER
    kernels = shear_kernels(cover, cover.thickness_mm, n, n, pitch)
    k = 2 * np.pi * np.fft.fftfreq(period * over, pitch / over)
    kx, ky = np.meshgrid(k, k)
    radius = np.maximum(np.hypot(kx, ky), 1e-9)
    of_layer = spectra(radius, cover.thickness_mm, cover.young_mpa, cover.poisson)
    cos, sin = kx / radius, ky / radius
    cell = (np.sinc(kx * pitch / 2 / np.pi) * np.sinc(ky * pitch / 2 / np.pi)) ** 2 * over**2
    expected_spectra = (
        of_layer.longitudinal * cos**2 + of_layer.transverse * sin**2,
        (of_layer.longitudinal - of_layer.transverse) * cos * sin,
        of_layer.longitudinal * sin**2 + of_layer.transverse * cos**2,
        1j * of_layer.coupling * cos,
        1j * of_layer.coupling * sin,
    )
    for kernel, spectrum in zip(kernels, expected_spectra, strict=True):
        values = np.roll(np.fft.ifft2(spectrum * cell).real, (period * over // 2,) * 2, (0, 1))
        middle = slice(period // 2 - n + 1, period // 2 + n)
        expected = values[::over, ::over][middle, middle]
        assert np.abs(kernel - expected).max() < 4e-3 * np.abs(expected).max()


# Friction


@pytest.mark.parametrize("poisson", [0.0, 0.47])
@pytest.mark.parametrize("share", [0.3, 0.9])
def test_ball_pushed_sideways(poisson, share):
    """Cattaneo 1938 and Mindlin 1949; exact for a Poisson's ratio of 0."""
    found = pushed_ball(poisson, share, pitch_mm=0.025)
    assert abs(found["compliance_error"]) < 0.01
    assert found["traction_error"] < 0.03
    assert abs(found["stick_radius_error"]) < 0.02


@pytest.mark.parametrize(("shape", "turn"), [(ball(6.0), 0.02), (block(4.3, 3.1), 0.0)])
def test_coarse_cells_have_the_slip_and_the_traction_of_fine_ones(shape, turn):
    flat, command = elastomer(0.47, 3.0), PressCommand(shape.name, 0.13, 0.07, 0.2, 6.0)
    coarse, fine = (solve_contact(shape, command, flat, pitch) for pitch in (0.25, 0.0625))
    for _ in range(2):
        step = 0.1, 0.05, turn, 6.0, Friction(0.6)
        coarse, fine = advance(coarse, *step), advance(fine, *step)
    assert coarse.slip_share == pytest.approx(fine.slip_share, abs=0.025)
    assert coarse.shear_n == pytest.approx(fine.shear_n, rel=0.02)
    traction = fine.shear_kpa.reshape(2, 80, 4, 80, 4).mean(axis=(2, 4))
    assert np.linalg.norm(coarse.shear_kpa - traction) < 0.15 * np.linalg.norm(traction)


def test_stuck_punch_on_thick_and_thin_layers():
    """8 G a / (2 - nu) (Mindlin 1949), and simple shear G A / h."""
    found = stuck_punches(pitch_mm=0.04)
    assert abs(found["thick_error"]) < 0.02 and abs(found["thin_error"]) < 0.02


def test_torsion_of_a_stuck_disc():
    """16 G a^3 / 3 (Reissner and Sagoci 1944)."""
    poisson, pitch = 0.3, 0.04
    x, y = grid(1.04, pitch)
    covered = np.hypot(x, y) <= 1.0
    layer = cached_shear_layer(elastomer(poisson), THICK, pitch, x.shape)
    turned = np.stack([-y, x])
    q, _, converged = solve_traction(
        layer, np.where(covered, 1e6, 0.0), turned, np.zeros_like(turned)
    )
    assert converged
    torque = float((x * q[1] - y * q[0]).sum() * pitch**2)
    assert torque == pytest.approx(16 / 3 * shear_modulus(poisson), rel=0.02)


def test_twist_of_a_ball_with_partial_slip():
    """Lubkin 1951 and Jaeger 1995; the limits of the closed form are those of a stuck contact,
    torque 16 G a^3 / 3 times the rotation, and of full slip, 3 pi / 16 friction P a."""
    angle, torque = torsion(0.99, friction_mpa=0.5, shear_mpa=0.4)
    assert torque == pytest.approx(16 / 3 * 0.4 * angle, rel=0.02)
    assert torsion(1e-3, 0.5, 0.4)[1] == pytest.approx(3 * np.pi / 16 * 0.5 * FORCE_N, rel=1e-4)
    for share in (0.4, 0.7):
        found = twisted_ball(share, pitch_mm=0.04)
        assert abs(found["torque_error"]) < 0.01
        assert abs(found["stick_radius_error"]) < 0.02


def test_unloading_and_reloading_of_a_ball():
    """Mindlin and Deresiewicz 1953: each branch is the first loading, doubled and turned over."""
    found = loop(pitch_mm=0.04)
    assert max(found[f"{branch}_error"] for branch in ("loading", "unloading", "reloading")) < 0.02
    assert found["closed_loop_error"] < 0.01
    assert found["least_work_share"] >= -1e-9  # friction dissipates in each step


# Presses in motion


@pytest.fixture(scope="module")
def press():
    def solve(name, elastomer=COVER, pitch=0.5, force=4.0, x=0.0, y=0.0, yaw=0.0):
        shape = catalogue.load(name)
        return solve_contact(shape, PressCommand(name, x, y, yaw, force), elastomer, pitch)

    return solve


def test_no_motion_is_the_press(press):
    contact = press("hemisphere-4", GEL, 0.25)
    still = advance(contact, 0.0, 0.0, 0.0, 4.0, Friction(0.8))
    assert still.settled and not still.shear_kpa.any() and still.slip_share == 0.0
    assert np.array_equal(still.pressure_kpa, contact.pressure_kpa)
    assert np.array_equal(still.surface_mm, contact.surface_mm)


def test_sliding_ends_at_the_limit_of_friction(press):
    friction, force = 0.6, 4.0
    contact = press("square-2", GEL, 0.25, force)
    forces = []
    for _ in range(10):
        contact = advance(contact, 0.2, 0.0, 0.0, force, Friction(friction))
        assert contact.settled
        forces.append(contact.shear_n[0])
        limit = friction * contact.pressure_kpa
        assert (np.hypot(*contact.shear_kpa) <= limit * (1 + 1e-6)).all()
        assert contact.force_n == pytest.approx(force, rel=1e-4)
    assert np.all(np.diff(forces) > -1e-3 * force) and forces[0] < 0.5 * friction * force
    assert forces[-1] == pytest.approx(friction * force, rel=2e-3)
    assert contact.slip_share == 1.0
    assert contact.motion is not None
    assert contact.motion.slip_mm[contact.pressure_kpa > 0].min() > 0


def test_a_quarter_turn_turns_all_fields(press):
    one = advance(press("line-sharp-2", yaw=0.3), 0.3, 0.0, 0.1, 4.0, Friction(0.8))
    other = advance(press("line-sharp-2", yaw=0.3 + np.pi / 2), 0.0, 0.3, 0.1, 4.0, Friction(0.8))
    half = one.x_mm.size // 2
    rows = one.y_mm.size // 2

    def middle(field):
        return field[..., rows - half : rows + half, :]

    def turned(field):  # x to y, clockwise in the image
        return np.rot90(middle(field), k=-1, axes=(-2, -1))

    scale = float(one.shear_kpa.max())
    assert middle(other.pressure_kpa) == pytest.approx(
        turned(one.pressure_kpa), abs=0.02 * float(one.pressure_kpa.max())
    )
    assert middle(other.shear_kpa[1]) == pytest.approx(turned(one.shear_kpa[0]), abs=0.03 * scale)
    assert middle(other.shear_kpa[0]) == pytest.approx(-turned(one.shear_kpa[1]), abs=0.03 * scale)
    assert other.torque_nmm == pytest.approx(one.torque_nmm, rel=0.02)


def test_shear_raises_the_stress_in_front():
    twin = t2twin.Twin(imperfections="none")
    touch = twin.press("hemisphere-4", force_n=4.0)
    layout = twin.layout
    slid = twin.slide(touch, dy_mm=1.0, steps=1)[0]
    stress = pad_pressure_mpa(slid.cyskin, layout)
    still = pad_pressure_mpa(replace(slid.cyskin, motion=None), layout)
    ahead = (np.abs(layout.x_mm) < 6) & (layout.y_mm > 4) & (layout.y_mm < 9)
    behind = (np.abs(layout.x_mm) < 6) & (layout.y_mm < -2) & (layout.y_mm > -9)
    assert (stress - still)[ahead].max() > 0 > (stress - still)[behind].min()


# The twin


def test_slides_do_not_depend_on_the_number_of_steps():
    twin = t2twin.Twin()
    touch = twin.press("hemisphere-4", force_n=4.0)
    few, many = (twin.slide(touch, dx_mm=1.2, dyaw_deg=4.0, steps=steps) for steps in (2, 6))
    assert len(few) == 2 and len(many) == 6
    for a, b in ((few[0], many[2]), (few[1], many[5])):
        assert a.command.x_mm == pytest.approx(b.command.x_mm)
        for sensor in touch.contacts:
            one, other = a.contacts[sensor], b.contacts[sensor]
            assert one.shear_n == pytest.approx(other.shear_n, abs=0.01 * 4.0)
    assert few[1].image.shape == (320, 240, 3) and few[1].counts.shape == (20,)
    assert touch.digit.motion is None  # the given touch does not change


@pytest.mark.parametrize(
    "arguments, sentence",
    [
        ({"dx_mm": np.nan}, "dx_mm is nan"),
        ({"dyaw_deg": 1e3}, "dyaw_deg is 1000"),
        ({"steps": 0}, "steps is 0"),
        ({"friction": -0.1}, "friction is -0.1"),
        ({"force_n": 0.0}, "a force of 0 N cannot be pressed"),
        ({"dx_mm": 40.0}, "does not lie over the"),
        ({"force_n": 2.0}, "nothing changes; give dx_mm"),
    ],
)
def test_a_wrong_slide_is_refused(arguments, sentence):
    twin = t2twin.Twin()
    touch = twin.press("square-2", force_n=2.0)
    with pytest.raises(T2TwinError, match=sentence):
        twin.slide(touch, **{"steps": 1, **arguments})


def test_friction_does_not_increase_beyond_full_contact():
    pressures = np.array([[0.5, 4.0, 8.0]]) * COVER.young_mpa
    for elastomer, most in ((COVER, 4.0), (replace(COVER, law="linear"), 8.0)):
        expected = 0.7 * COVER.young_mpa * np.array([[0.5, 4.0, most]])
        assert Friction(0.7).limit_mpa(pressures, elastomer) == pytest.approx(expected)


@pytest.mark.parametrize("excess_mm", [-0.5, 0.3])
def test_a_dome_responds_as_a_layer_of_its_thickness(excess_mm):
    rng, shape = np.random.default_rng(0), (24, 20)
    y, x = ((np.arange(n) - (n - 1) / 2) * 0.25 for n in shape)
    found = domed_layer(GEL, x, y, np.ones(shape))
    middle, slope, thickness = found.middle, found.slope, 4.0
    assert middle is cached_shear_layer(GEL, thickness, 0.25, shape) and slope is not None
    dome = DomedLayer(middle, slope, np.full(shape, excess_mm))
    thicker = cached_shear_layer(GEL, thickness + excess_mm, 0.25, shape)
    expected = DomedLayer(thicker, None, np.zeros(shape))
    traction, pressure = rng.uniform(size=(2, *shape)), rng.uniform(size=shape)
    for one, other in (
        (dome.response_mm(traction), expected.response_mm(traction)),
        (dome.spread_mm(pressure), expected.spread_mm(pressure)),
    ):
        assert np.abs(one - other).max() < 0.015 * np.abs(other).max()
    flat, added = dome.parts_mm(traction)
    assert np.array_equal(flat + added, dome.response_mm(traction))


def test_the_image_shows_each_point_where_it_has_moved():
    contact = solve_contact(
        catalogue.load("hemisphere-4"), PressCommand("", 0.0, 0.0, 0.0, 4.0), GEL, 0.25
    )
    contact = advance(contact, 0.2, 0.1, 0.0, 4.0, Friction(0.8))
    x, y = contact.x_mm.copy(), contact.y_mm.copy()
    still = replace(contact, motion=None)
    moved, rest = surface_on(contact, x, y), surface_on(still, x, y)
    at_rest = SurfaceShift(x, y, np.stack([rest, rest]))
    at_motion = SurfaceShift(x, y, np.stack([moved, moved]))
    u, v, into = contact.sheared_mm
    for i, j in ((50, 36), (46, 40), (54, 30), (20, 20)):
        place = np.array([x[j] + u[i, j]]), np.array([y[i] + v[i, j]])
        own = np.array([x[j]]), np.array([y[i]])
        expected = at_rest.on(*own)[0, 0, 0] + into[i, j]
        assert at_motion.on(*place)[0, 0, 0] == pytest.approx(expected, abs=0.01)


@pytest.mark.parametrize("direction", [(1.0, 0.0), (0.0, 1.0), (0.6, 0.6), (0.6, -0.6)])
def test_a_folded_surface_keeps_its_order(direction):
    """The mean displacement remains, and a uniform shortening becomes the largest allowed one,
    along x, along y and along both diagonals."""
    pitch = 0.25
    y, x = pitch * (np.mgrid[:11, :11] - 5)
    along_x, along_y = direction
    along = along_x * x + along_y * y
    folded = -3.0 * np.stack([along_x * along, along_y * along])
    allowed = 0.33 * MAX_SHORTENING * folded
    assert np.array_equal(unfolded(allowed, pitch), allowed)
    found = unfolded(folded, pitch)
    assert found.mean(axis=(1, 2)) == pytest.approx(folded.mean(axis=(1, 2)), abs=1e-9)
    for line in (found[0], found[1].T, *diagonals(found)):
        places = np.diff(line, axis=-1) if line.ndim == 2 else np.diff(line)
        assert places.min() >= -MAX_SHORTENING * pitch - 1e-9


def diagonals(moved):
    """Displacement along the middle diagonals, in cells of a row and a column."""
    down, up = (np.diagonal(each, axis1=1, axis2=2) for each in (moved, moved[:, :, ::-1]))
    return (down[0] + down[1]) / 2, (up[1] - up[0]) / 2


def test_a_tip_settles_between_two_sets_of_cells():
    """A smallest displacement adds two cells to the two that it loads, and takes them away."""
    shape = catalogue.load("random-4322000000063")
    start = PressCommand(shape.name, 0.6804239, -1.4767772, 4.4165892, 1.2738230)
    contact = solve_contact(shape, start, COVER, 0.5)
    for _ in range(6):
        contact = replace(contact, settled=True)  # else each step has the state of those before
        contact = advance(
            contact, 0.08064944, 0.16800086, -0.00170563, 1.2738230, Friction(1.2796767)
        )
        assert contact.settled or contact.smaller_than_grid
        assert contact.equilibrium.converged


def test_a_far_sheared_surface_is_named(press):
    far = press("hemisphere-4", Elastomer("thin", 0.5, 0.1, 0.47, 20.0, 20.0), 0.25, 4.0)
    for _ in range(6):
        far = advance(far, -0.1, 0.1, -0.03, 4.0, Friction(3.0))
    assert FAR_SHEARED in contact_notes(far)
    assert far.settled or far.smaller_than_grid
    assert not advance(replace(far, settled=False), -0.1, 0.1, 0.0, 4.0, Friction(3.0)).settled
    ordinary = advance(press("hemisphere-4", GEL, 0.25, 4.0), 0.1, 0.0, 0.0, 4.0, Friction(0.5))
    assert contact_notes(ordinary) == []
