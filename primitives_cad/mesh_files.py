"""Reads solids from STL, OBJ, PLY, 3MF, GLB and STEP files, and closes small holes of their meshes.

OBJ, 3MF and holes have own code. trimesh 5.2 returns wrong faces of OBJ without an error (notches,
corners counted back), needs lxml for 3MF, and closes holes that touch at corners wrongly.
"""

import json
import math
import re
import zipfile
from array import array
from codecs import BOM_UTF8
from collections.abc import Iterable, Iterator
from io import BytesIO
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING, Any
from xml.etree import ElementTree

import numpy as np
import trimesh

from t2twin.core import arguments
from t2twin.core.errors import T2TwinError
from t2twin.core.files import read_file
from t2twin.primitives_cad.shape import STL_HEADER_BYTES, STL_RECORD, SUFFIXES

if TYPE_CHECKING:
    import cadquery as cq  # slow to import

Read = tuple[trimesh.Trimesh, float]  # a mesh and its unit, mm

CHORDAL_MM = 0.005  # error requested from the mesher (assumed: half of the documented 0.01 mm)
ANGULAR_RAD = 0.25  # largest angle between the normals of neighboring triangles, rad (assumed)
BEYOND_MM = 1.0e3  # a length beyond any primitive, mm
MAX_BYTES = 500_000_000  # size limit of files, bytes (assumed: about 2 million triangles as text)
MAX_TRIANGLES = 2_000_000  # of a file (assumed: finer than any print, and minutes of computing)
# largest coordinate, in the file's units (assumed: corners lose precision beyond it)
FARTHEST = 1e10
FLAT = 1e-9  # share of a face's area below which one of its triangles counts as a line (assumed)
FOLD_RAD = math.pi - 1e-3  # least angle between neighboring triangles of a folded face (assumed)
# Least sides of a solid seen from above. The contact solver missed posts of 0.3 mm and blades of
# 0.1 mm at some of ten poses, and none of these; the contact area on a gel was within 3 %.
SMALLEST_MM, NARROWEST_MM = 0.5, 0.2
LARGEST_MM = 1000.0  # largest size of a solid, mm (assumed: larger ones are in other units)
# Units of files that a scale makes mm.
UNITS = {"millimeters": 1.0, "micrometers": 0.001, "inches": 25.4, "meters": 1000.0}
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

# decimals of a mm of the corners of an open mesh (assumed; STL is single precision)
LOOSE_DIGITS = 4
HOLES_SHARE = 0.01  # largest share of the surface that closes holes (assumed: less than a face)
MAX_RIM_EDGES = 2000  # around closed holes (assumed: more is a surface, not a solid)
THINNEST_MM = 1e-6  # least volume over half the surface; thinner bodies are sheets (assumed)
UPPER = "its upper surface is pressed"


def read_bytes(path: Path) -> bytes:
    """A file's content. Raises T2TwinError where it is missing, unreadable, empty or too large."""
    otherwise = f"give a catalogue name or a file of {', '.join(SUFFIXES)}"
    content = read_file(path, MAX_BYTES, otherwise)
    if not content:
        raise T2TwinError(f"{path} is empty; give the file of a solid")
    return content


def read_solid(path: Path, scale: float | None = None) -> tuple[trimesh.Trimesh, tuple[str, ...]]:
    """The solid or surface in a file, mm, with its top at 0 and centered, and sentences about it.

    Several bodies form one shape. scale: mm per unit of the file, of STEP a factor; None for the
    file's own unit (3MF, GLB, STEP), else 1. Raises T2TwinError for a file that cannot be pressed.
    """
    if scale is not None:
        scale = arguments.real(scale, "scale")
        if not (math.isfinite(scale) and scale > 0.0):
            raise T2TwinError(f"a scale of {scale:g} cannot be used; positive numbers are allowed")
    suffix = path.suffix.lower()
    if suffix not in READERS:
        raise T2TwinError(f"{path} is not a solid's file; one of {', '.join(SUFFIXES)} is needed")
    read_bytes(path)
    kind = suffix[1:].upper()
    try:
        mesh, unit_mm = READERS[suffix](path)
    except Exception as error:  # readers raise many unrelated types
        words = f"it is damaged or not {kind}"
        if isinstance(error, ValueError):
            words = str(error).strip().splitlines()[0]
        raise T2TwinError(f"{path} cannot be read as {kind}: {words}") from error
    of_file = mesh.metadata.get("note")
    unit_mm = unit_mm if scale is None else scale
    _check_size(path, np.ptp(mesh.vertices, axis=0), unit_mm)
    if unit_mm != 1.0:
        mesh.apply_scale(unit_mm)
    mesh, repaired = close_mesh(mesh)
    low, high = mesh.bounds
    middle = (low + high) / 2.0
    mesh.apply_translation((-middle[0], -middle[1], -high[2]))
    return mesh, tuple(f"{path} {clause}" for clause in (of_file, repaired) if clause)


