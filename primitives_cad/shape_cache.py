"""Disk cache of the prepared shapes of files."""

import io
import os
import re
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import msgspec
import numpy as np
import trimesh

from t2twin.core.cached_files import DIGEST_DIGITS, read_checked, short_digest, write_checked
from t2twin.core.machine import installed_version
from t2twin.primitives_cad.shape import HeightMap, Shape

MAKERS = ("cadquery", "cadquery-ocp", "trimesh")
"""Distributions whose versions affect meshes."""

NOT_MAKERS = (
    "contact_sheet.py",
    "export.py",
)
"""Sources of this package that do not affect meshes and surfaces."""

RANDOM_SHAPES = "random_shapes"
"""The subpackage for random shapes, which are not cached."""

SUFFIX = ".shape"
"""Suffix of the files with prepared shapes."""


@dataclass(frozen=True)
class _About:
    """Fields of a cached shape besides its arrays; see Shape."""

    name: str
    spacing_mm: tuple[float, float]
    parameters: dict[str, float]
    base_mm: float | None
    notes: tuple[str, ...]


def fetch(folder: Path | None, label: str, content: bytes, build: Callable[[], Shape]) -> Shape:
    """The cached shape of a label and content, or the result of `build`, which is then cached.

    folder: the cache, None for no cache. label: from `file_label`; the cache contains one shape for
    each. content: bytes that the shape depends on besides this package's code.
    Raises T2TwinError where the folder cannot be written.
    """
    if folder is None:
        return build()
    digest = key(label, content)
    stem = re.sub(r"[^A-Za-z0-9_-]+", "-", label)
    path = folder / f"{stem}.{digest}{SUFFIX}"
    cached = _read(path)
    if cached is not None:
        return cached
    shape = build()
    if os.path.lexists(path) and not path.is_file():
        return shape  # a folder or a device has this name
    write_checked(path, _packed(shape))
    for stale in folder.glob(f"{stem}.{'[0-9a-f]' * DIGEST_DIGITS}{SUFFIX}"):
        if stale != path:
            stale.unlink(missing_ok=True)
    return shape


def file_label(path: Path) -> str:
    """The label of a file: its stem and a digest of its path, as two folders may share a stem."""
    return f"{path.stem}-{short_digest(os.fsencode(path.absolute()))}"


def code_digest(with_random: bool = False) -> str:
    """Digest of this package's sources, including comments, and of the versions of MAKERS.

    with_random: whether to include the code for random shapes.
    """
    content = b""
    for source in sorted(Path(__file__).parent.rglob("*.py")):
        is_random = source.parent.name == RANDOM_SHAPES
        if source.name not in NOT_MAKERS and (with_random or not is_random):
            content += source.read_bytes()
    return short_digest(content + "".join(installed_version(maker) for maker in MAKERS).encode())


def key(label: str, content: bytes = b"") -> str:
    """Digest of everything that a shape depends on: its label, code_digest, and other content."""
    return short_digest(os.fsencode(label) + code_digest().encode() + content)


def _read(path: Path) -> Shape | None:
    """The cached shape, or None."""
    content = read_checked(path)
    if content is None:
        return None
    with np.load(io.BytesIO(content), allow_pickle=False) as arrays:
        about = msgspec.json.decode(str(arrays["about"]), type=_About)
        return Shape(
            name=about.name,
            mesh=trimesh.Trimesh(arrays["vertices"], arrays["faces"], process=False),
            surface=HeightMap(arrays["heights_mm"], arrays["x_mm"], arrays["y_mm"]),
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
