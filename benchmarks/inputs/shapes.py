"""Solids from files: damaged, open, of no size, in six formats; and odd ones that are fine."""

import base64
import io
import json
import os
import struct
import zipfile
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import trimesh

from benchmarks.inputs.case import Base, Case, Make, holding
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


def _model(corners: str = "", transform: str = "", more: str = "", unit: str = "") -> str:
    """The block's model, with more corners, its item's transform, and more parts."""
    mesh = block()
    v = "".join(f'<vertex x="{x}" y="{y}" z="{z}"/>' for x, y, z in mesh.vertices) + corners
    t = "".join(f'<triangle v1="{a}" v2="{b}" v3="{c}"/>' for a, b, c in mesh.faces)
    text = MODEL.format(v=v, t=t).replace("</resources>", f"{more}</resources>")
    if transform:
        text = text.replace('<item objectid="1"', f'<item objectid="1" transform="{transform}"')
    return text.replace("millimeter", unit or "millimeter")


RELATIONSHIPS = (
    '<?xml version="1.0"?><Relationships '
    'xmlns="http://schemas.openxmlformats.org/package/2006/relationships"><Relationship Id="r0" '
    'Type="http://schemas.microsoft.com/3dmanufacturing/2013/01/3dmodel" Target="{}"/>'
    "</Relationships>"
)
"""What names the model of a 3MF archive."""


def archive(files: dict[str, str]) -> bytes:
    file = io.BytesIO()
    with zipfile.ZipFile(file, "w", zipfile.ZIP_DEFLATED) as writer:
        for name, content in files.items():
            writer.writestr(name, content)
    return file.getvalue()


def _node(**more: object) -> bytes:
    """The block as GLB, its one node another."""
    return _glb({"nodes": [{"mesh": 0, **more}], "scenes": [{"nodes": [0]}], "scene": 0})


def _described() -> dict:
    length = struct.unpack("<I", GLB[12:16])[0]
    return json.loads(GLB[20 : 20 + length])


def _of(key: str, **change: object) -> dict:
    """A change of the first entry of a list of GLB's description."""
    first, *others = _described()[key]
    return {key: [first | change, *others]}


def _own_data(uri: str) -> bytes:
    """The block in meters as GLB, whose data stand in its description."""
    small = exported(block((0.006, 0.004, 0.003)), "glb")
    length = struct.unpack("<I", small[12:16])[0]
    data = small[28 + length :]
    coded = uri.format(base64.b64encode(data).decode())
    buffers = [{"byteLength": len(data), "uri": coded}]
    text = json.dumps(json.loads(small[20 : 20 + length]) | {"buffers": buffers}).encode()
    text += b" " * (-len(text) % 4)
    head = struct.pack("<4sIII4s", b"glTF", 2, 20 + len(text), len(text), b"JSON")
    return head + text


def _ring(corners: int, notched: bool = False) -> bytes:
    """A prism as OBJ, whose two ends are faces of many corners, with a notch or without."""
    turn = np.linspace(0, 2 * np.pi, corners, endpoint=False)
    radius = np.where(np.arange(corners) % 2, 5.0, 4.0 if notched else 5.0)
    lines = [f"v {r * np.cos(a):.6f} {r * np.sin(a):.6f} {z}"
             for z in (0, 5) for r, a in zip(radius, turn, strict=True)]  # fmt: skip
    n = corners
    lines += [f"f {i + 1} {(i + 1) % n + 1} {(i + 1) % n + 1 + n} {i + 1 + n}" for i in range(n)]
    lines.append("f " + " ".join(str(n - i) for i in range(n)))
    lines.append("f " + " ".join(str(n + 1 + i) for i in range(n)))
    return "\n".join(lines).encode()


NODES = {"nodes": [{"mesh": 0, "children": [0]}], "scenes": [{"nodes": [0]}], "scene": 0}
TURNED = "1 0 0 0 1 0 0 0 1 0 0 {}"

