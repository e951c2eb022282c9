"""Reads solids from mesh files and STEP files."""

import math
import re
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import trimesh

from t2twin.core import arguments
from t2twin.core.errors import T2TwinError
from t2twin.core.files import read_file
from t2twin.primitives_cad.mesh_io import gltf, obj, ply, repair, step, stl, threemf

READERS = {
    ".stl": stl.read,
    ".obj": obj.read,
    ".ply": ply.read,
    ".3mf": threemf.read,
    ".glb": gltf.read,
    ".step": step.read,
    ".stp": step.read,
}
SUFFIXES = tuple(READERS)

MAX_BYTES = 500_000_000
"""Size limit of files, bytes (assumed: about 2 million triangles as text)."""

SMALLEST_MM = 0.5
"""Least longer side of a solid seen from above, mm. The contact solver's survey has cells of 0.5
mm, and posts of 0.3 mm fall between its sample points at some poses. Measured at ten poses: from
0.5 mm on none was missed, and the contact area on a gel was within 3 %."""

NARROWEST_MM = 0.2
"""Least narrower side, mm: four points of a height map. Blades of 0.1 mm were missed at some poses,
blades of 0.2 mm and more at none."""

LARGEST_MM = 1000.0
"""Largest size of a solid, mm (assumed: larger ones are in other units)."""

HAND_MM = 500.0
"""Largest size of what a hand holds, mm (assumed: a long tool). Files of up to half a unit are
likely in meters, the unit of robot models."""

METER_MM, INCH_MM = 1000.0, 25.4

INCHES = re.compile(rb"\binch(es)?\b", re.IGNORECASE)
"""Words of a file for its unit."""

HEAD_BYTES = 2000
"""Bytes from the start of a file in which its unit may be named (assumed)."""


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
) -> tuple[trimesh.Trimesh, tuple[str, ...]]:
    """The solid or surface in a file, mm, its pressing side up (+z), and sentences about it.

    The press axis passes through the center of the bounding box in x and y; the highest point is at
    z = 0. Several bodies form one shape. scale: mm per unit of the file; None for the file's own
    unit (3MF, GLB, STEP), else 1. STEP is always read in mm, so that the scale is a factor.
    Raises T2TwinError for a missing, unreadable or empty file, one without a surface seen from
    above, and an unlikely size.
    """
    if scale is not None:
        scale = arguments.real(scale, "scale")
        if not (math.isfinite(scale) and scale > 0.0):
            raise T2TwinError(f"a scale of {scale:g} cannot be used; positive numbers are allowed")
    suffix = path.suffix.lower()
    if suffix not in READERS:
        raise T2TwinError(f"{path} is not a solid's file; one of {', '.join(SUFFIXES)} is needed")
    head = read_bytes(path)[:HEAD_BYTES]
    try:
        mesh, unit_mm = READERS[suffix](path)
    except Exception as error:  # readers raise many unrelated types
        raise T2TwinError(
            f"{path} cannot be read as {suffix[1:].upper()}: "
            f"{(str(error).strip().splitlines() or [type(error).__name__])[0]}"
        ) from error
    of_file = mesh.metadata.get("note")
    _resize(path, mesh, unit_mm if scale is None else scale, INCHES.search(head), hints)
    mesh, repaired = repair.close_mesh(mesh)
    low, high = mesh.bounds
    middle = (low + high) / 2.0
    mesh.apply_translation((-middle[0], -middle[1], -high[2]))
    return mesh, tuple(f"{path} {clause}" for clause in (of_file, repaired) if clause)


def _resize(
    path: Path, mesh: trimesh.Trimesh, unit_mm: float, in_inches: object, hints: Hints
) -> None:
    """Scale a mesh to mm. Raises T2TwinError for a size that cannot be pressed."""
    with np.errstate(over="ignore"):
        sides = np.ptp(mesh.vertices, axis=0)
    if sides[:2].min() == 0.0:
        raise T2TwinError(
            f"{path} is flat: it has no {'xy'[int(sides[:2].argmin())]}; a surface that is seen "
            "from above (+z) is needed"
        )
    width, length, height = (float(side) * unit_mm for side in sides)
    if not _fits(sides, unit_mm):
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
    """A clause with a scale that makes sides, (3,) in the file's units, large enough; empty for a
    shape that is too large."""
    largest = float(sides.max())
    if largest * unit_mm > LARGEST_MM:
        return ""
    for name, scale, likely in (
        ("inches", INCH_MM, in_inches),
        ("meters", METER_MM, largest * METER_MM <= HAND_MM),
    ):
        if likely and _fits(sides, scale):
            option = hints.scale.format(scale)
            return f"; if it is in {name}, {option} makes it {largest * scale:g} mm large"
    narrow, wide = sorted(sides[:2].tolist())
    least = max(NARROWEST_MM / narrow, SMALLEST_MM / wide)
    digit = 10.0 ** (math.floor(math.log10(least)) - 1)
    least = math.ceil(least / digit) * digit  # rounded up to two digits
    if not _fits(sides, least):
        return ""
    return f"; {hints.scale.format(least)} or more, mm per unit, makes it large enough"
