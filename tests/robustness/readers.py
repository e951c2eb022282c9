"""Readers of files: each kind of file with each damage, and wrong values by its format."""

import io
import json
from collections.abc import Iterator
from typing import Any

import pyarrow as pa
import pyarrow.parquet as pq
from cases import DAMAGES, JPEG, PNG, Case, Copy, Files, damaged, edit, encoded, frame, laid, put
from PIL import Image

from t2twin.sim.sensors.files import SPECS

OPTICS = SPECS / "digit.npz"
"""A valid optics file."""

# Valid files

RUN: Files = {"run": Copy("resnet18"), "x.png": PNG}
DATA: Files = {"data": Copy("data")}
SHARD, WEIGHTS = "data/train/circle-1.parquet", "run/best.safetensors"
UNTOUCHED = encoded(Image.new("RGB", (240, 320), (110, 90, 70)))
FRAMES: Files = {
    "background.png": UNTOUCHED,
    **{f"presses/press_{number}.png": encoded(frame(number)) for number in range(8)},
}
"""Frames of the right size, to which no optics can be fitted."""

FORCES = "file,force_n\npress_0.png,1.5\n"
TAXELS, COUNT = 20, 10
IMAGES = [encoded(frame(number, (24, 32))) for number in range(COUNT)]
HEAD = "image," + ",".join(f"taxel_{n}" for n in range(TAXELS))
ROWS = [",".join([f"{n}.png", *(str(100 * n + k) for k in range(TAXELS))]) for n in range(COUNT)]
TABLE = "\n".join([HEAD, *ROWS, ""])
IMAGE_FILES: Files = {f"{number}.png": image for number, image in enumerate(IMAGES)}
PAIRS: Files = {**IMAGE_FILES, "pairs.csv": TABLE}
"""A valid table of pairs with its images."""

LAYOUT = "x_mm,y_mm\n-6.0,-10.0\n0.0,-8.0\n6.0,-10.0\n-6.0,8.0\n0.5,9.0\n6.0,10.5\n"
RECIPE = """name = "mine"
[[parts]]
shapes = "random"
count = 1
presses = 1
place = { normal_mm = 1.0 }
"""
WHOLE_RECIPE = f"""seed = 1
imperfections = "white"
{RECIPE}force_n = {{ low = 1.0, high = 5.0 }}
background_share = 0.1
val_share = 0.2
[light]
kind = "drawn"
each = "shape"
renderer = "baked"
[light.draw]
led_size_mm = [1.0, 2.0]
"""

CAMERA = 'extends = "digit"\nname = "mine"\n[gel]\nyoung_mpa = 0.4\n'
"""A valid gel camera's file; tests/test_sensor_files.py has its wrong values."""

OWN_LIGHT = 'extends = "digit"\nname = "mine"\n[light]\noptics = "c.npz"\n'
ARRAY = 'extends = "cyskin-20"\nname = "mine"\n[layout]\nfile = "l.csv"\n'
"""A taxel array's."""

# Commands

TRANSLATE = "translate --run {resnet18} --out out "
CAMERAS = (
    "press circle-1 --source s.toml --out out", "simdata --scale smoke --target s.toml --out out",
    "slide circle-1 --dx-mm 1 --target s.toml --out out",
)  # fmt: skip
ARRAYS_OF_TAXELS = (
    "press circle-1 --target s.toml --out out", "simdata --recipe union --target s.toml --out out",
)  # fmt: skip
"""Commands that read a sensor's file, in turn."""

PRESS = "press circle-1 --sensor digit --out out --optics c.npz"
GIVEN = "--background background.png --presses presses --ball-diameter-mm 4.7 --out out"
CALIBRATE, ADAPT = f"calibrate {GIVEN}", f"adapt {GIVEN}"
ALONE = "calibrate --background background.png --out out"
CSV, PARQUET = "import-pairs pairs.csv --out out", "import-pairs pairs.parquet --out out"
MADE = "simdata --out out --workers 1 --recipe w.toml"
READERS = (
    "train resnet18 --data data --preset smoke --epochs 1 --out out", "simdata --verify data",
    "evaluate {touch2touch} --data data --split both --out out", "report --data data --out out",
    "convert data --to lerobot --out out", "report --data data --runs {resnet18} --out out",
)  # fmt: skip
"""Commands that read a dataset, in turn."""

USERS = (
    "translate --run run x.png --out out", "evaluate run --data {data} --split val --out out",
    "export --run run --out x.onnx", "report --data {data} --runs run --out out",
)  # fmt: skip
"""Commands that read a run, in turn."""

