"""A user's solid in every format that is read: the same shape, at the right size."""

import re
import struct

import numpy as np
import pytest
import trimesh
from solid_files import SIDES_MM, box, model, obj_text, part, threemf_of, y_up

import t2twin
from t2twin.core.errors import T2TwinError
from t2twin.primitives_cad import catalogue, mesh_files
from t2twin.primitives_cad.mesh_files import read_solid

VOLUME_MM3 = 72.0


def quads():
    """The outlines of a box's six sides, its corners counted from 1 as x y z in binary."""
    return [(1, 2, 4, 3), (5, 7, 8, 6), (1, 5, 6, 2), (3, 4, 8, 7), (1, 3, 7, 5), (2, 6, 8, 4)]


def squares():
    """The same, counted from 0."""
    return [[corner - 1 for corner in square] for square in quads()]


def mixed():
    """The same, with two sides cut into triangles."""
    return [
        *squares()[:4],
        *([a, b, c] for a, b, c, _ in squares()[4:]),
        *([a, c, d] for a, _, c, d in squares()[4:]),
    ]


def corners_of(at=(0.0, 0.0, 0.0)):
    grid = np.indices((2, 2, 2)).reshape(3, 8).T
    return trimesh.Trimesh((grid - 0.5) * SIDES_MM + at, [[0, 1, 2]], process=False)


def ply_head(form, faces):
    return (
        f"ply\nformat {form} 1.0\nelement vertex 9\nproperty float x\nproperty float y\n"
        f"property float z\nelement face {len(faces)}\nproperty uchar red\n"
        "property list uchar int vertex_indices\nend_header\n"
    ).encode()


def ply(faces):
    """A binary PLY file of the block's corners, one that is not a number, and of faces."""
    body = np.vstack([corners_of().vertices, [[np.nan] * 3]]).astype("<f4").tobytes()
    for face in faces:
        body += struct.pack(f"<BB{len(face)}i", 9, len(face), *face)
    return ply_head("binary_little_endian", faces) + body


def ply_text(faces):
    rows = [
        *corners_of().vertices.tolist(),
        [-2.5, -1.8, -1.5],
        *([9, len(face), *face] for face in faces),
    ]
    text = "\n".join(" ".join(map(str, row)) for row in rows)
    return ply_head("ascii", faces) + text.encode()