def _check_size(path: Path, sides: np.ndarray, unit_mm: float) -> None:
    """Raises T2TwinError for sides (3,) that cannot be pressed, with scales that fit."""
    if sides[:2].min() == 0.0:
        raise T2TwinError(
            f"{path} is flat: it has no {'xy'[int(sides[:2].argmin())]}; a surface that is seen "
            "from above (+z) is needed"
        )

    def fits(scale: float) -> bool:
        narrow, wide = sorted(sides[:2] * scale)
        is_seen = narrow >= NARROWEST_MM and wide >= SMALLEST_MM
        return is_seen and float(sides.max()) * scale <= LARGEST_MM

    if not fits(unit_mm):
        width, length, height = (float(side) * unit_mm for side in sides)
        case = "its millimeters are" if path.suffix.lower() in (".step", ".stp") else "it is in"
        scales = [f"{scale:g} if {case} {unit}" for unit, scale in UNITS.items() if fits(scale)]
        raise T2TwinError(
            f"{path} is {width:g} x {length:g} mm seen from above and {height:g} mm high; at least "
            f"{SMALLEST_MM:g} x {NARROWEST_MM:g} mm and at most {LARGEST_MM:g} mm are allowed"
            + (f"; another scale may fit: {', '.join(scales)}" if scales else "")
        )


def _mesh(corners: np.ndarray, faces: np.ndarray) -> trimesh.Trimesh:
    """The mesh of triangles (m, 3) of corners (n, 3), with equal corners merged."""
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


def _loaded(content: bytes, kind: str) -> trimesh.Trimesh:
    """What trimesh reads, all bodies in their places."""
    # Without a resolver, it opens no other files.
    scene = trimesh.load_scene(BytesIO(content), file_type=kind, process=False, skip_materials=True)
    return scene.to_mesh()


def _stl(path: Path) -> Read:
    """The triangles of binary or text STL. trimesh skips solids that are cut short."""
    content = path.read_bytes().removeprefix(BOM_UTF8)
    mesh = _loaded(content, "stl")
    number = int.from_bytes(content[STL_HEADER_BYTES - 4 : STL_HEADER_BYTES], "little")
    is_binary = len(content) == STL_HEADER_BYTES + number * STL_RECORD.itemsize
    if not is_binary and len(STL_CORNER.findall(content)) != 3 * len(mesh.faces):
        raise ValueError("it is cut short: some of its triangles are not whole")
    return _mesh(mesh.vertices, mesh.faces), 1.0


def _obj(path: Path) -> Read:
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


def _ply(path: Path) -> Read:
    """The faces of PLY. trimesh cuts larger ones without regard to notches."""
    content = path.read_bytes()
    mesh = _loaded(content, "ply")
    announced = PLY_FACES.search(content)
    are_triangles = announced is not None and int(announced[1]) == len(mesh.faces)
    if not are_triangles and (mesh.face_adjacency_angles > FOLD_RAD).any():
        raise ValueError("it has faces with notches; export it with triangles for faces")
    return _mesh(mesh.vertices, mesh.faces), 1.0


def _glb(path: Path) -> Read:
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
    return _mesh(mesh.vertices @ UPRIGHT.T, mesh.faces), UNITS["meters"]


