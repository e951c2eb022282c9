"""Every kind of file with every damage of `cases.DAMAGES`, and layouts of taxels."""

import json
from collections.abc import Iterator
from typing import Any

import numpy as np
from cases import DAMAGES, Case, Content, Copy, laid, put
from frames import ADAPT, CALIBRATE, FRAMES, PRESS
from pairs import CSV, PAIRS, PARQUET
from pictures import PNG, TRANSLATE, encoded, frame
from recipes import MADE, RECIPE
from solids import SOLIDS

RUN: dict[str, Content] = {"run": Copy("resnet18"), "x.png": PNG}
DATA: dict[str, Content] = {"data": Copy("data")}
SHARD = "data/train/circle-1.parquet"
SHARD_READERS = (
    "train resnet18 --data data --preset smoke --epochs 1 --out out", "simdata --verify data",
    "evaluate {resnet18} --data data --split val --out out", "report --data data --out out",
    "convert data --to lerobot --out out",
)  # fmt: skip
FIELD = "live d --frames 1 --background b.png"
LIVE = {"d/x.png": PNG, "b.png": PNG}
PLACES = ((-6.0, -10.0), (0.0, -8.0), (6.0, -10.0), (-6.0, 8.0), (0.5, 9.0), (6.0, 10.0))
ROWS = [{"x_mm": x, "y_mm": y} for x, y in PLACES]
JSON, LAYOUT_CSV = json.dumps({"taxels": ROWS}), "x_mm,y_mm\n" + "".join(
    f"{x},{y}\n" for x, y in PLACES
)  # fmt: skip
ASKED = ("press circle-1 --sensor cyskin --out out --layout ",
         "simdata --scale smoke --out out --layout ",
         "export --run {touch2touch} --out x.onnx --layout ",
         "import-pairs pairs.csv --out out --layout ")  # fmt: skip
"""Commands that read a layout."""

KINDS: dict[str, tuple[dict[str, Content], str, tuple[str, ...]]] = {
    "image": ({"x.png": PNG}, "x.png", (TRANSLATE + "x.png",)),
    "background": (FRAMES, "background.png", (CALIBRATE, ADAPT)),
    "press": (FRAMES, "presses/press_3.png", (CALIBRATE, ADAPT)),
    "forces": (FRAMES | {"presses/forces.csv": "file,force_n\npress_0.png,1\n"},
               "presses/forces.csv", (CALIBRATE, ADAPT)),
    "calibration": ({"c.npz": b"PK"}, "c.npz", (PRESS,)),
    "pairs.csv": (PAIRS, "pairs.csv", (CSV,)),
    "pairs.parquet": ({"pairs.parquet": b"PAR1"}, "pairs.parquet", (PARQUET,)),
    "image of a pair": (PAIRS, "2.png", (CSV,)),
    "layout.json": (PAIRS | {"l.json": JSON}, "l.json", tuple(f"{a}l.json" for a in ASKED)),
    "layout.csv": (PAIRS | {"l.csv": LAYOUT_CSV}, "l.csv", tuple(f"{a}l.csv" for a in ASKED)),
    "info.json": (DATA, "data/info.json", (
        "train resnet18 --data data --preset smoke --epochs 1 --out out", "report --data data",
        "evaluate {touch2touch} --data data --split both --out out", "simdata --verify data")),
    "shard": (DATA, SHARD, (
        "train resnet18 --data data --preset smoke --epochs 1 --out out", "simdata --verify data")),
    "config.json": (RUN, "run/config.json", (
        "translate --run run x.png --out out", "evaluate run --data {data} --split val --out out",
        "export --run run --out x.onnx", "report --data {data} --runs run --out out")),
    "weights": (RUN, "run/best.safetensors", ("translate --run run x.png --out out",
                                               "export --run run --out x.onnx")),
    "state": (RUN, "run/last.safetensors", (
        "train resnet18 --data {data} --preset smoke --epochs 1 --out run",)),
    "log": (RUN, "run/log.jsonl", ("report --data {data} --runs run --out out",)),
    "recipe": ({"w.toml": RECIPE}, "w.toml", (MADE + "w.toml",)),
    "background of live": (LIVE, "b.png", (FIELD,)),
    "background of translate": (LIVE, "b.png", ("translate d/x.png --out out --background b.png",)),
    "video": ({"v.avi": b"RIFF\0\0\0\0AVI LIST"}, "v.avi", ("live --run {resnet18} v.avi",)),
} | {
    f"solid of {suffix}": ({f"x.{suffix}": content}, f"x.{suffix}", (
        f"press x.{suffix} --sensor digit --out out",))
    for suffix, content in SOLIDS.items()
}  # fmt: skip
"""By the kind of file: valid files, the damaged one of them, and commands that read it in turn."""

VALID = {("forces", "half"), ("video", "a folder")}
"""Kinds and damages that give valid input, or input that is not read."""


def _layout(index: int = 1, **changed: Any) -> str:
    return json.dumps({"taxels": [row | changed if n == index else row
                                  for n, row in enumerate(ROWS)]})  # fmt: skip


def _all(**more: Any) -> str:
    return json.dumps({"taxels": [row | more for row in ROWS]})


