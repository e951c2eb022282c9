"""Cached files that are damaged: they are made again, without a message."""

import importlib.util
import os
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path

import numpy as np
from cases import DAMAGES, Base, Case, Copy, laid
from files import DATA, RUN
from pictures import PNG
from solids import STL
from stored import USERS

import t2twin
from t2twin.core.cache_dir import VARIABLE
from t2twin.core.cached_files import cached_array
from t2twin.primitives_cad import catalogue
from t2twin.sim.contact import mujoco_pins
from t2twin.sim.dataset.store import sha256_of

LOOPS = "from t2twin.core.jit import compiled\n" + "".join(
    f"@compiled('f8(f8)')\ndef {name}(x):\n    return {factor} * x\n"
    for name, factor in (("twice", 2.0), ("thrice", 3.0))
)


def _machine_code(box: Path, base) -> np.ndarray:
    specification = importlib.util.spec_from_file_location("loops", box / "loops.py")
    assert specification is not None and specification.loader is not None
    module = importlib.util.module_from_spec(specification)
    specification.loader.exec_module(module)
    (box / "cache/code").mkdir(parents=True, exist_ok=True)
    for loop in (module.twice, module.thrice):
        loop._cache._folder = box / "cache/code"  # not the folder of this process
    return np.array([module.twice(1.5), module.thrice(1.5)])


FEW = {name: DAMAGES[name] for name in ("half", "noise", "a pipe")}
"""Damages; tests/test_checksum.py has more."""

CACHED: dict[str, Callable[[Path, Base], np.ndarray]] = {
    "shape": lambda box, base: catalogue.load(
        box / "x.stl", box / "cache/shapes").surface.heights_mm,
    "array": lambda box, base: cached_array("arrays", "key", __file__, lambda: np.arange(5.0)),
    "pins": lambda box, base: mujoco_pins._model(mujoco_pins.MIN_CACHED_PINS).geom_pos,
    "ONNX file": lambda box, base: t2twin.load(base.resnet18, engine="onnx").predict(
        np.full((32, 24, 3), 90, np.uint8)).round(-1),  # as PyTorch may replace it
    "machine code": _machine_code,
}  # fmt: skip
"""Functions whose results are cached."""

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
        for name, damage in FEW.items():
            call = partial(_again, compute, damage)
            files = laid({"x.stl": STL, "loops.py": LOOPS})
            yield Case(f"cached {what}: {name}", "", files, fine=True, call=call)
    for number, array in enumerate(ARRAYS):
        write = partial(np.save, arr=array) if isinstance(array, np.ndarray) else (
            lambda path, array=array: path.write_bytes(array))  # fmt: skip
        make = laid(DATA | {"data/info.json": _decoded(write)})
        yield Case(f"decoded images {number}", DECODED, make, fine=True)
    for write, says in ((os.mkfifo, "a pipe"), (Path.mkdir, "a folder")):
        make = laid(DATA | {"data/info.json": _decoded(write)})
        yield Case(f"decoded images: {says}", DECODED, make, says)
    damaged = {"evaluation/val/metrics.json": "", "evaluation/test/predictions.npz": b"PK"}
    yield Case("evaluation", REPORT, laid({"evaluation": Copy("evaluation")} | damaged), fine=True)
    for content in ("", "[]", '{"images": 3}', '{"images": [{"tactile_image": "../mine.png"}]}',
                    "[" * 100_000):  # fmt: skip
        make = laid(RUN | {"out/counts.json": content, "mine.png": PNG})
        yield Case(f"counts of an earlier call: {content[:30]}", USERS[0], make, fine=True)
