"""What is kept between calls, damaged: it must be made anew, without a word."""

from collections.abc import Iterator
from pathlib import Path

import numpy as np

from benchmarks.inputs import kept_files
from benchmarks.inputs.case import Base, Case, Make, copied, replaced
from benchmarks.inputs.images import PNG
from benchmarks.inputs.runs import USERS
from t2twin.sim.dataset.store import sha256_of

DECODED = ("evaluate", "{resnet18}", "--data", "data", "--split", "val", "--out", "out")


def _decoded(content: bytes | np.ndarray) -> Make:
    """A dataset whose decoded validation pictures are damaged."""

    def make(box: Path, base: Base) -> None:
        data = copied(base.data, box / "data")
        digest = sha256_of(data / "info.json")[:12]
        (data / "cache").mkdir()
        for side in (32, 64):
            path = data / f"cache/val-{side}-rgb-{digest}.npy"
            if isinstance(content, bytes):
                path.write_bytes(content)
            else:
                np.save(path, content)

    return make


def _evaluation(file: str, content: str | bytes) -> Make:
    """An evaluation that a report is told to draw, one of its files damaged."""

    def make(box: Path, base: Base) -> None:
        folder = copied(base.evaluation, box / "evaluation")
        replaced(folder / file, content)

    return make


REPORT = ("report", "--data", "{data}", "--runs", "{touch2touch}", "{resnet18}",
          "--evaluation", "evaluation", "--out", "out")  # fmt: skip


def _earlier_counts(content: str) -> Make:
    def make(box: Path, base: Base) -> None:
        copied(base.resnet18, box / "run")
        (box / "x.png").write_bytes(PNG)
        (box / "out").mkdir()
        (box / "out/counts.json").write_text(content)
        (box / "mine.png").write_bytes(PNG)

    return make


def cases() -> Iterator[Case]:
    for name, content in (
        ("empty", b""),
        ("text", b"hello"),
        ("a head alone", b"\x93NUMPY\x01\x00v\x00"),
        ("cut", np.lib.format.magic(1, 0) + b"\x10\x00" + b"{" * 16),
        ("of another shape", np.zeros((6, 3, 3, 3), np.uint8)),
        ("of another kind", np.zeros((6, 64, 64, 3))),
        (
            "of objects",
            b"\x93NUMPY\x01\x00\x36\x00{'descr': '|O', 'fortran_order': False, 'shape': (6,)}  ",
        ),
    ):
        yield Case(f"decoded pictures: {name}", DECODED, _decoded(content), fine=True)
    yield Case(
        "an evaluation's metrics empty", REPORT, _evaluation("val/metrics.json", ""), fine=True
    )
    yield Case("its predictions cut", REPORT, _evaluation("val/predictions.npz", b"PK"), fine=True)
    for content in ("", "[]", '{"images": 3}', '{"images": [{"tactile_image": "../mine.png"}]}',
                    "[" * 100_000):  # fmt: skip
        name = f"counts of an earlier call: {content[:30]!r}"
        yield Case(name, USERS[0], _earlier_counts(content), fine=True)
    yield from kept_files.cases()
