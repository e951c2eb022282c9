"""Shear of a bonded layer and friction, against closed forms."""

import numpy as np
import pytest

from t2twin.sim.contact.elastomer import CYSKIN_COVER, Elastomer
from t2twin.sim.contact.layer import base_stress, compliance_mm_per_mpa
from t2twin.sim.contact.tangential.kernels import shear_kernels
from t2twin.sim.contact.tangential.spectra import spectra
from t2twin.sim.contact.tangential.traction import ShearLayer, solve_traction

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


def cell_means(function, x, y, pitch_mm, samples=8):
    offsets = (np.arange(samples) - (samples - 1) / 2) / samples * pitch_mm
    return np.mean([function(np.hypot(x + a, y + b)) for a in offsets for b in offsets], axis=0)


def half_ellipsoid(radius_mm):
    return lambda r: np.sqrt(np.maximum(0.0, 1 - (r / radius_mm) ** 2))


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
    assert short.transverse == pytest.approx(1 / (100 * shear))
    assert short.longitudinal == pytest.approx((1 - poisson) / (100 * shear))
    assert short.coupling == pytest.approx(-(1 - 2 * poisson) / (2 * 100 * shear), abs=1e-12)
    assert long.base_pressure == pytest.approx(1.0, rel=1e-5)
    assert abs(long.base_shear) < 1e-3


def test_normal_part_is_that_of_the_normal_press():
    k = np.geomspace(1e-3, 50, 40)
    found = spectra(k, 2.5, 0.1, 0.47)
    assert found.normal == pytest.approx(compliance_mm_per_mpa(k, 2.5, 0.1, 0.47), rel=1e-9)
    assert found.base_pressure == pytest.approx(base_stress(k, 2.5, 0.47), rel=1e-9, abs=1e-30)


def test_kernels_are_the_inverse_transform_of_the_spectra():
    pitch, n, over, period = 0.5, 16, 8, 96
    cover = CYSKIN_COVER
    kernels = shear_kernels(cover, cover.thickness_mm, n, n, pitch)
    k = 2 * np.pi * np.fft.fftfreq(period * over, pitch / over)
    kx, ky = np.meshgrid(k, k)
    radius = np.maximum(np.hypot(kx, ky), 1e-9)
    of_layer = spectra(radius, cover.thickness_mm, cover.young_mpa, cover.poisson)
    cos, sin = kx / radius, ky / radius
    cell = (np.sinc(kx * pitch / 2 / np.pi) * np.sinc(ky * pitch / 2 / np.pi)) ** 2 * over**2
    for name, spectrum in {
        "xx": of_layer.longitudinal * cos**2 + of_layer.transverse * sin**2,
        "xy": (of_layer.longitudinal - of_layer.transverse) * cos * sin,
        "yy": of_layer.longitudinal * sin**2 + of_layer.transverse * cos**2,
        "xz": 1j * of_layer.coupling * cos,
        "yz": 1j * of_layer.coupling * sin,
    }.items():
        values = np.roll(np.fft.ifft2(spectrum * cell).real, (period * over // 2,) * 2, (0, 1))
        middle = slice(period // 2 - n + 1, period // 2 + n)
        expected = values[::over, ::over][middle, middle]
        error = np.abs(getattr(kernels, name) - expected).max()
        assert error < 4e-3 * np.abs(expected).max(), name


# Friction


@pytest.mark.parametrize("poisson", [0.0, 0.47])
@pytest.mark.parametrize("share", [0.3, 0.6, 0.9])
def test_ball_pushed_sideways(poisson, share):
    """Cattaneo 1938 and Mindlin 1949; exact for a Poisson's ratio of 0."""
    pitch, friction, force = 0.025, 0.5, 1.0
    x, y = grid(1.1, pitch)
    peak = 1.5 * force / np.pi
    pressure = peak * cell_means(half_ellipsoid(1.0), x, y, pitch)
    stick = (1 - share) ** (1 / 3)
    shear = shear_modulus(poisson)
    shift = 3 * friction * force * (2 - poisson) / (16 * shear) * (1 - (1 - share) ** (2 / 3))
    layer = ShearLayer(elastomer(poisson), THICK, pitch, x.shape)
    wanted = np.stack([np.full_like(x, shift), np.zeros_like(x)])
    found = solve_traction(layer, friction * pressure, wanted, np.zeros_like(wanted))
    assert found.converged
    assert np.hypot(*found.q_mpa).max() <= friction * pressure.max() * (1 + 1e-6)
    assert (np.hypot(*found.q_mpa) <= friction * pressure * (1 + 1e-6)).all()
    pushed = found.q_mpa[0].sum() * pitch**2
    assert pushed == pytest.approx(share * friction * force, rel=0.01)
    inner = cell_means(half_ellipsoid(stick), x, y, pitch)
    expected = friction * (pressure - peak * stick * inner)
    error = np.linalg.norm(found.q_mpa[0] - expected) / np.linalg.norm(expected)
    assert error < 0.03
    sticks = np.hypot(*found.q_mpa) < friction * pressure * (1 - 1e-3)
    assert np.sqrt(sticks.sum() * pitch**2 / np.pi) == pytest.approx(stick, rel=0.02)


def stuck(layer, covered, wanted):
    return solve_traction(layer, np.where(covered, 1e6, 0.0), wanted, np.zeros_like(wanted)).q_mpa


def test_stuck_punch_on_thick_and_thin_layers():
    """8 G a / (2 - nu) (Mindlin 1949), and simple shear G A / h."""
    poisson, pitch = 0.47, 0.04
    shear = shear_modulus(poisson)
    x, y = grid(1.04, pitch)
    covered = np.hypot(x, y) <= 1.0
    moved = np.stack([np.ones_like(x), np.zeros_like(x)])
    thick = stuck(ShearLayer(elastomer(poisson), THICK, pitch, x.shape), covered, moved)
    assert thick[0].sum() * pitch**2 == pytest.approx(8 * shear / (2 - poisson), rel=0.02)
    thin_mm = 0.1
    thin = stuck(ShearLayer(elastomer(poisson, thin_mm), thin_mm, pitch, x.shape), covered, moved)
    inside = np.hypot(x, y) < 0.5
    assert thin[0][inside] == pytest.approx(shear / thin_mm, rel=0.02)


def test_torsion_of_a_stuck_disc():
    """16 G a^3 / 3 (Reissner and Sagoci 1944)."""
    poisson, pitch = 0.3, 0.04
    x, y = grid(1.04, pitch)
    covered = np.hypot(x, y) <= 1.0
    layer = ShearLayer(elastomer(poisson), THICK, pitch, x.shape)
    q = stuck(layer, covered, np.stack([-y, x]))
    torque = float((x * q[1] - y * q[0]).sum() * pitch**2)
    assert torque == pytest.approx(16 / 3 * shear_modulus(poisson), rel=0.02)
