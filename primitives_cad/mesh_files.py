"""Reads solids from STL, OBJ, PLY, 3MF, GLB and STEP files, and writes binary STL.

OBJ and 3MF are read here: trimesh 5.2 returns wrong faces of OBJ without an error (notches, corners
counted back), and needs lxml for 3MF. A reader returns the mesh and its unit, mm.
"""

import json
import math
import re
import zipfile
from array import array
from codecs import BOM_UTF8
from dataclasses import dataclass, field
from io import BytesIO
from pathlib import Path
from typing import IO, TYPE_CHECKING
from xml.etree import ElementTree

import numpy as np

from t2twin.core import arguments
from t2twin.core.errors import T2TwinError
from t2twin.core.files import read_file

if TYPE_CHECKING:
    import trimesh

    Read = tuple[trimesh.Trimesh, float]

MAX_BYTES = 500_000_000  # size limit of files, bytes (assumed: about 2 million triangles as text)
MAX_TRIANGLES = 2_000_000  # of a file (assumed: finer than any print, and minutes of computing)
MAX_PLACES = 10_000  # placements of parts of a 3MF file, which may refer to themselves (assumed)
# largest coordinate, in the file's units (assumed: corners lose precision beyond it)
FARTHEST = 1e10
FLAT = 1e-9  # share of a face's area below which one of its triangles counts as a line (assumed)
FOLD_RAD = math.pi - 1e-3  # least angle between neighboring triangles of a folded face (assumed)
# Least sides of a solid seen from above. The contact solver missed posts of 0.3 mm and blades of
# 0.1 mm at some of ten poses, and none of these; the contact area on a gel was within 3 %.
SMALLEST_MM, NARROWEST_MM = 0.5, 0.2

LARGEST_MM = 1000.0  # largest size of a solid, mm (assumed: larger ones are in other units)
# largest size of what a hand holds (assumed); files up to half a unit are likely in meters
HAND_MM = 500.0
METER_MM, INCH_MM = 1000.0, 25.4

INCHES = re.compile(rb"\binch(es)?\b", re.IGNORECASE)  # words of a file for its unit
HEAD_BYTES = 2000  # bytes from the start of a file in which its unit may be named (assumed)
STL_HEADER_BYTES = 84  # of binary STL: 80 of text, then the number of triangles
# one triangle of binary STL
STL_RECORD = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])
STL_CORNER = re.compile(rb"^\s*vertex\b", re.IGNORECASE | re.MULTILINE)  # a corner in text STL
PLY_FACES = re.compile(rb"^element face (\d+)", re.MULTILINE)  # the number of faces in PLY
UPRIGHT = np.array([[1, 0, 0], [0, 0, -1], [0, 1, 0]])  # from glTF's y up (glTF 2.0, 3.4) to z up
GLTF_FAN = 6  # mode of fans of triangles, which trimesh skips (glTF 2.0, 3.7.2)
# starts of the names of extensions of glTF that leave triangles as they are
APPEARANCE = ("KHR_materials_", "KHR_texture_", "KHR_lights_", "EXT_texture_", "MSFT_texture_")
# Units of a 3MF model; the default is millimeter (3MF Core Specification 1.3, 3.4).
UNITS_MM = {"micron": 0.001, "millimeter": 1.0, "centimeter": 10.0, "inch": 25.4, "foot": 304.8,
            "meter": 1000.0}  # fmt: skip

CORE = "{http://schemas.microsoft.com/3dmanufacturing/core/2015/02}"
PRODUCTION = "http://schemas.microsoft.com/3dmanufacturing/production/2015/06"

KNOWN_EXTENSIONS = (  # that a 3MF model may require: the others change its triangles
    PRODUCTION,
    "http://schemas.microsoft.com/3dmanufacturing/material/2015/02",
    "http://schemas.microsoft.com/3dmanufacturing/trianglesets/2021/07",
)
PRESSED = ("model", "surface")  # types of 3MF objects that are part of the shape; supports are not
START = "3D/3dmodel.model"  # name of the 3MF model with the build instructions
NOT_READ = "it requires the extension {}, which is not read; export it without"


