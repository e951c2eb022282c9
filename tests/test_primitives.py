"""The 32 primitives: solids against closed forms, meshes against the solids they stand for, and
height maps against analytic heights and under the symmetries of their shapes."""

from math import pi

import numpy as np
import pytest
import trimesh

from maintenance.write_bundled import tessellate_symmetric
from t2twin.primitives_cad import catalogue, height_map, solids
from t2twin.primitives_cad.catalogue import FEATURE_HEIGHT_MM, PLATE_SIDE_MM
from t2twin.primitives_cad.shape import NOTHING_MM, PLATE_THICKNESS_MM

PLATE_MM3 = PLATE_SIDE_MM**2 * PLATE_THICKNESS_MM
CHORDAL_MM = 0.01
"""Promised distance of a mesh from its solid, mm."""


def feature_mm3(name: str) -> float:
    """Volume above the plate, by the closed form of each family."""
    sizes = catalogue.parameters(name)
    tall = FEATURE_HEIGHT_MM
    match catalogue.family(name):
        case "line-sharp":
            return sizes["width"] * sizes["length"] * tall
        case "line-smooth":
            # Each rounded edge leaves a quarter of a circle of its square.
            corners = 2.0 * (1.0 - pi / 4.0) * sizes["radius"] ** 2
            return (sizes["width"] * tall - corners) * sizes["length"]
        case "square":
            return sizes["side"] ** 2 * tall
        case "square-empty":
            return (sizes["side"] ** 2 - (sizes["side"] - 2.0 * sizes["edge"]) ** 2) * tall
        case "circle":
            return pi * sizes["radius"] ** 2 * tall
        case "circle-empty":
            inner = sizes["radius"] - sizes["edge"]
            return pi * (sizes["radius"] ** 2 - inner**2) * tall
        case "hemisphere":
            radius = sizes["radius"]
            return pi * radius**2 * (tall - radius) + 2.0 / 3.0 * pi * radius**3
        case "bump":
            height, curvature = sizes["height"], sizes["curvature"]
            rim_squared = 2.0 * curvature * height - height**2
            cap = pi * height**2 * (3.0 * curvature - height) / 3.0
            return pi * rim_squared * (tall - height) + cap
        case other:
            raise AssertionError(other)


def on_triangles(mesh, rng: np.random.Generator, per_triangle: int = 8) -> np.ndarray:
    """Points spread over every triangle of a mesh, its sides' middles among them, (n, 3) mm."""
    weights = rng.dirichlet((1.0, 1.0, 1.0), per_triangle)
    weights = np.concatenate([weights, [[0.5, 0.5, 0], [0, 0.5, 0.5], [0.5, 0, 0.5]]])
    return np.einsum("wk,tkx->twx", weights, mesh.triangles).reshape(-1, 3)


@pytest.mark.parametrize("name", catalogue.PRIMITIVES)
def test_solid_is_valid_and_has_the_volume_of_its_closed_form(name):
    solid = solids.primitive(name)
    assert solid.isValid()
    assert len(solid.Solids()) == 1
    assert solid.Volume() == pytest.approx(PLATE_MM3 + feature_mm3(name), rel=1e-6)


@pytest.mark.parametrize("name", catalogue.PRIMITIVES)
def test_mesh_is_closed_and_stands_in_the_shape_frame(name, shapes):
    shape = shapes(name)
    assert shape.mesh.is_watertight
    assert shape.mesh.is_winding_consistent
    assert shape.mesh.volume == pytest.approx(PLATE_MM3 + feature_mm3(name), rel=2e-3)
    half = PLATE_SIDE_MM / 2.0
    bottom = -FEATURE_HEIGHT_MM - PLATE_THICKNESS_MM
    assert shape.mesh.bounds == pytest.approx(np.array([[-half, -half, bottom], [half, half, 0.0]]))


def test_chordal_error_on_the_largest_curved_primitives():
    rng = np.random.default_rng(0)
    for name in ("hemisphere-4", "bump-2"):
        sizes = catalogue.parameters(name)
        radius = sizes.get("curvature") or sizes["radius"]
        mesh = tessellate_symmetric(solids.primitive(name))
        mesh.update_faces(mesh.triangles[:, :, 2].min(axis=1) >= -sizes.get("height", radius))
        center = np.array([0.0, 0.0, -radius])
        error = np.abs(np.linalg.norm(on_triangles(mesh, rng) - center, axis=1) - radius)
        assert len(mesh.faces) > 100
        assert error.max() < CHORDAL_MM
    radius = catalogue.parameters("circle-4")["radius"]
    points = on_triangles(tessellate_symmetric(solids.primitive("circle-4")), rng)
    wall = points[(points[:, 2] > -FEATURE_HEIGHT_MM + 1e-6) & (points[:, 2] < -1e-6)]
    assert len(wall) > 100
    assert np.abs(np.hypot(wall[:, 0], wall[:, 1]) - radius).max() < CHORDAL_MM


def test_versions_differ_and_validation_lies_inside_its_family():
    for sizes in catalogue.FAMILIES.values():
        for versions in map(list, sizes.values()):
            assert len(versions) == len(set(versions)) == 4
            validation = versions.pop(catalogue.VALIDATION_VERSION - 1)
            assert min(versions) < validation < max(versions)


def test_the_grid_covers_the_feature():
    """From side to side along either axis; on narrow ones beyond."""
    assert catalogue.load("square-2").spacing_mm == (1.4, 1.4)
    assert catalogue.load("line-sharp-1").spacing_mm == pytest.approx((1.0, 6.65), abs=0.05)
    for name in catalogue.PRIMITIVES:
        spacings = catalogue.properties(name)["spacing_mm"]
        for spacing, extent in zip(spacings, catalogue.extents_mm(name), strict=True):
            covered = catalogue.GRID_INTERVALS * spacing
            if spacing > catalogue.MIN_SPACING_MM:
                assert covered == pytest.approx(extent, abs=0.16)
            else:
                assert covered >= extent - 0.16


def test_splits():
    assert len(catalogue.PRIMITIVES) == 32
    assert len(catalogue.OBJECTS) == 20
    by_split = [catalogue.split(name) for name in catalogue.NAMES]
    assert [by_split.count(split) for split in ("train", "val", "test")] == [24, 8, 20]
    assert {catalogue.split(f"{family}-3") for family in catalogue.FAMILIES} == {"val"}


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
