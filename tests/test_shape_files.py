"""Shapes from files and from the cache, what is written out, and what is refused."""

import json

import numpy as np
import pytest
import trimesh

from t2twin.core.errors import T2TwinError
from t2twin.primitives_cad import catalogue, export
from t2twin.primitives_cad import mesh_files as read


def block(path, sides=(6.0, 4.0, 3.0), at=(40.0, -7.0, 11.0)):
    mesh = trimesh.creation.box(sides)
    mesh.apply_translation(at)
    mesh.export(path)
    return path


def test_a_mesh_with_hairline_gaps_is_joined(tmp_path):
    mesh = trimesh.creation.box((5.0, 5.0, 5.0))
    soup = mesh.triangles.copy()
    soup += np.random.default_rng(0).uniform(-1e-5, 1e-5, soup.shape)
    loose = trimesh.Trimesh(soup.reshape(-1, 3), np.arange(36).reshape(-1, 3), process=False)
    loose.export(tmp_path / "loose.stl")
    assert catalogue.load(tmp_path / "loose.stl", tmp_path).mesh.is_watertight


@pytest.mark.parametrize(
    ("wrong", "near"),
    [
        ("squar-2", "square-2"), ("hemisfere-1", "hemisphere-1"), ("pliers", "pliers/jaw-tip"),
        ("Wrench/rings", "wrench/ring"), ("square", "square-4"), ("xyzzy", "t2twin shapes"),
    ],
)  # fmt: skip
def test_an_unknown_name_lists_the_near_ones(wrong, near, tmp_path):
    with pytest.raises(T2TwinError) as caught:
        catalogue.load(wrong, tmp_path)
    assert near in str(caught.value)
    assert ".step, .stp are also allowed" in str(caught.value)
    with pytest.raises(T2TwinError):
        catalogue.split(wrong)


def test_the_second_load_is_read_and_the_same(tmp_path, monkeypatch):
    path = block(tmp_path / "block.stl")
    first = catalogue.load(path, tmp_path / "kept")
    monkeypatch.setattr(catalogue, "_prepared", lambda *_: pytest.fail("was made again"))
    second = catalogue.load(path, tmp_path / "kept")
    np.testing.assert_array_equal(first.mesh.vertices, second.mesh.vertices)
    np.testing.assert_array_equal(first.mesh.faces, second.mesh.faces)
    np.testing.assert_array_equal(first.surface.heights_mm, second.surface.heights_mm)
    np.testing.assert_array_equal(first.surface.x_mm, second.surface.x_mm)
    for field in ("name", "spacing_mm", "parameters", "base_mm", "notes"):
        assert getattr(first, field) == getattr(second, field)


def test_stale_copies_are_not_used(tmp_path, monkeypatch):
    path, folder = block(tmp_path / "block.stl"), tmp_path / "kept"
    catalogue.load(path, folder)
    (kept,) = folder.iterdir()
    monkeypatch.setattr(catalogue, "installed_version", lambda name: "another")
    catalogue.load(path, folder)
    (newer,) = folder.iterdir()
    assert newer != kept


def test_files_of_one_stem_in_two_folders_are_both_kept(tmp_path, monkeypatch):
    paths = []
    for folder, height in (("a", 3.0), ("b", 5.0)):
        (tmp_path / folder).mkdir()
        paths.append(block(tmp_path / folder / "part.stl", (6.0, 4.0, height)))
    for path in paths:
        assert catalogue.load(path, tmp_path / "kept").name == "part"
    block(paths[1], (6.0, 4.0, 7.0))
    catalogue.load(paths[1], tmp_path / "kept")
    assert len(list((tmp_path / "kept").iterdir())) == 2  # the changed file's old shape is gone
    monkeypatch.setattr(catalogue, "_prepared", lambda *_: pytest.fail("was made again"))
    volumes = [catalogue.load(path, tmp_path / "kept").mesh.volume for path in paths]
    assert volumes == pytest.approx([72.0, 168.0])


def test_a_file_in_the_cache_s_place_is_an_error(tmp_path):
    (tmp_path / "kept").write_text("in the way")
    with pytest.raises(T2TwinError, match="expected a folder"):
        catalogue.load(block(tmp_path / "block.stl"), tmp_path / "kept")


@pytest.fixture
def few(monkeypatch):
    """A catalogue of two primitives and the quickest tool."""
    monkeypatch.setattr(catalogue, "PRIMITIVES", ("circle-empty-2", "hemisphere-3"))
    monkeypatch.setattr(catalogue, "TOOLS", ("allen-key",))


def test_export_writes_what_the_manifest_says(few, tmp_path):
    out = tmp_path / "out"
    manifest = json.loads(export.export_shapes(out).read_text())
    entries = {entry["name"]: entry for entry in manifest["shapes"]}
    assert list(entries) == ["circle-empty-2", "hemisphere-3", "allen-key", "mosaic"]
    assert entries["hemisphere-3"]["split"] == "val"
    assert entries["hemisphere-3"]["parameters_mm"] == {"radius": 3.3}
    assert len(entries["allen-key"]["keypoints"]) == 4
    for name, entry in entries.items():
        for suffix in (".stl", ".step"):
            mesh, notes = read.read_solid(out / f"{name}{suffix}")
            assert notes == ()
            assert mesh.volume == pytest.approx(entry["volume_mm3"], rel=2e-3)
    assert {file.suffix for file in out.iterdir()} == {".step", ".stl", ".json"}


def test_the_mosaic_holds_every_feature(shapes):
    solid = export.plate_solid()
    plate = (
        export.PLATE_COLUMNS
        * export.PLATE_ROWS
        * export.PLATE_PITCH_MM[0]
        * export.PLATE_PITCH_MM[1]
        * 3.0
    )
    single_plate = catalogue.PLATE_SIDE_MM**2 * 3.0
    features = sum(shapes(name).mesh.volume - single_plate for name in catalogue.PRIMITIVES)
    assert solid.isValid()
    assert len(solid.Solids()) == 1
    assert solid.Volume() == pytest.approx(plate + features, rel=1e-3)
    assert len(set(export.plate_positions().values())) == 32


def test_sheet_draws_shapes_and_places_points():
    mesh = trimesh.creation.box((10.0, 10.0, 2.0))
    picture, places = export.draw(
        mesh, (0.0, 90.0), (200, 200), export.STEEL, [(0, 0, 1), (5, 5, 1)]
    )
    assert picture.shape == (200, 200, 3)
    assert picture.dtype == np.uint8
    np.testing.assert_array_equal(picture[2, 2], export.PAPER)
    assert (picture[100, 100] != export.PAPER).any()
    # Seen from straight above, y is up in the picture and the box fills 0.88 of it.
    assert places == pytest.approx(np.array([[100.0, 100.0], [188.0, 12.0]]), abs=1.0)