FORMATS = {
    "binary.stl": lambda path: box().export(path),
    "text.STL": lambda path: path.write_text(box().export(file_type="stl_ascii")),
    "binary.ply": lambda path: box().export(path),
    "text.ply": lambda path: path.write_bytes(box().export(file_type="ply", encoding="ascii")),
    "triangles.obj": lambda path: path.write_text(obj_text(box())),
    "quads.OBJ": lambda path: path.write_text(obj_text(corners_of((9, 9, 9)), quads())),
    "back.obj": lambda path: path.write_text(
        obj_text(corners_of(), [[each - 9 for each in face] for face in quads()])
    ),
    "normals.obj": lambda path: path.write_text(
        box().export(file_type="obj", include_normals=True)
    ),
    "metres.glb": lambda path: y_up(box(unit_mm=1000.0)).export(path),
    "mm.3mf": lambda path: threemf_of(path, model(part(1, box()), '<item objectid="1"/>')),
    "inches.3MF": lambda path: threemf_of(
        path, model(part(1, box(unit_mm=25.4)), '<item objectid="1"/>', "inch")
    ),
    "marked.stl": lambda path: path.write_text(
        box().export(file_type="stl_ascii"), encoding="utf-8-sig"
    ),
    "surface.3mf": lambda path: threemf_of(
        path, model(part(1, box(), kind="surface"), '<item objectid="1"/>')
    ),
    "quads.ply": lambda path: path.write_bytes(ply(squares())),
    "mixed.ply": lambda path: path.write_bytes(ply_text(mixed())),
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


@pytest.mark.parametrize("suffix, unit_mm", [(".stl", 1000.0), (".obj", 25.4), (".ply", 0.001)])
def test_a_scale_makes_other_units_mm(suffix, unit_mm, tmp_path):
    box(unit_mm=unit_mm).export(tmp_path / f"other{suffix}")
    mesh, _ = read_solid(tmp_path / f"other{suffix}", unit_mm)
    np.testing.assert_allclose(mesh.bounds, [[-3, -2, -3], [3, 2, 0]], atol=1e-5)
    assert mesh.volume == pytest.approx(VOLUME_MM3, rel=1e-5)


def test_a_scale_takes_the_place_of_the_file_s_own_unit(tmp_path):
    y_up(box()).export(tmp_path / "mm.glb")
    threemf_of(tmp_path / "mm.3mf", model(part(1, box()), '<item objectid="1"/>', "inch"))
    for name in ("mm.glb", "mm.3mf"):
        assert read_solid(tmp_path / name, 1.0)[0].volume == pytest.approx(72.0, rel=1e-5)


def test_step_lengths_come_in_mm_and_a_scale_multiplies_them(tmp_path):
    import cadquery as cq

    path = tmp_path / "inches.step"
    cq.exporters.export(cq.Workplane().box(*SIDES_MM), str(path), unit="INCH", outputUnit="INCH")
    assert read_solid(path)[0].volume == pytest.approx(25.4**3 * VOLUME_MM3, rel=1e-6)
    assert read_solid(path, 0.5)[0].volume == pytest.approx(12.7**3 * VOLUME_MM3, rel=1e-6)


@pytest.mark.parametrize("scale", [0.0, np.inf])
def test_a_scale_must_be_positive_and_finite(scale, tmp_path):
    box().export(tmp_path / "block.stl")
    with pytest.raises(T2TwinError, match="positive"):
        catalogue.load(tmp_path / "block.stl", tmp_path / "kept", scale=scale)
    assert not (tmp_path / "kept").exists()


def test_a_scale_is_for_files_only(tmp_path):
    with pytest.raises(T2TwinError, match="for files only"):
        t2twin.load_shape("square-2", scale=2.0)
    box().export(tmp_path / "block.stl")
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
        ("it.stl", (1200.0, 900.0, 10.0), ()),
        ("it.glb", (1200.0, 900.0, 10.0), ()),
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


def test_a_glb_solid_of_several_materials_is_one(tmp_path):
    whole = y_up(box(unit_mm=1000.0))
    scene = trimesh.Scene()
    for rows in (range(5), range(5, 12)):
        scene.add_geometry(whole.submesh([list(rows)], append=True))
    scene.export(tmp_path / "two.glb")
    mesh, notes = read_solid(tmp_path / "two.glb")
    assert mesh.is_watertight and mesh.volume == pytest.approx(72.0) and notes == ()


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
        (ply(mixed()), "cannot be read as PLY"),
        (ply(squares())[:-3], "cannot be read as PLY"),
        (ply_text([[0, 1, 99]]), "corners that it lacks"),
        (ply_text([[4, 8, 2, 0]]), "notches"),
    ],
)
def test_a_ply_that_trimesh_reads_wrong_is_refused(faces, words, tmp_path):
    (tmp_path / "it.ply").write_bytes(faces)
    with pytest.raises(T2TwinError, match=words):
        read_solid(tmp_path / "it.ply")


def test_a_ply_of_triangles_that_lie_on_each_other_is_pressed(tmp_path):
    """As of scans with two sides; it has triangles for faces already."""
    faces = [face for a, b, c, d in squares() for face in ([a, b, c], [a, c, d])]
    (tmp_path / "twice.ply").write_bytes(ply([*faces, *(face[::-1] for face in faces)]))
    shape = catalogue.load(tmp_path / "twice.ply", tmp_path / "kept")
    assert shape.mesh.extents == pytest.approx(SIDES_MM)
    assert shape.surface.sample(np.zeros(1), np.zeros(1)) == pytest.approx([0.0])


def step(path, *shapes):
    import cadquery as cq

    cq.exporters.export(cq.Workplane(cq.Compound.makeCompound(list(shapes))), str(path))
    return path


def test_gaps_between_the_triangles_of_a_step_solid_are_closed(tmp_path, monkeypatch):
    """The kernel leaves some in valid solids; here one triangle is lost."""
    import cadquery as cq

    path = step(tmp_path / "ball.step", cq.Workplane().sphere(5.0).val())
    whole, notes = read_solid(path)
    assert notes == ()
    triangles_of = mesh_files.triangles_of

    def all_but_one(*given):
        points, triangles = triangles_of(*given)
        return points, triangles[1:]

    monkeypatch.setattr(mesh_files, "triangles_of", all_but_one)
    mesh, (note,) = read_solid(path)
    assert mesh.is_watertight and "1 small hole" in note
    assert mesh.volume == pytest.approx(whole.volume, rel=1e-3)


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
