"""Layouts of taxels, JSON and CSV."""

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from benchmarks.inputs.case import Base, Case, Make, holding

PLACES = ((-6.0, -10.0), (0.0, -8.0), (6.0, -10.0), (-6.0, 8.0), (0.5, 9.0), (6.0, 10.0))


def taxels(**more: Any) -> list[dict[str, Any]]:
    return [{"x_mm": x, "y_mm": y} | more for x, y in PLACES]


def _with(**other: Any) -> str:
    """A good layout whose second taxel is another."""
    rows = taxels()
    rows[1] |= other
    return json.dumps({"taxels": rows})


def _without(key: str) -> str:
    rows = taxels()
    del rows[1][key]
    return json.dumps({"taxels": rows})


def _grid(side: int, step: float) -> str:
    places = [(i * step - 8, j * step - 8) for i in range(side) for j in range(side)]
    return json.dumps({"taxels": [{"x_mm": x, "y_mm": y} for x, y in places]})


def _csv(head: str, mark: str = ",", line_end: str = "\n", decimal: str = ".") -> str:
    rows = [mark.join(f"{v:g}".replace(".", decimal) for v in place) for place in PLACES]
    return line_end.join([head, *rows, ""])


NAN_TEXT = json.dumps({"taxels": taxels()}).replace("-6.0", "NaN", 1)

BAD_JSON: tuple[tuple[str, str | bytes], ...] = (
    ("empty", ""),
    ("no JSON", "x_mm: 3"),
    ("cut", _with()[:60]),
    ("not text", b"\xff\xfe\x00\x01"),
    ("null", "null"),
    ("a number", "3"),
    ("a list", json.dumps(taxels())),
    ("no taxels", "{}"),
    ("taxels null", '{"taxels": null}'),
    ("taxels a number", '{"taxels": 20}'),
    ("taxels an object", '{"taxels": {"x_mm": 1}}'),
    ("taxels of numbers", '{"taxels": [1, 2, 3]}'),
    ("taxels of lists", '{"taxels": [[1, 2], [3, 4], [5, 6]]}'),
    ("none", '{"taxels": []}'),
    ("two", json.dumps({"taxels": taxels()[:2]})),
    ("x missing", _without("x_mm")),
    ("y missing", _without("y_mm")),
    ("x null", _with(x_mm=None)),
    ("x text", _with(x_mm="three")),
    ("x a list", _with(x_mm=[1])),
    ("x true", _with(x_mm=True)),
    ("x not a number", NAN_TEXT),
    ("x infinite", NAN_TEXT.replace("NaN", "Infinity")),
    ("x 1e400", NAN_TEXT.replace("NaN", "1e400")),
    ("x 1e300", _with(x_mm=1e300)),
    ("a taxel outside", _with(x_mm=100.0)),
    ("pad 0", _with(pad_diameter_mm=0)),
    ("pad negative", _with(pad_diameter_mm=-4)),
    ("pad text", _with(pad_diameter_mm="4 mm")),
    ("pad of a metre", _with(pad_diameter_mm=1000)),
    ("two in one place", _with(x_mm=-6.0, y_mm=-10.0)),
    ("all in one place", json.dumps({"taxels": [{"x_mm": 1, "y_mm": 1}] * 5})),
    ("6,000 taxels", _grid(78, 0.2)),
    ("100,000 levels deep", "[" * 100_000),
    ("a pad without its unit", json.dumps({"taxels": taxels(pad_diameter=4)})),
    ("a pad misspelt", json.dumps({"taxels": taxels(pad_diamter_mm=4)})),
    ("a pad in cm", json.dumps({"taxels": taxels(pad_diameter_cm=0.4)})),
    ("X beside x", json.dumps({"taxels": taxels(X_mm=4)})),
    ("of format 9", json.dumps({"format": 9, "taxels": taxels()})),
)

