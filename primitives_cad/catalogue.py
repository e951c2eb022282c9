"""Loads primitives, tools at their keypoints and random shapes by name, and solids from files.

`python -m maintenance.write_bundled` writes the bundled files from the CAD solids. Their arrays are
byte planes of differences between neighbors, which compress well. NAME.npz of a primitive has its
mesh and height map, TOOL.npz a tool's mesh in the tool's frame. TOOL--KEYPOINT.npz has a height map
and the transform from the tool's frame to the shape frame.
"""

import difflib
import hashlib
import os
import pickle
import re
from contextlib import suppress
from functools import partial
from math import sqrt
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from t2twin.core import arguments
from t2twin.core.cache_dir import cache_dir, short_digest
from t2twin.core.errors import T2TwinError
from t2twin.core.files import atomic_write
from t2twin.core.machine import installed_version
from t2twin.primitives_cad.shape import SUFFIXES, HeightMap, Shape, seed_of

if TYPE_CHECKING:
    import trimesh

BUNDLED = Path(__file__).parent / "bundled"  # folder of the bundled shapes
MAKERS = ("cadquery", "cadquery-ocp", "trimesh")  # distributions whose versions affect meshes
# The families of primitives, their parameters and the split by version are those of Grella et al.
# 2023. The sizes, mm, are assumed, for a DIGIT with a view of about 12.5 x 16.7 mm. Lines and the
# largest flat versions extend beyond it, as tools do; a network trained on one length of lines
# would predict it everywhere.
PLATE_SIDE_MM = 46.0  # side of a primitive's square base plate, mm (assumed: fits the longest line)
FEATURE_HEIGHT_MM = 6.0  # above the plate (assumed: more than the thickest soft layer, 4.07 mm)
VALIDATION_VERSION = 3  # of each family, in the validation split; the others are for training
# Parameters of versions 1 to 4 of each family (assumed). radius: of line-smooth's long edges'
# rounding, else of the outline. edge: wall thickness. curvature: of the spherical cap. length:
# along y.
FAMILIES: dict[str, dict[str, tuple[float, float, float, float]]] = {
    "line-smooth": {
        "width": (1.6, 3.0, 2.2, 7.0),
        "radius": (0.4, 1.2, 0.8, 2.0),
        "length": (28.0, 20.0, 24.0, 40.0),
    },
    "square": {"side": (5.6, 8.4, 7.0, 16.0)},
    "circle-empty": {"radius": (3.0, 4.6, 4.0, 6.5), "edge": (0.8, 1.6, 1.1, 1.3)},
    "circle": {"radius": (2.5, 5.0, 3.6, 8.0)},
    "bump": {"height": (0.8, 1.6, 1.2, 2.0), "curvature": (4.0, 9.0, 7.0, 6.0)},
    "square-empty": {"side": (6.0, 8.4, 7.2, 13.0), "edge": (0.8, 1.6, 1.1, 1.3)},
    "hemisphere": {"radius": (2.5, 4.0, 3.3, 5.5)},
    "line-sharp": {"width": (1.0, 2.6, 1.8, 5.5), "length": (40.0, 20.0, 24.0, 28.0)},
}

PRIMITIVES = tuple(f"{family}-{version}" for family in FAMILIES for version in (1, 2, 3, 4))
KEYPOINTS: dict[str, tuple[str, ...]] = {
    "pliers": ("jaw-tip", "teeth", "pivot", "handle"),
    "clamp": ("screw", "pad", "frame", "handle"),
    "scissors": ("blade-tip", "blade-back", "pivot", "ring"),
    "allen-key": ("long-arm", "bend", "short-end", "ridge"),
    "wrench": ("ring", "open-end", "shank", "jaw-end"),
}
"""Names of the tools' keypoints; the module `tools` defines the points."""

TOOLS = tuple(KEYPOINTS)
OBJECTS = tuple(f"{tool}/{keypoint}" for tool in TOOLS for keypoint in KEYPOINTS[tool])
NAMES = PRIMITIVES + OBJECTS

MIN_SPACING_MM = 1.0  # of the press grid, so that presses on narrow shapes differ (assumed)
SPACING_STEP_MM = 0.05  # spacings are rounded to this, mm (assumed)
GRID_INTERVALS = 6  # along one side of the protocol's 7 x 7 grid (Grella et al. 2023)
OBJECT_SPACING_MM = (1.5, 1.5)  # of the 3 x 3 grid at a tool's keypoint (Grella et al. 2023)
FILE_SPACING_MM = 1.5  # largest spacing on a file's shape (assumed: stays near the center)


