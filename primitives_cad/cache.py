"""Prepared shapes kept on disk, each under a name that says what made it."""

import hashlib
import json
import re
import zipfile
from collections.abc import Callable, Mapping
from importlib.metadata import version
from pathlib import Path
from typing import TypeVar

import numpy as np
import trimesh

from t2twin.primitives_cad.shape import HeightMap, Shape
from t2twin.primitives_cad.writing import whole_file

KEY_DIGITS = 16
"""Hexadecimal digits of the key in a kept file's name: 64 bits, so no two meet."""

MAKERS = ("cadquery", "cadquery-ocp", "trimesh")
"""Distributions whose version can change a mesh."""

NOT_MAKERS = ("errors.py", "export.py", "sheet.py", "writing.py")
"""Sources of this package that no kept mesh or surface depends on."""

Kept = TypeVar("Kept")


def fetch(folder: Path, name: str, content: bytes, build: Callable[[], Shape]) -> Shape:
    """The kept shape of this name and content, or the one that `build` makes, then kept.

    content: bytes that the shape is made from besides this package's own code.
    Raises T2TwinError where the folder cannot be written.
    """

    def pack(shape: Shape) -> dict[str, np.ndarray]:
        about = {
            "name": shape.name,
            "spacing_mm": shape.spacing_mm,
            "parameters": shape.parameters,
            "base_mm": shape.base_mm,
        }
        return {
            "about": np.array(json.dumps(about)),
            "vertices": shape.mesh.vertices,
            "faces": shape.mesh.faces.astype(np.int32),
            "heights_mm": shape.surface.heights_mm,
            "x_mm": shape.surface.x_mm,
            "y_mm": shape.surface.y_mm,
        }

    def unpack(kept: Mapping[str, np.ndarray]) -> Shape:
        about = json.loads(str(kept["about"]))
        x, y = about.pop("spacing_mm")
        return Shape(
            mesh=trimesh.Trimesh(kept["vertices"], kept["faces"], process=False),
            surface=HeightMap(kept["heights_mm"], kept["x_mm"], kept["y_mm"]),
            spacing_mm=(x, y),
            **about,
        )

    return _fetch(_path(folder, name, content), build, pack, unpack)


def fetch_mesh(folder: Path, name: str, build: Callable[[], trimesh.Trimesh]) -> trimesh.Trimesh:
    """The kept mesh of this name, or the one that `build` makes, then kept; as `fetch`."""

    def pack(mesh: trimesh.Trimesh) -> dict[str, np.ndarray]:
        return {"vertices": mesh.vertices, "faces": mesh.faces.astype(np.int32)}

    def unpack(kept: Mapping[str, np.ndarray]) -> trimesh.Trimesh:
        return trimesh.Trimesh(kept["vertices"], kept["faces"], process=False)

    return _fetch(_path(folder, name, b"mesh"), build, pack, unpack)


def _fetch(
    path: Path,
    build: Callable[[], Kept],
    pack: Callable[[Kept], dict[str, np.ndarray]],
    unpack: Callable[[Mapping[str, np.ndarray]], Kept],
) -> Kept:
    try:
        # Opened here: NumPy leaves a damaged file open.
        with path.open("rb") as file, np.load(file, allow_pickle=False) as kept:
            return unpack(kept)
    except (OSError, KeyError, ValueError, TypeError, EOFError, zipfile.BadZipFile):
        pass  # not there yet, or damaged: made anew
    made = build()
    with whole_file(path) as temporary:
        np.savez_compressed(temporary, **pack(made))  # pyright: ignore[reportArgumentType]
    for stale in path.parent.glob(f"{path.name.split('.')[0]}.{'[0-9a-f]' * KEY_DIGITS}.npz"):
        if stale != path:
            stale.unlink(missing_ok=True)
    return made


def _path(folder: Path, name: str, content: bytes) -> Path:
    stem = re.sub(r"[^A-Za-z0-9_-]+", "-", name.replace("/", "--"))
    return folder / f"{stem}.{key(name, content)}.npz"


def key(name: str, content: bytes = b"") -> str:
    """What a shape is made by, as hexadecimal digits: its name, this package's code, the
    libraries that mesh it, and any other content."""
    digest = hashlib.sha256(name.encode())
    for source in sorted(Path(__file__).parent.rglob("*.py")):
        if source.name not in NOT_MAKERS:
            digest.update(source.read_bytes())
    for maker in MAKERS:
        digest.update(version(maker).encode())
    digest.update(content)
    return digest.hexdigest()[:KEY_DIGITS]
