"""Files of a user's solid, well made and otherwise, for tests to read."""

import json
import struct
import zipfile

import numpy as np
import trimesh

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


def glb_of(path, about, binary=b""):
    """A GLB file of this description and binary part."""
    text = about if isinstance(about, bytes) else json.dumps(about).encode()
    text += b" " * (-len(text) % 4)
    chunks = struct.pack("<II", len(text), 0x4E4F534A) + text
    if binary:
        chunks += struct.pack("<II", len(binary), 0x004E4942) + binary
    path.write_bytes(struct.pack("<4sII", b"glTF", 2, 12 + len(chunks)) + chunks)


def taken_apart(mesh):
    """A GLB file of a mesh as its description and its binary part."""
    content = bytes(mesh.export(file_type="glb"))
    length = int.from_bytes(content[12:16], "little")
    return json.loads(content[20 : 20 + length]), content[28 + length :]


def obj_text(mesh, faces=None):
    corners = [f"v {x} {y} {z}" for x, y, z in mesh.vertices]
    faces = mesh.faces + 1 if faces is None else faces
    return "\n".join([*corners, *("f " + " ".join(map(str, face)) for face in faces)]) + "\n"