BAD_NUMBERS: tuple[tuple[str, str, bytes, str], ...] = (
    ("OBJ, a corner of nan", "x.obj", OBJ.replace(b"v ", b"v nan 0 0\nv ", 1), "not numbers"),
    ("OBJ, a corner of inf", "x.obj", OBJ.replace(b"v ", b"v inf 0 0\nv ", 1), "not numbers"),
    ("OBJ, a corner of 1e999", "x.obj", OBJ.replace(b"v ", b"v 1e999 0 0\nv ", 1), "not numbers"),
    ("OBJ, a corner at 1e300", "x.obj", OBJ.replace(b"v ", b"v 1e300 0 0\nv ", 1), "farther out"),
    ("OBJ, decimal commas", "x.obj", OBJ.replace(b".", b","), "three numbers"),
    ("OBJ, a face of 20,000 corners", "x.obj", _ring(20_000), "20,000 corners"),
    ("OBJ, notches in 900 corners", "x.obj", _ring(900, notched=True), "notches"),
    ("OBJ, a line of 2 MB", "x.obj", OBJ + b"v" + b" 1" * 1_000_000, "characters"),
    ("OBJ, corner 10^30", "x.obj", OBJ + b"f 1 2 1" + b"0" * 30 + b"\n", "lacks"),
    ("OBJ, corner -10^30", "x.obj", OBJ + b"f 1 2 -1" + b"0" * 30 + b"\n", "lacks"),
    ("OBJ, a corner of nan in a face", "x.obj", OBJ + b"f 1 2 nan\n", "whole numbers"),
    ("OBJ, corners without numbers", "x.obj", OBJ + b"f // // //\n", "whole numbers"),
    ("OBJ, null bytes", "x.obj", OBJ + b"v 1 \0 2\n", "three numbers"),
    ("ASCII STL, a corner of nan", "x.stl", ASCII.replace(b"vertex ", b"vertex nan 0 0\nx", 1),
     "not numbers"),
    ("ASCII STL, decimal commas", "x.stl", ASCII.replace(b".", b","), "not numbers"),
    ("ASCII STL, a corner of 1e400", "x.stl",
     ASCII.replace(b"vertex ", b"vertex 1e400 0 0\nx", 1), "not numbers"),
    ("3MF, a corner of nan", "x.3mf", threemf(_model('<vertex x="nan" y="0" z="0"/>')),
     "not numbers"),
    ("3MF, a corner of inf", "x.3mf", threemf(_model('<vertex x="inf" y="0" z="0"/>')),
     "not numbers"),
    ("3MF, a corner at 1e300", "x.3mf", threemf(_model('<vertex x="1e300" y="0" z="0"/>')),
     "farther out"),
    ("3MF, a corner of text", "x.3mf", threemf(_model('<vertex x="a" y="0" z="0"/>')), "x.3mf"),
    ("3MF, a corner without z", "x.3mf", threemf(_model('<vertex x="1" y="0"/>')), "lacks z"),
    ("3MF, placed by nan", "x.3mf", threemf(_model(transform=TURNED.format("nan"))), "not finite"),
    ("3MF, placed by inf", "x.3mf", threemf(_model(transform=TURNED.format("inf"))), "not finite"),
    ("3MF, placed at 1e300", "x.3mf", threemf(_model(transform=TURNED.format("1e300"))),
     "farther out"),
    ("3MF, placed by 11 numbers", "x.3mf", threemf(_model(transform=TURNED.format(""))),
     "12 numbers"),
    ("3MF, placed by text", "x.3mf", threemf(_model(transform="here")), "12 numbers"),
    ("3MF, a part within itself", "x.3mf", threemf(_model(more=(
        '<object id="2"><components><component objectid="2"/></components></object>'
    )).replace('<item objectid="1"', '<item objectid="2"')), "allowed places"),
    ("3MF of 20,000 parts", "x.3mf", threemf(_model(more='<object id="2"/>' * 20_000)), "parts"),
    ("3MF in furlongs", "x.3mf", threemf(_model(unit="furlong")), "furlong"),
    ("3MF, a corner of 10^30", "x.3mf", threemf(_model().replace('v1="0"', f'v1="{10**30}"', 1)),
     "lacks"),
    ("3MF, its model not there", "x.3mf", archive({"_rels/.rels": RELATIONSHIPS.format("/a.model"),
                                                  "3D/b.model": _model()}), "a.model"),
    ("3MF, relationships cut", "x.3mf", archive({"_rels/.rels": RELATIONSHIPS[:200],
                                                "3D/3dmodel.model": _model()}), "XML"),
    ("3MF, relationships with entities", "x.3mf", archive({"_rels/.rels": ENTITIES,
                                                          "3D/3dmodel.model": _model()}),
     "document type"),
    ("GLB, placed by nan", "x.glb", _node(matrix=[float("nan")] * 16), "damaged"),
    ("GLB, placed at 1e300", "x.glb", _node(translation=[1e300, 0, 0]), "farther out"),
    ("GLB, placed beyond all numbers", "x.glb", _node(scale=[1e200, 1e200, 1e200],
                                                      translation=[1e308, 0, 0]), "farther out"),
    ("GLB, a matrix of 15", "x.glb", _node(matrix=[1.0] * 15), "damaged"),
    ("GLB, a rotation of text", "x.glb", _node(rotation=["a"] * 4), "damaged"),
    ("GLB, a node within itself", "x.glb", _glb(NODES), "below itself"),
    ("GLB, a node that is not there", "x.glb", _glb({"scenes": [{"nodes": [9]}]}), "damaged"),
    ("GLB, a mesh that is not there", "x.glb", _node(mesh=9), "damaged"),
    ("GLB, a node below 0", "x.glb", _glb({"scenes": [{"nodes": [-1]}]}), "damaged"),
    ("GLB, compressed by Draco", "x.glb",
     _glb({"extensionsRequired": ["KHR_draco_mesh_compression"]}), "compressed"),
    ("GLB, compressed by meshopt", "x.glb",
     _glb({"extensionsRequired": ["EXT_meshopt_compression"]}), "compressed"),
    ("GLB, quantized", "x.glb", _glb({"extensionsRequired": ["KHR_mesh_quantization"]}),
     "compressed"),
    ("GLB, sparse", "x.glb", _glb(_of("accessors", sparse={"count": 1})), "compressed"),
    ("GLB, 10^12 corners", "x.glb", _glb(_of("accessors", count=10**12)), "damaged"),
    ("GLB, corners of 64 bits", "x.glb", _glb(_of("accessors", componentType=5130)), "compressed"),
    ("GLB, a view outside its buffer", "x.glb", _glb(_of("bufferViews", byteOffset=10**9)),
     "damaged"),
    ("GLB, a stride of 0", "x.glb", _glb(_of("bufferViews", byteStride=0)), "damaged"),
    ("GLB, a length below 0", "x.glb", _glb(_of("bufferViews", byteLength=-1)), "damaged"),
    ("GLB, its data not base64", "x.glb",
     _own_data("data:application/octet-stream;base64,!!!{}"), "damaged"),
    ("GLB, its data cut", "x.glb", _own_data("data:;base64,{}"[:13] + "AAAA"), "damaged"),
    ("GLB of glTF 1", "x.glb", GLB[:4] + struct.pack("<I", 1) + GLB[8:], "version 1"),
    ("GLB without its end", "x.glb", GLB[:-4], "shorter"),
    ("PLY, a corner of nan", "x.ply", exported(block(), "ply").replace(
        np.float32(-3.0).tobytes(), np.float32(np.nan).tobytes(), 1), "x.ply"),
)  # fmt: skip


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
    yield "STL in meters", "x.stl", exported(block((0.03, 0.02, 0.01)), "stl")
    yield "STL of two meters", "x.stl", exported(block((2000.0, 10.0, 10.0)), "stl")
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
    yield "GLB in meters", "x.glb", exported(block((0.006, 0.004, 0.003)), "glb"), ()
    yield "3MF", "x.3mf", threemf(), ()
    yield (
        "STL in meters, with a scale",
        "x.stl",
        exported(block((0.006, 0.004, 0.003)), "stl"),
        ("--scale", "1000"),
    )
    yield "STL in inches", "x.stl", exported(block((0.2, 0.2, 0.2)), "stl"), ("--scale", "25.4")
    yield "OBJ, a byte order mark", "x.obj", b"\xef\xbb\xbf" + OBJ.partition(b"\n")[2], ()
    yield "OBJ, lines of Windows", "x.obj", OBJ.replace(b"\n", b"\r\n"), ()
    yield "OBJ, lines of old Macs", "x.obj", OBJ.replace(b"\n", b"\r"), ()
    yield "OBJ, a face over two lines", "x.obj", OBJ.replace(b"f 1 ", b"f \\\n1 ", 1), ()
    yield "OBJ, faces of 900 corners", "x.obj", _ring(900), ()
    named = {"_rels/.rels": RELATIONSHIPS.format("/3D/other.model"), "3D/other.model": _model()}
    yield "3MF, its model of another name", "x.3mf", archive(named), ()
    named = {"_rels/.rels": RELATIONSHIPS.format("mine/part.xml"), "mine/part.xml": _model()}
    yield "3MF, its model in another folder", "x.3mf", archive(named), ()
    for head in ("data:application/octet-stream;base64,", "data:;base64,"):
        yield f"GLB, its data as {head}", "x.glb", _own_data(head + "{}"), ()
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


