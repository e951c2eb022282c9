"""Cached files that are damaged: they are made again, without a message."""

import importlib.util
import os
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path

import numpy as np
from cases import DAMAGES, Case, Copy, edit, laid, put
from files import DATA, RUN
from pictures import PNG
from stored import USERS

import t2twin
from t2twin.core.cache_dir import VARIABLE
from t2twin.core.cached_files import cached_array, write_checked
from t2twin.primitives_cad import catalogue
from t2twin.sim.contact import mujoco_pins
from t2twin.sim.dataset.store import sha256_of

LOOPS = """
from t2twin.core.jit import compiled

@compiled("f8(f8)")
def twice(x):
    return 2.0 * x

@compiled("f8(f8)")
def thrice(x):
    return 3.0 * x
"""


def _shape(box: Path, base) -> np.ndarray:
    import trimesh

    path = box / "box.stl"
    if not path.exists():
        trimesh.creation.box((6.0, 4.0, 3.0)).export(path)
    return catalogue.load(path, box / "cache/shapes").surface.heights_mm


def _array(box: Path, base) -> np.ndarray:
    return cached_array("arrays", "key", __file__, lambda: np.arange(5.0))


def _pins(box: Path, base) -> np.ndarray:
    """Stiffness and places of the smallest cached model."""
    model = mujoco_pins._model(mujoco_pins.MIN_CACHED_PINS)
    return np.concatenate([model.jnt_stiffness.ravel(), model.geom_pos.ravel()])


def _counts(box: Path, base) -> np.ndarray:
    """Counts of an image by ONNX Runtime, rounded, as PyTorch may replace it."""
    run = t2twin.load(base.resnet18, engine="onnx")
    return run.predict(np.full((32, 24, 3), 90, np.uint8)).round(-1)


def _machine_code(box: Path, base) -> np.ndarray:
    put(box / "loops.py", LOOPS) if not (box / "loops.py").exists() else None
    specification = importlib.util.spec_from_file_location("loops", box / "loops.py")
    assert specification is not None and specification.loader is not None
    module = importlib.util.module_from_spec(specification)
    specification.loader.exec_module(module)
    (box / "cache/code").mkdir(parents=True, exist_ok=True)
    for loop in (module.twice, module.thrice):
        loop._cache._folder = box / "cache/code"  # not the folder of this process
    return np.array([module.twice(1.5), module.thrice(1.5)])


def _flip(content: bytes, place: int) -> bytes:
    changed = bytearray(content)
    changed[place] ^= 0x10
    return bytes(changed)


def _other(path: Path) -> None:
    """Takes the content of another cached file, or that of a valid file of its kind."""
    others = [each for each in path.parent.iterdir() if each != path and each.is_file()]
    if others:
        put(path, others[0].read_bytes())
    else:
        write_checked(path.with_name("other"), b"another file")
        path.with_name("other").replace(path)


CACHED_DAMAGES = DAMAGES | {
    "without its last byte": edit(lambda content: content[:-1]),
    "with a byte more": edit(lambda content: content + b"x"),
    "a flipped bit in the middle": edit(lambda content: _flip(content, len(content) // 2)),
    "a flipped bit at the end": edit(lambda content: _flip(content, -1)),
    "the content of another": _other,
}
CACHED: dict[str, Callable[[Path, t2twin.Twin], np.ndarray]] = {
    "shape": _shape, "array": _array, "pins": _pins, "ONNX file": _counts,
    "machine code": _machine_code,
}  # fmt: skip
"""What is cached, and a function that computes and caches it."""

ARRAYS = (
    b"", b"hello", b"\x93NUMPY\x01\x00v\x00", np.lib.format.magic(1, 0) + b"\x10\x00" + b"{" * 16,
    np.zeros((6, 3, 3, 3), np.uint8), np.zeros((6, 64, 64, 3)),
    b"\x93NUMPY\x01\x00\x36\x00{'descr': '|O', 'fortran_order': False, 'shape': (6,)}  ",
)  # fmt: skip
"""Wrong contents of a cache of decoded images."""

DECODED = "evaluate {resnet18} --data data --split val --out out"
REPORT = "report --data {data} --runs {touch2touch} {resnet18} --evaluation evaluation --out out"


def _again(compute: Callable, damage: Callable[[Path], object], box: Path, base) -> None:
    """Computes, damages the cached file, and computes twice again."""
    before = os.environ.get(VARIABLE)
    os.environ[VARIABLE] = str(box / "cache")
    try:
        first = compute(box, base)
        files = sorted(path for path in (box / "cache").rglob("*") if path.is_file())
        assert files, "nothing is cached"
        damage(files[0])
        for _ in range(2):
            np.testing.assert_array_equal(compute(box, base), first)
    finally:
        os.environ.pop(VARIABLE)
        if before is not None:
            os.environ[VARIABLE] = before


def _decoded(write: Callable[[Path], object]) -> Callable[[Path], object]:
    """Writes caches of the decoded validation images of the dataset whose info.json is given."""

    def lay(info: Path) -> None:
        folder = info.with_name("cache")
        folder.mkdir()
        for side in (32, 64):
            write(folder / f"val-{side}-rgb-{sha256_of(info)[:12]}.npy")

    return lay


def cases() -> Iterator[Case]:
    for what, compute in CACHED.items():
        for name, damage in CACHED_DAMAGES.items():
            call = partial(_again, compute, damage)
            yield Case(f"cached {what}: {name}", call=call, fine=True)
    for number, array in enumerate(ARRAYS):
        write = partial(np.save, arr=array) if isinstance(array, np.ndarray) else (
            lambda path, array=array: path.write_bytes(array))  # fmt: skip
        make = laid(DATA | {"data/info.json": _decoded(write)})
        yield Case(f"decoded images {number}", DECODED, make, fine=True)
    for write, says in ((os.mkfifo, "a pipe"), (Path.mkdir, "a folder")):
        make = laid(DATA | {"data/info.json": _decoded(write)})
        yield Case(f"decoded images: {says}", DECODED, make, says)
    for file, content in (("val/metrics.json", ""), ("val/predictions.npz", b"PK")):
        make = laid({"evaluation": Copy("evaluation"), f"evaluation/{file}": content})
        yield Case(f"evaluation: {file}", REPORT, make, fine=True)
    for content in ("", "[]", '{"images": 3}', '{"images": [{"tactile_image": "../mine.png"}]}',
                    "[" * 100_000):  # fmt: skip
        make = laid(RUN | {"out/counts.json": content, "mine.png": PNG})
        yield Case(f"counts of an earlier call: {content[:30]}", USERS[0], make, fine=True)
