"""Solids from files of six formats: damaged, open, of no size; and odd valid ones."""

import io
import json
import os
import struct
import zipfile
from collections.abc import Iterator
from typing import Any

import numpy as np
import trimesh
from cases import Case, Content, laid
from pictures import PNG

PRESS = "press --sensor digit --out out "


def _block(*sides: float) -> trimesh.Trimesh:
    return trimesh.creation.box(sides or (6.0, 4.0, 3.0))


def _exported(mesh: trimesh.Trimesh, kind: str) -> bytes:
    content = mesh.export(file_type=kind)
    assert isinstance(content, str | bytes)  # some formats of trimesh are dictionaries
    return content.encode() if isinstance(content, str) else content


def _binary(triangles: np.ndarray, announced: int | None = None) -> bytes:
    """A binary STL of (n, 3, 3) corners."""
    count = len(triangles) if announced is None else announced
    rows = (struct.pack("<12fH", 0, 0, 1, *corners.ravel(), 0) for corners in triangles)
    return bytes(80) + struct.pack("<I", count) + b"".join(rows)


def _moved(value: float) -> bytes:
    corners = _block().triangles.copy()
    return _binary(np.where(corners == corners.max(), value, corners))


def _part(faces: slice) -> bytes:
    mesh = trimesh.creation.icosphere(3, 5.0)
    mesh.update_faces(np.isin(np.arange(len(mesh.faces)), np.arange(len(mesh.faces))[faces]))
    return _exported(mesh, "stl")


STL, ASCII = _exported(_block(), "stl"), _exported(_block(), "stl_ascii")
OBJ, PLY, GLB = (_exported(_block(), kind) for kind in ("obj", "ply", "glb"))


LENGTH = struct.unpack("<I", GLB[12:16])[0]
DESCRIBED = json.loads(GLB[20 : 20 + LENGTH])


def _glb(change: dict[str, Any]) -> bytes:
    """The block as GLB with another description."""
    text = json.dumps(DESCRIBED | change).encode()
    text += b" " * (-len(text) % 4)
    rest = GLB[20 + LENGTH :]
    head = struct.pack("<4sII", b"glTF", 2, 20 + len(text) + len(rest))
    return head + struct.pack("<I4s", len(text), b"JSON") + text + rest


def _node(**node: object) -> bytes:
    return _glb({"nodes": [{"mesh": 0, **node}], "scenes": [{"nodes": [0]}], "scene": 0})


def _of(key: str, **change: object) -> bytes:
    """The block as GLB with a changed first entry of a list."""
    first, *others = DESCRIBED[key]
    return _glb({key: [first | change, *others]})


MODEL = """<?xml version="1.0"?><model unit="UNIT"
xmlns="http://schemas.microsoft.com/3dmanufacturing/core/2015/02"><resources><object id="1"
type="model"><mesh><vertices>{}</vertices><triangles>{}</triangles></mesh></object>MORE</resources>
<build><item objectid="1"/></build></model>""".format(
    "".join(f'<vertex x="{x}" y="{y}" z="{z}"/>' for x, y, z in _block().vertices) + "CORNER",
    "".join(f'<triangle v1="{a}" v2="{b}" v3="{c}"/>' for a, b, c in _block().faces),
)
ENTITIES = '<?xml version="1.0"?><!DOCTYPE m [<!ENTITY a "aaaaaaaaaa">' + "".join(
    f'<!ENTITY {b} "{f"&{a};" * 10}">' for a, b in zip("abcdefgh", "bcdefghi", strict=True)
) + "]><model>&i;</model>"  # fmt: skip


def _model(unit: str = "millimeter", corner: str = "", more: str = "", place: str = "") -> str:
    """The block as a 3MF model. place: transform of its item."""
    text = MODEL.replace("UNIT", unit).replace("CORNER", corner).replace("MORE", more)
    return text.replace("<item", f'<item transform="{place}"') if place else text