BAD_CSV: tuple[tuple[str, str | bytes], ...] = (
    ("empty", ""),
    ("head alone", "x_mm,y_mm\n"),
    ("no head", _csv("1,2")),
    ("one column", "x_mm\n1\n2\n3\n"),
    ("y called y", _csv("x_mm,y")),
    ("words", "x_mm,y_mm\na,b\nc,d\ne,f\n"),
    ("an empty cell", "x_mm,y_mm\n1,2\n3,\n5,6\n"),
    ("a short row", "x_mm,y_mm\n1,2\n3\n5,6\n"),
    ("a long row", "x_mm,y_mm\n1,2\n3,4,5\n5,6\n"),
    ("nan", "x_mm,y_mm\n1,2\nnan,4\n5,6\n"),
    ("inf", "x_mm,y_mm\n1,2\ninf,4\n5,6\n"),
    ("not text", b"\xff\xfe\x00\x01\x02"),
    ("an open quote", 'x_mm,y_mm\n"1,2\n3,4\n5,6\n'),
    ("a pad without its unit", "x_mm,y_mm,pad_diameter\n1,2,3\n3,4,3\n5,9,3\n"),
    ("a column of notes", "x_mm,y_mm,note\n1,2,a\n3,4,b\n5,9,c\n"),
    ("x twice", "x_mm,y_mm,x_mm\n1,2,1\n3,4,3\n5,9,5\n"),
    ("a pad of nan", "x_mm,y_mm,pad_diameter_mm\n1,2,nan\n3,4,3\n5,9,3\n"),
    ("a pad of infinity", "x_mm,y_mm,pad_diameter_mm\n1,2,inf\n3,4,3\n5,9,3\n"),
    ("spaces before names", "x_mm, y_mm\n1,2\n3,4\n5,9\n"),
    ("capitals", "X_MM,Y_MM\n1,2\n3,4\n5,9\n"),
    ("NA", "x_mm,y_mm\n1,2\nNA,4\n5,6\n"),
    ("1e400", "x_mm,y_mm\n1,2\n1e400,4\n5,6\n"),
    ("pads of nothing", "x_mm,y_mm,pad_diameter_mm\n1,2,0\n3,4,0\n5,9,0\n"),
)

GOOD: tuple[tuple[str, str, str | bytes], ...] = (
    ("JSON with more keys", "l.json", json.dumps({"taxels": taxels(note="x"), "about": "mine"})),
    ("JSON with whole numbers", "l.json", _with(x_mm=0, y_mm=0)),
    ("JSON, own pads", "l.json", _with(pad_diameter_mm=1.5)),
    ("CSV", "l.csv", _csv("x_mm,y_mm")),
    ("CSV, capital suffix", "l.CSV", _csv("x_mm,y_mm")),
    ("CSV of a spreadsheet", "l.csv", "\ufeff" + _csv("x_mm;y_mm", ";", "\r\n", ",")),
    ("CSV with tabs", "l.csv", _csv("x_mm\ty_mm", "\t")),
    ("CSV with empty lines", "l.csv", _csv("x_mm,y_mm").replace("\n", "\n\n")),
    ("CSV, columns the other way", "l.csv", _csv("y_mm,x_mm")),
)


PRESS = ("press", "circle-1", "--sensor", "cyskin", "--out", "out", "--layout")
ASKED = (
    PRESS,
    ("simdata", "--scale", "smoke", "--out", "out", "--layout"),
    ("export", "--run", "{touch2touch}", "--out", "x.onnx", "--layout"),
    ("import-pairs", "pairs.csv", "--out", "out", "--layout"),
)
"""Commands that take a layout; the cases are asked of them in turn."""


def cases() -> Iterator[Case]:
    bad = [("l.json", *each) for each in BAD_JSON] + [("l.csv", *each) for each in BAD_CSV]
    for number, (file, name, content) in enumerate(bad):
        command = PRESS if name in ("a taxel outside", "x 1e300") else ASKED[number % len(ASKED)]
        make = _laid_with_pairs(file, content)
        yield Case(f"layout, {file[2:]}: {name} ({command[0]})", (*command, file), make)
    for name, file, content in GOOD:
        yield Case(f"layout: {name}", (*PRESS, file), holding(file, content), fine=True)


def _laid_with_pairs(name: str, content: str | bytes) -> Make:
    from benchmarks.inputs.tables import good_pairs

    def make(box: Path, base: Base) -> None:
        good_pairs(box, base)
        holding(name, content)(box, base)

    return make
