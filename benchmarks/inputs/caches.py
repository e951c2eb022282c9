"""What is kept between calls, damaged: it must be made anew, without a word."""

import os
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np

import t2twin
from benchmarks.inputs import kept_files
from benchmarks.inputs.case import Base, Case, Make, copied, replaced
from benchmarks.inputs.images import PNG
from benchmarks.inputs.runs import USERS
from t2twin.core.cache_dir import VARIABLE
from t2twin.core.cached_files import write_checked
from t2twin.sim.contact import mujoco_pins
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


def _in_place(put: Callable[[Path], object]) -> Make:
    """A dataset at whose decoded validation pictures' place something else is."""

    def make(box: Path, base: Base) -> None:
        data = copied(base.data, box / "data")
        digest = sha256_of(data / "info.json")[:12]
        (data / "cache").mkdir()
        for side in (32, 64):
            put(data / f"cache/val-{side}-rgb-{digest}.npy")

    return make


def _cached(user: Callable[[Base], np.ndarray], damage: Callable[[Path], object]) -> Make:
    """Calls what keeps one file in the cache, damages the file, and calls it again."""

    def call(box: Path, base: Base) -> None:
        before = os.environ.get(VARIABLE)
        os.environ[VARIABLE] = str(box / "cache")
        try:
            first = user(base)
            (file,) = (each for each in (box / "cache").rglob("*") if each.suffix in KEPT)
            damage(file)
            assert np.array_equal(first, user(base)), "the damaged file was used"
        finally:
            os.environ.pop(VARIABLE)
            if before is not None:
                os.environ[VARIABLE] = before

    return call


def _counts(base: Base) -> np.ndarray:
    """Of an image, by ONNX Runtime, rounded as PyTorch may stand in."""
    run = t2twin.load(base.resnet18, engine="onnx")
    return run.predict(np.full((32, 24, 3), 90, np.uint8)).round(-1)


def _model(base: Base) -> np.ndarray:
    """The stiffness and the places of a bed of pins that is large enough to be kept."""
    model = mujoco_pins._model(mujoco_pins.MIN_CACHED_PINS)
    return np.concatenate([model.jnt_stiffness.ravel(), model.geom_pos.ravel()])


def _flip(path: Path) -> None:
    content = bytearray(path.read_bytes())
    for place in range(len(content) // 3, len(content), len(content) // 3):
        content[place] ^= 64
    path.write_bytes(content)


def _swap(path: Path) -> None:
    """Puts another whole file of its kind into its place."""
    write_checked(path.with_name(f"other{path.suffix}"), b"another file")
    path.with_name(f"other{path.suffix}").replace(path)


def _instead(make: Callable[[Path], object]) -> Callable[[Path], object]:
    def damage(path: Path) -> None:
        path.unlink(missing_ok=True)
        make(path)

    return damage


KEPT = (".onnx", ".mjb")
"""Names of cached files end so."""

DAMAGES: dict[str, Callable[[Path], object]] = {
    "empty": lambda path: path.write_bytes(b""),
    "text": lambda path: path.write_bytes(b"hello"),
    "cut": lambda path: path.write_bytes(path.read_bytes()[:-100]),
    "longer": lambda path: path.write_bytes(path.read_bytes() + b"0"),
    "of flipped bits": _flip,
    "another's": _swap,
    "a pipe": _instead(os.mkfifo),
    "a folder": _instead(Path.mkdir),
    "a link to itself": _instead(lambda path: path.symlink_to(path)),
}

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
    yield Case("decoded pictures: a pipe", DECODED, _in_place(os.mkfifo), says="a pipe")
    yield Case("decoded pictures: a folder", DECODED, _in_place(Path.mkdir), says="a folder")
    for what, user in (("ONNX file", _counts), ("compiled bed", _model)):
        for name, damage in DAMAGES.items():
            yield Case(f"a cached {what}: {name}", (), call=_cached(user, damage), fine=True)
    yield Case(
        "an evaluation's metrics empty", REPORT, _evaluation("val/metrics.json", ""), fine=True
    )
    yield Case("its predictions cut", REPORT, _evaluation("val/predictions.npz", b"PK"), fine=True)
    for content in ("", "[]", '{"images": 3}', '{"images": [{"tactile_image": "../mine.png"}]}',
                    "[" * 100_000):  # fmt: skip
        name = f"counts of an earlier call: {content[:30]!r}"
        yield Case(name, USERS[0], _earlier_counts(content), fine=True)
    yield from kept_files.cases()