def _threemf(path: Path) -> Read:
    """The built parts of 3MF: a ZIP archive of XML models (3MF Core Specification 1.3)."""
    with zipfile.ZipFile(path) as archive:
        texts = {n: archive.read(n) for n in archive.namelist() if n.lower().endswith(".model")}
    models = {name: ElementTree.fromstring(text) for name, text in texts.items()}
    for name, root in models.items():
        extensions = dict(re.findall(r'xmlns:(\w+)="([^"]+)"', texts[name].decode("latin-1")))
        for prefix in root.get("requiredextensions", "").split():
            if extensions.get(prefix) not in KNOWN_EXTENSIONS:
                raise ValueError(NOT_READ.format(extensions.get(prefix, prefix)))
    start = next(name for name in models if name.lower() == START.lower())
    unit = models[start].get("unit", "millimeter")
    if unit not in UNITS_MM:
        raise ValueError(f"its unit {unit!r} is not one of {', '.join(UNITS_MM)}")
    objects = {
        (name, part.get("id")): part
        for name, root in models.items()
        for part in root.iter(f"{CORE}object")
    }

    def placed(
        place: ElementTree.Element, model: str, outer: np.ndarray
    ) -> Iterator[tuple[np.ndarray, np.ndarray]]:
        """Corners (n, 3) and faces (m, 3) of the parts that an item or a component places."""
        transform = np.eye(4)
        if numbers := place.get("transform"):
            transform[:, :3] = np.array(numbers.split(), float).reshape(4, 3)
        transform = transform @ outer
        model = place.get(f"{{{PRODUCTION}}}path", model).removeprefix("/")
        key = model, place.get("objectid")
        if key not in objects:
            raise ValueError(f"it builds part {key[1]}, which it lacks")
        part = objects[key]
        if part.get("type", "model") not in PRESSED:
            return
        corners = [[each.attrib[axis] for axis in "xyz"] for each in part.iter(f"{CORE}vertex")]
        faces = [
            [each.attrib[corner] for corner in ("v1", "v2", "v3")]
            for each in part.iter(f"{CORE}triangle")
        ]
        if faces:
            rows, points = np.array(faces, int), np.array(corners, float).reshape(-1, 3)
            _check_indices(rows, points)
            mirrored = np.linalg.det(transform[:3, :3]) < 0.0
            moved = points @ transform[:3, :3] + transform[3, :3]
            yield moved, rows[:, ::-1] if mirrored else rows
        for each in part.iter(f"{CORE}component"):
            yield from placed(each, model, transform)

    items = models[start].iter(f"{CORE}item")
    built = [part for item in items for part in placed(item, start, np.eye(4))]
    if not built:
        raise ValueError("it builds no triangles")
    return _mesh(*trimesh.util.append_faces(*zip(*built, strict=True))), UNITS_MM[unit]


def _step(path: Path) -> Read:
    """The solids of STEP, or its surfaces without solids, as one mesh in mm; it may have gaps."""
    import cadquery as cq
    from OCP.Message import Message  # pyright: ignore[reportAttributeAccessIssue]

    kernel = Message.DefaultMessenger_s()
    for printer in list(kernel.Printers()):  # it prints to standard output
        kernel.RemovePrinter(printer)
    content = cq.importers.importStep(str(path))
    found = content.solids().vals()
    mesh: trimesh.Trimesh = trimesh.util.concatenate(  # pyright: ignore[reportAssignmentType]
        [_mesh(*triangles_of(each)) for each in found or content.faces().vals()]  # pyright: ignore[reportArgumentType]
    )
    if len(found) > 1:
        mesh.metadata["note"] = f"contains {len(found)} solids, which are pressed as one shape"
    return mesh, 1.0


def triangles_of(
    solid: "cq.Shape", chordal_mm: float = CHORDAL_MM
) -> tuple[np.ndarray, np.ndarray]:
    """Points (n, 3) mm and triangles (m, 3), with an error of about chordal_mm.

    Each face of the solid has its own points.
    """
    from OCP.BRepMesh import BRepMesh_IncrementalMesh  # pyright: ignore[reportAttributeAccessIssue]

    own = solid.copy()
    # CadQuery requests an error relative to each edge's length; here it is absolute, in mm.
    BRepMesh_IncrementalMesh(own.wrapped, chordal_mm, False, ANGULAR_RAD, True)
    # With such a tolerance CadQuery returns the existing mesh.
    vertices, faces = own.tessellate(BEYOND_MM)
    points = np.array([vertex.toTuple() for vertex in vertices], dtype=np.float64)
    return points.reshape(-1, 3), np.array(faces, dtype=np.int64).reshape(-1, 3)


def watertight(points: np.ndarray, triangles: np.ndarray) -> trimesh.Trimesh:
    """A mesh of points (n, 3) mm and triangles (m, 3), with coincident vertices merged."""
    mesh = trimesh.Trimesh(points, triangles, process=False)
    mesh.merge_vertices()
    mesh.update_faces((mesh.faces != np.roll(mesh.faces, 1, axis=1)).all(axis=1))
    mesh.remove_unreferenced_vertices()
    if not mesh.is_watertight or mesh.volume <= 0.0:
        raise T2TwinError("the solid's mesh is not closed; it must be a watertight solid")
    return mesh


READERS = dict(zip(SUFFIXES, (_stl, _obj, _ply, _threemf, _glb, _step, _step), strict=True))


