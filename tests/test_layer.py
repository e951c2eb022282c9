import numpy as np
import pytest
from kinds import GEL

from t2twin.sim.contact.elastomer import Elastomer
from t2twin.sim.contact.layer import Layer

H, E, NU = 2.5, 0.3, 0.47


def test_a_wide_pressure_sinks_by_the_confined_modulus():
    flat = Elastomer("flat", H, E, NU, width_mm=80, length_mm=80, law="linear")
    ground = Layer(flat, 1.0)
    sunk = ground.deflection_mm(np.full((ground.rows, ground.columns), 0.01))
    confined = H * (1 - 2 * NU) * (1 + NU) / ((1 - NU) * E)
    assert sunk[ground.rows // 2, ground.columns // 2] == pytest.approx(0.01 * confined, rel=5e-3)


def test_a_window_gives_the_same_as_the_whole():
    ground = Layer(GEL, 0.5)
    pressure = np.zeros((ground.rows, ground.columns))
    window = (slice(10, 26), slice(8, 24))
    pressure[14:20, 12:18] = np.random.default_rng(0).random((6, 6))
    part = ground.deflection_mm(pressure[window], window)
    assert part == pytest.approx(ground.deflection_mm(pressure)[window], abs=1e-5)
