import pickle

import numpy as np
import pytest

from t2twin.core.errors import T2TwinError
from t2twin.primitives_cad import catalogue, height_map, random_shapes
from t2twin.primitives_cad.random_shapes import (
    BASE_DEPTH_MM,
    PITCH_MM,
    Feature,
    heights_mm,
    random_shape,
    sample,
)
from t2twin.primitives_cad.shape import NOTHING_MM, seed_of

AXIS = np.arange(-200, 201) * 0.1


def heights_of(*parts, cuts=(), holes=(), tilt=(0.0, 0.0)):
    return heights_mm((parts, cuts, holes, tilt), AXIS, AXIS)


def area_mm2(heights):
    return float((heights > NOTHING_MM / 2).sum() * 0.1**2)


def test_a_seed_is_a_shape():
    first, again, other = random_shape(17), catalogue.load("random-17"), random_shape(18)
    np.testing.assert_array_equal(first.surface.heights_mm, again.surface.heights_mm)
    assert first.name == again.name == pickle.loads(pickle.dumps(first)).name == "random-17"
    assert not np.array_equal(first.surface.heights_mm, other.surface.heights_mm)


def test_surfaces_are_as_the_frame_has_them():
    for seed in range(30):
        composition, surface = sample(seed)
        heights = surface.heights_mm
        inside = heights[1:-1, 1:-1]
        assert inside.max() == 0.0 and inside.min() >= -BASE_DEPTH_MM
        assert (heights[[0, -1]] == NOTHING_MM).all() and (heights[:, [0, -1]] == NOTHING_MM).all()
        assert surface.pitch_mm == pytest.approx(PITCH_MM)
        # random-27, for example, once had a hole that left nothing
        assert heights_mm(composition, AXIS, AXIS).max() > NOTHING_MM / 2


@pytest.mark.parametrize(
    "seed", [3, *(pytest.param(seed, marks=pytest.mark.exhaustive) for seed in (14, 25))]
)
def test_the_solid_presses_with_the_surface(seed):
    shape = random_shape(seed)
    assert shape.base_mm == -BASE_DEPTH_MM
    assert shape.mesh.is_watertight and shape.mesh.is_winding_consistent and shape.mesh.volume > 0
    seen = height_map.aligned(shape.mesh, PITCH_MM)[1]
    x, y = np.meshgrid(shape.surface.x_mm[1:-1], shape.surface.y_mm[1:-1])
    np.testing.assert_allclose(seen.sample(x, y), shape.surface.heights_mm[1:-1, 1:-1], atol=2e-3)


def test_outlines_have_their_areas():
    square = tuple((k * np.pi / 2, 4.0) for k in range(4))
    for feature, area in (
        (Feature("bar", "flat", 0, 0, 0.4, 1.5, half_length_mm=6.0), 36.0),
        (Feature("disc", "flat", 1, 2, 0, 5.0), np.pi * 25),
        (Feature("ring", "flat", 0, 0, 0, 0.5, radius_mm=6.0), np.pi * (6.5**2 - 5.5**2)),
        (Feature("polygon", "flat", 0, 0, 0.3, 4.0, sides=square), 64.0),
        (Feature("polygon", "flat", 0, 0, 0.3, 4.0, sides=square, wall_mm=1.0), 64.0 - 36.0),
        # bent, a bar's middle line stays as long
        (Feature("bar", "flat", 0, 0, 0, 1.0, half_length_mm=5.0, radius_mm=6.0), 20.0),
    ):
        assert area_mm2(heights_of(feature)) == pytest.approx(area, rel=0.02)


def in_frame_of(feature):
    """The axes' points in a feature's frame."""
    x, y = np.meshgrid(AXIS - feature.x_mm, AXIS - feature.y_mm)
    cos, sin = np.cos(feature.turn_rad), np.sin(feature.turn_rad)
    return cos * x + sin * y, cos * y - sin * x


@pytest.mark.parametrize("turn", [0.0, 0.7, np.pi / 2, -1.2])
@pytest.mark.parametrize("profile", ["flat", "rounded"])
def test_a_half_plane_is_all_that_lies_beyond_its_edge(turn, profile):
    feature = Feature("half-plane", profile, 1.03, -2.04, turn, np.inf, curve=1.5, lower_mm=0.4)
    heights = heights_of(feature, tilt=(0.02, -0.01))
    inner, _ = in_frame_of(feature)
    rest = np.clip(1.5 - inner, 0.0, 1.5)
    fallen = 1.5 - np.sqrt(1.5**2 - rest**2) if profile == "rounded" else 0.0
    wanted = -0.4 - fallen + 0.02 * AXIS[None, :] - 0.01 * AXIS[:, None]
    sure = np.abs(inner) > 1e-9
    np.testing.assert_allclose(
        heights[sure], np.where(inner >= 0.0, wanted, NOTHING_MM)[sure], atol=1e-5
    )


