"""Solids that a user brings, from STL and STEP files."""

from pathlib import Path

import numpy as np
import trimesh

from t2twin.primitives_cad.errors import T2TwinError

STL_SUFFIXES = (".stl",)
STEP_SUFFIXES = (".step", ".stp")
SUFFIXES = STL_SUFFIXES + STEP_SUFFIXES

SMALLEST_MM = 0.2
"""Least size of a solid, mm (assumed: a few pixels of a DIGIT; less is a file in other units)."""

LARGEST_MM = 1000.0
"""Greatest size of a solid, mm (assumed: more is a file in other units)."""

LOOSE_DIGITS = 4
"""Decimals of a mm to which the corners of a mesh with gaps are joined (assumed; STL is
single precision)."""


def read_solid(path: Path) -> trimesh.Trimesh:
    """The solid in an STL or STEP file, mm, turned as in the file (+z is the pressing side).

    Moved so that the press axis passes the middle of its bounding box in x and y, and its
    highest point is at z = 0. STL has no units: mm is assumed. Several bodies are kept together.
    Raises T2TwinError for a missing, unreadable, empty or open solid, or an unlikely size.
    """
    suffix = path.suffix.lower()
    if suffix not in SUFFIXES:
        raise T2TwinError(f"{path} is not a solid's file; {', '.join(SUFFIXES)} are allowed")
    if not path.is_file():
        raise T2TwinError(f"there is no file {path}; give a catalogue name or an STL or STEP file")
    mesh = _read_stl(path) if suffix in STL_SUFFIXES else _read_step(path)
    if not np.isfinite(mesh.vertices).all():
        raise T2TwinError(f"{path} has corners that are not numbers; all must be finite lengths")
    _check_size(path, mesh)
    _close(path, mesh)
    low, high = mesh.bounds
    middle = (low + high) / 2.0
    mesh.apply_translation((-middle[0], -middle[1], -high[2]))
    return mesh


def _read_stl(path: Path) -> trimesh.Trimesh:
    try:
        mesh = trimesh.load_mesh(path, file_type="stl")
    except Exception as error:  # the reader's errors are of many unrelated kinds
        raise T2TwinError(
            f"{path} cannot be read as STL ({_first_line(error)}); give a binary or ASCII STL file"
        ) from error
    if not isinstance(mesh, trimesh.Trimesh) or not len(mesh.faces):
        raise T2TwinError(f"{path} holds no triangles; give the STL file of a solid")
    return mesh


def _read_step(path: Path) -> trimesh.Trimesh:
    import cadquery as cq

    from t2twin.primitives_cad.tessellate import tessellate

    try:
        solids = cq.importers.importStep(str(path)).solids().vals()
    except Exception as error:  # the CAD kernel's errors are of many unrelated kinds
        raise T2TwinError(
            f"{path} cannot be read as STEP ({_first_line(error)}); give a STEP file of a solid"
        ) from error
    if not solids:
        raise T2TwinError(f"{path} holds no solid body; surfaces alone cannot be pressed")
    return trimesh.util.concatenate([tessellate(solid) for solid in solids])  # pyright: ignore[reportArgumentType, reportReturnType]


def _check_size(path: Path, mesh: trimesh.Trimesh) -> None:
    size = float(mesh.extents.max()) if mesh.extents is not None else 0.0
    if not SMALLEST_MM <= size <= LARGEST_MM:
        raise T2TwinError(
            f"{path} is {size:g} mm large, read in mm; "
            f"sizes from {SMALLEST_MM:g} to {LARGEST_MM:g} mm are allowed"
        )


def _close(path: Path, mesh: trimesh.Trimesh) -> None:
    if not mesh.is_watertight:
        mesh.merge_vertices(digits_vertex=LOOSE_DIGITS)
        mesh.update_faces(mesh.nondegenerate_faces())
        mesh.update_faces(mesh.unique_faces())
        mesh.remove_unreferenced_vertices()
    if not mesh.is_watertight:
        raise T2TwinError(
            f"{path} is open: its triangles do not close around a solid; "
            "a watertight mesh is needed"
        )
    if not mesh.is_winding_consistent or mesh.volume <= 0.0:
        trimesh.repair.fix_normals(mesh)
    if mesh.volume <= 0.0:
        raise T2TwinError(f"{path} encloses no volume; a solid is needed")


def _first_line(error: Exception) -> str:
    return (str(error).strip().splitlines() or [type(error).__name__])[0]
