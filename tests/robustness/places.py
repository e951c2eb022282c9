"""Places to write to that cannot be written, or that hold something of the user's."""

import os
from collections.abc import Iterator
from pathlib import Path

from cases import Case, Copy, Files, bind_socket, laid, link
from pictures import PNG
from readers import CALIBRATE, FRAMES, PAIRS, RUN

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
BAD = ("file", "file/below", "/proc/1/nope", "/dev/null", "x" * 300)
KEPT = ("convert", "import-pairs", "simdata", "train", "press", "slide")
"""Commands that write to empty folders only."""

TARGETS: Files = {
    "file.onnx": "mine", "folder": Path.mkdir, "pipe": os.mkfifo, "socket": bind_socket,
    "to-file": link("file.onnx"), "to-folder": link("folder"), "to-device": link("/dev/null"),
    "to-nothing": link("nothing"), "to-itself": link("to-itself"),
}  # fmt: skip
NEVER = {
    "a folder": "'' .. folder to-folder", "a socket": "socket", "a device": "/dev/null to-device",
    "a pipe": "pipe", "to-itself": "to-itself", "proc": "/proc/version",
    "already exists": "folder/../file.onnx to-file to-nothing",
}  # fmt: skip
"""Files that cannot be written without --force, by a part of the sentence."""

FINE = ("new/folders/x.onnx", "'a\nb.onnx'", "ü🖐.onnx", "file.onnx --force", "to-file --force")


def cases() -> Iterator[Case]:
    for name, command in WRITERS.items():
        for place in BAD:
            if name != "export" or place not in ("file", "/dev/null"):
                yield Case(f"{name} to {place[:20]}", f"{command} {place}", laid(INPUTS))
    notes = laid(INPUTS | {"taken/notes.txt": "mine"})
    for name in KEPT:
        yield Case(f"{name} to notes", f"{WRITERS[name]} taken", notes, "not empty")
    seeded = f"{WRITERS['simdata']} taken --seed 5"
    yield Case("simdata to another", seeded, laid({"taken": Copy("data")}), "another seed")
    for file, make, says in (
        ("digit.png", Path.mkdir, "digit.png cannot be"),
        ("press.json", os.mkfifo, "not of a press"),
    ):
        files = laid(INPUTS | {"out/press.json": "{}", f"out/{file}": make})
        yield Case(f"{file} is no file", f"{WRITERS['press']} out", files, says)
    export, targets = WRITERS["export"], laid(TARGETS)
    for says, places in NEVER.items():
        for place in places.split():
            yield Case(f"export to {place}", f"{export} {place}", targets, says)
    for place in ("folder", "/dev/null", "pipe", "to-device", "socket"):
        words = f"{export} {place} --force"
        yield Case(f"export to {place} by force", words, targets, "cannot be written")
    own = "export --run run --out run/config.json"
    yield Case("export to its own file", own, laid(RUN), "already exists")
    for words in FINE:
        yield Case(f"export {words[:20]}", f"{export} {words}", targets, fine=True)
