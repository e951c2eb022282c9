"""Caches and results that are damaged: they are made again; tests/test_checksum.py has more."""

import os
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path

import numpy as np
from cases import Case, Copy, laid
from files import DATA, RUN
from pictures import PNG
from stored import USERS

from t2twin.sim.dataset.store import sha256_of

ARRAYS = (
    b"", b"hello", b"\x93NUMPY\x01\x00v\x00", np.lib.format.magic(1, 0) + b"\x10\x00" + b"{" * 16,
    np.zeros((6, 3, 3, 3), np.uint8), np.zeros((6, 64, 64, 3)),
    b"\x93NUMPY\x01\x00\x36\x00{'descr': '|O', 'fortran_order': False, 'shape': (6,)}  ",
)  # fmt: skip
"""Wrong contents of a cache of decoded images."""

DECODED = "evaluate {resnet18} --data data --split val --out out"
REPORT = "report --data {data} --runs {touch2touch} {resnet18} --evaluation evaluation --out out"


def _decoded(write: Callable[[Path], object]) -> Callable[[Path], object]:
    """Writes caches of the decoded validation images of the dataset whose info.json is given."""

    def lay(info: Path) -> None:
        folder = info.with_name("cache")
        folder.mkdir()
        for side in (32, 64):
            write(folder / f"val-{side}-rgb-{sha256_of(info)[:12]}.npy")

    return lay


def cases() -> Iterator[Case]:
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