AGAIN = "train resnet18 --data {data} --preset smoke --epochs 1 --out run"
LAYOUTS = (
    "press circle-1 --sensor cyskin --out out --layout ",
    "simdata --scale smoke --out out --layout ",
    "export --run {touch2touch} --out x.onnx --layout ",
    "import-pairs pairs.csv --out out --layout ",
)
LIVE: Files = {"d/x.png": PNG, "b.png": PNG}
KINDS: dict[str, tuple[Files, str, tuple[str, ...]]] = {
    "image": ({"x.png": PNG}, "x.png", (f"{TRANSLATE} x.png",)),
    "background": (FRAMES, "background.png", (CALIBRATE, ADAPT)),
    "press": (FRAMES, "presses/press_3.png", (CALIBRATE, ADAPT)),
    "forces": (FRAMES | {"presses/forces.csv": FORCES}, "presses/forces.csv", (CALIBRATE, ADAPT)),
    "optics": ({"c.npz": OPTICS.read_bytes()}, "c.npz", (PRESS,)),
    "sensor": ({"s.toml": CAMERA}, "s.toml", CAMERAS),
    "optics of a sensor": ({"s.toml": OWN_LIGHT, "c.npz": OPTICS.read_bytes()}, "c.npz", CAMERAS),
    "layout of a sensor": ({"s.toml": ARRAY, "l.csv": LAYOUT}, "l.csv", ARRAYS_OF_TAXELS),
    "pairs.csv": (PAIRS, "pairs.csv", (CSV,)),
    "pairs.parquet": ({"pairs.parquet": b"PAR1"}, "pairs.parquet", (PARQUET,)),
    "image of a pair": (PAIRS, "2.png", (CSV,)),
    "layout.json": (PAIRS | {"l.json": "{}"}, "l.json",
                    tuple(f"{each}l.json" for each in LAYOUTS)),
    "layout.csv": (PAIRS | {"l.csv": LAYOUT}, "l.csv", tuple(f"{each}l.csv" for each in LAYOUTS)),
    "info.json": (DATA, "data/info.json", READERS), "shard": (DATA, SHARD, READERS[:2]),
    "config.json": (RUN, "run/config.json", USERS), "weights": (RUN, WEIGHTS, USERS[::2]),
    "state": (RUN, "run/last.safetensors", (AGAIN,)), "log": (RUN, "run/log.jsonl", USERS[3:]),
    "recipe": ({"w.toml": RECIPE}, "w.toml", (MADE,)),
    "background of live": (LIVE, "b.png", ("live d --frames 1 --background b.png",)),
    "background of translate": (LIVE, "b.png", ("translate d/x.png --out out --background b.png",)),
    "video": ({"v.avi": b"RIFF\0\0\0\0AVI LIST"}, "v.avi", ("live --run {resnet18} v.avi",)),
    "solid": ({"x.stl": b""}, "x.stl", ("press x.stl --sensor digit --out out",)),
}  # fmt: skip
"""By the kind of file: valid files, the damaged one of them, and commands that read it in turn."""

VALID = {("forces", "half"), ("video", "a folder")}
"""Kinds and damages that give valid input, or input that is not read."""

OWN = ("info.json", "shard", "config.json", "weights", "state", "log")
"""Files that t2twin itself has written: their content may be damaged."""


# Wrong values by format


def wrong_tables(good: str) -> Iterator[tuple[str, str]]:
    """CSV tables with one thing wrong. Their last column has numbers."""
    head, first, *rest = good.strip().split("\n")
    column, start = head.rpartition(",")[2], first.rpartition(",")[0]
    for value in ("many", "nan", "inf", "true", "1 N", "\0"):
        yield f"{column} is {value!r}", "\n".join([head, f"{start},{value}", *rest])
    yield "no column", good.replace(column, "other")
    yield "another unit", good.replace(column, f"{column[:-1]}q")
    yield "a column twice", good.replace(head, f"{head},{column}").replace(first, f"{first},1")
    yield "a row twice", "\n".join([head, first, first, *rest])
    yield "an open quotation mark", good.replace(first, f'"{first}')
    yield "a short row", good + start + "\n"


def wrong_recipes() -> Iterator[tuple[str, str]]:
    """TOML with one value of another type, one name misspelled, or broken."""
    for line in WHOLE_RECIPE.splitlines():
        name, equals, _ = line.partition(" = ")
        for value in ("-1", "[]", "nan", "true", "{}") if equals else ():
            yield f"{name} = {value}", WHOLE_RECIPE.replace(line, f"{name} = {value}")
        if equals:
            yield f"{name}s", WHOLE_RECIPE.replace(line, line.replace(name, f"{name}s", 1))
    for text in ('{"format": 1}', RECIPE[:20], RECIPE + "[[parts]]", "parts = " + "[" * 5000):
        yield text[-20:], text


