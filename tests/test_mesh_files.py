"""A solid in every format that is read, meshes that are mended, and files that are refused."""

import json
import re
import struct
import zipfile
from functools import partial
from typing import Any, cast

import numpy as np
import pytest
import trimesh

import t2twin
from t2twin.cli import main
from t2twin.core.errors import T2TwinError
from t2twin.primitives_cad import catalogue, mesh_files
from t2twin.primitives_cad.mesh_files import SUFFIXES, read_solid
from t2twin.primitives_cad.shape import NOTHING_MM

SIDES_MM = (6.0, 4.0, 3.0)
CORE = "http://schemas.microsoft.com/3dmanufacturing/core/2015/02"
PRODUCTION = "http://schemas.microsoft.com/3dmanufacturing/production/2015/06"


def box(sides=SIDES_MM, at=(40.0, -7.0, 11.0), unit_mm=1.0):
    """A box of these sides and place in mm, its numbers in a unit."""
    return trimesh.creation.box(
        np.array(sides) / unit_mm,
        trimesh.transformations.translation_matrix(np.array(at) / unit_mm),
    )


def y_up(mesh):
    """As glTF wants it: what was z is y."""
    turned = mesh.copy()
    turned.apply_transform(trimesh.transformations.rotation_matrix(-np.pi / 2, (1, 0, 0)))
    return turned


def part(number, mesh, kind="model"):
    """A part of a 3MF model."""
    corners = "".join(f'<vertex x="{x}" y="{y}" z="{z}"/>' for x, y, z in mesh.vertices)
    faces = "".join(f'<triangle v1="{a}" v2="{b}" v3="{c}"/>' for a, b, c in mesh.faces)
    return (
        f'<object id="{number}" type="{kind}"><mesh><vertices>{corners}</vertices>'
        f"<triangles>{faces}</triangles></mesh></object>"
    )


def model(resources, items, unit="millimeter"):
    return (
        f'<model unit="{unit}" xmlns="{CORE}" xmlns:p="{PRODUCTION}">'
        f"<resources>{resources}</resources><build>{items}</build></model>"
    )


def threemf_of(path, start, **others):
    """A 3MF archive: its first model, and others by name."""
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("3D/3dmodel.model", start)
        for name, text in others.items():
            archive.writestr(f"3D/{name}.model", text)


def obj_text(mesh, faces=None):
    corners = [f"v {x} {y} {z}" for x, y, z in mesh.vertices]
    faces = mesh.faces + 1 if faces is None else faces
    return "\n".join([*corners, *("f " + " ".join(map(str, face)) for face in faces)]) + "\n"


VOLUME_MM3 = 72.0


# The outlines of a box's six sides, its corners counted from 1, and from 0, as x y z in binary.
QUADS = [(1, 2, 4, 3), (5, 7, 8, 6), (1, 5, 6, 2), (3, 4, 8, 7), (1, 3, 7, 5), (2, 6, 8, 4)]
SQUARES = [[corner - 1 for corner in square] for square in QUADS]


def corners_of(at=(0.0, 0.0, 0.0)):
    grid = np.indices((2, 2, 2)).reshape(3, 8).T
    return trimesh.Trimesh((grid - 0.5) * SIDES_MM + at, [[0, 1, 2]], process=False)


def ply(faces, ninth=(np.nan,) * 3):
    """A binary PLY file of the block's corners, a ninth that no side has, and of faces."""
    head = (
        "ply\nformat binary_little_endian 1.0\nelement vertex 9\nproperty float x\n"
        f"property float y\nproperty float z\nelement face {len(faces)}\nproperty uchar red\n"
        "property list uchar int vertex_indices\nend_header\n"
    )
    body = np.vstack([corners_of().vertices, [ninth]]).astype("<f4").tobytes()
    for face in faces:
        body += struct.pack(f"<BB{len(face)}i", 9, len(face), *face)
    return head.encode() + body