@dataclass(frozen=True)
class Hints:
    """How hints name a scale and the option that centers a shape."""

    scale: str = "--scale {:g}"
    center: str = "--center"


COMMAND_HINTS = Hints()


def read_bytes(path: Path) -> bytes:
    """A file's content. Raises T2TwinError where it is missing, unreadable, empty or too large."""
    otherwise = f"give a catalogue name or a file of {', '.join(SUFFIXES)}"
    content = read_file(path, MAX_BYTES, otherwise)
    if not content:
        raise T2TwinError(f"{path} is empty; give the file of a solid")
    return content


def read_solid(
    path: Path, scale: float | None = None, hints: Hints = COMMAND_HINTS
) -> tuple["trimesh.Trimesh", tuple[str, ...]]:
    """The solid or surface in a file, mm, with its top at 0 and centered, and sentences about it.

    Several bodies form one shape. scale: mm per unit of the file, of STEP a factor; None for the
    file's own unit (3MF, GLB, STEP), else 1. Raises T2TwinError for a file that cannot be pressed.
    """
    from t2twin.primitives_cad.mesh_repair import close_mesh

    if scale is not None:
        scale = arguments.real(scale, "scale")
        if not (math.isfinite(scale) and scale > 0.0):
            raise T2TwinError(f"a scale of {scale:g} cannot be used; positive numbers are allowed")
    suffix = path.suffix.lower()
    if suffix not in READERS:
        raise T2TwinError(f"{path} is not a solid's file; one of {', '.join(SUFFIXES)} is needed")
    head = read_bytes(path)[:HEAD_BYTES]
    kind = suffix[1:].upper()
    try:
        mesh, unit_mm = READERS[suffix](path)
    except Exception as error:  # readers raise many unrelated types
        words = f"it is damaged or not {kind}"
        if isinstance(error, ValueError):
            words = str(error).strip().splitlines()[0]
        raise T2TwinError(f"{path} cannot be read as {kind}: {words}") from error
    of_file = mesh.metadata.get("note")
    _resize(path, mesh, unit_mm if scale is None else scale, INCHES.search(head), hints)
    mesh, repaired = close_mesh(mesh)
    low, high = mesh.bounds
    middle = (low + high) / 2.0
    mesh.apply_translation((-middle[0], -middle[1], -high[2]))
    return mesh, tuple(f"{path} {clause}" for clause in (of_file, repaired) if clause)


def _resize(
    path: Path, mesh: "trimesh.Trimesh", unit_mm: float, in_inches: object, hints: Hints
) -> None:
    """Scale a mesh to mm. Raises T2TwinError for a size that cannot be pressed."""
    sides = np.ptp(mesh.vertices, axis=0)
    if sides[:2].min() == 0.0:
        raise T2TwinError(
            f"{path} is flat: it has no {'xy'[int(sides[:2].argmin())]}; a surface that is seen "
            "from above (+z) is needed"
        )
    if not _fits(sides, unit_mm):
        width, length, height = (float(side) * unit_mm for side in sides)
        raise T2TwinError(
            f"{path} is {width:g} x {length:g} mm seen from above and {height:g} mm high; at least "
            f"{SMALLEST_MM:g} x {NARROWEST_MM:g} mm and at most {LARGEST_MM:g} mm are allowed"
            + _scale_hint(sides, unit_mm, bool(in_inches), hints)
        )
    if unit_mm != 1.0:
        mesh.apply_scale(unit_mm)


def _fits(sides: np.ndarray, unit_mm: float) -> bool:
    narrow, wide = sorted(sides[:2] * unit_mm)
    return narrow >= NARROWEST_MM and wide >= SMALLEST_MM and sides.max() * unit_mm <= LARGEST_MM