COLUMNS: dict[str, tuple[Any, ...]] = {
    "image": (None, 1, {"bytes": b"", "path": "x"}),
    "taxels": (None, [], [1] * 19, [-1] * 20, ["a"] * 20, [float("nan")] * 20),
    "force_n": ("x", -3.0, float("inf")), "x_mm": ("a", float("nan")),
}  # fmt: skip
"""Wrong values of the columns of pairs."""


def wrong_columns(good: dict[str, list]) -> Iterator[tuple[str, bytes]]:
    """Parquet files with one column wrong, in all rows or in the first, or damaged."""

    def packed(columns: dict[str, list]) -> bytes:
        file = io.BytesIO()
        pq.write_table(pa.table(columns), file)
        return file.getvalue()

    rows = len(good["image"])
    for name, values in COLUMNS.items():
        for value in values:
            yield f"{name} {str(value)[:30]}", packed(good | {name: [value] * rows})
    for name in good:
        yield f"no {name}", packed({key: value for key, value in good.items() if key != name})
        yield f"first {name}", packed(good | {name: [None, *good[name][1:]]})
    yield "no rows", packed({name: values[:0] for name, values in good.items()})
    yield "cut by ten bytes", packed(good)[:-10]


BAD_LAYOUTS = (
    "null", '{"taxels": 20}', '{"taxels": [1, 2, 3]}', "[" * 100_000,
    *(f'{{"taxels": [{{"x_mm": {x}, "y_mm": 1}}]}}' for x in ("null", '"three"', "[1]", "NaN")),
)  # fmt: skip