FORMATS = {
    "binary.stl": lambda path: box().export(path),
    "text.STL": lambda path: path.write_text(box().export(file_type="stl_ascii")),
    "binary.ply": lambda path: box().export(path),
    "text.ply": lambda path: path.write_bytes(box().export(file_type="ply", encoding="ascii")),
    "triangles.obj": lambda path: path.write_text(obj_text(box())),
    "quads.OBJ": lambda path: path.write_text(obj_text(corners_of((9, 9, 9)), QUADS)),
    "back.obj": lambda path: path.write_text(
        obj_text(corners_of(), [[each - 9 for each in face] for face in QUADS])
    ),
    "metres.glb": lambda path: y_up(box(unit_mm=1000.0)).export(path),
    "mm.3mf": lambda path: threemf_of(path, model(part(1, box()), '<item objectid="1"/>')),
    "inches.3MF": lambda path: threemf_of(
        path, model(part(1, box(unit_mm=25.4)), '<item objectid="1"/>', "inch")
    ),
    "marked.stl": lambda path: path.write_text(
        box().export(file_type="stl_ascii"), encoding="utf-8-sig"
    ),
    "quads.ply": lambda path: path.write_bytes(ply(SQUARES)),
}


@pytest.mark.parametrize("name", FORMATS)
def test_each_format_gives_the_same_block(name, tmp_path):
    path = tmp_path / name
    FORMATS[name](path)
    shape = catalogue.load(path, tmp_path / "kept")
    assert shape.name == path.stem
    np.testing.assert_allclose(shape.mesh.bounds, [[-3, -2, -3], [3, 2, 0]], atol=1e-5)
    assert shape.mesh.volume == pytest.approx(VOLUME_MM3, rel=1e-5)
    assert shape.mesh.is_watertight
    assert shape.surface.sample(np.array([0.0, 2.9]), np.array([0.0, -1.9])) == pytest.approx(0.0)
    assert shape.notes == ()


def test_a_scale_takes_the_place_of_the_file_s_own_unit(tmp_path):
    y_up(box()).export(tmp_path / "mm.glb")
    threemf_of(tmp_path / "mm.3mf", model(part(1, box()), '<item objectid="1"/>', "inch"))
    box(unit_mm=25.4).export(tmp_path / "inches.stl")
    for name, scale in (("mm.glb", 1.0), ("mm.3mf", 1.0), ("inches.stl", 25.4)):
        mesh, _ = read_solid(tmp_path / name, scale)
        np.testing.assert_allclose(mesh.bounds, [[-3, -2, -3], [3, 2, 0]], atol=1e-5)


def test_step_lengths_come_in_mm_and_a_scale_multiplies_them(tmp_path):
    import cadquery as cq

    path = tmp_path / "inches.step"
    cq.exporters.export(cq.Workplane().box(*SIDES_MM), str(path), unit="INCH", outputUnit="INCH")
    assert read_solid(path)[0].volume == pytest.approx(25.4**3 * VOLUME_MM3, rel=1e-6)
    assert read_solid(path, 0.5)[0].volume == pytest.approx(12.7**3 * VOLUME_MM3, rel=1e-6)
    cq.exporters.export(cq.Workplane().box(0.03, 0.03, 0.03), str(path))
    with pytest.raises(T2TwinError, match=r"25\.4 if its millimeters are inches, 1000 if"):
        read_solid(path)


def test_a_scale_is_positive_and_finite_and_for_files_only(tmp_path):
    with pytest.raises(T2TwinError, match="for files only"):
        t2twin.load_shape("square-2", scale=2.0)
    box().export(tmp_path / "block.stl")
    for scale in (0.0, np.inf):
        with pytest.raises(T2TwinError, match="positive"):
            t2twin.load_shape(tmp_path / "block.stl", scale=scale)
    shape = t2twin.load_shape(tmp_path / "block.stl")
    assert t2twin.load_shape(shape) is shape
    with pytest.raises(T2TwinError, match="for files only"):
        t2twin.load_shape(shape, scale=2.0)


