from dataclasses import replace

import numpy as np
import pytest
from kinds import taxel_array
from msgspec import structs

from benchmarks.contact.solids import punch
from t2twin.core.errors import T2TwinError
from t2twin.primitives_cad.shape import ball
from t2twin.sim.contact.types import PressCommand
from t2twin.sim.taxels import pads, reading
from t2twin.sim.taxels.layout import Layout, load_layout
from t2twin.sim.taxels.spec import Imperfections


@pytest.fixture(scope="module")
def sensor():
    return taxel_array()


def imperfect(array, noiseless, rng):
    return reading.read_after(None, noiseless, array.layout, array.flaws, array.spec.counts, rng)[0]


def dense(pitch):
    x, y = np.meshgrid(np.arange(-12, 12.1, pitch), np.arange(-20, 20.1, pitch))
    # A round pad as large as its square tile.
    side = np.full(x.size, 2 * pitch / np.sqrt(np.pi))
    return Layout("dense", x.ravel(), y.ravel(), side)


def test_pads_that_tile_the_cover_feel_the_whole_force(sensor):
    layout = dense(1.0)
    contact = sensor.press(ball(5.0), PressCommand("ball", 1.0, 2.0, 0.0, 8.0))
    pressure = pads.pad_pressure_mpa(contact, layout)
    assert pressure.sum() * 1.0**2 == pytest.approx(8.0, rel=0.01)


def test_counts_rise_with_force_and_flatten_at_saturation(sensor):
    pressure = np.linspace(0.0, 5.0, 200)
    read = np.rint(sensor.counts_of(pressure)).astype(int)
    assert read[0] == 0 and read[-1] == read.max() == sensor.full_scale
    assert (np.diff(read[read < sensor.full_scale]) > 0).all()


def test_untouched_readings_scatter_as_the_real_ones_do(sensor):
    array, rng = sensor.with_options({"imperfections": "baseline"}), np.random.default_rng(0)
    # Around an offset, so that readings below the baseline are seen too.
    offset = 5000.0
    samples = np.array([imperfect(array, np.full(20, offset), rng) for _ in range(2000)])
    away = np.abs(samples.astype(float) - offset).ravel()
    assert np.percentile(away, 95) == pytest.approx(600, rel=0.15)
    assert np.percentile(away, 50) < 7


def test_every_imperfection_does_what_it_says(sensor):
    layout, true = load_layout(), np.full(20, 10_000.0)

    def read(rng=0, **flaws):
        own, counts = Imperfections(**flaws), sensor.spec.counts
        found = reading.read_after(None, true, layout, own, counts, np.random.default_rng(rng))
        return found[0].astype(float)

    assert (read() == true).all()
    assert read(dead=(3,))[3] == 0 and (np.delete(read(dead=(3,)), 3) == 10_000).all()
    assert (read(crosstalk=0.01) > true).all()
    in_line = 1e-3 * (read(line_crosstalk=0.1) - true)  # of 4 others in its row
    np.testing.assert_allclose(in_line.min(), 4, atol=1e-3)
    assert (read(hysteresis=0.1) >= 9_000).all() and (read(hysteresis=0.1) < true).all()
    assert read(gain_spread=0.1).std() == pytest.approx(1000, rel=0.5)
    assert (read(0, gain_spread=0.1) == read(1, gain_spread=0.1)).all()
    assert 0 < read(white_counts=50.0).std() < 50


def test_a_touch_that_no_taxel_counts_is_noted(sensor):
    weak = structs.replace(sensor.spec, counts=structs.replace(sensor.spec.counts, gain=1e-3))
    contact = sensor.press(ball(5.0), PressCommand("ball", 0.0, 0.0, 0.0, 8.0))
    notes = [each.read(contact).notes for each in (sensor, replace(sensor, spec=weak))]
    assert notes[0] == [] and "no taxel reaches a count" in notes[1][0]


def test_taxels_outside_the_cover_are_an_error(sensor):
    far = Layout("far", np.array([0.0, 5.0, 40.0]), np.zeros(3), np.full(3, 4.0))
    contact = sensor.press(ball(5.0), PressCommand("ball", 0.0, 0.0, 0.0, 8.0))
    with pytest.raises(T2TwinError, match="off the cover"):
        pads.pad_pressure_mpa(contact, far)


def test_a_force_within_a_cell_acts_at_its_center_of_pressure(sensor):
    """A thin punch gives the same counts wherever its center lies in a cell of the grid, if the
    layout moves with it."""
    layout, found = sensor.layout, []
    for off_mm in (0.0, 0.1, 0.2, 0.25):
        moved = replace(layout, x_mm=layout.x_mm + off_mm, y_mm=layout.y_mm + 0.5 * off_mm)
        command = PressCommand("punch", off_mm, 0.5 * off_mm, 0.0, 2.0)
        contact = sensor.press(punch(0.5), command)
        pressure, places = contact.pressure_kpa, (contact.x_mm, contact.y_mm[:, None])
        moment = contact.moments_kpa_mm.sum(axis=(1, 2)) + [(pressure * at).sum() for at in places]
        assert moment / pressure.sum() == pytest.approx([off_mm, 0.5 * off_mm], abs=0.02)
        found.append(pads.pad_pressure_mpa(contact, moved))
    assert np.abs(np.array(found) - found[0]).max() < 0.02 * found[0].max()
