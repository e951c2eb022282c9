"""Every shape by name: the primitives, the tools at their keypoints, and a user's own files."""

import difflib
import hashlib
import os
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from t2twin.core import arguments
from t2twin.core.cache_dir import cache_dir
from t2twin.core.errors import T2TwinError
from t2twin.primitives_cad import bundled_shapes, primitive_parameters
from t2twin.primitives_cad.primitive_parameters import PRIMITIVES
from t2twin.primitives_cad.random_shapes import seeds
from t2twin.primitives_cad.shape import Keypoint, Shape

if TYPE_CHECKING:
    import trimesh

KEYPOINTS: dict[str, tuple[str, ...]] = {
    "pliers": ("jaw-tip", "teeth", "pivot", "handle"),
    "clamp": ("screw", "pad", "frame", "handle"),
    "scissors": ("blade-tip", "blade-back", "pivot", "ring"),
    "allen-key": ("long-arm", "bend", "short-end", "ridge"),
    "wrench": ("ring", "open-end", "shank", "jaw-end"),
}
"""The tools and their keypoints by name; the points themselves stand with each tool's solid."""

TOOLS = tuple(KEYPOINTS)
OBJECTS = tuple(f"{tool}/{keypoint}" for tool in TOOLS for keypoint in KEYPOINTS[tool])
NAMES = PRIMITIVES + OBJECTS

OBJECT_SPACING_MM = (1.5, 1.5)
"""Spacing of the 3 x 3 grid at a tool's keypoint, x and y, mm (Grella et al. 2023)."""

FILE_SPACING_MM = 1.5
"""Largest spacing of the grid on a user's shape, mm (assumed: so that it stays near the middle,
where there surely is something to press)."""


def split(name: str) -> str:
    """What a catalogue shape is for: "train", "val" (version 3) or "test" (tools).

    Raises T2TwinError for a name that is not in the catalogue.
    """
    if name in OBJECTS:
        return "test"
    if name not in PRIMITIVES:
        raise T2TwinError(_unknown(name))
    return (
        "val"
        if primitive_parameters.version(name) == primitive_parameters.VALIDATION_VERSION
        else "train"
    )


def load(
    name_or_path: str | Path, cache_dir: str | Path | None = None, scale: float | None = None
) -> Shape:
    """A shape of the catalogue by name (`square-2`, `pliers/jaw-tip`), a random one by its seed
    (`random-17`), or of a user's file.

    The file is of one of files.SUFFIXES, its pressing side up (+z).
    cache_dir: where the prepared shapes of files are kept between calls, None for the folder
    `shapes` of the cache home. They are used only while the code that made them and the file's
    content are the same.
    scale: mm in one of the file's units, None for what the file says, else 1: see files.read_solid.
    Raises T2TwinError for a name that is not in the catalogue, a file that cannot be pressed, and
    a scale that is not positive or not for a file.
    """
    name = str(name_or_path)
    if scale is not None and name in NAMES:
        raise T2TwinError(f"{name} is a shape of the catalogue, in mm; a scale is for files only")
    if name in NAMES:
        return bundled_shapes.BundledShape(name, **_properties(name))
    if (seed := seeds.seed_of(name)) is not None:
        if scale is not None:
            raise T2TwinError(f"{name} is a random shape, in mm; a scale is for files only")
        from t2twin.primitives_cad.random_shapes.shape import RandomShape

        return RandomShape(seed)
    from t2twin.primitives_cad import shape_cache
    from t2twin.primitives_cad.mesh_io import read

    path = Path(name_or_path)
    if path.suffix.lower() not in read.SUFFIXES and not path.is_file():
        raise T2TwinError(_unknown(name))
    read.check_scale(scale)
    content = hashlib.sha256(read.read_bytes(path)).digest()
    made_from = f"{path.suffix.lower()} {scale}".encode() + content
    return shape_cache.fetch(
        cache_folder(cache_dir), shape_cache.file_label(path), made_from, lambda: _file(path, scale)
    )


def cache_folder(folder: str | Path | None) -> Path | None:
    """The folder for prepared shapes of files, as for `load`; None where none is writable."""
    if folder is not None:
        return arguments.path(folder, "cache_dir")
    default = cache_dir()
    return None if default is None else default / "shapes"


def tool_mesh(tool: str) -> "trimesh.Trimesh":
    """A tool's watertight mesh in its own frame, mm.

    Raises T2TwinError for a name that is not a tool's.
    """
    import trimesh

    _check_tool(tool)
    return trimesh.Trimesh(*bundled_shapes.read_mesh(tool), process=False)


def keypoints(tool: str) -> tuple[Keypoint, ...]:
    """The four keypoints of a tool, in the tool's own frame.

    Raises T2TwinError for a name that is not a tool's.
    """
    from t2twin.primitives_cad import tools

    _check_tool(tool)
    return tools.keypoints(tool)