@pytest.mark.parametrize(
    "name, sides, units",
    [
        ("it.stl", (0.03, 0.02, 0.01), ("inches", "meters")),
        ("it.stl", (0.12, 0.33, 0.03), ("inches", "meters")),
        ("it.stl", (0.4, 0.18, 1.2), ("inches",)),
        ("it.stl", (1200.0, 900.0, 10.0), ("micrometers",)),
        ("it.glb", (6.0, 4.0, 5.0), ("millimeters", "inches")),
        ("it.glb", (1e7, 9e6, 10.0), ()),
    ],
)
def test_a_refusal_names_scales_that_work(name, sides, units, tmp_path):
    path = tmp_path / name
    box(sides, at=(0, 0, 0)).export(path)
    with pytest.raises(T2TwinError, match=r"0\.5 x 0\.2 mm and at most 1000 mm") as caught:
        read_solid(path)
    found = dict(re.findall(r"(?<= )(\S+) if it is in (\w+)", str(caught.value)))
    assert tuple(found.values()) == units
    for scale in found:
        assert read_solid(path, float(scale))[0].is_watertight


def test_the_smallest_solid_is_felt_wherever_it_is_pressed(tmp_path):
    side = mesh_files.SMALLEST_MM
    box((side, side, 3.0)).export(tmp_path / "least.stl")
    box((side / 2, side / 2, 3.0)).export(tmp_path / "less.stl")
    with pytest.raises(
        T2TwinError, match=r"0\.25 x 0\.25 mm seen from above.*at least 0\.5 x 0\.2"
    ):
        read_solid(tmp_path / "less.stl")
    twin, shape = t2twin.Twin(), t2twin.load_shape(tmp_path / "least.stl")
    for x, yaw in ((0.0, 0.0), (0.13, 30.0), (0.25, 45.0)):
        touch = twin.press(shape, force_n=1.0, x_mm=x, yaw_deg=yaw)
        assert touch.digit.settled and touch.cyskin.settled
        assert touch.digit.contact_area_mm2 == pytest.approx(side**2, rel=0.05)
        assert touch.cyskin.force_n == pytest.approx(1.0, rel=0.005)


def test_bodies_of_a_scene_stand_where_it_puts_them(tmp_path):
    scene = trimesh.Scene()
    for x, height in ((0.0, 2.0), (6.0, 4.0)):
        mesh = y_up(box((2.0, 2.0, height), at=(0, 0, height / 2), unit_mm=1000.0))
        scene.add_geometry(
            mesh, transform=trimesh.transformations.translation_matrix((x / 1e3, 0, 0))
        )
    scene.export(tmp_path / "two.glb")
    threemf_of(
        tmp_path / "two.3mf",
        model(
            part(1, box((2, 2, 2), at=(0, 0, 1)))
            + '<object id="2"><components><component objectid="1"/>'
            '<component objectid="1" transform="1 0 0 0 1 0 0 0 2 6 0 0"/></components></object>'
            + part(3, box((50, 50, 50)), kind="support"),
            '<item objectid="2" transform="0 1 0 1 0 0 0 0 1 9 9 9"/><item objectid="3"/>',
        ),
    )
    # The 3MF build mirrors x and y, so there the second body stands along y.
    for name, along in (("two.glb", (0, 1)), ("two.3mf", (1, 0))):
        shape = catalogue.load(tmp_path / name, tmp_path / "kept")
        x, y = (np.array([3.0, -3.0]) if axis == along[0] else np.zeros(2) for axis in (0, 1))
        assert shape.mesh.body_count == 2
        assert shape.mesh.volume == pytest.approx(8.0 + 16.0, rel=1e-5)
        assert shape.surface.sample(x, y) == pytest.approx([0.0, -2.0], abs=1e-4)


def test_a_3mf_build_takes_parts_from_other_models(tmp_path):
    """As slicers write it: parts of one number in several models."""
    places = "".join(
        f'<item objectid="1" p:path="/3D/{name}.model" transform="1 0 0 0 1 0 0 0 1 {x} 0 0"/>'
        for name, x in (("a", 0), ("b", 6))
    )
    parts = {
        name: model(part(1, box((2, 2, height), at=(0, 0, height / 2))), "")
        for name, height in (("a", 2), ("b", 4))
    }
    threemf_of(tmp_path / "two.3mf", model("", places), **parts)
    mesh, _ = read_solid(tmp_path / "two.3mf")
    assert mesh.volume == pytest.approx(24.0)
    np.testing.assert_allclose(mesh.extents, (8, 2, 4))


