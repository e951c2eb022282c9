"""Loads primitives, tools at their keypoints and random shapes by name, and solids from files.

`python -m maintenance.write_bundled` writes the bundled files from the CAD solids. Their arrays are
byte planes of differences between neighbors, which compress well. NAME.npz of a primitive has its
mesh and height map, TOOL.npz a tool's mesh in the tool's frame. TOOL--KEYPOINT.npz has a height map
and the transform from the tool's frame to the shape frame.
"""

import difflib
import os
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from t2twin.core import arguments
from t2twin.core.cache_dir import cache_dir
from t2twin.core.errors import T2TwinError
from t2twin.primitives_cad import mesh_files, primitive_parameters
from t2twin.primitives_cad.primitive_parameters import PRIMITIVES
from t2twin.primitives_cad.shape import HeightMap, LazyShape, Shape, seed_of

if TYPE_CHECKING:
    import trimesh

BUNDLED = Path(__file__).parent / "bundled"  # folder of the bundled shapes
KEYPOINTS: dict[str, tuple[str, ...]] = {
    "pliers": ("jaw-tip", "teeth", "pivot", "handle"),
    "clamp": ("screw", "pad", "frame", "handle"),
    "scissors": ("blade-tip", "blade-back", "pivot", "ring"),
    "allen-key": ("long-arm", "bend", "short-end", "ridge"),
    "wrench": ("ring", "open-end", "shank", "jaw-end"),
}
"""Names of the tools' keypoints; the module of each tool defines the points."""

TOOLS = tuple(KEYPOINTS)
OBJECTS = tuple(f"{tool}/{keypoint}" for tool in TOOLS for keypoint in KEYPOINTS[tool])
NAMES = PRIMITIVES + OBJECTS

OBJECT_SPACING_MM = (1.5, 1.5)  # of the 3 x 3 grid at a tool's keypoint (Grella et al. 2023)
FILE_SPACING_MM = 1.5  # largest spacing on a file's shape (assumed: stays near the center)


def split(name: str) -> str:
    """Split of a catalogue shape: "train", "val" (version 3) or "test" (tools)."""
    if name in OBJECTS:
        return "test"
    if name not in PRIMITIVES:
        raise T2TwinError(_unknown(name))
    is_validation = primitive_parameters.version(name) == primitive_parameters.VALIDATION_VERSION
    return "val" if is_validation else "train"


def load(
    name_or_path: str | Path,
    cache_dir: str | Path | None = None,
    scale: float | None = None,
    center: bool = False,
    hints: mesh_files.Hints | None = None,
) -> Shape:
    """A shape by its name (`square-2`, `pliers/jaw-tip`, `random-17`), or from a file.

    cache_dir: folder for the prepared shapes of files, None for `shapes` in the cache directory.
    scale: see mesh_files.read_solid. center: whether the press axis passes through the middle of a
    file's highest part instead of that of its bounding box. hints: how messages name both.
    Raises T2TwinError for an unknown name, a file that cannot be pressed, and options without one.
    """
    name = str(name_or_path)
    arguments.instance(center, "center", bool)
    if name in NAMES:
        check_not_of_file(f"{name} is a shape of the catalogue", scale, center)
        surface, make = read_surface(name), partial(read_mesh, name)
        return LazyShape(make, name=name, surface=surface, **properties(name))
    if (seed := seed_of(name)) is not None:
        check_not_of_file(f"{name} is a random shape", scale, center)
        from t2twin.primitives_cad.random_shapes import random_shape  # slow to import

        return random_shape(seed)
    from t2twin.primitives_cad import shape_cache

    path = Path(name_or_path)
    if path.suffix.lower() not in mesh_files.SUFFIXES and not path.is_file():
        raise T2TwinError(_unknown(name))
    return shape_cache.fetch(
        cache_folder(cache_dir),
        path,
        f"{scale} {center}",
        lambda: _file(path, scale, center, hints or mesh_files.COMMAND_HINTS),
    )


def check_not_of_file(shape: str, scale: float | None, center: bool) -> None:
    """Raises T2TwinError for options of files. shape: a clause about what is no file."""
    if scale is not None:
        raise T2TwinError(f"{shape}, in mm; a scale is for files only")
    if center:
        raise T2TwinError(f"{shape}, which has its place; center is for files only")


def cache_folder(folder: str | Path | None) -> Path | None:
    """The folder for prepared shapes of files, as for `load`; None where none is writable."""
    if folder is not None:
        return arguments.path(folder, "cache_dir")
    default = cache_dir()
    return None if default is None else default / "shapes"


def tool_mesh(tool: str) -> "trimesh.Trimesh":
    """A tool's watertight mesh in its own frame, mm."""
    import trimesh

    return trimesh.Trimesh(*read_mesh(tool), process=False)


