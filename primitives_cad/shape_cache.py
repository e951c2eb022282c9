"""Disk cache of the prepared shapes of files."""

import hashlib
import json
import os
import re
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from zipfile import BadZipFile

import numpy as np
import trimesh

from t2twin.core.cache_dir import DIGEST_DIGITS, short_digest
from t2twin.core.files import atomic_write
from t2twin.core.machine import installed_version
from t2twin.primitives_cad.mesh_files import read_bytes
from t2twin.primitives_cad.shape import HeightMap, Shape

MAKERS = ("cadquery", "cadquery-ocp", "trimesh")  # distributions whose versions affect meshes
NOT_MAKERS = ("contact_sheet.py", "export.py")  # sources that do not affect meshes and surfaces
RANDOM_SHAPES = "random_shapes.py"  # the source for random shapes, which are not cached
SURFACE = ("heights_mm", "x_mm", "y_mm")
ABOUT = ("name", "spacing_mm", "parameters", "base_mm", "notes")  # of a shape


def fetch(folder: Path | None, file: Path, options: str, build: Callable[[], Shape]) -> Shape:
    """The cached shape of a file, or the result of `build`, which is then cached.

    folder: None for no cache; it contains one shape of each file. options: what the shape depends
    on besides the file's content and this package's code.
    """
    content = hashlib.sha256(read_bytes(file)).digest()
    if folder is None:
        return build()
    # two folders may have files of one name
    stem = re.sub(r"[^A-Za-z0-9_-]+", "-", file.stem)
    stem = f"{stem}-{short_digest(os.fsencode(file.absolute()))}"
    known = f"{file.suffix.lower()} {options} {code_digest()}".encode()
    path = folder / f"{stem}.{short_digest(known + content)}.npz"
    with suppress(OSError, ValueError, KeyError, BadZipFile):  # missing or damaged
        return _read(path)
    shape = build()
    surface = {name: getattr(shape.surface, name) for name in SURFACE}
    about = json.dumps({name: getattr(shape, name) for name in ABOUT})
    mesh = {"vertices": shape.mesh.vertices, "faces": shape.mesh.faces.astype(np.int32)}
    with atomic_write(path) as temporary, temporary.open("wb") as opened:
        np.savez_compressed(opened, about=about, **mesh, **surface)
    for stale in folder.glob(f"{stem}.{'[0-9a-f]' * DIGEST_DIGITS}.npz"):
        if stale != path:
            stale.unlink(missing_ok=True)
    return shape


def code_digest(with_random: bool = False) -> str:
    """Digest of the sources, with random shapes or not, and of the versions of MAKERS."""
    content = b""
    for source in sorted(Path(__file__).parent.rglob("*.py")):
        if source.name not in NOT_MAKERS and (with_random or source.name != RANDOM_SHAPES):
            content += source.read_bytes()
    return short_digest(content + "".join(installed_version(maker) for maker in MAKERS).encode())


def _read(path: Path) -> Shape:
    with path.open("rb") as opened, np.load(opened, allow_pickle=False) as file:
        arrays = dict(file)
    about = json.loads(str(arrays["about"]))
    return Shape(
        mesh=trimesh.Trimesh(arrays["vertices"], arrays["faces"], process=False),
        surface=HeightMap(*(arrays[name] for name in SURFACE)),
        spacing_mm=tuple(about.pop("spacing_mm")),
        notes=tuple(about.pop("notes")),
        **about,
    )
