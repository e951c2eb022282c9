"""Solids that a user brings, from files of triangles and STEP files."""

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
"""Largest file that is read, bytes (assumed: about 2 million triangles as text)."""

SMALLEST_MM = 0.5
"""Least longer side of a solid seen from above, mm: a press looks for its contact on cells of
0.5 mm, and posts of 0.3 mm fall between their sample points at some places (measured at ten poses:
from 0.5 mm on none was missed, and the DIGIT's contact area was within 3 %)."""

NARROWEST_MM = 0.2
"""Least narrower side, mm: four points of a height map. Blades of 0.1 mm were missed at some
places, of 0.2 mm and more at none."""

LARGEST_MM = 1000.0
"""Greatest size of a solid, mm (assumed: more is a file in other units)."""

UNITS_MM = {"metres": 1000.0, "inches": 25.4, "mm": 1.0, "micrometers": 0.001}
"""Units that a file of an unlikely size may be in, mm."""

LIKELY_MM = 30.0
"""A likely size of what is pressed, mm (assumed: about a sensor's length)."""


def check_scale(scale: float | None) -> None:
    """Raises T2TwinError for a scale that is not a positive, finite number."""
    if scale is None:
        return
    scale = arguments.real(scale, "scale")
    if not (math.isfinite(scale) and scale > 0.0):
        raise T2TwinError(f"a scale of {scale:g} cannot be used; positive numbers are allowed")


def read_bytes(path: Path) -> bytes:
    """A file's content. Raises T2TwinError where it is no file, cannot be read, or is too large."""
    otherwise = f"give a catalogue name or a file of {', '.join(SUFFIXES)}"
    content = read_file(path, MAX_BYTES, otherwise)
    if not content:
        raise T2TwinError(f"{path} is empty; give the file of a solid")
    return content


def read_solid(path: Path, scale: float | None = None) -> tuple[trimesh.Trimesh, tuple[str, ...]]:
    """The solid in a file, mm, its pressing side up (+z), and what had to be mended, in sentences.

    Moved so that the press axis passes the middle of its bounding box in x and y, and its highest
    point is at z = 0. Several bodies are kept together, each where the file puts it. scale: mm in
    one of the file's units; None takes what the file says (3MF, GLB, STEP), else 1. The lengths of
    STEP come in mm whatever its unit: there the scale is a factor.
    Raises T2TwinError for a missing, unreadable, empty or open solid, or an unlikely size.
    """
    check_scale(scale)
    suffix = path.suffix.lower()
    if suffix not in READERS:
        raise T2TwinError(f"{path} is not a solid's file; one of {', '.join(SUFFIXES)} is needed")
    read_bytes(path)
    try:
        mesh, unit_mm = READERS[suffix](path)
    except Exception as error:  # readers' errors are of many unrelated kinds
        raise T2TwinError(
            f"{path} cannot be read as {suffix[1:].upper()}: {_first_line(error)}"
        ) from error
    _resize(path, mesh, unit_mm if scale is None else scale)
    try:
        mesh, mended = repair.closed(mesh)
    except ValueError as error:
        raise T2TwinError(f"{path} {error}") from error
    low, high = mesh.bounds
    middle = (low + high) / 2.0
    mesh.apply_translation((-middle[0], -middle[1], -high[2]))
    return mesh, () if mended is None else (f"{path} {mended}",)


def _resize(path: Path, mesh: trimesh.Trimesh, unit_mm: float) -> None:
    """Brings the mesh to mm. Raises T2TwinError for a size that cannot be pressed."""
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
    """Which scale would make these sides (3,) a likely size, in words, or nothing."""
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