def _scale_hint(sides: np.ndarray, unit_mm: float, in_inches: bool, hints: Hints) -> str:
    """A clause with a likely scale of too small sides (3,), in the file's units."""
    largest = float(sides.max())
    name, scale = ("inches", INCH_MM) if in_inches else ("meters", METER_MM)
    is_likely = in_inches or largest * scale <= HAND_MM
    if largest * unit_mm > LARGEST_MM or not is_likely or not _fits(sides, scale):
        return ""
    option = hints.scale.format(scale)
    return f"; if it is in {name}, {option} makes it {largest * scale:g} mm large"


def _mesh(corners: np.ndarray, faces: np.ndarray) -> "trimesh.Trimesh":
    """The mesh of triangles (m, 3) of corners (n, 3), with equal corners merged."""
    import trimesh

    if not len(faces):
        raise ValueError("it holds no triangles, or is cut short")
    if len(faces) > MAX_TRIANGLES:
        raise ValueError(f"it has more than the {MAX_TRIANGLES:,} triangles that are allowed")
    _check_indices(faces, corners)
    used, numbers = np.unique(faces, return_inverse=True)  # scans have unused corners that are NaN
    corners = np.asarray(corners, np.float64)[used]
    if not (np.abs(corners) <= FARTHEST).all():
        raise ValueError(f"it has corners that are not numbers, or farther out than {FARTHEST:g}")
    return trimesh.Trimesh(corners, numbers.reshape(-1, 3))


def _check_indices(faces: np.ndarray, corners: np.ndarray) -> None:
    if faces.min() < 0 or faces.max() >= len(corners):
        raise ValueError("its faces name corners that it lacks")


def _loaded(content: bytes, kind: str) -> "trimesh.Trimesh":
    """What trimesh reads, all bodies in their places."""
    import trimesh

    # Without a resolver, it opens no other files.
    scene = trimesh.load_scene(BytesIO(content), file_type=kind, process=False, skip_materials=True)
    return scene.to_mesh()


def _stl(path: Path) -> "Read":
    """The triangles of binary or text STL. trimesh skips solids that are cut short."""
    content = path.read_bytes().removeprefix(BOM_UTF8)
    mesh = _loaded(content, "stl")
    number = int.from_bytes(content[STL_HEADER_BYTES - 4 : STL_HEADER_BYTES], "little")
    is_binary = len(content) == STL_HEADER_BYTES + number * STL_RECORD.itemsize
    if not is_binary and len(STL_CORNER.findall(content)) != 3 * len(mesh.faces):
        raise ValueError("it is cut short: some of its triangles are not whole")
    return _mesh(mesh.vertices, mesh.faces), 1.0


def binary_stl(vertices: np.ndarray, faces: np.ndarray) -> bytes:
    """A binary STL file. vertices: (n, 3), mm. faces: (m, 3), counterclockwise from outside."""
    corners = np.asarray(vertices)[np.asarray(faces)]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    lengths = np.linalg.norm(normals, axis=1, keepdims=True)
    records = np.zeros(len(corners), STL_RECORD)
    records["normal"] = np.divide(normals, lengths, out=np.zeros_like(normals), where=lengths > 0)
    records["corners"] = corners
    return bytes(STL_HEADER_BYTES - 4) + np.uint32(len(corners)).tobytes() + records.tobytes()


def _obj(path: Path) -> "Read":
    """The faces of OBJ; their corners are counted from 1, or back from the last one so far."""
    text = path.read_bytes().removeprefix(BOM_UTF8).decode("latin-1")
    flat = array("d")
    polygons: dict[int, array[int]] = {}
    for line in re.sub(r"\\\r?\n", " ", text).splitlines():
        match line.split():
            case ["v", x, y, z, *_]:
                flat.extend((float(x), float(y), float(z)))
            case ["f", *fields] if len(fields) >= 3:
                numbers = (int(each.partition("/")[0]) for each in fields)
                last = len(flat) // 3
                polygon = [number - 1 if number >= 0 else last + number for number in numbers]
                polygons.setdefault(len(polygon), array("q")).extend(polygon)
            case ["v" | "f", *_]:
                raise ValueError(f"it has a line that is cut short: {line[:80]!r}")
    corners = np.array(flat).reshape(-1, 3)
    faces = [_fans(np.array(polygons[n]).reshape(-1, n), corners) for n in sorted(polygons)]
    return _mesh(corners, np.concatenate(faces) if faces else np.zeros((0, 3), int)), 1.0