def _check_tool(tool: str) -> None:
    if tool not in TOOLS:
        raise T2TwinError(f"there is no tool {tool!r}; the tools are {', '.join(TOOLS)}")


def _unknown(name: str) -> str:
    """What to say of a name that is not in the catalogue: which names are near, what else is
    allowed."""
    from t2twin.primitives_cad.mesh_io import read

    also = f"a path to a file of {', '.join(read.SUFFIXES)} is also allowed"
    if name in TOOLS:
        choices = ", ".join(f"{name}/{keypoint}" for keypoint in KEYPOINTS[name])
        return f"{name!r} is a tool and is pressed at a keypoint: {choices}; {also}"
    # A family or a tool by itself is near, but not a shape: what it holds is named instead.
    groups = {
        **{
            kind: tuple(n for n in PRIMITIVES if primitive_parameters.family(n) == kind)
            for kind in primitive_parameters.FAMILIES
        },
        **{tool: tuple(n for n in OBJECTS if n.startswith(tool + "/")) for tool in TOOLS},
    }
    near = difflib.get_close_matches(name.lower(), (*NAMES, *groups), n=4, cutoff=0.5)
    named = dict.fromkeys(full for guess in near for full in groups.get(guess, (guess,)))
    if named:
        hint = f"near names are {', '.join(named)}"
    else:
        hint = (
            "names are like square-2, pliers/jaw-tip or random-17; `t2twin shapes` lists all but "
            "the random ones"
        )
    return f"there is no shape {name!r}; {hint}; {also}"


def spacing_mm(name: str) -> tuple[float, float]:
    """Spacings along x and y of the protocol's grid on a shape of the catalogue, mm."""
    return OBJECT_SPACING_MM if name in OBJECTS else primitive_parameters.spacings_mm(name)


def build(name: str, tool: "trimesh.Trimesh | None" = None) -> Shape:
    """A shape of the catalogue made from its CAD solid, as the bundled one was.

    tool: the tool's mesh, of a shape that is a tool's keypoint.
    """
    from t2twin.primitives_cad import height_map, solids
    from t2twin.primitives_cad.solids import tessellate_symmetric

    if name in PRIMITIVES:
        mesh = tessellate_symmetric(solids.primitive(name))
    else:
        assert tool is not None
        mesh = tool.copy().apply_transform(keypoint_transform(name))
    mesh, heights = height_map.stand(mesh)
    return Shape(name=name, mesh=mesh, surface=heights, **_properties(name))


def keypoint_transform(name: str) -> np.ndarray:
    """(4, 4) transform from a tool's frame that brings the keypoint of a shape to the origin."""
    tool, _, at = name.partition("/")
    return upright(next(each for each in keypoints(tool) if each.name == at))


def _properties(name: str) -> dict[str, Any]:
    """What a shape of the catalogue has besides its mesh and its surface."""
    if name in OBJECTS:
        return {"spacing_mm": OBJECT_SPACING_MM}
    return {
        "spacing_mm": primitive_parameters.spacings_mm(name),
        "parameters": primitive_parameters.parameters(name),
        "base_mm": -primitive_parameters.FEATURE_HEIGHT_MM,
    }


def _file(path: Path, scale: float | None) -> Shape:
    from t2twin.primitives_cad import height_map
    from t2twin.primitives_cad.mesh_io import read

    mesh, notes = read.read_solid(path, scale)
    mesh, heights = height_map.stand(mesh)
    spacing = min(primitive_parameters.spacing_mm(float(mesh.extents[:2].max())), FILE_SPACING_MM)
    return Shape(
        name=os.fsencode(path.stem).decode(errors="replace"),  # a file's name may be no text
        mesh=mesh,
        surface=heights,
        spacing_mm=(spacing, spacing),
        base_mm=height_map.base_mm(heights),
        notes=notes,
    )


def upright(keypoint: Keypoint) -> np.ndarray:
    """(4, 4) transform that brings a keypoint to the origin and its direction to +z.

    The smallest turn that does it (Rodrigues' rotation formula); half a turn about x for -z.
    """
    direction = np.asarray(keypoint.direction, dtype=np.float64)
    axis = np.cross(direction, (0.0, 0.0, 1.0))
    cosine = float(direction[2])
    if cosine <= -1.0 + 1.0e-12:
        turn = np.diag((1.0, -1.0, -1.0))
    else:
        skew = np.array(
            [[0.0, -axis[2], axis[1]], [axis[2], 0.0, -axis[0]], [-axis[1], axis[0], 0.0]]
        )
        turn = np.eye(3) + skew + skew @ skew / (1.0 + cosine)
    transform = np.eye(4)
    transform[:3, :3] = turn
    transform[:3, 3] = -turn @ np.asarray(keypoint.point_mm)
    return transform
