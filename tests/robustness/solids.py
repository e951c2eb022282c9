"""Files of solids of six formats; what is refused in them is in tests/test_mesh_files.py."""

import trimesh
from cases import Content
from solid_files import box, model, obj_text, part, threemf_of, y_up


def exported(mesh: trimesh.Trimesh, kind: str) -> bytes:
    content = mesh.export(file_type=kind)
    assert isinstance(content, bytes)  # some formats of trimesh are dictionaries
    return content


BOX = box(at=(0.0, 0.0, 0.0))
STL, OBJ = exported(BOX, "stl"), obj_text(BOX)
MODEL = model(part(1, BOX), '<item objectid="1"/>')

SOLIDS: dict[str, Content] = {
    "stl": STL, "obj": OBJ, "ply": exported(BOX, "ply"),
    "3mf": lambda path: threemf_of(path, MODEL),
    "glb": exported(y_up(box(unit_mm=1000.0)), "glb"), "step": b"ISO-10303-21;",
}  # fmt: skip
"""A file of each format; STEP is not complete."""
