"""Places to write to that cannot be written, or that hold something of the user's."""

import os
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path

from cases import Base, Case, Copy, Files, bind_socket, instead, laid, link
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
KEPT = ("convert", "import-pairs", "simdata", "train", "slide")
"""Commands that write to empty folders only."""

TARGETS: Files = {
    "file.onnx": "mine", "folder": Path.mkdir, "full/notes.txt": "mine", "pipe": os.mkfifo,
    "socket": bind_socket, "to-file": link("file.onnx"), "to-folder": link("folder"),
    "to-device": link("/dev/null"), "to-nothing": link("nothing"), "to-itself": link("to-itself"),
}  # fmt: skip
NEVER = {
    "a folder": "'' .. ./ folder folder/. full to-folder", "a socket": "socket",
    "a device": "/dev/null /dev/full to-device", "a pipe": "pipe", "to-itself": "to-itself",
    "proc": "/proc/1/x.onnx /proc/version", "": "file.onnx/x.onnx pipe/x.onnx " + "x" * 300,
    "already exists": "file.onnx folder/../file.onnx to-file to-nothing",
}  # fmt: skip
"""Places that cannot be written without --force, by a part of the sentence."""

FINE = ("x.onnx", "new/folders/x.onnx", "'no suffix'", "'a\nb.onnx'", "n" * 250, "ü🖐.onnx",
        "file.onnx --force", "to-file --force")  # fmt: skip
RESULTS = {
    "press circle-1": "press.json digit.png cyskin.json contact_digit.npz tactile_image.png",
    "translate --run {resnet18} x.png": "counts.csv counts.json x.png",
    "report --data {data}": "index.html",
    "calibrate --background background.png": "optics.npz",
}  # fmt: skip
"""Commands, and files that they write into their folder."""

IN_THE_WAY: dict[str, Callable[[Path], object]] = {
    "folder": Path.mkdir, "pipe": os.mkfifo, "device": instead(link("/dev/null")),
}  # fmt: skip


def _save_optics(place: str, box: Path, base: Base) -> None:
    from t2twin.sim.sensors.pair import SensorPair

    SensorPair().camera.optics.save(Path(place))


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
    for command, files in RESULTS.items():
        for number, file in enumerate(files.split()):
            what = [*IN_THE_WAY][number % 3]
            says = file if command.startswith("report") else f"{file} cannot be written"
            make = laid(INPUTS | {f"out/{file}": IN_THE_WAY[what]})
            yield Case(f"{file} is a {what}", f"{command} --out out", make, says)
    yield from _exports()


def _exports() -> Iterator[Case]:
    export, own, targets = "export --run {resnet18} --out", "export --run run", laid(TARGETS)
    for says, places in NEVER.items():
        for place in places.split():
            if not place.startswith("/dev/") or Path(place).exists():  # macOS has no /dev/full
                yield Case(f"export to {place[:20]}", f"{export} {place}", targets, says)
    for place in ("folder", "/dev/null", "pipe", "to-device", "socket"):
        words = f"{export} {place} --force"
        yield Case(f"export to {place} by force", words, targets, "cannot be written")
        save = partial(_save_optics, place)
        yield Case(f"optics to {place}", "", targets, call=save)
    for file in ("best.safetensors", "config.json"):
        yield Case(f"export to {file}", f"{own} --out run/{file}", laid(RUN), "already exists")
    again = laid(RUN | {"run/resnet18.onnx": "an earlier export"})
    yield Case("export again", own, again, "already exists")
    yield Case("export again by force", f"{own} --force", again, fine=True)
    for words in FINE:
        yield Case(f"export {words[:20]}", f"{export} {words}", targets, fine=True)
