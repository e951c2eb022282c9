"""Places to write into that cannot be written into, or hold something else."""

from collections.abc import Iterator
from pathlib import Path

from benchmarks.inputs.calibrations import good_frames
from benchmarks.inputs.case import Base, Case, Make, copied
from benchmarks.inputs.images import PNG
from benchmarks.inputs.tables import good_pairs

WRITERS: dict[str, tuple[str, ...]] = {
    "press": ("press", "circle-1", "--out"),
    "slide": ("slide", "circle-1", "--dx-mm", "0.1", "--steps", "1", "--out"),
    "primitives": ("primitives", "--out"),
    "simdata": ("simdata", "--scale", "smoke", "--out"),
    "train": ("train", "resnet18", "--data", "{data}", "--preset", "smoke", "--out"),
    "evaluate": ("evaluate", "{resnet18}", "--data", "{data}", "--out"),
    "translate": ("translate", "--run", "{resnet18}", "x.png", "--out"),
    "export": ("export", "--run", "{resnet18}", "--out"),
    "report": ("report", "--data", "{data}", "--out"),
    "report of runs": ("report", "--data", "{data}", "--runs", "{resnet18}", "--out"),
    "import-pairs": ("import-pairs", "pairs.csv", "--out"),
    "calibrate": ("calibrate", "--background", "background.png", "--presses", "presses",
                  "--ball-diameter-mm", "4.7", "--out"),
}  # fmt: skip


def _inputs(box: Path, base: Base) -> None:
    (box / "x.png").write_bytes(PNG)
    good_pairs(box, base)
    good_frames(box, base)
    (box / "file").write_text("mine")
    (box / "nowhere").symlink_to("no/such/place/at/all")


BAD = {
    "a file": "file",
    "below a file": "file/below",
    "far below a file": "file/far/below",
    "no name": "/proc/1/nope",
    "a device": "/dev/null",
    "below a device": "/dev/null/x",
    "a name too long": "x" * 300,
    "a path too long": "/".join(["x" * 200] * 30),
}
NOT_FOR_ONE_FILE = ("a file", "a device")
"""Places that `export`, which writes one file, may be told to replace: it is left out of them."""


def _dataset(box: Path, base: Base) -> None:
    _inputs(box, base)
    copied(base.data, box / "taken")


def _notes(box: Path, base: Base) -> None:
    _inputs(box, base)
    (box / "taken").mkdir()
    (box / "taken/notes.txt").write_text("mine")


TAKEN: tuple[tuple[str, str, Make], ...] = (
    ("import-pairs", "a dataset", _dataset),
    ("import-pairs", "notes", _notes),
    ("slide", "notes", _notes),
    ("simdata", "notes", _notes),
    ("train", "a dataset", _dataset),
    ("train", "notes", _notes),
)


def cases() -> Iterator[Case]:
    for command, words in WRITERS.items():
        for name, place in BAD.items():
            if command != "export" or name not in NOT_FOR_ONE_FILE:
                yield Case(f"{command} into {name}", (*words, place), _inputs)
    yield Case("export into a folder", (*WRITERS["export"], "presses"), _inputs)
    for command, what, make in TAKEN:
        words = (*WRITERS[command], "taken")
        yield Case(f"{command} into a folder with {what}", words, make, "not empty")
    words = ("simdata", "--scale", "smoke", "--seed", "5", "--out", "taken")
    yield Case("simdata into another dataset", words, _dataset, "another seed")
