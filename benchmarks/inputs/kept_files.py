"""Prepared shapes, arrays, beds and machine code in the cache home, damaged: made again, unnoticed.

Each case keeps something, damages the file, asks again, and compares the two results.
"""

import importlib.util
import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np

from benchmarks.inputs.case import Base, Case, Make, replaced
from t2twin.core.cache_dir import VARIABLE
from t2twin.primitives_cad import catalogue

Compute = Callable[[Path], np.ndarray]
"""Computes something that is kept; given a case's folder."""

Damage = Callable[[Path], object]

BED_PINS = 1024
"""Pins of the smallest bed that is kept."""

LOOP = """
from t2twin.core.jit import compiled

@compiled("f8(f8)")
def twice(x):
    return 2.0 * x

@compiled("f8(f8)")
def thrice(x):
    return 3.0 * x
"""


def _shape(box: Path) -> np.ndarray:
    import trimesh

    path = box / "box.stl"
    if not path.exists():
        trimesh.creation.box((6.0, 4.0, 3.0)).export(path)
    return catalogue.load(path, box / "cache/shapes").surface.heights_mm


def _array(box: Path) -> np.ndarray:
    from t2twin.core.cached_files import cached_array

    return cached_array("arrays", "key", __file__, lambda: np.arange(5.0))


def _bed(box: Path) -> np.ndarray:
    from t2twin.sim.contact import mujoco_pins

    return np.array([mujoco_pins._model(BED_PINS).ngeom])


def _machine_code(box: Path) -> np.ndarray:
    path = box / "loops.py"
    if not path.exists():
        path.write_text(LOOP)
    specification = importlib.util.spec_from_file_location("loops", path)
    assert specification is not None and specification.loader is not None
    module = importlib.util.module_from_spec(specification)
    specification.loader.exec_module(module)
    for loop in (module.twice, module.thrice):
        folder = box / "cache/code"
        folder.mkdir(parents=True, exist_ok=True)
        loop._cache._folder = folder  # and not the folder of this process
    return np.array([module.twice(1.5), module.thrice(1.5)])


def _flip(path: Path, place: int) -> None:
    content = bytearray(path.read_bytes())
    content[place] ^= 0x10
    replaced(path, bytes(content))


def _exchange(path: Path) -> None:
    """Takes the content of another file of its kind, or of this one with another name."""
    others = [each for each in path.parent.iterdir() if each != path and each.is_file()]
    other = others[0] if others else path.rename(path.with_name("other"))
    replaced(path, other.read_bytes())


def _instead(make: Callable[[Path], object]) -> Damage:
    def damage(path: Path) -> None:
        path.unlink()
        make(path)

    return damage


DAMAGES: dict[str, Damage] = {
    "empty": lambda path: replaced(path, b""),
    "text": lambda path: replaced(path, "hello"),
    "zeros": lambda path: replaced(path, bytes(path.stat().st_size)),
    "cut in half": lambda path: replaced(path, path.read_bytes()[: path.stat().st_size // 2]),
    "without its last byte": lambda path: replaced(path, path.read_bytes()[:-1]),
    "with a byte more": lambda path: replaced(path, path.read_bytes() + b"x"),
    "a bit wrong in the middle": lambda path: _flip(path, path.stat().st_size // 2),
    "a bit wrong at the end": lambda path: _flip(path, -1),
    "the content of another": _exchange,
    "a pipe": _instead(os.mkfifo),
    "a folder": _instead(Path.mkdir),
    "a folder with a file": _instead(lambda path: (path.mkdir(), (path / "x").touch())),
    "a link to itself": _instead(lambda path: path.symlink_to(path)),
    "a link to nothing": _instead(lambda path: path.symlink_to("nothing")),
}

KEPT: dict[str, Compute] = {
    "shape": _shape,
    "array": _array,
    "bed": _bed,
    "machine code": _machine_code,
}


@contextmanager
def _cache_in(folder: Path) -> Iterator[None]:
    """The cache home within the block."""
    before = os.environ.get(VARIABLE)
    os.environ[VARIABLE] = str(folder)
    try:
        yield
    finally:
        os.environ.pop(VARIABLE)
        if before is not None:
            os.environ[VARIABLE] = before


def _asked_again(compute: Compute, damage: Damage) -> Make:
    def call(box: Path, base: Base) -> None:
        with _cache_in(box / "cache"):
            first = compute(box)
            files = sorted(path for path in (box / "cache").rglob("*") if path.is_file())
            assert files, "nothing is kept"
            damage(files[0])
            np.testing.assert_array_equal(compute(box), first)
            np.testing.assert_array_equal(compute(box), first)

    return call


def cases() -> Iterator[Case]:
    for kind, compute in KEPT.items():
        for name, damage in DAMAGES.items():
            yield Case(f"kept {kind}: {name}", (), call=_asked_again(compute, damage), fine=True)
