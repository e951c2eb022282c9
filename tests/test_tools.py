"""The five tools: one closed solid each, and keypoints that a sensor can reach."""

from functools import cache

import numpy as np
import pytest
import trimesh

from t2twin.primitives_cad import catalogue, tools

NEAR_MM = 12.0
"""Within this distance of the press axis the keypoint is among the highest places, mm."""

LEDGE_MM = 0.6
"""How far below the highest place near it a keypoint may lie, mm."""

PROMISED_MM = 0.01
"""Promised distance of a mesh from its solid, mm."""


QUICK = ("allen-key", "wrench")
"""Tools whose solids are quick to make; the others are exhaustive."""

SOLIDS = [
    pytest.param(tool, marks=() if tool in QUICK else pytest.mark.exhaustive)
    for tool in catalogue.TOOLS
]


@pytest.fixture(scope="module")
def solids():
    return cache(tools.solid)


def distance_mm(mesh: trimesh.Trimesh, point: np.ndarray) -> tuple[float, np.ndarray]:
    """From a point to a mesh, mm, and the nearest triangle's normal."""
    corners = mesh.triangles
    near = (corners.min(axis=1) <= point + 1.0).all(axis=1)
    near &= (corners.max(axis=1) >= point - 1.0).all(axis=1)
    chosen = np.flatnonzero(near)
    closest = trimesh.triangles.closest_point(corners[chosen], np.tile(point, (len(chosen), 1)))
    distances = np.linalg.norm(closest - point, axis=1)
    return float(distances.min()), mesh.face_normals[chosen[distances.argmin()]]


@pytest.mark.parametrize("tool", SOLIDS)
def test_each_tool_is_one_closed_solid(tool, solids):
    solid = solids(tool)
    assert solid.isValid()
    assert len(solid.Solids()) == 1
    mesh = catalogue.tool_mesh(tool)
    assert mesh.is_watertight
    assert mesh.body_count == 1
    assert mesh.volume == pytest.approx(solid.Volume(), rel=2e-3)
    assert 90.0 < mesh.extents.max() < 200.0


@pytest.mark.parametrize("tool", SOLIDS)
def test_chordal_error_of_tools(tool, solids):
    import cadquery as cq
    from OCP.BRepExtrema import BRepExtrema_DistShapeShape  # pyright: ignore[reportAttributeAccessIssue]

    shell = cq.Compound.makeCompound(solids(tool).Faces()).wrapped
    mesh = catalogue.tool_mesh(tool)
    chosen = np.random.default_rng(0).choice(len(mesh.faces), 120)
    for point in mesh.triangles_center[chosen]:
        vertex = cq.Vertex.makeVertex(*point).wrapped
        assert BRepExtrema_DistShapeShape(shell, vertex).Value() < PROMISED_MM


def test_tools_have_the_catalogue_s_keypoints():
    for tool in catalogue.TOOLS:
        assert tuple(tools.KEYPOINTS[tool]) == catalogue.KEYPOINTS[tool]
        places = np.array([point_mm for point_mm, _ in tools.KEYPOINTS[tool].values()])
        apart = np.linalg.norm(places[:, None] - places[None], axis=-1) + 100.0 * np.eye(4)
        assert apart.min() > 5.0


@pytest.mark.parametrize("name", catalogue.OBJECTS)
def test_keypoint_lies_on_the_tool_and_faces_outwards(name):
    tool, _, at = name.partition("/")
    point_mm, direction = tools.KEYPOINTS[tool][at]
    assert np.linalg.norm(direction) == pytest.approx(1.0, abs=1e-4)
    apart, normal = distance_mm(catalogue.tool_mesh(tool), np.array(point_mm))
    assert apart < PROMISED_MM
    # A corner's triangles stand up to 60 degrees off the direction between them.
    assert normal @ direction > 0.5


@pytest.mark.parametrize("name", catalogue.OBJECTS)
def test_a_sensor_reaches_the_keypoint(name):
    shape = catalogue.load(name)
    assert shape.spacing_mm == (1.5, 1.5)
    assert shape.mesh.is_watertight
    heights = shape.surface
    assert heights.heights_mm.max() == 0.0
    x, y = np.meshgrid(heights.x_mm, heights.y_mm)
    at_axis = heights.sample(np.zeros(1), np.zeros(1))[0]
    near = heights.heights_mm[np.hypot(x, y) <= NEAR_MM]
    assert near.max() - at_axis < LEDGE_MM
    assert near.min() < at_axis - LEDGE_MM  # there is an edge or a slope to feel
