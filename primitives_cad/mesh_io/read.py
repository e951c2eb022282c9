"""Reads solids from mesh files and STEP files."""

import math
from pathlib import Path

import numpy as np
import trimesh

from t2twin.core import arguments
from t2twin.core.errors import T2TwinError
from t2twin.core.files import read_file
from t2twin.primitives_cad.mesh_io import glb, obj, ply, repair, step, stl, threemf

READERS = {
    ".stl": stl.read,
    ".obj": obj.read,
    ".ply": ply.read,
    ".3mf": threemf.read,
    ".glb": glb.read,
    ".step": step.read,
    ".stp": step.read,
}
SUFFIXES = tuple(READERS)

MAX_BYTES = 500_000_000
"""Size limit of files, bytes (assumed: about 2 million triangles as text)."""

SMALLEST_MM = 0.5
"""Least longer side of a solid seen from above, mm. The contact solver's survey has cells of 0.5
mm, and posts of 0.3 mm fall between its sample points at some poses. Measured at ten poses: from
0.5 mm on none was missed, and the DIGIT's contact area was within 3 %."""

NARROWEST_MM = 0.2
"""Least narrower side, mm: four points of a height map. Blades of 0.1 mm were missed at some poses,
blades of 0.2 mm and more at none."""

LARGEST_MM = 1000.0
"""Largest size of a solid, mm (assumed: larger ones are in other units)."""

UNITS_MM = {"meters": 1000.0, "inches": 25.4, "mm": 1.0, "micrometers": 0.001}
"""Possible units of a file with an unlikely size, mm."""

LIKELY_MM = 30.0
"""A likely size of a shape, mm (assumed: about a sensor's length)."""


def check_scale(scale: float | None) -> None:
    """Raises T2TwinError for a scale that is not a positive, finite number."""
    if scale is None:
        return
    scale = arguments.real(scale, "scale")
    if not (math.isfinite(scale) and scale > 0.0):
        raise T2TwinError(f"a scale of {scale:g} cannot be used; positive numbers are allowed")


def read_bytes(path: Path) -> bytes:
    """A file's content. Raises T2TwinError where it is missing, unreadable, empty or too large."""
    otherwise = f"give a catalogue name or a file of {', '.join(SUFFIXES)}"
    content = read_file(path, MAX_BYTES, otherwise)
    if not content:
        raise T2TwinError(f"{path} is empty; give the file of a solid")
    return content


def read_solid(path: Path, scale: float | None = None) -> tuple[trimesh.Trimesh, tuple[str, ...]]:
    """The solid in a file, mm, its pressing side up (+z), and sentences about repairs.

    The press axis passes through the center of the bounding box in x and y; the highest point is at
    z = 0. Several bodies form one solid. scale: mm per unit of the file; None for the file's own
    unit (3MF, GLB, STEP), else 1. STEP is always read in mm, so that the scale is a factor.
    Raises T2TwinError for a missing, unreadable, empty or open solid, or an unlikely size.
    """
    check_scale(scale)
    suffix = path.suffix.lower()
    if suffix not in READERS:
        raise T2TwinError(f"{path} is not a solid's file; one of {', '.join(SUFFIXES)} is needed")
    read_bytes(path)
    try:
        mesh, unit_mm = READERS[suffix](path)
    except Exception as error:  # readers raise many unrelated types
        raise T2TwinError(
            f"{path} cannot be read as {suffix[1:].upper()}: {_first_line(error)}"
        ) from error
    _resize(path, mesh, unit_mm if scale is None else scale)
    try:
        mesh, repaired = repair.close_mesh(mesh)
    except ValueError as error:
        raise T2TwinError(f"{path} {error}") from error
    low, high = mesh.bounds
    middle = (low + high) / 2.0
    mesh.apply_translation((-middle[0], -middle[1], -high[2]))
    return mesh, () if repaired is None else (f"{path} {repaired}",)


def _resize(path: Path, mesh: trimesh.Trimesh, unit_mm: float) -> None:
    """Scale a mesh to mm. Raises T2TwinError for a size that cannot be pressed."""
    with np.errstate(over="ignore"):
        sides = np.ptp(mesh.vertices, axis=0)
    if sides.min() == 0.0:
        raise T2TwinError(
            f"{path} is flat: it has no {'xyz'[int(sides.argmin())]}; a solid is needed"
        )
    width, length, height = (float(side) * unit_mm for side in sides)
    if not _fits(width, length, height):
        raise T2TwinError(
            f"{path} is {width:g} x {length:g} mm seen from above and {height:g} mm high; at least "
            f"{SMALLEST_MM:g} x {NARROWEST_MM:g} mm and at most {LARGEST_MM:g} mm are allowed"
            + _likelier(sides, unit_mm)
        )
    if unit_mm != 1.0:
        mesh.apply_scale(unit_mm)


def _fits(width: float, length: float, height: float) -> bool:
    narrow, wide = sorted((width, length))
    return (
        narrow >= NARROWEST_MM and wide >= SMALLEST_MM and max(width, length, height) <= LARGEST_MM
    )


def _likelier(sides: np.ndarray, unit_mm: float) -> str:
    """A clause with a scale that gives these sides, (3,), a likely size, or an empty one."""
    largest = float(sides.max())

    def unlikeliness(unit: float) -> float:
        return abs(math.log(largest * unit / LIKELY_MM))

    fitting = {
        name: unit
        for name, unit in UNITS_MM.items()
        if _fits(*(float(side) * unit for side in sides))
        and unlikeliness(unit) < unlikeliness(unit_mm)
    }
    if not fitting:
        return ""
    name = min(fitting, key=lambda name: unlikeliness(fitting[name]))
    unit = fitting[name]
    return f"; if it is in {name}, --scale {unit:g} makes it {largest * unit:g} mm large"


def _first_line(error: Exception) -> str:
    return (str(error).strip().splitlines() or [type(error).__name__])[0]
