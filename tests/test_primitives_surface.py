"""Height maps: against analytic heights, and under the symmetries of their shapes."""

import numpy as np
import pytest
import trimesh

from t2twin.primitives_cad import catalogue, height_map
from t2twin.primitives_cad.shape import NOTHING_MM

CHORDAL_MM = 0.01


def grid(heights):
    return np.meshgrid(heights.x_mm, heights.y_mm)


@pytest.mark.parametrize(
    ("name", "radius", "height"), [("hemisphere-2", 4.0, 4.0), ("bump-4", 6.0, 2.0)]
)
def test_caps_have_their_sphere_s_heights(name, radius, height, shapes):
    heights = shapes(name).surface
    x, y = grid(heights)
    inside = np.hypot(x, y) < catalogue.cap_radius_mm(height, radius) - 0.1
    expected = np.sqrt(radius**2 - x[inside] ** 2 - y[inside] ** 2) - radius
    # Near a hemisphere's rim the surface is steep: a chord's error there is taken along it.
    steep = radius / np.sqrt(radius**2 - x[inside] ** 2 - y[inside] ** 2)
    assert (np.abs(heights.heights_mm[inside] - expected) / steep).max() < CHORDAL_MM


def test_square_ends_where_its_side_does(shapes):
    shape = shapes("square-2")
    x, y = grid(shape.surface)
    half = catalogue.parameters("square-2")["side"] / 2.0
    on_top = np.maximum(np.abs(x), np.abs(y)) <= half + 1e-9
    on_plate = ~on_top & (np.maximum(np.abs(x), np.abs(y)) <= catalogue.PLATE_SIDE_MM / 2.0 + 1e-9)
    heights = shape.surface.heights_mm
    assert (heights[on_top] == 0.0).all()
    assert (heights[on_plate] == shape.base_mm).all()
    assert (heights[~on_top & ~on_plate] == NOTHING_MM).all()


@pytest.mark.parametrize("name", catalogue.PRIMITIVES)
def test_maps_of_symmetric_shapes_are_symmetric_and_rimmed(name, shapes):
    heights = shapes(name).surface.heights_mm
    assert heights.max() == 0.0
    np.testing.assert_array_equal(heights, heights[::-1])
    np.testing.assert_array_equal(heights, heights[:, ::-1])
    rim = np.concatenate([heights[0], heights[-1], heights[:, 0], heights[:, -1]])
    assert (rim == NOTHING_MM).all()


def test_quarter_turn_of_the_mesh_turns_the_map(shapes):
    mesh = shapes("line-smooth-2").mesh.copy()
    mesh.apply_translation((1.3, -0.7, 0.0))  # so that no symmetry hides a wrong turn
    turned = mesh.copy()
    turned.vertices = mesh.vertices[:, [1, 0, 2]] * (-1.0, 1.0, 1.0)
    before, after = height_map.aligned(mesh)[1], height_map.aligned(turned)[1]
    # x' = -y, y' = x: rows of the new map are columns of the old one.
    np.testing.assert_allclose(after.heights_mm, before.heights_mm.T[:, ::-1], atol=1e-6)
    assert not np.array_equal(after.heights_mm, before.heights_mm)


def test_only_what_is_within_reach_counts():
    low = trimesh.creation.box((4.0, 4.0, 2.0))
    tower = trimesh.creation.box((4.0, 4.0, 20.0))
    tower.apply_translation((50.0, 0.0, 0.0))
    both = trimesh.util.concatenate([low, tower])
    assert isinstance(both, trimesh.Trimesh)
    lowered, heights = height_map.aligned(both)
    assert np.abs(heights.x_mm).max() < height_map.REACH_MM + 2 * heights.pitch_mm
    assert heights.sample(np.zeros(1), np.zeros(1))[0] == 0.0
    assert lowered.bounds[1, 2] == pytest.approx(9.0)


def test_large_maps_take_a_coarser_pitch():
    plate = trimesh.creation.box((400.0, 300.0, 2.0))
    heights = height_map.aligned(plate)[1]
    assert heights.pitch_mm == pytest.approx(0.1)
    assert heights.heights_mm.size <= height_map.MAX_CELLS
    assert height_map.aligned(plate, pitch_mm=0.5)[1].pitch_mm == pytest.approx(0.5)