def split(name: str) -> str:
    """Split of a catalogue shape: "train", "val" (version 3) or "test" (tools)."""
    if name in OBJECTS:
        return "test"
    if name not in PRIMITIVES:
        raise T2TwinError(f"there is no primitive or tool {name!r}; {_near(name)}")
    return "val" if version(name) == VALIDATION_VERSION else "train"


def load(
    name_or_path: str | Path,
    kept: str | Path | None = None,
    scale: float | None = None,
    center: bool = False,
) -> Shape:
    """A shape by its name (`square-2`, `pliers/jaw-tip`, `random-17`), or from a file.

    kept: folder for the prepared shapes of files, None for `shapes` in the cache directory.
    scale: see mesh_files.read_solid. center: whether the press axis passes through the middle of a
    file's highest part instead of that of its bounding box.
    Raises T2TwinError for an unknown name, a file that cannot be pressed, and options without one.
    """
    name = str(name_or_path)
    arguments.instance(center, "center", bool)
    if name in NAMES:
        check_not_of_file(f"{name} is a shape of the catalogue", scale, center)
        return Shape(name, partial(read_mesh, name), read_surface(name), **properties(name))
    if (seed := seed_of(name)) is not None:
        check_not_of_file(f"{name} is a random shape", scale, center)
        from t2twin.primitives_cad.random_shapes import random_shape  # slow to import

        return random_shape(seed)
    path = Path(name_or_path)
    if path.suffix.lower() not in SUFFIXES and not path.is_file():
        others = f"random-17 and a path to a file of {', '.join(SUFFIXES)} are also allowed"
        raise T2TwinError(f"there is no shape {name!r}; {_near(name)}; {others}")
    return _kept(cache_folder(kept), path, scale, center)


def check_not_of_file(shape: str, scale: float | None, center: bool) -> None:
    """Raises T2TwinError for options of files. shape: a clause about what is no file."""
    if scale is not None or center:
        raise T2TwinError(f"{shape}, in mm and in its place; scale and center are for files only")


def cache_folder(folder: str | Path | None) -> Path | None:
    """The folder for prepared shapes of files, as for `load`; None where none is writable."""
    if folder is not None:
        path = arguments.path(folder, "cache_dir")
        if path.is_file():
            raise T2TwinError(f"cache_dir is {path}, a file; expected a folder for prepared shapes")
        return path
    default = cache_dir()
    return None if default is None else default / "shapes"


def tool_mesh(tool: str) -> "trimesh.Trimesh":
    """A tool's watertight mesh in its own frame, mm."""
    import trimesh

    return trimesh.Trimesh(*read_mesh(tool), process=False)


def _near(name: str) -> str:
    """A clause with names like an unknown one."""
    if near := difflib.get_close_matches(name.lower(), NAMES, n=4, cutoff=0.5):
        return f"near names are {', '.join(near)}"
    return "names are like square-2 or pliers/jaw-tip; see `t2twin shapes`"


def family(name: str) -> str:
    """Family of a primitive: `square` of `square-2`."""
    return name.rpartition("-")[0]


def version(name: str) -> int:
    """Version of a primitive, 1 to 4: 2 of `square-2`."""
    return int(name.rpartition("-")[2])


def parameters(name: str) -> dict[str, float]:
    """The parameters of a primitive by name, mm."""
    sizes = FAMILIES[family(name)]
    return {parameter: versions[version(name) - 1] for parameter, versions in sizes.items()}


def extents_mm(name: str) -> tuple[float, float]:
    """Sides of a primitive's outline along x and y, mm."""
    match parameters(name):
        case {"width": width, "length": length}:
            return width, length
        case {"height": height, "curvature": curvature}:
            side = 2.0 * cap_radius_mm(height, curvature)
        case {"radius": radius}:
            side = 2.0 * radius
        case sizes:
            side = sizes["side"]
    return side, side


def cap_radius_mm(height_mm: float, curvature_mm: float) -> float:
    """Radius of the circle where a spherical cap of this height ends, mm: sqrt(2 R h - h^2)."""
    return sqrt(2.0 * curvature_mm * height_mm - height_mm**2)