def test_irregular_polygons_keep_their_corners():
    """Also where a side lies so far out that its neighbors meet before it."""
    rng = np.random.default_rng(5)
    for number in (3, 4, 5, 6, 8) * 4:
        apart = 4.0 * np.exp(0.25 * rng.standard_normal(number))
        apart[0] *= rng.choice([1.0, 2.5])
        sides = tuple((2 * np.pi * k / number, float(d)) for k, d in enumerate(apart))
        feature = Feature("polygon", "flat", 0.51, 0.27, 0.9, float(apart.min()), sides=sides)
        u, v = in_frame_of(feature)
        inner = np.min([d - np.cos(a) * u - np.sin(a) * v for a, d in sides], axis=0)
        sure = np.abs(inner) > 1e-9
        there = heights_of(feature) > NOTHING_MM / 2
        np.testing.assert_array_equal(there[sure], (inner > 0)[sure])


def test_profiles_are_what_they_are_called():
    rod = heights_of(Feature("bar", "rod", 0, 0, 0, 3.0, half_length_mm=50.0, curve=5.0))
    across = np.abs(AXIS) < 2.9
    middle = rod[200, across]
    np.testing.assert_allclose(middle, np.sqrt(25.0 - AXIS[across] ** 2) - 5.0, atol=1e-5)
    roof = heights_of(Feature("bar", "wedge", 0, 0, 0, 3.0, half_length_mm=50.0, curve=0.5))
    np.testing.assert_allclose(roof[200, across], -0.5 * np.abs(AXIS[across]), atol=1e-5)
    ball = heights_of(Feature("disc", "rod", 0, 0, 0, 4.0, curve=4.0))
    assert ball[200, 200] == 0.0 and ball[200, 230] == pytest.approx(np.sqrt(16 - 9) - 4, abs=1e-5)
    rounded = heights_of(Feature("bar", "rounded", 0, 0, 0, 3.0, half_length_mm=50.0, curve=1.0))
    assert rounded[200, 200] == 0.0 and rounded[200, 225] == pytest.approx(
        -(1 - np.sqrt(1 - 0.25)), abs=1e-5
    )


def test_cuts_holes_tilt_and_teeth():
    plate = Feature("disc", "flat", 0, 0, 0, 8.0)
    assert area_mm2(heights_of(plate, cuts=((0.3, 0.0),))) == pytest.approx(np.pi * 32, rel=0.02)
    holed = heights_of(plate, holes=((1.0, 1.0, 2.0),))
    assert area_mm2(holed) == pytest.approx(np.pi * 60, rel=0.02)
    tilted = heights_of(plate, tilt=(0.02, -0.01))
    assert tilted[200, 250] == pytest.approx(0.1, abs=1e-6)
    assert tilted[250, 200] == pytest.approx(-0.05, abs=1e-6)
    saw = heights_of(
        Feature("bar", "flat", 0, 0, 0, 2.0, half_length_mm=9.0, teeth="square",
                teeth_pitch_mm=2.0, teeth_depth_mm=0.7)
    )  # fmt: skip
    there = saw[saw > NOTHING_MM / 2]
    assert set(np.round(there, 6)) == {0.0, np.float32(-0.7)}
    assert (there == 0.0).mean() == pytest.approx(0.5, abs=0.02)


def test_what_is_drawn_is_of_every_kind():
    rng = np.random.default_rng(0)
    drawn = [random_shapes.sample_composition(rng) for _ in range(600)]
    parts = [feature for features, *_ in drawn for feature in features]
    assert {each.outline for each in parts} == {"bar", "half-plane", "disc", "ring", "polygon"}
    assert {each.profile for each in parts} == {"flat", "rounded", "rod", "wedge"}
    assert {each.teeth for each in parts} == {"none", "pointed", "square"}
    assert {len(features) for features, *_ in drawn} == {1, 2, 3, 4}
    widths = 2 * np.array([feature.half_width_mm for feature in parts])
    assert widths.min() < 0.6 and widths[np.isfinite(widths)].max() > 30
    assert any(holes for _, _, holes, _ in drawn)
    assert any(feature.radius_mm for feature in parts if feature.outline == "bar")


def test_names_that_are_no_random_shapes():
    assert seed_of("square-1") is None and seed_of("random-5") == 5
    for name in ("random-", "random-x", "random--3", "random-1e3", f"random-{2**63}"):
        with pytest.raises(T2TwinError, match=r"not a random shape.*random-0, random-1"):
            catalogue.load(name)