def test_a_face_with_a_notch_is_cut_within_its_outline(tmp_path):
    outline = np.array([(0, 0), (4, 0), (4, 4), (3, 4), (3, 1), (1, 1), (1, 4), (0, 4)], float)
    ell = np.array([(4, 0), (4, 2), (2, 2), (2, 4), (0, 4), (0, 0)], float)
    for name, ring in (("notch", outline), ("corner", ell)):
        n = len(ring)
        corners = [f"v {x} {y} {z}" for z in (0, 5) for x, y in ring]
        sides = [(i + 1, (i + 1) % n + 1, (i + 1) % n + 1 + n, i + 1 + n) for i in range(n)]
        faces = [range(n, 0, -1), range(n + 1, 2 * n + 1), *sides]
        lines = corners + ["f " + " ".join(map(str, face)) for face in faces]
        (tmp_path / f"{name}.obj").write_text("\n".join(lines))
    mesh, _ = read_solid(tmp_path / "corner.obj")
    assert mesh.volume == pytest.approx(12 * 5)
    assert mesh.area == pytest.approx(2 * 12 + 16 * 5)  # folds would count twice
    with pytest.raises(T2TwinError, match="notches"):
        read_solid(tmp_path / "notch.obj")


@pytest.mark.parametrize(
    "faces, words",
    [
        (ply(SQUARES)[:-3], "cannot be read as PLY"),
        (ply([[0, 1, 99]]), "corners that it lacks"),
        (ply([[4, 8, 2, 0]], (-2.5, -1.8, -1.5)), "notches"),
    ],
)
def test_a_ply_that_trimesh_reads_wrong_is_refused(faces, words, tmp_path):
    (tmp_path / "it.ply").write_bytes(faces)
    with pytest.raises(T2TwinError, match=words):
        read_solid(tmp_path / "it.ply")


def step(path, *shapes):
    import cadquery as cq

    cq.exporters.export(cq.Workplane(cq.Compound.makeCompound(list(shapes))), str(path))
    return path


def test_step_bodies_are_one_shape_and_faces_a_surface(tmp_path):
    import cadquery as cq

    low, high = (cq.Workplane().box(4, 4, 2 * z).translate((x, 0, 0)).val() for x, z in
                 ((0, 1), (8, 2)))  # fmt: skip
    two = catalogue.load(step(tmp_path / "two.step", low, high), tmp_path / "kept")
    assert two.notes == (
        f"{tmp_path / 'two.step'} contains 2 solids, which are pressed as one shape",
    )
    assert two.surface.sample(np.array([-4.0, 4.0]), np.zeros(2)) == pytest.approx([-1.0, 0.0])
    top = cq.Workplane(high).faces(">Z").val()
    sheet = catalogue.load(step(tmp_path / "sheet.step", top), tmp_path / "kept")
    assert "is open at 4 edges, the widest gap 4 mm" in sheet.notes[0]
    assert sheet.surface.sample(np.zeros(1), np.ones(1)) == pytest.approx([0.0])


def test_a_hole_in_a_wall_at_45_degrees_is_pressed(tmp_path):
    """Weights of a triangle of the wall, x - y = 9.8 mm, have the sum 0."""
    import cadquery as cq

    block = cq.Workplane().box(20, 20, 10)
    block = block.edges(cq.selectors.NearestToPointSelector((10, -10, 0))).chamfer(10.2)
    wall = cq.Workplane(cq.Plane((4.9, -4.9, 0), xDir=(1, 1, 0), normal=(1, -1, 0)))
    block: Any = block.cut(wall.circle(2).extrude(-6)).val()
    shape = catalogue.load(step(tmp_path / "block.step", block), tmp_path / "kept")
    assert shape.mesh.volume == pytest.approx(block.Volume(), rel=1e-3)
    heights = shape.surface.sample(np.array([4.8, 5.0]), np.array([-4.8, -5.0]))
    assert heights == pytest.approx([0.0, NOTHING_MM])


def test_bounds_are_those_that_are_named(tmp_path, monkeypatch):
    box().export(tmp_path / "block.stl")
    threemf_of(tmp_path / "block.3mf", model(part(1, box()), '<item objectid="1"/>'))
    monkeypatch.setattr(mesh_files, "MAX_TRIANGLES", 12)
    read_solid(tmp_path / "block.stl")
    monkeypatch.setattr(mesh_files, "MAX_TRIANGLES", 11)
    for name in ("block.stl", "block.3mf"):
        with pytest.raises(T2TwinError, match="more than the 11 triangles"):
            read_solid(tmp_path / name)
    monkeypatch.setattr(mesh_files, "MAX_BYTES", 100)
    with pytest.raises(T2TwinError, match="MB are allowed"):
        read_solid(tmp_path / "block.stl")


