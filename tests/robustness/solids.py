"""Solids from files of six formats; tests/test_mesh_repair.py has more refusals."""

import io
import json
import os
import struct
import zipfile
from collections.abc import Iterator
from typing import Any

import trimesh
from cases import Case, Content, laid

PRESS = "press --sensor digit --out out "


def _block(*sides: float) -> trimesh.Trimesh:
    return trimesh.creation.box(sides or (6.0, 4.0, 3.0))


def _exported(mesh: trimesh.Trimesh, kind: str) -> bytes:
    content = mesh.export(file_type=kind)
    assert isinstance(content, str | bytes)  # some formats of trimesh are dictionaries
    return content.encode() if isinstance(content, str) else content


STL, ASCII, OBJ, PLY, GLB = (
    _exported(_block(), kind) for kind in ("stl", "stl_ascii", "obj", "ply", "glb")
)
LENGTH = struct.unpack("<I", GLB[12:16])[0]
DESCRIBED = json.loads(GLB[20 : 20 + LENGTH])


def _glb(**change: Any) -> bytes:
    """The block as GLB with another description."""
    text = json.dumps(DESCRIBED | change).encode()
    text += b" " * (-len(text) % 4)
    rest = GLB[20 + LENGTH :]
    head = struct.pack("<4sII", b"glTF", 2, 20 + len(text) + len(rest))
    return head + struct.pack("<I4s", len(text), b"JSON") + text + rest


def _node(**node: object) -> bytes:
    return _glb(nodes=[{"mesh": 0, **node}], scenes=[{"nodes": [0]}], scene=0)


def _of(key: str, **change: object) -> bytes:
    """The block as GLB with a changed first entry of a list."""
    first, *others = DESCRIBED[key]
    return _glb(**{key: [first | change, *others]})


MODEL = """<?xml version="1.0"?><model unit="UNIT"
xmlns="http://schemas.microsoft.com/3dmanufacturing/core/2015/02"><resources><object id="1"
type="model"><mesh><vertices>{}</vertices><triangles>{}</triangles></mesh></object>MORE</resources>
<build><item objectid="1"/></build></model>""".format(
    "".join(f'<vertex x="{x}" y="{y}" z="{z}"/>' for x, y, z in _block().vertices) + "CORNER",
    "".join(f'<triangle v1="{a}" v2="{b}" v3="{c}"/>' for a, b, c in _block().faces),
)


def _3mf(unit: str = "millimeter", corner: str = "", more: str = "", place: str = "",
         requires: str = "") -> bytes:  # fmt: skip
    """The block as 3MF. place: transform of its item. requires: an extension."""
    text = MODEL.replace("UNIT", unit).replace("CORNER", corner).replace("MORE", more)
    if place:
        text = text.replace("<item", f'<item transform="{place}"')
    if requires:
        text = text.replace("<model ", f'<model xmlns:x="{requires}" requiredextensions="x" ')
    return _zipped(text)


