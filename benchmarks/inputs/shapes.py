"""Solids from files: damaged, open, of no size, in six formats; and odd ones that are fine."""

import json
import os
import struct
import zipfile
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import trimesh

from benchmarks.inputs.case import Base, Case, holding
from benchmarks.inputs.images import PNG

OUT = ("--sensor", "digit", "--out", "out")


def block(sides: tuple[float, float, float] = (6.0, 4.0, 3.0)) -> trimesh.Trimesh:
    return trimesh.creation.box(sides)


def exported(mesh: trimesh.Trimesh, kind: str) -> bytes:
    content = mesh.export(file_type=kind)
    assert isinstance(content, str | bytes)  # some formats of trimesh are dictionaries
    return content.encode() if isinstance(content, str) else content


def binary(triangles: np.ndarray, announced: int | None = None) -> bytes:
    """A binary STL of (n, 3, 3) corners."""
    count = len(triangles) if announced is None else announced
    rows = b"".join(
        struct.pack("<12fH", 0, 0, 1, *corners.ravel(), 0) for corners in triangles.astype("f4")
    )
    return bytes(80) + struct.pack("<I", count) + rows


def _moved(value: float) -> bytes:
    corners = block().triangles.copy()
    corners[corners == corners.max()] = value
    return binary(corners)


def _part(faces: slice) -> trimesh.Trimesh:
    mesh = trimesh.creation.icosphere(3, 5.0)
    mesh.update_faces(np.isin(np.arange(len(mesh.faces)), np.arange(len(mesh.faces))[faces]))
    return mesh


STL, ASCII = exported(block(), "stl"), exported(block(), "stl_ascii")
OBJ, PLY, GLB = (exported(block(), kind) for kind in ("obj", "ply", "glb"))


def _glb(change: dict) -> bytes:
    """The block as GLB, with other entries in its description."""
    length = struct.unpack("<I", GLB[12:16])[0]
    description = json.loads(GLB[20 : 20 + length]) | change
    text = json.dumps(description).encode()
    text += b" " * (-len(text) % 4)
    rest = GLB[20 + length :]
    head = struct.pack("<4sII", b"glTF", 2, 20 + len(text) + len(rest))
    return head + struct.pack("<I4s", len(text), b"JSON") + text + rest


MODEL = """<?xml version="1.0"?><model unit="millimeter"
xmlns="http://schemas.microsoft.com/3dmanufacturing/core/2015/02"><resources><object id="1"
type="model"><mesh><vertices>{v}</vertices><triangles>{t}</triangles></mesh></object></resources>
<build><item objectid="1"/></build></model>"""