GRID = [{"x_mm": i * 0.2 - 8, "y_mm": j * 0.2 - 8} for i in range(78) for j in range(78)]
BAD_JSON = (
    "x_mm: 3", JSON[:60], "null", "3", json.dumps(ROWS), "{}", '{"taxels": null}', '{"taxels": 20}',
    '{"taxels": {"x_mm": 1}}', '{"taxels": [1, 2, 3]}', '{"taxels": [[1, 2], [3, 4], [5, 6]]}',
    '{"taxels": []}', json.dumps({"taxels": ROWS[:2]}), json.dumps({"taxels": [{"x_mm": 1}] * 5}),
    *(_layout(x_mm=v) for v in (None, "three", [1], True, np.nan, np.inf, 1e300, 100.0)),
    JSON.replace("-6.0", "1e400", 1), *(_layout(pad_diameter_mm=v) for v in (0, -4, "4 mm", 1000)),
    _layout(x_mm=-6.0, y_mm=-10.0), json.dumps({"taxels": ROWS[:1] * 5}), "[" * 100_000,
    json.dumps({"taxels": GRID}), _all(pad_diameter=4), _all(pad_diamter_mm=4), _all(X_mm=4),
    _all(pad_diameter_cm=0.4), _all(gain=2), json.dumps({"taxels": ROWS, "units": "cm"}),
    json.dumps({"format": 9, "taxels": ROWS}),
)  # fmt: skip
XY = "x_mm,y_mm"
BAD_CSV = (
    "1,2", f"{XY}|", "1,2|3,4|5,6", "x_mm|1|2|3", "x_mm,y|1,2|3,4|5,9", f"{XY}|a,b|c,d|e,f",
    f"{XY}|1,2|3,|5,6", f"{XY}|1,2|3|5,6", f"{XY}|1,2|3,4,5|5,6", f"{XY}|1,2|nan,4|5,6",
    f"{XY}|1,2|inf,4|5,6", f'{XY}|"1,2|3,4|5,6', f"{XY},pad_diameter|1,2,3|3,4,3|5,9,3",
    f"{XY},note|1,2,a|3,4,b|5,9,c", f"{XY},x_mm|1,2,1|3,4,3|5,9,5", f"{XY}|1,2|NA,4|5,6",
    f"{XY},pad_diameter_mm|1,2,nan|3,4,3|5,9,3", f"{XY},pad_diameter_mm|1,2,inf|3,4,3|5,9,3",
    "x_mm, y_mm|1, 2|3, |5, 9", 'x_mm, y_mm|"1, 2|3, 4|5, 9', "X_MM,Y_MM|1,2|3,4|5,9",
    f"{XY}|1,2|1e400,4|5,6",
    f"{XY},pad_diameter_mm|1,2,0|3,4,0|5,9,0",
)  # fmt: skip
GOOD: dict[str, str] = {
    "more.json": json.dumps({"taxels": [row | {"note": "x"} for row in ROWS], "about": "mine"}),
    "whole.json": _layout(x_mm=0, y_mm=0), "pads.json": _layout(pad_diameter_mm=1.5),
    "l.csv": LAYOUT_CSV, "l.CSV": LAYOUT_CSV, "tabs.csv": LAYOUT_CSV.replace(",", "\t"),
    "bom.csv": "\ufeff" + LAYOUT_CSV.replace(",", ";").replace(".", ",").replace("\n", "\r\n"),
    "lines.csv": LAYOUT_CSV.replace("\n", "\n\n"),
    "spaces.csv": LAYOUT_CSV.replace(",", ", "),
    "quoted.csv": '"' + LAYOUT_CSV.replace(",", '" , "').replace("\n", '"\n"')[:-1],
    "all.csv": "\ufeff" + LAYOUT_CSV.replace(",", " , ").replace("\n", "\r\n"),
    "turned.csv": LAYOUT_CSV.replace("x_mm,y_mm", "y_mm,x_mm"),
}  # fmt: skip


def cases() -> Iterator[Case]:
    for kind, (files, target, commands) in KINDS.items():
        for number, (damage, content) in enumerate(DAMAGES.items()):
            if (kind, damage) not in VALID:
                make = laid(files | {f"./{target}": content})
                yield Case(f"{kind}: {damage}", commands[number % len(commands)], make)
    for suffix, contents in (("json", BAD_JSON), ("csv", BAD_CSV)):
        for number, content in enumerate(contents):
            # Taxels far outside are valid for all commands but `press`.
            command = ASKED[0] if "100" in content or "1e+300" in content else ASKED[number % 4]
            files = PAIRS | {f"l.{suffix}": content.replace("|", "\n") + "\n"}
            yield Case(f"layout: {content[:60]}", f"{command}l.{suffix}", laid(files))
    for name, content in GOOD.items():
        yield Case(f"layout: {name}", ASKED[0] + name, laid({name: content}), fine=True)
    swapped = DATA | {SHARD: lambda path: put(path, path.with_stem("square-1").read_bytes())}
    for command in SHARD_READERS:
        yield Case(f"a swapped shard: {command[:8]}", command, laid(swapped), "circle-1.parquet")
    small = {"d/x.png": PNG, "b.png": encoded(frame(size=(30, 40)).convert("L"))}
    yield Case("a small background", FIELD, laid(small), fine=True)