ODD_IMAGES = {
    **{f"mode {mode}": encoded(frame().convert(mode)) for mode in ("L", "RGBA", "P", "1")},
    "JPEG as PNG": JPEG,
}
BAD_IMAGES = {
    "a flipped byte": PNG[: len(PNG) // 2] + b"\xa5\x5a" + PNG[len(PNG) // 2 + 2 :],
    "4,001 x 3,000": encoded(Image.new("RGB", (4001, 3000))), "BMP": encoded(frame(), "BMP"),
}  # fmt: skip
FOLDERS: tuple[tuple[Files, str, str], ...] = (
    ({"x.png/notes.txt": b""}, "x.png", "images"),
    ({"d/a.png": PNG, "d/b.png": PNG[:300]}, "d", "b.png"),
    ({"out/x.png": PNG}, "out/x.png", "would be replaced"),
)
"""Files, argument of `t2twin translate`, and part of the message."""

NAMES = ("naïve 🖐.png", "--out.png", "A.PNG")


def cases() -> Iterator[Case]:
    for kind, (files, target, commands) in KINDS.items():
        contents = [
            (name, damage)
            for name, damage in DAMAGES.items()
            if (kind, name) not in VALID and not (kind in OWN and name.startswith("a "))
        ]
        yield from damaged(kind, commands, files, target, contents)
    layout_csv, layout_json = (
        tuple(each + name for each in LAYOUTS) for name in ("l.csv", "l.json")
    )
    columns = {"image": [{"bytes": each, "path": None} for each in IMAGES],
               "taxels": [[100 * n + k for k in range(TAXELS)] for n in range(COUNT)]}  # fmt: skip
    for name, commands, files, target, contents in (
        ("forces", (CALIBRATE, ADAPT), FRAMES, "presses/forces.csv", wrong_tables(FORCES)),
        ("layout", layout_csv, PAIRS, "l.csv", wrong_tables(LAYOUT)),
        ("layout", layout_json[:2], {}, "l.json", ((t[:60], t) for t in BAD_LAYOUTS)),
        ("pairs", (CSV,), IMAGE_FILES, "pairs.csv", wrong_tables(TABLE)),
        ("parquet", (PARQUET,), {}, "pairs.parquet", wrong_columns(columns)),
        ("recipe", (MADE,), {}, "w.toml", wrong_recipes()),
        ("image", (f"{TRANSLATE} x.png",), {}, "x.png", BAD_IMAGES.items()),
    ):
        yield from damaged(name, commands, files, target, contents)
    odd = ODD_IMAGES.items()
    yield from damaged("image", (f"{TRANSLATE} x.png",), {}, "x.png", odd, fine=True)
    for files, argument, says in FOLDERS:
        yield Case(f"images {argument}", TRANSLATE + argument, laid(files), says)
    for name in NAMES:
        files = {f"d/{name}": PNG}
        yield Case(f"image called {name!r}", TRANSLATE + "d", laid(files), fine=True)
    yield from _of_frames()
    yield from _of_runs()


def _of_frames() -> Iterator[Case]:
    """Frames of `calibrate` and `adapt`, and the background of `live`."""
    other = "presses/press_9.png"
    wrong: tuple[tuple[str, Files, str], ...] = (
        ("no background", {"presses/1.png": PNG}, "background.png"),
        ("a wide background", FRAMES | {"background.png": encoded(frame(size=(320, 240)))}, "wide"),
        ("notes only", {"background.png": UNTOUCHED, "presses/notes.txt": b"x"}, "presses"),
        ("one press", {"background.png": UNTOUCHED, "presses/1.png": PNG}, "press"),
        ("a press of another size", FRAMES | {other: encoded(frame(size=(240, 240)))}, "press_9"),
        ("one press eight times", FRAMES | {f"presses/press_{n}.png": PNG for n in range(8)}, ""),
        ("presses are a file", {"background.png": UNTOUCHED, "presses": JPEG}, "presses"),
    )  # fmt: skip
    for number, (name, files, says) in enumerate(wrong):
        yield Case(f"frames: {name}", (CALIBRATE, ADAPT)[number % 2], laid(files), says)
    begun = FRAMES | {"out/optics.json": "{}", "out/optics.npz": b""}
    yield Case("adapt: a damaged earlier start", ADAPT, laid(begun), "optics.json")
    yield Case("the background alone", ALONE, laid({"background.png": UNTOUCHED}), fine=True)
    small = LIVE | {"b.png": encoded(frame(size=(30, 40)).convert("L"))}
    live = "live d --frames 1 --background b.png"
    yield Case("a small background", live, laid(small), fine=True)


def _of_runs() -> Iterator[Case]:
    """Runs and datasets that are whole, but not what the command needs."""
    swapped: Files = DATA | {SHARD: lambda path: put(path, path.with_stem("square-1").read_bytes())}
    for command in READERS[:5]:
        yield Case(f"a swapped shard: {command[:8]}", command, laid(swapped), "circle-1.parquet")

    def swapped_sides(text: bytes) -> bytes:
        content = json.loads(text)
        data = content["data"]
        data["source"], data["target"] = data["target"], data["source"]
        return json.dumps(content).encode()

    turned = edit(swapped_sides)
    files: Files = {"x.png": PNG, "run": Copy("touch2touch"), "run/config.json": turned}
    translate, evaluate, *others = USERS
    for user in (*others, "live --run run {data}", "studio --run run"):
        yield Case(f"{user[:9]} with a reverse run", user, laid(files), "image-to-counts")
    yield Case("translate an image to one", translate, laid(files), "of counts of cyskin-20")
    yield Case("evaluate a reverse run", evaluate, laid(files), fine=True)
    reseeded = edit(lambda text: json.dumps(json.loads(text) | {"seed": 1}).encode())
    files = RUN | {"run/config.json": reseeded}
    yield Case("another seed", AGAIN, laid(files), "another")
    yield Case("no run", AGAIN.replace("--out run", "--out data"), laid(DATA), "contains no run")
    for user in (USERS[0], AGAIN):
        yield Case(f"valid: {user}", user, laid(RUN), fine=True)


INPUTS = FRAMES | PAIRS | {"x.png": PNG, "file": "mine"}
WRITERS = {
    "press": "press circle-1 --out", "primitives": "primitives --out",
    "slide": "slide circle-1 --dx-mm 0.1 --steps 1 --out",
    "simdata": "simdata --scale smoke --out", "export": "export --run {resnet18} --out",
    "train": "train resnet18 --data {data} --preset smoke --out",
    "evaluate": "evaluate {resnet18} --data {data} --out",
    "translate": "translate --run {resnet18} x.png --out", "report": "report --data {data} --out",
    "convert": "convert {data} --to lerobot --out",
    "import-pairs": "import-pairs pairs.csv --out", "calibrate": CALIBRATE.removesuffix(" out"),
}  # fmt: skip
KEPT = ("convert", "import-pairs", "simdata", "train")
"""Commands that write to empty folders only."""


def places() -> Iterator[Case]:
    """Places to write to that cannot be written, or that hold something of the user's."""
    for name, command in WRITERS.items():
        for place in ("file/below", "/proc/1/nope"):
            yield Case(f"{name} to {place[:20]}", f"{command} {place}", laid(INPUTS))
    for name in KEPT:
        notes = laid(INPUTS | {"taken/notes.txt": "mine"})
        says = "contains no run" if name == "train" else "not empty"
        yield Case(f"{name} to notes", f"{WRITERS[name]} taken", notes, says)
    seeded = f"{WRITERS['simdata']} taken --seed 5"
    yield Case("simdata to another", seeded, laid({"taken": Copy("data")}), "another seed")
    export = WRITERS["export"]
    taken = laid({"taken/x": "mine"})
    yield Case("export to a folder", f"{export} taken", taken, "is a folder")
    yield Case("export to a file", f"{export} file", laid(INPUTS), "file exists")
    for words in ("new/folders/x.onnx", "ü🖐.onnx", "file --force"):
        yield Case(words, f"{export} {words}", laid(INPUTS), fine=True)
