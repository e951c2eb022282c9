"""What `adapt` is given: frames, tables and numbers, all refused before any work begins."""

from collections.abc import Iterator
from pathlib import Path

from benchmarks.inputs.calibrations import BAD_FRAMES, BAD_TABLES, good_frames, with_table
from benchmarks.inputs.case import Base, Case

ADAPT = ("adapt", "--background", "background.png", "--presses", "presses",
         "--ball-diameter-mm", "4.7", "--out", "out")  # fmt: skip

BAD_NUMBERS: tuple[tuple[str, tuple[str, ...], str], ...] = (
    ("no minutes", ("--minutes", "0"), "minutes"),
    ("minutes below 0", ("--minutes", "-5"), "minutes"),
    ("minutes not a number", ("--minutes", "nan"), "minutes"),
    ("minutes without end", ("--minutes", "inf"), "minutes"),
    ("no workers", ("--workers", "0"), "workers"),
    ("workers below 0", ("--workers", "-1"), "workers"),
    ("a million workers", ("--workers", "1000000"), "workers"),
    ("a model that is none", ("--model", "resnet"), "model"),
    ("a start that is not there", ("--init-from", "gone"), "gone"),
    ("a start of another model", ("--model", "field", "--init-from", "{resnet18}"), "resnet18"),
    ("all held out", ("--held-out", "8"), "held out"),
    ("none held out", ("--held-out", "0"), "held_out"),
    ("a ball of nan", ("--ball-diameter-mm", "nan"), "ball"),
    ("a ball of 0", ("--ball-diameter-mm", "0"), "ball"),
    ("a ball of inches", ("--ball-diameter-mm", "0.19"), "ball"),
    ("a scale of 0", ("--scale-px-per-mm", "0"), "scale"),
    ("a scale of nan", ("--scale-px-per-mm", "nan"), "scale"),
    ("a tolerance below 0", ("--ball-tolerance-mm", "-0.1"), "tolerance"),
    ("a tolerance of nan", ("--depth-tolerance-mm", "nan"), "tolerance"),
    ("a tolerance of infinity", ("--force-tolerance-n", "inf"), "tolerance"),
    ("a tolerance of the whole modulus", ("--young-tolerance-mpa", "0.5"), "modulus"),
    ("a folder below a file", ("--out", "background.png/out"), "background.png"),
    ("a folder that is a file", ("--out", "background.png"), "background.png"),
    ("a folder with other things", ("--out", "presses"), "presses"),
)


def _no_folder(box: Path, base: Base) -> None:
    good_frames(box, base)
    (box / "out").mkdir()
    (box / "out/presses.json").write_text("{}")
    (box / "out/calibration.npz").write_bytes(b"")


def cases() -> Iterator[Case]:
    for name, make, says in BAD_FRAMES:
        yield Case(f"adapt, frames: {name}", ADAPT, make, says)
    for name, content in BAD_TABLES:
        yield Case(f"adapt, forces.csv: {name}", ADAPT, with_table(content), "forces.csv")
    for name, words, says in BAD_NUMBERS:
        yield Case(f"adapt: {name}", (*ADAPT, *words), good_frames, says)
    yield Case("adapt: a damaged earlier start", ADAPT, _no_folder, "presses.json")