def threemf(model: str | None = None, more: dict[str, bytes] | None = None) -> bytes:
    import io

    mesh, file = block(), io.BytesIO()
    corners = "".join(f'<vertex x="{x}" y="{y}" z="{z}"/>' for x, y, z in mesh.vertices)
    faces = "".join(f'<triangle v1="{a}" v2="{b}" v3="{c}"/>' for a, b, c in mesh.faces)
    whole = MODEL.format(v=corners, t=faces) if model is None else model
    with zipfile.ZipFile(file, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("3D/3dmodel.model", whole)
        for name, content in (more or {}).items():
            archive.writestr(name, content)
    return file.getvalue()


ENTITIES = '<?xml version="1.0"?><!DOCTYPE m [<!ENTITY a "aaaaaaaaaa">' + "".join(
    f'<!ENTITY {b} "{f"&{a};" * 10}">' for a, b in zip("abcdefgh", "bcdefghi", strict=True)
) + "]><model>&i;</model>"  # fmt: skip


def _bad() -> Iterator[tuple[str, str, bytes]]:
    """Name, file, content."""
    for suffix in ("stl", "step", "stp", "obj", "ply", "3mf", "glb"):
        yield f"{suffix} empty", f"x.{suffix}", b""
        yield f"{suffix} of text", f"x.{suffix}", b"this is a solid\n"
        yield f"{suffix} that is a picture", f"x.{suffix}", PNG
        yield f"{suffix} of noise", f"x.{suffix}", np.random.default_rng(0).bytes(5000)
    for name, content in (("stl", STL), ("glb", GLB), ("3mf", threemf())):
        yield f"{name} cut in half", f"x.{name}", content[: len(content) // 2]
    yield "ASCII STL cut", "x.stl", ASCII[: len(ASCII) // 2]
    yield "OBJ cut", "x.obj", OBJ[: len(OBJ) // 3]
    yield "PLY cut", "x.ply", PLY[: len(PLY) // 2]
    yield "STL of 4 billion triangles", "x.stl", binary(block().triangles, 2**32 - 1)
    yield "STL of no triangles", "x.stl", binary(block().triangles[:0])
    yield "STL, a corner not a number", "x.stl", _moved(np.nan)
    yield "STL, a corner infinite", "x.stl", _moved(np.inf)
    yield "STL, a corner at 1e38", "x.stl", _moved(1e38)
    yield "STL, half a ball", "x.stl", exported(_part(slice(0, 640)), "stl")
    yield "STL, one triangle", "x.stl", binary(block().triangles[:1])
    yield "STL, all corners in one place", "x.stl", binary(np.ones((12, 3, 3)))
    yield "STL of 0.25 mm", "x.stl", exported(block((0.25, 0.25, 0.25)), "stl")
    yield "STL in metres", "x.stl", exported(block((0.03, 0.02, 0.01)), "stl")
    yield "STL of two metres", "x.stl", exported(block((2000.0, 10.0, 10.0)), "stl")
    yield "OBJ, a corner that is not there", "x.obj", OBJ + b"f 1 2 99\n"
    yield "OBJ, corner 0", "x.obj", OBJ + b"f 0 1 2\n"
    yield "OBJ, a corner of text", "x.obj", OBJ.replace(b"v ", b"v x ", 1)
    yield "PLY of 10^12 corners", "x.ply", PLY.replace(b"vertex 8", b"vertex 1000000000000")
    yield "GLB, its buffer in a file", "x.glb", _glb({"buffers": [{"uri": "/etc/passwd",
                                                                  "byteLength": 100}]})  # fmt: skip
    yield "GLB, its buffer on a host", "x.glb", _glb({"buffers": [{"uri": "http://x.test/a",
                                                                  "byteLength": 100}]})  # fmt: skip
    yield "GLB, a buffer of 10^12 bytes", "x.glb", _glb({"buffers": [{"byteLength": 10**12}]})
    yield "GLB, no meshes", "x.glb", _glb({"meshes": []})
    yield "3MF, a zip of nothing", "x.3mf", threemf("")
    yield "3MF, not XML", "x.3mf", threemf("<model>")
    yield "3MF, a billion laughs", "x.3mf", threemf(ENTITIES)
    yield "FreeCAD", "x.FCStd", threemf()
    yield "no suffix", "x", STL


def _good() -> Iterator[tuple[str, str, bytes, tuple[str, ...]]]:
    """Name, file, content, more arguments."""
    yield "STL", "x.stl", STL, ()
    yield "STL, capital suffix", "x.STL", STL, ()
    yield "ASCII STL", "x.stl", ASCII, ()
    yield "OBJ", "x.obj", OBJ, ()
    yield "OBJ with another file's materials", "x.obj", b"mtllib ../../etc/passwd\n" + OBJ, ()
    yield "PLY", "x.ply", PLY, ()
    yield "GLB in metres", "x.glb", exported(block((0.006, 0.004, 0.003)), "glb"), ()
    yield "3MF", "x.3mf", threemf(), ()
    yield (
        "STL in metres",
        "x.stl",
        exported(block((0.006, 0.004, 0.003)), "stl"),
        ("--scale", "1000"),
    )
    yield "STL in inches", "x.stl", exported(block((0.2, 0.2, 0.2)), "stl"), ("--scale", "25.4")
    inside_out = block()
    inside_out.invert()
    yield "STL inside out", "x.stl", exported(inside_out, "stl"), ()
    far = block()
    far.apply_translation((1000.0, -2000.0, 500.0))
    yield "STL far from its origin", "x.stl", exported(far, "stl"), ()
    yield "STL with a small hole", "x.stl", exported(_part(slice(1, None)), "stl"), ()
    yield "a name of LaTeX", "$\\foo_{$.stl", STL, ()
    yield "a name that is not UTF-8", os.fsdecode(b"caf\xe9.stl"), STL, ()
    yield "a name that looks like a flag", "./--out.stl", STL, ()
    yield "a catalogue name with a suffix", "square-2.stl", STL, ()


def _fifo(box: Path, base: Base) -> None:
    os.mkfifo(box / "x.stl")


def _bomb(box: Path, base: Base) -> None:
    """A model of 1.1 GB of spaces, in a small file."""
    with (
        zipfile.ZipFile(box / "x.3mf", "w", zipfile.ZIP_DEFLATED) as archive,
        archive.open("3D/3dmodel.model", "w") as file,
    ):
        for _ in range(1100):
            file.write(b" " * 1_000_000)


def _folder(box: Path, base: Base) -> None:
    (box / "x.stl").mkdir()


def _link(box: Path, base: Base) -> None:
    (box / "x.stl").symlink_to("/dev/zero")


def cases() -> Iterator[Case]:
    for name, file, content in _bad():
        yield Case(f"solid: {name}", ("press", file, *OUT), holding(file, content))
    yield Case("solid: 3MF, a bomb", ("press", "x.3mf", *OUT), _bomb, "x.3mf")
    for name, make in (("a FIFO", _fifo), ("a folder", _folder), ("a device", _link)):
        yield Case(f"solid: {name}", ("press", "x.stl", *OUT), make, "x.stl")
    for name, file, content, more in _good():
        words = ("press", file, *OUT, *more)
        yield Case(f"solid: {name}", words, holding(file, content), fine=True)
    for scale in ("0", "-1", "nan", "inf", "1e30", "1e-30"):
        words = ("press", "x.stl", *OUT, "--scale", scale)
        yield Case(f"solid: scale {scale}", words, holding("x.stl", STL))
    yield Case("a scale of a catalogue's shape", ("press", "circle-1", *OUT, "--scale", "2"))
