"""Tools in a user's recipe are found; what is none is not taken for one."""

from typing import Literal

import numpy as np
import pytest
import trimesh

from t2twin.core.errors import T2TwinError
from t2twin.primitives_cad import catalogue
from t2twin.sim.dataset.generate import check_held_out, invariants, tool_in
from t2twin.sim.sampling.recipe import Part, Place, Recipe


@pytest.fixture(scope="module")
def tools():
    return {tool: catalogue.tool_mesh(tool) for tool in catalogue.TOOLS}


@pytest.fixture
def recipe(tmp_path, shape_cache):
    """Checks a recipe of one folder, which has these meshes."""

    def check(split: Literal["train", "test"] = "train", val_share=0.0, **meshes):
        folder = tmp_path / "solids"
        folder.mkdir()
        for name, mesh in meshes.items():
            mesh.export(folder / f"{name}.stl")
        part = Part(str(folder), split=split, presses=1, place=Place(1.0), val_share=val_share)
        check_held_out(Recipe("own", (part,)), shape_cache)

    return check


def turned(mesh, seed, scale=1.0):
    other = mesh.copy()
    rng = np.random.default_rng(seed)
    other.apply_transform(trimesh.transformations.random_rotation_matrix(rng.random(3)))
    other.apply_translation(rng.normal(0.0, 50.0, 3))
    other.apply_scale(scale)
    return other


def test_a_box_has_the_numbers_of_a_box():
    sides = np.array((2.0, 3.0, 6.0))
    found = invariants(turned(trimesh.creation.box(sides), 0, 3.0))
    second = np.sort(sides**2) / 12.0 * sides.prod() ** (1.0 - 5 / 3)
    np.testing.assert_allclose(found, [[72.0**1.5 / 36.0, *second]])


QUICK = ("allen-key", "wrench")


@pytest.mark.parametrize(
    "name",
    [
        pytest.param(name, marks=() if name in QUICK else pytest.mark.exhaustive)
        for name in catalogue.TOOLS
    ],
)
def test_a_tool_is_found_however_it_lies(tools, name):
    mesh = tools[name]
    assert tool_in(mesh) == name
    assert tool_in(turned(mesh, 1, 0.7)) == name
    mirrored = mesh.copy()
    mirrored.apply_transform(np.diag((-1.0, 1.0, 1.0, 1.0)))
    assert tool_in(mirrored) == name


@pytest.mark.exhaustive
def test_a_tool_of_coarser_triangles_is_found(tools):
    from t2twin.primitives_cad import mesh_files
    from t2twin.primitives_cad.tools import solid

    coarse = mesh_files.watertight(*mesh_files.triangles_of(solid("wrench"), 0.05))
    assert len(coarse.faces) < len(tools["wrench"].faces) / 3
    assert tool_in(coarse) == "wrench"


@pytest.mark.exhaustive
def test_no_primitive_is_taken_for_a_tool(shapes):
    for name in catalogue.PRIMITIVES:
        assert tool_in(shapes(name).mesh) is None, name


def test_a_tool_among_other_solids_is_refused(recipe, tools):
    """In a file of its own, and beside another body."""
    block = trimesh.creation.box((9.0, 8.0, 7.0), transform=np.eye(4) + np.eye(4, k=3) * 80.0)
    both = trimesh.util.concatenate([block, turned(tools["allen-key"], 3)])
    with pytest.raises(T2TwinError, match=r"b\.stl is the tool allen-key"):
        recipe(a=block, b=both)


def test_only_a_part_that_is_for_the_test_alone_may_have_tools(recipe, tools, tmp_path):
    recipe("test", 0.0, tool=tools["allen-key"])
    (tmp_path / "solids/tool.stl").unlink()
    (tmp_path / "solids").rmdir()
    with pytest.raises(T2TwinError, match="is the tool allen-key"):
        recipe("test", 0.5, tool=tools["allen-key"])