def grid_mm(extent: float) -> float:
    """Spacing of a 7 x 7 grid of presses that covers a feature of this extent (mm), mm."""
    steps = round(extent / GRID_INTERVALS / SPACING_STEP_MM)
    return round(max(steps * SPACING_STEP_MM, MIN_SPACING_MM), 2)


def properties(name: str) -> dict[str, Any]:
    """Fields of a catalogue shape besides its name, solid and surface."""
    if name in OBJECTS:
        return {"spacing_mm": OBJECT_SPACING_MM}
    x_mm, y_mm = extents_mm(name)
    return {
        "spacing_mm": (grid_mm(x_mm), grid_mm(y_mm)),
        "parameters": parameters(name),
        "base_mm": -FEATURE_HEIGHT_MM,
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
        if "transform" not in file:
            vertices = unpacked(file["vertices"], np.uint64).view(np.float64).reshape(-1, 3)
            return vertices, unpacked(file["faces"], np.uint32).view(np.int32).reshape(-1, 3)
        transform = file["transform"]
    vertices, faces = read_mesh(name.partition("/")[0])
    return vertices @ transform[:3, :3].T + transform[:3, 3], faces


def unpacked(planes: np.ndarray, kind: type[np.unsignedinteger]) -> np.ndarray:
    """The values of maintenance.write_bundled.packed as unsigned integers of a type, (n,)."""
    differences = np.ascontiguousarray(planes.T).view(kind).ravel()
    return np.cumsum(differences, dtype=kind)


def _kept(folder: Path | None, file: Path, scale: float | None, center: bool) -> Shape:
    """The shape of a file, kept in a folder with one shape of each file; None for no folder."""
    from t2twin.primitives_cad import mesh_files  # slow to import

    content = mesh_files.read_bytes(file)
    if folder is None:
        return _prepared(file, scale, center)
    # Two folders may have files of one name.
    stem = re.sub(r"[^A-Za-z0-9_-]+", "-", file.stem)
    stem = f"{stem}-{short_digest(os.fsencode(file.absolute()))}"
    made_by = f"{file.suffix.lower()} {scale} {center} {code_digest()}".encode()
    path = folder / f"{stem}.{short_digest(made_by + hashlib.sha256(content).digest())}.pickle"
    with suppress(OSError):
        return pickle.loads(path.read_bytes())
    shape = _prepared(file, scale, center)
    with atomic_write(path) as temporary:
        temporary.write_bytes(pickle.dumps(shape))
    for stale in set(folder.glob(f"{stem}.*.pickle")) - {path}:
        stale.unlink(missing_ok=True)
    return shape


def code_digest() -> str:
    """Digest of this folder's sources and of the versions of MAKERS."""
    content = b"".join(source.read_bytes() for source in sorted(Path(__file__).parent.glob("*.py")))
    return short_digest(content + "".join(map(installed_version, MAKERS)).encode())


def _prepared(path: Path, scale: float | None, center: bool) -> Shape:
    """The shape of a file."""
    from t2twin.primitives_cad import height_map, mesh_files

    mesh, notes = mesh_files.read_solid(path, scale)
    if center:
        x, y = height_map.highest_place(mesh)
        mesh.apply_translation((-x, -y, 0.0))
    try:
        mesh, heights = height_map.aligned(mesh, of_file=True)
    except T2TwinError as error:
        hint = "" if center else "; the option center presses its highest part"
        raise T2TwinError(f"{path} cannot be pressed: {error}{hint}") from error
    narrow, wide = mesh_files.NARROWEST_MM, mesh_files.SMALLEST_MM
    if narrow_mm := height_map.narrow_mm(mesh, heights, (narrow, wide)):
        notes += (
            f"{path} has parts that are narrower than {wide:g} x {narrow:g} mm, up to "
            f"{narrow_mm:.2g} mm above the others; a press may miss them",
        )
    spacing = min(grid_mm(float(mesh.extents[:2].max())), FILE_SPACING_MM)
    return Shape(
        name=os.fsencode(path.stem).decode(errors="replace"),  # a file name may be invalid text
        solid=mesh,
        surface=heights,
        spacing_mm=(spacing, spacing),
        base_mm=height_map.base_mm(heights),
        notes=notes,
    )
