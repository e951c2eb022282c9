"""STEP and STL files of every primitive, every tool and the mosaic, and what they are."""

from dataclasses import dataclass
from pathlib import Path

import cadquery as cq
import msgspec
import trimesh

from t2twin.core import arguments
from t2twin.core.errors import T2TwinError
from t2twin.core.files import atomic_write, locked, write_json
from t2twin.core.progress import Progress
from t2twin.primitives_cad import catalogue, primitive_parameters, shape_cache
from t2twin.primitives_cad.shape import Keypoint

MANIFEST = "manifest.json"
MOSAIC = "mosaic"
SUFFIXES = (".step", ".stl")


@dataclass(frozen=True, kw_only=True)
class Entry:
    """One shape in the manifest. What a shape does not have is None, and not in the file.

    family, version, parameters_mm: of a primitive. keypoints: of a tool.
    split, spacing_mm: what it is for, and the spacings of its press grid; not of the mosaic.
    places_mm: x, y of every primitive's axis on the mosaic. pitch_mm: between them along x and y.
    bounding_box_mm: lowest and highest corner of the mesh, (2, 3).
    chordal_error_mm: asked of the mesher. bytes: sizes of its files. made_by: cache.key.
    """

    name: str
    family: str | None = None
    version: int | None = None
    split: str | None = None
    parameters_mm: dict[str, float] | None = None
    spacing_mm: tuple[float, float] | None = None
    keypoints: tuple[Keypoint, ...] | None = None
    places_mm: dict[str, tuple[float, float]] | None = None
    pitch_mm: tuple[float, float] | None = None
    volume_mm3: float
    bounding_box_mm: tuple[tuple[float, ...], ...]
    triangles: int
    chordal_error_mm: float
    bytes: dict[str, int]
    made_by: str


@dataclass(frozen=True)
class _Manifest:
    units: str
    shapes: tuple[Entry, ...]


def export(out_dir: str | Path) -> Path:
    """Write NAME.step and NAME.stl of the 32 primitives, the 5 tools and the mosaic, in mm.

    Beside them manifest.json says what each is. A shape whose files are there, made by the same
    code, is not made again. Returns the manifest's path.
    Raises T2TwinError where the folder cannot be written.
    """
    folder = arguments.path(out_dir, "out_dir")
    with locked(folder):
        return _export(folder)


def _export(folder: Path) -> Path:
    path = folder / MANIFEST
    before = _read(path)
    entries: dict[str, Entry] = {}
    names = (*catalogue.PRIMITIVES, *catalogue.TOOLS, MOSAIC)
    for name in Progress(names, desc="primitives and tools", unit="shape"):
        entry = before.get(name)
        if entry is None or not _still_there(folder, entry):
            entry = _write_shape(folder, name)
            # Kept up to date so that an interrupted export continues.
            _write_manifest(path, {**before, **entries, name: entry})
        entries[name] = entry
    if entries != before:
        _write_manifest(path, entries)
    return path


def _read(path: Path) -> dict[str, Entry]:
    """Entries by name of the manifest that lies there; none where there is no whole one."""
    try:
        manifest = msgspec.json.decode(path.read_bytes(), type=_Manifest)
    except (OSError, msgspec.DecodeError):
        return {}
    return {entry.name: entry for entry in manifest.shapes}


def _write_manifest(path: Path, entries: dict[str, Entry]) -> None:
    shapes = [
        {name: value for name, value in msgspec.to_builtins(entry).items() if value is not None}
        for entry in entries.values()
    ]
    write_json(path, {"units": "mm", "shapes": shapes})


def _still_there(folder: Path, entry: Entry) -> bool:
    if entry.made_by != shape_cache.key(entry.name):
        return False
    files = [folder / f"{entry.name}{suffix}" for suffix in SUFFIXES]
    return all(
        file.is_file() and file.stat().st_size == entry.bytes.get(file.name) for file in files
    )


def _write_shape(folder: Path, name: str) -> Entry:
    """Both files of one shape; returns its entry in the manifest."""

    from t2twin.primitives_cad import print_plate, solids, tools

    mesh: trimesh.Trimesh
    if name == MOSAIC:
        solid = print_plate.solid()
        mesh = solids.tessellate(solid)
        about = {"places_mm": print_plate.places(), "pitch_mm": print_plate.PITCH_MM}
    elif name in catalogue.TOOLS:
        solid = tools.solid(name)
        mesh = catalogue.tool_mesh(name)
        about = {
            "split": "test",
            "spacing_mm": catalogue.OBJECT_SPACING_MM,
            "keypoints": catalogue.keypoints(name),
        }
    else:
        solid = solids.primitive(name)
        shape = catalogue.load(name)
        mesh = shape.mesh
        about = {
            "family": primitive_parameters.family(name),
            "version": primitive_parameters.version(name),
            "split": catalogue.split(name),
            "parameters_mm": shape.parameters,
            "spacing_mm": shape.spacing_mm,
        }
    bodies = solid.Solids()
    if len(bodies) != 1 or not bodies[0].isValid():
        raise T2TwinError(f"{name} is not one valid solid; its parameters do not make a shape")
    with atomic_write(folder / f"{name}.step") as temporary:
        cq.exporters.export(cq.Workplane(bodies[0]), str(temporary))
    with atomic_write(folder / f"{name}.stl") as temporary:
        mesh.export(temporary, file_type="stl")
    return Entry(
        name=name,
        **about,
        volume_mm3=round(solid.Volume(), 3),
        bounding_box_mm=tuple(tuple(round(float(x), 4) for x in corner) for corner in mesh.bounds),
        triangles=len(mesh.faces),
        chordal_error_mm=tools.CHORDAL_MM.get(name, solids.CHORDAL_MM),
        bytes={
            f"{name}{suffix}": (folder / f"{name}{suffix}").stat().st_size for suffix in SUFFIXES
        },
        made_by=shape_cache.key(name),
    )