def _fans(polygons: np.ndarray, corners: np.ndarray) -> np.ndarray:
    """Triangles (m, 3) of polygons (k, n): fans from a corner that sees all others."""
    _check_indices(polygons, corners)
    cut, waiting = [], polygons
    for _ in range(polygons.shape[1]):
        spokes = corners[waiting[:, 1:]] - corners[waiting[:, :1]]
        areas = np.cross(spokes[:, :-1], spokes[:, 1:])
        whole = areas.sum(axis=1, keepdims=True)
        along = (areas * whole).sum(axis=2)
        folded = (along < -FLAT * (whole**2).sum(axis=2)).any(axis=1)
        fans = waiting[~folded]
        first = np.broadcast_to(fans[:, :1], fans[:, 2:].shape)
        cut.append(np.stack([first, fans[:, 1:-1], fans[:, 2:]], axis=-1).reshape(-1, 3))
        waiting = np.roll(waiting[folded], -1, axis=1)
    if len(waiting):
        raise ValueError("it has faces with notches; export it with triangles for faces")
    return np.concatenate(cut)


def _ply(path: Path) -> "Read":
    """The faces of PLY. trimesh cuts larger ones without regard to notches."""
    content = path.read_bytes()
    try:
        mesh = _loaded(content, "ply")
    except ValueError as error:
        words = str(error).rstrip(".!")
        raise ValueError(
            f"{words}; faces of a binary file must have one number of corners"
        ) from error
    announced = PLY_FACES.search(content)
    are_triangles = announced is not None and int(announced[1]) == len(mesh.faces)
    if not are_triangles and (mesh.face_adjacency_angles > FOLD_RAD).any():
        raise ValueError("it has faces with notches; export it with triangles for faces")
    return _mesh(mesh.vertices, mesh.faces), 1.0


def _glb(path: Path) -> "Read":
    """The triangles of GLB with z up. trimesh skips fans, and reads compressed corners as 0."""
    content = path.read_bytes()
    about = json.loads(content[20 : 20 + int.from_bytes(content[12:16], "little")])
    for name in about.get("extensionsRequired", ()):
        if not name.startswith(APPEARANCE):
            raise ValueError(NOT_READ.format(name))
    if any("uri" in each and not each["uri"].startswith("data:") for each in about["buffers"]):
        raise ValueError("it keeps its triangles in another file; all must be in one")
    accessors = about.get("accessors", ())
    if any("sparse" in each or "bufferView" not in each for each in accessors):
        raise ValueError("its triangles are compressed; export it without compression")
    if any(each.get("mode") == GLTF_FAN for mesh in about["meshes"] for each in mesh["primitives"]):
        raise ValueError("it has fans of triangles, which are not read; export it without")
    mesh = _loaded(content, "glb")
    return _mesh(mesh.vertices @ UPRIGHT.T, mesh.faces), METER_MM


@dataclass
class _Part:
    """A part of 3MF. corners: flat x, y, z. faces: flat corner indices. places: placed parts."""

    corners: array = field(default_factory=lambda: array("d"))
    faces: array = field(default_factory=lambda: array("q"))
    places: list["_Place"] = field(default_factory=list)


_Place = tuple[tuple[str, str], np.ndarray]
"""A part's model and number, and the transform (4, 4) to the frame of what contains it."""


