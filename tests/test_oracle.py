"""Closed forms of the engine, against waves that are integrated through the thickness."""

import numpy as np
import pytest

from benchmarks.contact.oracle import Waves
from t2twin.sim.contact.closed_forms import spectra

E, NU = 0.5, 0.47


def test_waves_integrated_through_the_thickness_meet_the_engine_s_closed_form():
    wavenumbers = np.geomspace(1e-3, 20.0, 60)
    waves = Waves(2.5, E, NU)
    closed = spectra(wavenumbers, 2.5, E, NU)
    assert waves.compliance(wavenumbers) == pytest.approx(closed.normal, rel=1e-5)
    assert waves.base_stress(wavenumbers) == pytest.approx(closed.base_pressure, abs=1e-4)
