"""Places to write to that cannot be written, or that hold something of the user's."""

import os
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path

from cases import Base, Case, Content, Copy, bind_socket, instead, laid, link
from files import RUN
from frames import CALIBRATE, FRAMES
from pairs import PAIRS
from pictures import PNG

INPUTS = FRAMES | PAIRS | {"x.png": PNG, "file": "mine"}
WRITERS = {
    "press": "press circle-1 --out", "primitives": "primitives --out",
    "slide": "slide circle-1 --dx-mm 0.1 --steps 1 --out",
    "simdata": "simdata --scale smoke --out", "export": "export --run {resnet18} --out",
    "train": "train resnet18 --data {data} --preset smoke --out",
    "evaluate": "evaluate {resnet18} --data {data} --out",
    "translate": "translate --run {resnet18} x.png --out", "report": "report --data {data} --out",
    "report of runs": "report --data {data} --runs {resnet18} --out",
    "convert": "convert {data} --to lerobot --out",
    "import-pairs": "import-pairs pairs.csv --out", "calibrate": CALIBRATE.removesuffix(" out"),
}  # fmt: skip
BAD = ("file", "file/below", "file/far/below", "/proc/1/nope", "/dev/null", "/dev/null/x",
       "x" * 300, "/".join(["x" * 200] * 30))  # fmt: skip
TAKEN: dict[str, dict[str, Content]] = {
    "a dataset": {"taken": Copy("data")}, "notes": {"taken/notes.txt": "mine"},
}  # fmt: skip

TARGETS: dict[str, Content] = {
    "file.onnx": "mine", "folder": Path.mkdir, "full/notes.txt": "mine", "pipe": os.mkfifo,
    "socket": bind_socket, "to-file": link("file.onnx"), "to-folder": link("folder"),
    "to-pipe": link("pipe"), "to-device": link("/dev/null"), "to-nothing": link("nothing"),
    "to-itself": link("to-itself"),
}  # fmt: skip
NEVER = {
    "a folder": "'' . .. / ./ folder folder/ folder/. full to-folder", "a socket": "socket",
    "a device": "/dev/null /dev/zero /dev/full to-device", "a pipe": "pipe to-pipe",
    "dev/tty": "/dev/tty", "to-itself": "to-itself", "proc": "/proc/1/x.onnx /proc/version",
    "": "file.onnx/x.onnx pipe/x.onnx " + "x" * 300,
}  # fmt: skip
"""Places that no option makes writable, by a part of the sentence."""

EXISTING = ("file.onnx", "./file.onnx", "folder/../file.onnx", "to-file", "to-nothing")
FINE = ("--out x.onnx", "--out new/folders/x.onnx", "--out 'no suffix'", "--out 'a\nb.onnx'",
        f"--out {'n' * 250}", "--out ü🖐.onnx", "--out .hidden", "--out file.onnx --force",
        "--out to-file --force", "--out=folder/x.onnx", "--force --out x.onnx", "")  # fmt: skip

RESULTS = {
    "press circle-1": "press.json digit.png cyskin.json contact_digit.npz tactile_image.png",
    "translate --run {resnet18} x.png": "counts.csv counts.json x.png",
    "report --data {data}": "index.html",
    "calibrate --background background.png": "calibration.npz",
}  # fmt: skip
"""Commands, and files that they write into their folder."""


def _write_json(place: str, box: Path, base: Base) -> None:
    from t2twin.core.files import write_json

    write_json(Path(place), {"a": 1})


def _save_calibration(place: str, box: Path, base: Base) -> None:
    from t2twin.sim.digit.calibration import Calibration

    Calibration.load().save(Path(place))


def cases() -> Iterator[Case]:
    for name, command in WRITERS.items():
        for place in BAD:
            if name != "export" or place not in ("file", "/dev/null"):
                yield Case(f"{name} to {place[:20]}", f"{command} {place}", laid(INPUTS))
    for name in ("convert", "import-pairs", "simdata", "train"):
        for what, files in TAKEN.items():
            if (name, what) != ("simdata", "a dataset"):
                make = laid(INPUTS | files)
                yield Case(f"{name} to {what}", f"{WRITERS[name]} taken", make, "not empty")
    notes = laid(INPUTS | TAKEN["notes"])
    yield Case("slide to notes", f"{WRITERS['slide']} taken", notes, "not empty")
    seeded = f"{WRITERS['simdata']} taken --seed 5"
    yield Case("simdata to another", seeded, laid(TAKEN["a dataset"]), "another seed")
    yield from _exports()
    in_the_way: dict[str, Callable[[Path], object]] = {
        "folder": Path.mkdir, "pipe": os.mkfifo, "device": instead(link("/dev/null")),
    }  # fmt: skip
    for command, files in RESULTS.items():
        for file in files.split():
            says = file if command.startswith("report") else f"{file} cannot be written"
            for what, put in in_the_way.items():
                if (file, what) == ("index.html", "device"):
                    continue  # a report takes seconds
                make = laid(INPUTS | {f"out/{file}": put})
                yield Case(f"{file} is a {what}", f"{command} --out out", make, says)


def _exports() -> Iterator[Case]:
    export, own, targets = "export --run {resnet18} ", "export --run run ", laid(TARGETS)
    for says, places in NEVER.items():
        for place in places.split():
            if place.startswith("/dev/") and not Path(place).exists():
                continue  # macOS has no /dev/full
            yield Case(f"export to {place[:20]}", f"{export} --out {place}", targets, says)
    for place in ("folder", "/dev/null", "pipe", "to-device", ".", "socket"):
        words = f"{export} --force --out {place}"
        yield Case(f"export to {place} by force", words, targets, "cannot be written")
        for name, write in (("JSON", _write_json), ("calibration", _save_calibration)):
            yield Case(f"{name} to {place}", "", targets, call=partial(write, place))
    for place in EXISTING:
        yield Case(f"export to {place}", f"{export} --out {place}", targets, "already exists")
    for file in ("best.safetensors", "config.json", "log.jsonl"):
        yield Case(f"export to {file}", f"{own} --out run/{file}", laid(RUN), "already exists")
    again = laid(RUN | {"run/resnet18.onnx": "an earlier export"})
    yield Case("export again", own, again, "already exists")
    yield Case("export again by force", f"{own} --force", again, fine=True)
    yield Case("export into the run", own, laid(RUN), fine=True)
    for words in FINE:
        run = export if words else "export"
        yield Case(f"export {words[:20]}", f"{run} {words}", targets, fine=True)
