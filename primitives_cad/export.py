"""STEP and STL files of every primitive, every tool and the mosaic, and what they are."""

import json
from pathlib import Path
from typing import Any

import trimesh
from tqdm import tqdm

from t2twin.primitives_cad import cache, catalogue, families
from t2twin.primitives_cad.errors import T2TwinError
from t2twin.primitives_cad.writing import whole_file

MANIFEST = "manifest.json"
MOSAIC = "mosaic"
SUFFIXES = (".step", ".stl")


def export(out_dir: str | Path, cache_dir: str | Path | None = None) -> Path:
    """Write NAME.step and NAME.stl of the 32 primitives, the 5 tools and the mosaic, in mm.

    Beside them manifest.json says what each is. A shape whose files are there, made by the same
    code, is not made again. cache_dir: as for catalogue.load. Returns the manifest's path.
    Raises T2TwinError where the folder cannot be written.
    """
    folder = Path(out_dir)
    path = folder / MANIFEST
    before = _read(path)
    entries: dict[str, Any] = {}
    names = (*catalogue.PRIMITIVES, *catalogue.TOOLS, MOSAIC)
    for name in tqdm(names, desc="primitives and tools", unit="shape"):
        entry = before.get(name)
        if entry is None or not _still_there(folder, name, entry):
            entry = _write_shape(folder, name, cache_dir)
            # Kept up to date so that an interrupted export continues.
            _write_manifest(path, {**before, **entries, name: entry})
        entries[name] = entry
    if entries != before:
        _write_manifest(path, entries)
    return path


def _read(path: Path) -> dict[str, Any]:
    try:
        shapes = json.loads(path.read_text(encoding="utf-8"))["shapes"]
        return {entry["name"]: entry for entry in shapes}
    except (OSError, ValueError, KeyError, TypeError):
        return {}


def _write_manifest(path: Path, entries: dict[str, Any]) -> None:
    text = json.dumps({"units": "mm", "shapes": list(entries.values())}, indent=2)
    with whole_file(path) as temporary:
        temporary.write_text(text + "\n", encoding="utf-8")


def _still_there(folder: Path, name: str, entry: dict[str, Any]) -> bool:
    if entry.get("made_by") != cache.key(name):
        return False
    sizes = entry.get("bytes", {})
    files = [folder / f"{name}{suffix}" for suffix in SUFFIXES]
    return all(file.is_file() and file.stat().st_size == sizes.get(file.name) for file in files)


def _write_shape(folder: Path, name: str, cache_dir: str | Path | None) -> dict[str, Any]:
    """Both files of one shape; returns its entry in the manifest."""
    import cadquery as cq

    from t2twin.primitives_cad import mosaic, solids, tessellate, tools

    mesh: trimesh.Trimesh
    if name == MOSAIC:
        solid = mosaic.solid()
        mesh = tessellate.tessellate(solid)
        about = {"places_mm": mosaic.places(), "pitch_mm": mosaic.PITCH_MM}
    elif name in catalogue.TOOLS:
        solid = tools.solid(name)
        mesh = catalogue.tool_mesh(name, cache_dir)
        about = {
            "split": "test",
            "spacing_mm": catalogue.OBJECT_SPACING_MM,
            "keypoints": [
                {"name": each.name, "point_mm": each.point_mm, "direction": each.direction}
                for each in catalogue.keypoints(name)
            ],
        }
    else:
        solid = solids.primitive(name)
        shape = catalogue.load(name, cache_dir)
        mesh = shape.mesh
        about = {
            "family": families.family(name),
            "version": families.version(name),
            "split": catalogue.split(name),
            "parameters_mm": shape.parameters,
            "spacing_mm": shape.spacing_mm,
        }
    bodies = solid.Solids()
    if len(bodies) != 1 or not bodies[0].isValid():
        raise T2TwinError(f"{name} is not one valid solid; its parameters do not make a shape")
    with whole_file(folder / f"{name}.step") as temporary:
        cq.exporters.export(cq.Workplane(bodies[0]), str(temporary))
    with whole_file(folder / f"{name}.stl") as temporary:
        mesh.export(temporary, file_type="stl")
    return {
        "name": name,
        **about,
        "volume_mm3": round(solid.Volume(), 3),
        "bounding_box_mm": [[round(float(value), 4) for value in corner] for corner in mesh.bounds],
        "triangles": len(mesh.faces),
        "chordal_error_mm": tools.CHORDAL_MM.get(name, tessellate.CHORDAL_MM),
        "bytes": {
            f"{name}{suffix}": (folder / f"{name}{suffix}").stat().st_size for suffix in SUFFIXES
        },
        "made_by": cache.key(name),
    }