def _unknown(name: str) -> str:
    """The message for an unknown name."""
    also = f"a path to a file of {', '.join(mesh_files.SUFFIXES)} is also allowed"
    if name in TOOLS:
        choices = ", ".join(f"{name}/{keypoint}" for keypoint in KEYPOINTS[name])
        return f"{name!r} is a tool and is pressed at a keypoint: {choices}; {also}"
    # Names of families and tools are not shapes; their members are listed instead.
    groups = {
        group: [n for n in NAMES if group in (primitive_parameters.family(n), n.partition("/")[0])]
        for group in (*primitive_parameters.FAMILIES, *TOOLS)
    }
    near = difflib.get_close_matches(name.lower(), (*NAMES, *groups), n=4, cutoff=0.5)
    named = dict.fromkeys(full for guess in near for full in groups.get(guess, (guess,)))
    hint = "names are like square-2, pliers/jaw-tip or random-17; see `t2twin shapes`"
    if named:
        hint = f"near names are {', '.join(named)}"
    return f"there is no shape {name!r}; {hint}; {also}"


def spacing_mm(name: str) -> tuple[float, float]:
    """Spacings along x and y of the protocol's grid on a catalogue shape, mm."""
    return OBJECT_SPACING_MM if name in OBJECTS else primitive_parameters.spacings_mm(name)


def properties(name: str) -> dict[str, Any]:
    """Fields of a catalogue shape besides its name, mesh and surface."""
    if name in OBJECTS:
        return {"spacing_mm": OBJECT_SPACING_MM}
    return {
        "spacing_mm": primitive_parameters.spacings_mm(name),
        "parameters": primitive_parameters.parameters(name),
        "base_mm": -primitive_parameters.FEATURE_HEIGHT_MM,
    }


def path_of(name: str) -> Path:
    """The file of a catalogue shape or a tool."""
    return BUNDLED / f"{name.replace('/', '--')}.npz"


def read_surface(name: str) -> HeightMap:
    """The height map of a catalogue shape."""
    with np.load(path_of(name), allow_pickle=False) as file:
        rows, columns = (int(side) for side in file["shape"])
        heights = unpacked(file["heights"], np.uint32).view(np.float32).reshape(rows, columns)
        pitch_mm = float(file["pitch_mm"])
    x_mm, y_mm = (np.arange(-(n // 2), n // 2 + 1) * pitch_mm for n in (columns, rows))
    return HeightMap(heights, x_mm, y_mm)


def read_mesh(name: str) -> tuple[np.ndarray, np.ndarray]:
    """Vertices (n, 3), mm, and faces (m, 3) of a shape in the shape frame, of a tool in its own."""
    with np.load(path_of(name), allow_pickle=False) as file:
        if "transform" in file:
            transform = file["transform"]
        else:
            vertices = unpacked(file["vertices"], np.uint64).view(np.float64).reshape(-1, 3)
            faces = unpacked(file["faces"], np.uint32).view(np.int32).reshape(-1, 3)
            return vertices, faces
    vertices, faces = read_mesh(name.partition("/")[0])
    return vertices @ transform[:3, :3].T + transform[:3, 3], faces


def unpacked(planes: np.ndarray, kind: type[np.unsignedinteger]) -> np.ndarray:
    """The values of maintenance.write_bundled.packed as unsigned integers of a type, (n,)."""
    differences = np.ascontiguousarray(planes.T).view(kind).ravel()
    return np.cumsum(differences, dtype=kind)


def _file(path: Path, scale: float | None, center: bool, hints: mesh_files.Hints) -> Shape:
    from t2twin.primitives_cad import height_map

    mesh, notes = mesh_files.read_solid(path, scale, hints)
    if center:
        x, y = height_map.highest_place(mesh)
        mesh.apply_translation((-x, -y, 0.0))
    try:
        mesh, heights = height_map.aligned(mesh, of_file=True)
    except T2TwinError as error:
        hint = "" if center else f"; {hints.center} presses its highest part"
        raise T2TwinError(f"{path} cannot be pressed: {error}{hint}") from error
    narrow, wide = mesh_files.NARROWEST_MM, mesh_files.SMALLEST_MM
    if narrow_mm := height_map.narrow_mm(mesh, heights, (narrow, wide)):
        notes += (
            f"{path} has parts that are narrower than {wide:g} x {narrow:g} mm, up to "
            f"{narrow_mm:.2g} mm above the others; a press may miss them",
        )
    spacing = min(primitive_parameters.spacing_mm(float(mesh.extents[:2].max())), FILE_SPACING_MM)
    return Shape(
        name=os.fsencode(path.stem).decode(errors="replace"),  # a file name may be invalid text
        mesh=mesh,
        surface=heights,
        spacing_mm=(spacing, spacing),
        base_mm=height_map.base_mm(heights),
        notes=notes,
    )
