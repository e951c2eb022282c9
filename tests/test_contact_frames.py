"""The benchmark of the contact on frames of a real DIGIT: its comparison, and what it needs."""

from argparse import Namespace
from pathlib import Path

import numpy as np
import pytest

from benchmarks.networks import gradients
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


def test_depth_is_learned_from_colors_that_are_its_gradients(monkeypatch):
    """Red and green change with the gradients along y and x; an unseen place is predicted."""
    monkeypatch.setattr(gradients, "STEPS", 300)
    y, x = np.linspace(-8.3, 8.3, 80)[:, None], np.linspace(-6.2, 6.2, 60)
    places = ((-2.0, 0.0), (1.0, 2.0), (0.5, -2.5), (-1.0, -1.0))
    depths = np.stack([np.exp(-((x - a) ** 2 + (y - b) ** 2) / 4.5) for a, b in places])
    slopes = np.moveaxis(np.array(np.gradient(depths, 0.2075, 0.2067, axis=(1, 2))), 0, -1)
    blue = np.zeros((*depths.shape, 1))
    colors = 120.0 + 100.0 * np.concatenate([slopes, blue], axis=-1)
    images = np.rint(colors).astype(np.uint8).repeat(2, axis=1).repeat(2, axis=2)
    background = np.full_like(images[0], 120)
    model = gradients.DepthFromGradients(images[:3], background, depths[:3], (6.2, 8.3))
    found = model.depth_mm(images[3])
    assert np.sqrt(np.square(found - depths[3]).mean()) < 0.03
