"""Places of single output files: files, folders, devices and pipes of the user are kept."""

import os
import socket
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path

from benchmarks.inputs.calibrations import good_frames
from benchmarks.inputs.case import Base, Case, Make, copied
from benchmarks.inputs.images import PNG

EXPORT = ("export", "--run", "{resnet18}")
OWN = ("export", "--run", "run")
FORCE = "--force"


def _targets(box: Path, base: Base) -> None:
    """Everything that a file to write may be already."""
    (box / "file.onnx").write_text("mine")
    (box / "folder").mkdir()
    (box / "full").mkdir()
    (box / "full/notes.txt").write_text("mine")
    os.mkfifo(box / "pipe")
    (box / "to-file").symlink_to("file.onnx")
    (box / "to-folder").symlink_to("folder")
    (box / "to-pipe").symlink_to("pipe")
    (box / "to-device").symlink_to("/dev/null")
    (box / "to-nothing").symlink_to("nothing")
    (box / "to-itself").symlink_to("to-itself")
    with socket.socket(socket.AF_UNIX) as made, _short(box):
        made.bind("socket")


class _short:
    """Within the block the box is the working folder, as a socket's path is short."""

    def __init__(self, box: Path) -> None:
        self._box = box

    def __enter__(self) -> None:
        self._before = Path.cwd()
        os.chdir(self._box)

    def __exit__(self, *_: object) -> None:
        os.chdir(self._before)


def _run(box: Path, base: Base) -> None:
    copied(base.resnet18, box / "run")


def _exported(box: Path, base: Base) -> None:
    _run(box, base)
    (box / "run/resnet18.onnx").write_text("an earlier export")


NEVER: tuple[tuple[str, str], ...] = (
    ("", "a folder"), (".", "a folder"), ("..", "a folder"), ("/", "a folder"),
    ("./", "a folder"), ("folder", "a folder"), ("folder/", "a folder"),
    ("folder/.", "a folder"), ("full", "a folder"), ("to-folder", "a folder"),
    ("/dev/null", "a device"), ("/dev/zero", "a device"), ("/dev/full", "a device"),
    ("/dev/tty", "dev/tty"), ("pipe", "a pipe"), ("socket", "a socket"),
    ("to-pipe", "a pipe"), ("to-device", "a device"), ("to-itself", "to-itself"),
    ("file.onnx/x.onnx", "file.onnx/x.onnx"), ("x" * 300, "x"), ("/proc/1/x.onnx", "proc"),
    ("/proc/version", "proc"), ("pipe/x.onnx", "pipe"),
)  # fmt: skip
"""Places that no option makes writable, and what the sentence must hold."""

EXISTING = ("file.onnx", "./file.onnx", "folder/../file.onnx", "to-file", "to-nothing")
"""Places that are replaced with --force only."""

RUN_FILES = ("best.safetensors", "config.json", "log.jsonl")

FINE: tuple[tuple[str, ...], ...] = (
    ("--out", "x.onnx"), ("--out", "new/folders/x.onnx"), ("--out", "no suffix"),
    ("--out", "a\nb.onnx"), ("--out", "n" * 250), ("--out", "ü🖐.onnx"), ("--out", ".hidden"),
    ("--out", "file.onnx", FORCE), ("--out", "to-file", FORCE),
    ("--out=folder/x.onnx",), (FORCE, "--out", "x.onnx"),
)  # fmt: skip

WRITERS: dict[str, tuple[tuple[str, ...], tuple[str, ...]]] = {
    "press": (("press", "circle-1"), ("press.json", "digit.png", "cyskin.json",
                                      "contact_digit.npz", "tactile_image.png")),
    "translate": (("translate", "--run", "{resnet18}", "x.png"),
                  ("counts.csv", "counts.json", "x.png")),
    "report": (("report", "--data", "{data}"), ("index.html",)),
    "calibrate": (("calibrate", "--background", "background.png"), ("calibration.npz",)),
}  # fmt: skip
"""Commands, and files that they write into their folder."""


def _pipe(path: Path) -> None:
    os.mkfifo(path)


def _device(path: Path) -> None:
    path.symlink_to("/dev/null")


IN_THE_WAY: dict[str, Callable[[Path], object]] = {
    "folder": Path.mkdir, "pipe": _pipe, "link to a device": _device,
}  # fmt: skip


def _in_the_way(name: str, put: Callable[[Path], object]) -> Make:
    def make(box: Path, base: Base) -> None:
        good_frames(box, base)
        (box / "x.png").write_bytes(PNG)
        (box / "out").mkdir()
        put(box / "out" / name)

    return make


def cases() -> Iterator[Case]:
    for place, says in NEVER:
        yield Case(f"export to {place[:20]!r}", (*EXPORT, "--out", place), _targets, says)
    for place in ("folder", "/dev/null", "pipe", "to-device", ".", "socket"):
        words = (*EXPORT, FORCE, "--out", place)
        yield Case(f"export to {place!r} by force", words, _targets, "cannot be written")
    for place in EXISTING:
        words = (*EXPORT, "--out", place)
        yield Case(f"export to {place!r}, which exists", words, _targets, "already exists")
    for name in RUN_FILES:
        words = (*OWN, "--out", f"run/{name}")
        yield Case(f"export to the run's {name}", words, _run, "already exists")
    yield Case("export again", OWN, _exported, "already exists")
    yield Case("export again by force", (*OWN, FORCE), _exported, fine=True)
    yield Case("export into the run's folder", OWN, _run, fine=True)
    yield Case("export the pretrained run", ("export",), _targets, fine=True)
    for words in FINE:
        name = " ".join(word[:20] for word in words)
        yield Case(f"export {name!r}", (*EXPORT, *words), _targets, fine=True)
    for command, (words, names) in WRITERS.items():
        for name in names:
            for what, put in IN_THE_WAY.items():
                yield Case(
                    f"{command} where {name} is a {what}",
                    (*words, "--out", "out"),
                    _in_the_way(name, put),
                    name if command == "report" else f"{name} cannot be written",
                )
    yield from _in_python()


def _in_python() -> Iterator[Case]:
    for place, says in (("folder", "a folder"), ("pipe", "a pipe"), ("to-device", "a device"),
                        (".", "a folder"), ("/dev/null", "a device"), ("to-pipe", "a pipe"),
                        ("file.onnx/x", "cannot be written")):  # fmt: skip
        for name, write in PYTHON.items():
            yield Case(f"{name} to {place!r}", (), _targets, says, call=partial(write, place))


def _write_json(place: str, box: Path, base: Base) -> None:
    from t2twin.core.files import write_json

    write_json(Path(place), {"a": 1})


def _save_calibration(place: str, box: Path, base: Base) -> None:
    from t2twin.sim.digit.calibration import Calibration

    Calibration.load().save(Path(place))


PYTHON: dict[str, Callable[[str, Path, Base], None]] = {
    "write_json": _write_json,
    "a calibration's save": _save_calibration,
}
