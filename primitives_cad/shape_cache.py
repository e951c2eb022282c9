"""Shapes of a user's files, kept on disk once they are prepared."""

import hashlib
import io
import os
import re
from collections.abc import Callable
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path

import msgspec
import numpy as np
import trimesh

from t2twin.core.cached_files import read_checked, write_checked
from t2twin.primitives_cad.shape import HeightMap, Shape

KEY_DIGITS = 16
"""Hexadecimal digits of a digest, 64 bits: no two things that are kept will share one."""

MAKERS = ("cadquery", "cadquery-ocp", "trimesh")
"""Distributions whose version can change a mesh."""

NOT_MAKERS = (
    "bundled_shapes.py",
    "cache_home.py",
    "checks.py",
    "checksum.py",
    "compile_ahead.py",
    "errors.py",
    "export.py",
    "folder_lock.py",
    "jit.py",
    "kept_array.py",
    "machine.py",
    "progress.py",
    "reading.py",
    "same_solid.py",
    "same_surface.py",
    "sheet.py",
    "stl_bytes.py",
    "write_bundled.py",
    "writing.py",
)
"""Sources of this package that no kept mesh or surface depends on."""

RANDOM_SHAPES = "random_shapes"
"""The folder of this package that makes random shapes."""

SUFFIX = ".shape"
"""Of the files that hold prepared shapes."""


@dataclass(frozen=True)
class _About:
    """What a kept shape is besides its arrays; see Shape."""

    name: str
    spacing_mm: tuple[float, float]
    parameters: dict[str, float]
    base_mm: float | None
    notes: tuple[str, ...]


def fetch(folder: Path | None, label: str, content: bytes, build: Callable[[], Shape]) -> Shape:
    """The kept shape of this label and content, or the one that `build` makes, then kept.

    folder: where it is kept, None to keep nothing.
    label: what file_label gives; one shape is kept for each.
    content: bytes that the shape is made from besides this package's own code.
    Raises T2TwinError where the folder cannot be written.
    """
    if folder is None:
        return build()
    digest = key(label, content)
    stem = re.sub(r"[^A-Za-z0-9_-]+", "-", label)
    path = folder / f"{stem}.{digest}{SUFFIX}"
    kept = _read(path)
    if kept is not None:
        return kept
    made = build()
    if os.path.lexists(path) and not path.is_file():
        return made  # nothing can be kept under this name
    write_checked(path, _packed(made))
    for stale in folder.glob(f"{stem}.{'[0-9a-f]' * KEY_DIGITS}{SUFFIX}"):
        if stale != path:
            stale.unlink(missing_ok=True)
    return made


def file_label(path: Path) -> str:
    """The label of a user's file: its stem, and a digest of where it lies.

    So files of one stem in two folders are both kept.
    """
    place = hashlib.sha256(os.fsencode(path.absolute())).hexdigest()
    return f"{path.stem}-{place[:KEY_DIGITS]}"


def code_digest(with_random: bool = False) -> str:
    """Digest of what makes shapes, KEY_DIGITS hexadecimal digits: this package's code and the
    versions of the libraries that mesh. with_random: also of what makes random shapes, none of
    which is kept.

    Of the code's source bytes: a changed comment changes it too.
    """
    digest = hashlib.sha256()
    for source in sorted(Path(__file__).parent.rglob("*.py")):
        is_random = source.parent.name == RANDOM_SHAPES
        if source.name not in NOT_MAKERS and (with_random or not is_random):
            digest.update(source.read_bytes())
    for maker in MAKERS:
        digest.update(version(maker).encode())
    return digest.hexdigest()[:KEY_DIGITS]


def key(label: str, content: bytes = b"") -> str:
    """Digest of what makes one shape, KEY_DIGITS hexadecimal digits: its label, code_digest, and
    any other content."""
    made_from = os.fsencode(label) + code_digest().encode() + content
    return hashlib.sha256(made_from).hexdigest()[:KEY_DIGITS]


def _read(path: Path) -> Shape | None:
    """The kept shape, or None."""
    content = read_checked(path)
    if content is None:
        return None
    with np.load(io.BytesIO(content), allow_pickle=False) as kept:
        about = msgspec.json.decode(str(kept["about"]), type=_About)
        return Shape(
            name=about.name,
            mesh=trimesh.Trimesh(kept["vertices"], kept["faces"], process=False),
            surface=HeightMap(kept["heights_mm"], kept["x_mm"], kept["y_mm"]),
            spacing_mm=about.spacing_mm,
            parameters=about.parameters,
            base_mm=about.base_mm,
            notes=about.notes,
        )


def _packed(shape: Shape) -> bytes:
    about = _About(shape.name, shape.spacing_mm, shape.parameters, shape.base_mm, shape.notes)
    packed = io.BytesIO()
    np.savez_compressed(
        packed,
        about=np.array(msgspec.json.encode(about).decode()),
        vertices=shape.mesh.vertices,
        faces=shape.mesh.faces.astype(np.int32),
        heights_mm=shape.surface.heights_mm,
        x_mm=shape.surface.x_mm,
        y_mm=shape.surface.y_mm,
    )
    return packed.getvalue()
