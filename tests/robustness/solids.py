"""Solids from files of six formats, as other programs write them. What is refused is in
tests/test_mesh_repair.py."""

import os
from collections.abc import Iterator

import trimesh
from cases import Case, Content, laid
from solid_files import box, model, obj_text, part, threemf_of, y_up


def exported(mesh: trimesh.Trimesh, kind: str) -> bytes:
    content = mesh.export(file_type=kind)
    assert isinstance(content, bytes)  # some formats of trimesh are dictionaries
    return content


BOX = box(at=(0.0, 0.0, 0.0))
STL, OBJ = exported(BOX, "stl"), obj_text(BOX)
MATERIAL = "http://schemas.microsoft.com/3dmanufacturing/material/2015/02"
MODEL = model(part(1, BOX), '<item objectid="1"/>')

SOLIDS: dict[str, Content] = {
    "stl": STL, "obj": OBJ, "ply": exported(BOX, "ply"),
    "3mf": lambda path: threemf_of(path, MODEL),
    "glb": exported(y_up(box(unit_mm=1000.0)), "glb"), "step": b"ISO-10303-21;",
}  # fmt: skip
"""A file of each format; STEP is not complete."""

GOOD: dict[str, tuple[Content, ...]] = {
    "--scale 1000 x.stl": (exported(box(at=(0.0, 0.0, 0.0), unit_mm=1000.0), "stl"),),
    "x.obj": (f"mtllib ../../etc/passwd\n{OBJ}", OBJ.replace("\n", "\r\n"), f"\ufeff{OBJ}",
              OBJ.replace("\n", "\r"), OBJ.replace("f 1 ", "f \\\n1 ", 1)),
    "x.3mf": (lambda path: threemf_of(path, MODEL.replace(
        "<model ", f'<model xmlns:m="{MATERIAL}" requiredextensions="m" ')),),
    **dict.fromkeys(("'$\\foo_{$.stl'", os.fsdecode(b"caf\xe9.stl"), "./--out.stl",
                     "square-2.stl", "x.STL"), (STL,)),
}  # fmt: skip
"""Valid contents by the end of the command."""


def cases() -> Iterator[Case]:
    for words, contents in GOOD.items():
        for content in contents:
            make = laid({words.split()[-1].strip("'"): content})
            press = f"press --sensor digit --out out {words}"
            yield Case(f"valid {words!r}", press, make, fine=True)