def _3mf(model: str | None = None) -> bytes:
    file = io.BytesIO()
    with zipfile.ZipFile(file, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("3D/3dmodel.model", _model() if model is None else model)
    return file.getvalue()


SOLIDS: dict[str, Content] = {"stl": STL, "obj": OBJ, "ply": PLY, "3mf": _3mf(), "glb": GLB,
                              "step": b"ISO-10303-21;"}  # fmt: skip
"""A file of each format; STEP is not complete."""

BEAMS = "http://schemas.microsoft.com/3dmanufacturing/beamlattice/2017/02"
MATERIALS = "http://schemas.microsoft.com/3dmanufacturing/material/2015/02"
REQUIRES = '<model requiredextensions="y" '


def _required(name: str) -> str:
    """The block as a 3MF model that requires an extension."""
    return _model().replace("<model ", f'<model xmlns:x="{name}" requiredextensions="x" ')


WITHIN = '<object id="2"><components><component objectid="2"/></components></object>'
SMALL = {"nodes": [{"mesh": 0, "scale": [1e-3] * 3}], "scenes": [{"nodes": [0]}], "scene": 0}
LOOP = {"nodes": [{"mesh": 0, "children": [0]}], "scenes": [{"nodes": [0]}], "scene": 0}
TURNED = "1 0 0 0 1 0 0 0 1 0 0 "

BAD: dict[str, tuple[tuple[Content, str], ...]] = {
    "obj": (
        *((OBJ.replace(b"v ", b"v %s 0 0\nv " % value, 1), says) for value, says in (
            (b"nan", "not numbers"), (b"inf", "not numbers"), (b"1e999", "not numbers"),
            (b"1e300", "farther out"), (b"x", ""))),
        (OBJ.replace(b".", b","), "three numbers"), (OBJ[: len(OBJ) // 3], ""),
        (OBJ + b"v" + b" 1" * 1_000_000, "characters"), (OBJ + b"v 1 \0 2\n", "three numbers"),
        *((OBJ + b"f 1 2 " + face, says) for face, says in (
            (b"1" + b"0" * 30, "lacks"), (b"-1" + b"0" * 30, "lacks"), (b"nan", "whole numbers"),
            (b"//", "whole numbers"), (b"99", ""), (b"0", ""))),
    ),
    "stl": (
        *((ASCII.replace(b"vertex ", b"vertex %s 0 0\nx" % value, 1), "not numbers")
          for value in (b"nan", b"1e400")),
        (ASCII.replace(b".", b","), "not numbers"), (ASCII[: len(ASCII) // 2], ""),
        (_binary(_block().triangles, 2**32 - 1), ""), (_binary(_block().triangles[:0]), ""),
        *((_moved(value), "") for value in (np.nan, np.inf, 1e38)),
        (_binary(np.ones((12, 3, 3))), ""),
        *((_exported(_block(*sides), "stl"), "") for sides in (
            (0.25, 0.25, 0.25), (0.03, 0.02, 0.01), (2000.0, 10.0, 10.0))),
    ),
    "3mf": (
        *((_3mf(_model(corner=f'<vertex x="{x}" y="0" z="0"/>')), says) for x, says in (
            ("nan", "not numbers"), ("inf", "not numbers"), ("1e300", "farther out"), ("a", ""))),
        (_3mf(_model(corner='<vertex x="1" y="0"/>')), "lacks z"),
        *((_3mf(_model(place=place)), says) for place, says in (
            (TURNED + "nan", "not finite"), (TURNED + "inf", "not finite"), ("here", "12 numbers"),
            (TURNED + "1e300", "farther out"), (TURNED, "12 numbers"))),
        (_3mf(_model(more=WITHIN).replace('<item objectid="1"', '<item objectid="2"')), "allowed"),
        (_3mf(_model(more='<object id="2"/>' * 20_000)), "parts"), (_3mf(""), ""),
        (_3mf(_model("furlong")), "furlong"), (_3mf("<model>"), ""), (_3mf(ENTITIES), ""),
        (_3mf(_model().replace('v1="0"', f'v1="{10**30}"', 1)), "lacks"),
        (lambda path: path.write_bytes(_3mf(" " * 1_100_000_000)), "x.3mf"),
        (_3mf(_required("http://example.org/x")), "http://example.org/x"),
        (_3mf(_required(BEAMS)), "beamlattice"),
        (_3mf(_model().replace("<model ", REQUIRES)), "extension y,"),
    ),
    "glb": (
        (_node(matrix=[float("nan")] * 16), "damaged"), (_node(matrix=[1.0] * 15), "damaged"),
        (_node(translation=[1e300, 0, 0]), "farther out"), (_node(mesh=9), "damaged"),
        (_node(scale=[1e200] * 3, translation=[1e308, 0, 0]), "farther out"),
        (_node(rotation=["a"] * 4), "damaged"), (_glb(LOOP), "below itself"),
        *((_glb({"scenes": [{"nodes": [node]}]}), "damaged") for node in (9, -1)),
        *((_glb({"extensionsRequired": [name]}), "compressed") for name in (
            "KHR_draco_mesh_compression", "EXT_meshopt_compression", "KHR_mesh_quantization")),
        *((_glb({"extensionsRequired": [name]}), name) for name in (
            "EXT_mesh_gpu_instancing", "KHR_unknown")),
        (_of("accessors", sparse={"count": 1}), "compressed"),
        (_of("accessors", count=10**12), "damaged"), (_glb({"meshes": []}), ""),
        (_of("accessors", componentType=5130), "compressed"),
        *((_of("bufferViews", **{key: value}), "damaged") for key, value in (
            ("byteOffset", 10**9), ("byteStride", 0), ("byteLength", -1))),
        (GLB[:-4], "shorter"),
        (GLB[:4] + struct.pack("<I", 1) + GLB[8:], "version 1"),
        *((_glb({"buffers": [{"byteLength": size} | more]}), "") for size, more in (
            (100, {"uri": "/etc/passwd"}), (100, {"uri": "http://x.test/a"}), (10**12, {}))),
    ),
    "ply": (
        (PLY.replace(np.float32(-3).tobytes(), np.float32(np.nan).tobytes(), 1), "x.ply"),
        (PLY.replace(b"vertex 8", b"vertex 1000000000000"), ""),
    ),
    "step": ((PNG, ""),), "stp": ((b"text", ""), (PNG, "")), "FCStd": ((_3mf(), ""),),
    "": ((STL, ""),),
}  # fmt: skip
"""By the file's suffix: contents, and a part of the sentence."""


GOOD: dict[str, tuple[bytes, ...]] = {
    "x.stl": (STL, ASCII, b"\xef\xbb\xbf" + ASCII, _part(slice(0, 640)),
              _binary(_block().triangles[:8]),
              _exported(_block().apply_translation((1e3, -2e3, 5e2)), "stl"),
              _binary(_block().triangles[:, ::-1]), _part(slice(1, None))),
    "--scale 1000 x.stl": (_exported(_block(0.006, 0.004, 0.003), "stl"),),
    "x.obj": (OBJ, b"mtllib ../../etc/passwd\n" + OBJ, OBJ.replace(b"\n", b"\r\n"),
              b"\xef\xbb\xbf" + OBJ.partition(b"\n")[2], OBJ.replace(b"\n", b"\r"),
              OBJ.replace(b"f 1 ", b"f \\\n1 ", 1)),
    "x.ply": (PLY, PLY.replace(b"vertex_indices", b"vertex_index")),
    "x.glb": (_exported(_block(0.006, 0.004, 0.003), "glb"),
              _glb(SMALL | {"extensionsRequired": ["KHR_materials_unlit"]})),
    "x.3mf": (_3mf(), _3mf(_required(MATERIALS)), _3mf(_model().replace('"model"', '"surface"'))),
} | dict.fromkeys(("'$\\foo_{$.stl'", os.fsdecode(b"caf\xe9.stl"), "./--out.stl", "square-2.stl",
                   "x.STL"), (STL,))  # fmt: skip
"""Valid contents by the end of the command."""


def cases() -> Iterator[Case]:
    for suffix, contents in BAD.items():
        file = f"x.{suffix}".rstrip(".")
        for number, (content, says) in enumerate(contents):
            yield Case(f"{file} {number}: {says}", PRESS + file, laid({file: content}), says)
    for words, contents in GOOD.items():
        file = words.split()[-1].strip("'")
        for content in contents:
            yield Case(f"valid {words!r}", PRESS + words, laid({file: content}), fine=True)
    for scale in ("0", "-1", "nan", "inf", "1e30", "1e-30"):
        yield Case(f"scale {scale}", f"{PRESS} --scale {scale} x.stl", laid({"x.stl": STL}))
