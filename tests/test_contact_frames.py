"""The benchmark of the contact on frames of a real DIGIT: its comparison, and what it needs."""

from argparse import Namespace
from pathlib import Path

import numpy as np
import pytest

from benchmarks.networks.contact_frames import measure
from benchmarks.networks.gradients import integrated
from t2twin.core.errors import T2TwinError


def test_the_integral_of_a_surfaces_gradients_is_the_surface():
    y, x = np.linspace(-8.3, 8.3, 160), np.linspace(-6.2, 6.2, 120)
    depth_mm = np.exp(-((x - 1.0) ** 2 + (y[:, None] + 2.0) ** 2) / 4.5)
    pitch_mm = (y[1] - y[0], x[1] - x[0])
    down, across = np.gradient(depth_mm, *pitch_mm)
    found = integrated(down, across, pitch_mm)
    np.testing.assert_allclose(found, depth_mm, atol=3e-3)


def test_it_names_the_frames_that_it_needs(tmp_path):
    with pytest.raises(T2TwinError, match=r"has no background\.png; expected a folder"):
        measure(Namespace(frames=tmp_path, runs=[Path("field")]))
