"""Meshes that are mended and said to be, and files that are refused in one sentence."""

import os
import struct
from functools import partial

import numpy as np
import pytest
import trimesh
from solid_files import box, glb_of, model, obj_text, part, taken_apart, threemf_of, y_up
from waiting import no_hang

from t2twin.cli import main
from t2twin.core.errors import T2TwinError
from t2twin.primitives_cad import catalogue
from t2twin.primitives_cad.mesh_files import SUFFIXES, read_solid


def without(mesh, *triangles):
    """The mesh with some triangles lost."""
    kept = mesh.copy()
    kept.update_faces(np.setdiff1d(np.arange(len(mesh.faces)), triangles))
    return kept


def ball():
    return trimesh.creation.icosphere(subdivisions=3, radius=6.0)


@pytest.mark.parametrize(
    "lost, said", [((7,), "1 small hole(s), the widest"), ((7, 700), "2 small hole(s), the widest")]
)
def test_small_holes_are_closed_and_said(lost, said, tmp_path):
    without(ball(), *lost).export(tmp_path / "ball.stl")
    for _ in range(2):  # made, then kept
        shape = catalogue.load(tmp_path / "ball.stl", tmp_path / "kept")
        (note,) = shape.notes
        assert said in note and f"with {len(lost)} triangle" in note and "ball.stl" in note
        assert shape.mesh.is_watertight and shape.mesh.is_winding_consistent
        assert len(shape.mesh.faces) == len(ball().faces)
        assert shape.mesh.volume == pytest.approx(ball().volume, rel=1e-5)


def test_holes_that_touch_at_corners_are_closed(tmp_path):
    """The three triangles beside one that stays."""
    beside = [pair.sum() - 777 for pair in ball().face_adjacency if 777 in pair]
    without(ball(), *beside).export(tmp_path / "ball.stl")
    mesh, (note,) = read_solid(tmp_path / "ball.stl")
    assert mesh.is_watertight and "3 small hole(s)" in note
    assert mesh.volume == pytest.approx(ball().volume, rel=1e-5)