def _zipped(model: str) -> bytes:
    file = io.BytesIO()
    with zipfile.ZipFile(file, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("3D/3dmodel.model", model)
    return file.getvalue()


SOLIDS: dict[str, Content] = {"stl": STL, "obj": OBJ, "ply": PLY, "3mf": _3mf(), "glb": GLB,
                              "step": b"ISO-10303-21;"}  # fmt: skip
"""A file of each format; STEP is not complete."""

MICROSOFT = "http://schemas.microsoft.com/3dmanufacturing"
TURNED = "1 0 0 0 1 0 0 0 1 0 0 "
LOOP: dict[str, Any] = {"nodes": [{"mesh": 0, "children": [0]}], "scenes": [{"nodes": [0]}]}

BAD: dict[str, tuple[tuple[Content, str], ...]] = {
    "obj": (
        (OBJ.replace(b"v ", b"v 1e999 0 0\nv ", 1), "not numbers"),
        (OBJ.replace(b"v ", b"v 1e300 0 0\nv ", 1), "farther out"),
        (OBJ.replace(b".", b","), "three numbers"), (OBJ + b"v 1 \0 2\n", "three numbers"),
        (OBJ + b"v" + b" 1" * 1_000_000, "characters"), (OBJ + b"f 1 2 //", "whole numbers"),
    ),
    "stl": (
        (ASCII.replace(b"vertex ", b"vertex 1e400 0 0\nx", 1), "not numbers"),
        (ASCII[: len(ASCII) // 2], ""), (_exported(_block(2000.0, 10.0, 10.0), "stl"), ""),
    ),
    "3mf": (
        *((_3mf(corner=f'<vertex x="{x}" y="0" z="0"/>'), says) for x, says in (
            ("nan", "not numbers"), ("1e300", "farther out"), ("a", ""))),
        (_3mf(corner='<vertex x="1" y="0"/>'), "lacks z"),
        *((_3mf(place=place), says) for place, says in (
            (TURNED + "nan", "not finite"), ("here", "12 numbers"), (TURNED, "12 numbers"))),
        (_3mf(more='<object id="2"/>' * 20_000), "parts"),
        (_zipped(MODEL.replace('v1="0"', f'v1="{10**30}"', 1)), ""),
        (lambda path: path.write_bytes(_zipped(" " * 1_100_000_000)), "x.3mf"),
        (_3mf(requires="http://example.org/x"), "http://example.org/x"),
        (_3mf(requires=f"{MICROSOFT}/beamlattice/2017/02"), "beamlattice"),
    ),
    "glb": (
        (_node(matrix=[float("nan")] * 16), "damaged"), (_node(matrix=[1.0] * 15), "damaged"),
        (_node(translation=[1e300, 0, 0]), "farther out"), (_node(mesh=9), "damaged"),
        (_node(rotation=["a"] * 4), "damaged"), (_glb(**LOOP), "below itself"),
        *((_glb(extensionsRequired=[name]), says) for name, says in (
            ("KHR_draco_mesh_compression", "compressed"), ("KHR_unknown", "KHR_unknown"))),
        (_of("accessors", sparse={"count": 1}), "compressed"),
        *((_of("bufferViews", **{key: value}), "damaged") for key, value in (
            ("byteOffset", 10**9), ("byteStride", 0), ("byteLength", -1))),
        (GLB[:4] + struct.pack("<I", 1) + GLB[8:], "version 1"), (GLB[:-4], "shorter"),
        (_glb(buffers=[{"byteLength": 10**12}]), ""),
    ),
    "FCStd": ((_3mf(), ""),), "": ((STL, ""),),
}  # fmt: skip
"""By the file's suffix: contents, and a part of the sentence."""

GOOD: dict[str, tuple[bytes, ...]] = {
    "--scale 1000 x.stl": (_exported(_block(0.006, 0.004, 0.003), "stl"),),
    "x.obj": (b"mtllib ../../etc/passwd\n" + OBJ, OBJ.replace(b"\n", b"\r\n"),
              b"\xef\xbb\xbf" + OBJ.partition(b"\n")[2], OBJ.replace(b"\n", b"\r"),
              OBJ.replace(b"f 1 ", b"f \\\n1 ", 1)),
    "x.3mf": (_3mf(requires=f"{MICROSOFT}/material/2015/02"),),
} | dict.fromkeys(("'$\\foo_{$.stl'", os.fsdecode(b"caf\xe9.stl"), "./--out.stl", "square-2.stl",
                   "x.STL"), (STL,))  # fmt: skip
"""Valid contents by the end of the command."""


def cases() -> Iterator[Case]:
    for suffix, contents in BAD.items():
        file = f"x.{suffix}".rstrip(".")
        for number, (content, says) in enumerate(contents):
            make = laid({file: content})
            yield Case(f"{file} {number}: {says}", PRESS + file, make, says)
    for words, contents in GOOD.items():
        for content in contents:
            make = laid({words.split()[-1].strip("'"): content})
            yield Case(f"valid {words!r}", PRESS + words, make, fine=True)