def _bomb(box: Path, base: Base) -> None:
    """A model of 1.1 GB of spaces, in a small file."""
    with (
        zipfile.ZipFile(box / "x.3mf", "w", zipfile.ZIP_DEFLATED) as archive,
        archive.open("3D/3dmodel.model", "w") as file,
    ):
        for _ in range(1100):
            file.write(b" " * 1_000_000)


def _laid(name: str, lay: Callable[[Path], object]) -> Make:
    def make(box: Path, base: Base) -> None:
        lay(box / name)

    return make


ODD_FILES: tuple[tuple[str, Callable[[Path], object]], ...] = (
    ("a FIFO", os.mkfifo),
    ("a folder", Path.mkdir),
    ("a device", lambda path: path.symlink_to("/dev/zero")),
)


def cases() -> Iterator[Case]:
    for name, file, content in _bad():
        yield Case(f"solid: {name}", ("press", file, *OUT), holding(file, content))
    yield Case("solid: 3MF, a bomb", ("press", "x.3mf", *OUT), _bomb, "x.3mf")
    for suffix in ("stl", "obj", "ply", "3mf", "glb", "step"):
        for name, lay in ODD_FILES:
            file = f"x.{suffix}"
            yield Case(f"{suffix}: {name}", ("press", file, *OUT), _laid(file, lay), file)
    for name, file, content, says in BAD_NUMBERS:
        yield Case(f"solid: {name}", ("press", file, *OUT), holding(file, content), says)
    for name, file, content, more in _good():
        words = ("press", file, *OUT, *more)
        yield Case(f"solid: {name}", words, holding(file, content), fine=True)
    for scale in ("0", "-1", "nan", "inf", "1e30", "1e-30"):
        words = ("press", "x.stl", *OUT, "--scale", scale)
        yield Case(f"solid: scale {scale}", words, holding("x.stl", STL))
    yield Case("a scale of a catalogue's shape", ("press", "circle-1", *OUT, "--scale", "2"))