def close_mesh(mesh: trimesh.Trimesh) -> tuple[trimesh.Trimesh, str | None]:
    """A mesh (mm), closed if possible, and a clause about closed holes or what stays open."""
    note = None
    if not mesh.is_watertight:
        loose = mesh.copy()
        loose.merge_vertices(digits_vertex=LOOSE_DIGITS)
        loose.update_faces(loose.nondegenerate_faces())
        single = loose.copy()
        single.update_faces(single.unique_faces())
        single.remove_unreferenced_vertices()
        if not len(single.faces):  # all triangles are smaller than the rounding
            return mesh, _openness(mesh)
        if single.is_watertight:
            mesh = single
        elif _balanced(loose):  # bodies that share edges or faces
            mesh = loose
        elif (filled := _filled(single)) is not None:
            mesh, note = filled
        else:
            return single, _openness(single)
    with np.errstate(invalid="ignore", divide="ignore"):  # a sheet has no center of volume
        if not mesh.is_winding_consistent or mesh.volume <= 0.0:
            trimesh.repair.fix_normals(mesh)
        sheet = mesh.volume <= THINNEST_MM * mesh.area / 2.0
    return mesh, f"encloses no volume; {UPPER}" if sheet else note


def _openness(mesh: trimesh.Trimesh) -> str:
    """A clause about the edges that keep a mesh from being closed."""
    rims = _rim_edges(mesh)
    if not len(rims):
        _, counts = np.unique(mesh.edges_sorted, axis=0, return_counts=True)
        many = int((counts > 2).sum())
        return f"has edges ({many}) at which more than two triangles meet; {UPPER}"
    widest = _widest_mm(mesh, trimesh.graph.connected_components(rims, min_len=2))
    return f"is open at {len(rims)} edges, the widest gap {widest:.4g} mm; {UPPER}"


def _widest_mm(mesh: trimesh.Trimesh, groups: Iterable[Any]) -> float:
    """Largest extent along an axis of any group of corners, mm."""
    return max(float(np.ptp(mesh.vertices[group], axis=0).max()) for group in groups)


def _balanced(mesh: trimesh.Trimesh) -> bool:
    """Whether the faces pass each edge equally often in both directions."""
    edges = mesh.edges
    forward = edges[:, 0] < edges[:, 1]
    _, which = np.unique(mesh.edges_sorted, axis=0, return_inverse=True)
    return not np.bincount(which.reshape(-1), np.where(forward, 1.0, -1.0)).any()


def _rim_edges(mesh: trimesh.Trimesh) -> np.ndarray:
    """(n, 2) corners of the edges of a single triangle, in that triangle's order."""
    return mesh.edges[trimesh.grouping.group_rows(mesh.edges_sorted, require_count=1)]


def _filled(mesh: trimesh.Trimesh) -> tuple[trimesh.Trimesh, str] | None:
    """The mesh with holes closed by fans, and a clause about them; None for large or odd holes."""
    if not 0 < len(_rim_edges(mesh)) <= MAX_RIM_EDGES:
        return None
    mesh = mesh.copy()
    trimesh.repair.fix_winding(mesh)
    rims = _rims(mesh, _rim_edges(mesh))
    added = [(rim[0], b, a) for rim in rims for a, b in pairwise(rim[1:])]
    whole = trimesh.Trimesh(mesh.vertices, [*mesh.faces.tolist(), *added], process=False)
    if not added or not _balanced(whole) or whole.area > (1.0 + HOLES_SHARE) * mesh.area:
        return None
    return whole, (
        f"had {len(rims)} small hole(s), the widest {_widest_mm(mesh, rims):.2g} mm, closed flat "
        f"with {len(added)} triangle(s)"
    )


def _rims(mesh: trimesh.Trimesh, edges: np.ndarray) -> list[list[int]]:
    """Corners around each hole, from the edges (n, 2) around all; empty where they do not close."""
    ends: dict[int, list[int]] = {}
    for a, b in edges.tolist():
        ends.setdefault(a, []).append(b)
    following = {}
    for a, b in edges.tolist():
        if b not in ends:
            return []
        # The edge onward at the least angle from the edge back stays on the same hole.
        here, normal = mesh.vertices[b], mesh.vertex_normals[b]
        back, ways = np.asarray(mesh.vertices[a] - here), np.asarray(mesh.vertices[ends[b]] - here)
        along = ways @ back - (ways @ normal) * (back @ normal)
        turns = np.arctan2(np.cross(back, ways) @ normal, along) % (2.0 * np.pi)
        following[a, b] = b, ends[b][int(turns.argmin())]
    rims = []
    while following:
        edge, rim = next(iter(following)), []
        while edge in following:
            rim.append(edge[0])
            edge = following.pop(edge)
        rims.append(rim)
    return rims