def without(mesh, *triangles):
    """The mesh with some triangles lost."""
    kept = mesh.copy()
    kept.update_faces(np.setdiff1d(np.arange(len(mesh.faces)), triangles))
    return kept


def ball():
    return trimesh.creation.icosphere(subdivisions=3, radius=6.0)


BESIDE = [pair.sum() - 777 for pair in ball().face_adjacency if 777 in pair]
"""Three triangles beside one that stays: their holes touch at its corners."""


@pytest.mark.parametrize("lost", [(7,), (7, 700), BESIDE])
def test_small_holes_are_closed_and_said(lost, tmp_path):
    said = f"{len(lost)} small hole(s), the widest"
    without(ball(), *lost).export(tmp_path / "ball.stl")
    for _ in range(2):  # made, then kept
        shape = catalogue.load(tmp_path / "ball.stl", tmp_path / "kept")
        (note,) = shape.notes
        assert said in note and f"with {len(lost)} triangle" in note and "ball.stl" in note
        assert shape.mesh.is_watertight and shape.mesh.is_winding_consistent
        assert len(shape.mesh.faces) == len(ball().faces)
        assert shape.mesh.volume == pytest.approx(ball().volume, rel=1e-5)


def test_the_command_says_what_was_mended(capsys):
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
    inner_wall(tmp_path / "it.stl")
    heights, (note,) = surface_of(tmp_path / "it.stl", [0.5], [-0.7])
    assert "more than two triangles meet" in note and heights == pytest.approx([0.0])
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
    """A GLB file of a box with a changed description."""
    content = cast(bytes, y_up(box(unit_mm=1000.0)).export(file_type="glb"))
    end = 20 + int.from_bytes(content[12:16], "little")
    about = json.loads(content[20:end])
    change(about)
    text = json.dumps(about).encode()
    text += b" " * (-len(text) % 4)
    chunks = struct.pack("<II", len(text), 0x4E4F534A) + text + content[end:]
    path.write_bytes(struct.pack("<4sII", b"glTF", 2, 12 + len(chunks)) + chunks)


def threemf_with(path, old, new):
    threemf_of(path, model(part(1, box()), '<item objectid="1"/>').replace(old, new, 1))


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
    "gone.obj": (lambda path: path.symlink_to("nowhere"), "there is no file"),
    **{f"empty{suffix}": (raw(b""), "is empty") for suffix in SUFFIXES},
    **{
        f"noise{suffix}": (raw(bytes(range(256)) * 9), f"cannot be read as {suffix[1:].upper()}")
        for suffix in SUFFIXES
    },
    # STL
    "cut.stl": (raw(stl(box().triangles)[:-70]), "no triangles, or is cut short"),
    "letters.stl": (text(f"solid a\nfacet{2 * CORNER}\nvertex 1 x 1\nendsolid"), "read as STL"),
    "nan.stl": (raw(stl(bad_corner(np.nan))), "not numbers"),
    "large.stl": (raw(stl(bad_corner(3e38))), "farther out"),
    "edge.stl": (raw(stl(SHEET * (1, 0, 1))), "is flat: it has no y"),
    "slant.stl": (raw(stl(SHEET[:, :, [0, 0, 2]])), "no surface within"),
    "thin.stl": (lambda path: box((0.125, 9, 9)).export(path), "0.125 x 9 mm seen from above"),
    "tall.stl": (lambda path: box((9, 9, 2000)).export(path), "2000 mm high"),
    # OBJ
    "far.obj": (text(obj_text(box(), [(1, 2, 99)])), "corners that it lacks"),
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
    with pytest.raises(T2TwinError, match=words) as caught:
        catalogue.load(path, tmp_path / "kept")
    assert str(caught.value).startswith(str(path)) or "there is no file" in str(caught.value)
    assert "\n" not in str(caught.value)
    said = capfd.readouterr()
    assert said.out == said.err == ""
    assert not (tmp_path / "kept").exists()
