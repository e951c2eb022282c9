"""The oracle that the engine is held against, itself held against closed forms."""

import numpy as np
import pytest

from benchmarks.contact.flat_pad import FlatPad
from benchmarks.contact.oracle import Waves, kernel, solve
from benchmarks.contact.solids import block
from t2twin.sim.contact.closed_forms import spectra
from t2twin.sim.contact.elastomer import Elastomer
from t2twin.sim.contact.types import PressCommand
from t2twin.sim.taxels.layout import load_layout

E, NU = 0.5, 0.47
MODULUS = E / (1 - NU**2)
PITCH, CELLS = 0.2, 60


def grid():
    axis = (np.arange(CELLS) - (CELLS - 1) / 2) * PITCH
    return np.hypot(*np.meshgrid(axis, axis))


@pytest.fixture(scope="module")
def thick():
    return kernel(CELLS, CELLS, PITCH, 50.0, E, NU)


@pytest.mark.exhaustive
@pytest.mark.parametrize("force", [0.2, 0.5])
def test_a_ball_is_hertz(thick, force):
    radius = 6.0
    answer = solve(grid() ** 2 / (2 * radius), force, PITCH, thick)
    contact = (3 * force * radius / (4 * MODULUS)) ** (1 / 3)
    assert answer.depth_mm == pytest.approx(contact**2 / radius, rel=0.05)
    assert answer.pressure_mpa.max() == pytest.approx(1.5 * force / np.pi / contact**2, rel=0.05)
    area = np.count_nonzero(answer.pressure_mpa) * PITCH**2
    assert np.sqrt(area / np.pi) == pytest.approx(contact, rel=0.08)
    assert answer.pressure_mpa.sum() * PITCH**2 == pytest.approx(force)


@pytest.mark.exhaustive
def test_a_flat_punch_is_boussinesq(thick):
    radius, force = 2.0, 1.0
    answer = solve(np.where(grid() <= radius, 0.0, 10.0), force, PITCH, thick)
    assert answer.depth_mm == pytest.approx(force / (2 * radius * MODULUS), rel=0.05)
    # Half the mean pressure over sqrt(1 - (r / a)^2), where the edge is far.
    inner = grid() < radius / 3
    expected = force / (2 * np.pi * radius * np.sqrt(radius**2 - grid()[inner] ** 2))
    assert answer.pressure_mpa[inner] == pytest.approx(expected, rel=0.05)


def test_a_shape_longer_than_the_pad_is_cut_at_its_rim():
    layer = Elastomer("layer", 4.0, E, NU, width_mm=8.0, length_mm=10.0, law="linear")
    pad = FlatPad(layer, 8.0, 10.0, PITCH)
    command = PressCommand("block", 0.0, 0.0, 0.0, 2.0)
    longer, cut = (pad.press(block(4.0, length), command) for length in (26.0, 10.0))
    assert longer.pressure_mpa.shape == (50, 40)
    assert longer.depth_mm == pytest.approx(cut.depth_mm, rel=1e-6)
    assert longer.pressure_mpa == pytest.approx(cut.pressure_mpa, abs=1e-6)


def test_a_pressure_reaches_the_base_whole():
    layer = Elastomer("layer", 2.5, E, NU, width_mm=28.0, length_mm=46.0, law="linear")
    pad = FlatPad(layer, 28.0, 46.0, 0.5)
    everywhere = np.full((92, 56), 0.01)
    middle = load_layout("cyskin-20")
    pressures = pad.pad_pressure_mpa(everywhere, middle)
    inner = np.hypot(middle.x_mm, middle.y_mm) < 5.0
    assert inner.any()
    assert pressures[inner] == pytest.approx(0.01, rel=0.02)


def test_waves_integrated_through_the_thickness_meet_the_engine_s_closed_form():
    wavenumbers = np.geomspace(1e-3, 20.0, 60)
    waves = Waves(2.5, E, NU)
    closed = spectra(wavenumbers, 2.5, E, NU)
    assert waves.compliance(wavenumbers) == pytest.approx(closed.normal, rel=1e-5)
    assert waves.base_stress(wavenumbers) == pytest.approx(closed.base_pressure, abs=1e-4)
