"""A recipe of a user's files: their scale, their place, their names, and what is said of them."""

import pytest
import trimesh

from t2twin.cli import main
from t2twin.core.errors import T2TwinError, T2TwinWarning
from t2twin.sim.dataset.generate import make_dataset
from t2twin.sim.dataset.store import read_split, verify_dataset
from t2twin.sim.sampling.plan import load_shape
from t2twin.sim.sampling.recipe import Part, Place

NEAR = Place(uniform_mm=1.0)


def recipe(path, more="", folder="solids"):
    """A recipe of two presses of each file in a folder beside it."""
    path.write_text(
        'name = "mine"\ndense_counts = false\nbackground_frames = false\n[[parts]]\n'
        f'shapes = "{path.parent / folder}"\npresses = 2\nplace = {{ uniform_mm = 1.0 }}\n{more}'
    )
    return path


@pytest.fixture
def solids(tmp_path):
    folder = tmp_path / "solids"
    folder.mkdir()
    return folder


def test_a_hint_of_scale_names_a_field_of_the_recipe_that_works(
    solids, tmp_path, shape_cache, capfd
):
    trimesh.creation.box((0.12, 0.33, 0.03)).export(solids / "tool.stl")
    path = recipe(tmp_path / "mine.toml")
    with pytest.raises(SystemExit):
        main(["simdata", "--recipe", str(path), "--out", str(tmp_path / "out")])
    said = capfd.readouterr().err
    assert "1000 if it is in meters" in said and not (tmp_path / "out").exists()
    recipe(path, "scale = 1000\n")
    info = make_dataset(tmp_path / "out", recipe=path, workers=1, cache=shape_cache)
    assert info.pairs["train"] == 2 and verify_dataset(tmp_path / "out") == []
    part = Part(shapes=str(solids), presses=2, place=NEAR, scale=1000.0)
    shape = load_shape(part, str(solids / "tool.stl"), shape_cache)
    assert shape.mesh.extents == pytest.approx((120.0, 330.0, 30.0))


def test_files_off_the_middle_are_pressed_with_center(solids, tmp_path, shape_cache):
    trimesh.creation.annulus(r_min=60.0, r_max=66.0, height=5.0).export(solids / "ring.stl")
    path = recipe(tmp_path / "mine.toml")
    with pytest.raises(T2TwinError, match="32 mm of the press axis; the option center presses"):
        make_dataset(tmp_path / "out", recipe=path, workers=1, cache=shape_cache)
    recipe(path, "center = true\n")
    make_dataset(tmp_path / "out", recipe=path, workers=1, cache=shape_cache)
    rows = read_split(tmp_path / "out", "train").to_pylist()
    assert len(rows) == 2 and all(row["source_settled"] for row in rows)


def test_two_files_of_one_name_are_refused(solids, tmp_path):
    trimesh.creation.box((6, 4, 3)).export(solids / "a.stl")
    trimesh.creation.box((5, 5, 5)).export(solids / "a.obj")
    with pytest.raises(T2TwinError, match=r"a\.obj and .*a\.stl would both be the shape 'a'"):
        make_dataset(tmp_path / "out", recipe=recipe(tmp_path / "mine.toml"), workers=1)
    assert not (tmp_path / "out").exists()


def test_a_recipe_says_what_is_open_in_its_files(solids, tmp_path, shape_cache):
    cap = trimesh.creation.icosphere(3, 6.0)
    cap.update_faces(cap.triangles_center[:, 2] > 1.0)
    cap.export(solids / "cap.stl")
    path = recipe(tmp_path / "mine.toml", 'split = "test"\n')
    with pytest.warns(T2TwinWarning, match="its upper surface is pressed") as said:
        make_dataset(tmp_path / "out", recipe=path, workers=1, cache=shape_cache)
    assert ["cap.stl is open at" in str(each.message) for each in said] == [True]