def _threemf(path: Path) -> "Read":
    """The built parts of 3MF: a ZIP archive of XML models (3MF Core Specification 1.3)."""
    parts: dict[tuple[str, str], _Part] = {}
    waiting, unit_mm = [], 1.0
    with zipfile.ZipFile(path) as archive:
        for name in archive.namelist():
            if name.lower().endswith(".model"):
                with archive.open(name) as file:
                    built, unit = _model_parts(file, name, parts)
                if name.lower() == START.lower():
                    waiting, unit_mm = built, unit
    corners, faces, seen, number = [np.zeros((0, 3))], [np.zeros((0, 3), int)], 0, 0
    while waiting:
        key, transform = waiting.pop()
        seen += 1
        if seen > MAX_PLACES:
            raise ValueError(f"its parts stand at more than the {MAX_PLACES:,} allowed places")
        if key not in parts:
            raise ValueError(f"it builds part {key[1]}, which it lacks")
        part = parts[key]
        waiting += [(inner, transform @ place) for inner, place in part.places]
        own = np.array(part.corners).reshape(-1, 3)
        rows = np.array(part.faces, np.int64).reshape(-1, 3)
        if len(rows):
            _check_indices(rows, own)
        mirrored = np.linalg.det(transform[:3, :3]) < 0.0
        corners.append(own @ transform[:3, :3].T + transform[:3, 3])
        faces.append(number + (rows[:, ::-1] if mirrored else rows))
        number += len(own)
    return _mesh(np.concatenate(corners), np.concatenate(faces)), unit_mm


def _model_parts(
    file: IO[bytes], model: str, parts: dict[tuple[str, str], _Part]
) -> tuple[list[_Place], float]:
    """Add the parts of a 3MF model; what it builds, and its unit in mm."""
    part, built, unit_mm, namespaces = _Part(), [], 1.0, {}
    for event, element in ElementTree.iterparse(file, ("start-ns", "end")):
        if event == "start-ns":
            namespaces[element[0]] = element[1]
            continue
        about = element.attrib
        match element.tag.removeprefix(CORE):
            case "vertex":
                part.corners.extend(float(about[axis]) for axis in "xyz")
            case "triangle":
                part.faces.extend(int(about[corner]) for corner in ("v1", "v2", "v3"))
            case "component":
                part.places.append(_place(about, model))
            case "object":
                pressed = about.get("type", "model") in PRESSED
                parts[model, about["id"]] = part if pressed else _Part()
                part = _Part()
            case "item":
                built.append(_place(about, model))
            case "model":
                unit = about.get("unit", "millimeter")
                if unit not in UNITS_MM:
                    raise ValueError(f"its unit {unit!r} is not one of {', '.join(UNITS_MM)}")
                unit_mm = UNITS_MM[unit]
                for prefix in about.get("requiredextensions", "").split():
                    if (name := namespaces.get(prefix, prefix)) not in KNOWN_EXTENSIONS:
                        raise ValueError(NOT_READ.format(name))
        element.clear()
    return built, unit_mm


def _place(about: dict[str, str], model: str) -> _Place:
    """The placement that an element's attributes name."""
    transform = np.eye(4)
    if "transform" in about:
        transform[:3] = np.array(about["transform"].split(), np.float64).reshape(4, 3).T
    model = about.get(f"{{{PRODUCTION}}}path", model).removeprefix("/")
    return (model, about["objectid"]), transform


def _step(path: Path) -> "Read":
    """The solids of STEP, or its surfaces without solids, as one mesh in mm; it may have gaps."""
    import cadquery as cq
    import trimesh
    from OCP.Message import Message  # pyright: ignore[reportAttributeAccessIssue]

    from t2twin.primitives_cad import solids

    kernel = Message.DefaultMessenger_s()
    for printer in list(kernel.Printers()):  # it prints to standard output
        kernel.RemovePrinter(printer)
    content = cq.importers.importStep(str(path))
    found = content.solids().vals()
    mesh: trimesh.Trimesh = trimesh.util.concatenate(  # pyright: ignore[reportAssignmentType]
        [_mesh(*solids.triangles_of(each)) for each in found or content.faces().vals()]  # pyright: ignore[reportArgumentType]
    )
    if len(found) > 1:
        mesh.metadata["note"] = f"contains {len(found)} solids, which are pressed as one shape"
    return mesh, 1.0


READERS = {".stl": _stl, ".obj": _obj, ".ply": _ply, ".3mf": _threemf, ".glb": _glb,
           ".step": _step, ".stp": _step}  # fmt: skip
SUFFIXES = tuple(READERS)