def test_the_command_says_what_was_mended(tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    without(ball(), 7).export("ball.stl")
    main(["press", "ball.stl", "--sensor", "cyskin", "--scale", "0.5", "--out", "out"])
    said = capsys.readouterr()
    notes = [line for line in said.err.splitlines() if "compiling numerical loops" not in line]
    assert len(notes) == 1 and notes[0].startswith("t2twin: ball.stl had 1 small hole")
    assert "8.00 N" in said.out
    assert np.ptp(trimesh.load_mesh("out/shape.stl").vertices, axis=0) == pytest.approx(
        6.0, rel=0.01
    )


def test_bodies_that_share_a_face_are_one_solid(tmp_path):
    """Four triangles meet at an edge there, and nothing is open."""
    stacked = [box((4, 4, 2), at=(0, 0, 0)), box((4, 4, 2), at=(0, 0, 2))]
    trimesh.util.concatenate(stacked).export(tmp_path / "stacked.stl")
    beside = [box((4, 4, 2), at=(0, 0, 0)), box((4, 4, 3), at=(4, 4, 0.5))]
    trimesh.util.concatenate(beside).export(tmp_path / "beside.stl")
    for name, volume in (("stacked.stl", 64.0), ("beside.stl", 80.0)):
        shape = catalogue.load(tmp_path / name, tmp_path / "kept")
        assert shape.mesh.volume == pytest.approx(volume) and shape.notes == ()
    assert shape.surface.sample(np.array([2.0, -2.0]), np.array([2.0, -2.0])) == pytest.approx(
        [0, -1]
    )


def test_overlapping_and_inverted_bodies_have_the_right_surface(tmp_path):
    low, high = box((6, 6, 2), at=(0, 0, 1)), box((2, 2, 4), at=(1, 0, 2))
    inverted = high.copy()
    inverted.invert()
    for name, other in (("overlapping", high), ("inverted", inverted)):
        trimesh.util.concatenate([low, other]).export(tmp_path / f"{name}.stl")
        shape = catalogue.load(tmp_path / f"{name}.stl", tmp_path / "kept")
        assert shape.surface.sample(np.array([1.0, -2.0]), np.zeros(2)) == pytest.approx(
            [0.0, -2.0]
        )


def surface_of(path, x, y):
    """Heights of a file's shape at points, mm, and its notes."""
    shape = catalogue.load(path, path.parent / "kept")
    return shape.surface.sample(np.array(x, float), np.array(y, float)), shape.notes


@pytest.mark.parametrize("lost, turned", [(0.3, 0.5), (0.7, 0.0)])
def test_an_open_mesh_is_pressed_by_its_upper_surface(lost, turned, tmp_path):
    """The upper part of a ball, with or without triangles turned inwards: its heights are those of
    the ball."""
    rng = np.random.default_rng(0)
    whole = trimesh.creation.icosphere(subdivisions=4, radius=6.0)
    kept = whole.faces[whole.triangles_center[:, 2] > 12.0 * lost - 6.0]
    kept = np.where(rng.random((len(kept), 1)) < turned, kept[:, ::-1], kept)
    trimesh.Trimesh(whole.vertices, kept, process=False).export(tmp_path / "cap.stl")
    x = np.linspace(-3.0, 3.0, 13)
    heights, (note,) = surface_of(tmp_path / "cap.stl", x, 0.4 * x)
    assert heights == pytest.approx(np.sqrt(36.0 - 1.16 * x**2) - 6.0, abs=0.02)
    assert "cap.stl is open at" in note and note.endswith("its upper surface is pressed")


def test_a_surface_is_pressed_where_walls_without_width_are_not(tmp_path):
    without(box(), *np.flatnonzero(box().face_normals[:, 2] > 0.5)).export(tmp_path / "cup.stl")
    heights, (opening, walls) = surface_of(tmp_path / "cup.stl", [0, 2.9], [0, -1.9])
    assert heights == pytest.approx([0.0, 0.0])
    assert "is open at 4 edges" in opening and "up to 3 mm above the others" in walls


def test_sheets_and_walls_of_more_than_two_triangles_are_pressed(tmp_path):
    for make, words in ((fan, "is open at 2 edges"), (inner_wall, "more than two triangles meet")):
        make(tmp_path / "it.stl")
        heights, (note,) = surface_of(tmp_path / "it.stl", [0.5], [-0.7])
        assert words in note and heights == pytest.approx([0.0])
    for name, sheet in (("slope", SHEET), ("flat", SHEET * (1, 1, 0)), ("single", SHEET[:1])):
        (tmp_path / f"{name}.stl").write_bytes(stl(sheet))
        heights, (note,) = surface_of(tmp_path / f"{name}.stl", [-1.0], [-1.0])
        assert heights == pytest.approx([0.0 if name == "flat" else -0.7], abs=1e-6)
        assert "encloses no volume" in note or "is open" in note


def stl(triangles, announced=None):
    """A binary STL file of triangles (n, 3, 3) that announces a number of them."""
    records = b"".join(
        struct.pack("<12fH", 0, 0, 0, *np.ravel(triangle), 0) for triangle in triangles
    )
    number = len(triangles) if announced is None else announced
    return bytes(80) + struct.pack("<I", number) + records


def bad_corner(value):
    triangles = np.array(box().triangles)
    triangles[3, 1, 2] = value
    return triangles


def glb_with(path, change):
    about, binary = taken_apart(y_up(box(unit_mm=1000.0)))
    change(about)
    glb_of(path, about, binary)


def threemf_with(path, old, new):
    threemf_of(path, model(part(1, box()), '<item objectid="1"/>').replace(old, new, 1))


def fan(path):
    """Three triangles at one edge, and no others open."""
    tents = [box((4, 4, 4), at=(0, 0, 0)).triangles, [[[-2, -2, -2], [2, -2, -2], [0, 0, 0]]]]
    path.write_bytes(stl(np.concatenate(tents)))


def inner_wall(path):
    """A solid with an inner wall: at the wall's rim three triangles meet."""
    wall = [[[-2, -2, -2], [2, 2, -2], [2, 2, 2]], [[-2, -2, -2], [2, 2, 2], [-2, -2, 2]]]
    corners = np.array(
        [(x, y, z) for z in (-2, 2) for x, y in ((-2, -2), (2, -2), (2, 2), (-2, 2))]
    )
    faces = [(0, 2, 1), (0, 3, 2), (4, 5, 6), (4, 6, 7)]
    for i in range(4):
        j = (i + 1) % 4
        faces += [(i, j, j + 4), (i, j + 4, i + 4)]
    path.write_bytes(stl(np.concatenate([corners[np.array(faces)], wall])))


def text(content):
    return lambda path: path.write_text(content)


def raw(content):
    return lambda path: path.write_bytes(content)


SHEET = np.array([[[0, 0, 0], [5, 0, 0], [0, 5, 1]], [[0, 0, 0], [0, 5, 1], [5, 0, 0]]])
CORNER = "\nvertex 1 2 3"

REFUSED = {
    "folder.stl": (lambda path: path.mkdir(), "is a folder"),
    "pipe.stl": (os.mkfifo, "a folder or a device"),
    "gone.obj": (lambda path: path.symlink_to("nowhere"), "there is no file"),
    **{f"empty{suffix}": (raw(b""), "is empty") for suffix in SUFFIXES},
    **{
        f"noise{suffix}": (raw(bytes(range(256)) * 9), f"cannot be read as {suffix[1:].upper()}")
        for suffix in SUFFIXES
    },
    # STL
    "cut.stl": (raw(stl(box().triangles)[:-70]), "no triangles, or is cut short"),
    "none.stl": (raw(stl([])), "no triangles"),
    "second.stl": (
        text(f"{box().export(file_type='stl_ascii')}solid\n{3 * CORNER}"), "cut short",
    ),
    "letters.stl": (text(f"solid a\nfacet{2 * CORNER}\nvertex 1 x 1\nendsolid"), "read as STL"),
    "nan.stl": (raw(stl(bad_corner(np.nan))), "not numbers"),
    "large.stl": (raw(stl(bad_corner(3e38))), "farther out"),
    "edge.stl": (raw(stl(SHEET * (1, 0, 1))), "is flat: it has no y"),
    "slant.stl": (raw(stl(SHEET[:, :, [0, 0, 2]])), "no surface within"),
    "thin.stl": (lambda path: box((0.125, 9, 9)).export(path), "0.125 x 9 mm seen from above"),
    "tall.stl": (lambda path: box((9, 9, 2000)).export(path), "2000 mm high"),
    # OBJ
    "far.obj": (text(obj_text(box(), [(1, 2, 99)])), "corners that it lacks"),
    "back.obj": (text(obj_text(box(), [(-9, -1, -2)])), "corners that it lacks"),
    "points.obj": (text("v 1 2 3\n"), "no triangles"),
    "cut.obj": (text(obj_text(box()) + "\nf 1 2"), "cut short"),
    "commas.obj": (text(obj_text(box()).replace(".", ",")), "could not convert"),
    # GLB
    "cut.glb": (raw(y_up(box()).export(file_type="glb")[:-50]), "read as GLB"),
    "elsewhere.glb": (
        partial(glb_with, change=lambda it: it["buffers"][0].update(uri="/etc/hostname")),
        "another file",
    ),
    "packed.glb": (
        partial(glb_with, change=lambda it: it["accessors"][0].pop("bufferView")), "compressed",
    ),
    "fan.glb": (
        partial(glb_with, change=lambda it: it["meshes"][0]["primitives"][0].update(mode=6)),
        "fans",
    ),
    "nowhere.glb": (partial(glb_with, change=lambda it: it.update(nodes=[])), "damaged"),
    "extension.glb": (
        partial(glb_with, change=lambda it: it.update(extensionsRequired=["KHR_x"])), "KHR_x",
    ),
    # 3MF
    "cut.3mf": (lambda path: threemf_of(path, model(part(1, box()), "")[:-9]), "damaged"),
    "unit.3mf": (lambda path: threemf_of(path, model("", "", "parsec")), "parsec"),
    "unbuilt.3mf": (lambda path: threemf_of(path, model(part(1, box()), "")), "no triangles"),
    "missing.3mf": (lambda path: threemf_of(path, model("", '<item objectid="7"/>')), "part 7"),
    "far.3mf": (partial(threemf_with, old='v1="0"', new='v1="8"'), "corners that it lacks"),
    "extension.3mf": (partial(threemf_with, old="<model ", new=(
        '<model xmlns:x="http://example.org/x" requiredextensions="x" ')), "example.org/x"),
}  # fmt: skip


@pytest.mark.parametrize("name", REFUSED)
def test_what_cannot_be_pressed_is_refused_in_one_sentence(name, tmp_path, capfd):
    make, words = REFUSED[name]
    path = tmp_path / name
    make(path)
    capfd.readouterr()
    with no_hang(), pytest.raises(T2TwinError, match=words) as caught:
        catalogue.load(path, tmp_path / "kept")
    assert str(caught.value).startswith(str(path)) or "there is no file" in str(caught.value)
    assert "\n" not in str(caught.value)
    said = capfd.readouterr()
    assert said.out == said.err == ""
    assert not (tmp_path / "kept").exists()
