"""Tables of pairs for `import-pairs`, CSV and Parquet, and the images that they name."""

import io
import os
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from cases import Case, Content, instead, laid
from pictures import JPEG, PNG, bomb, encoded, frame

TAXELS, COUNT = 20, 10
SMALL = (24, 32)
"""Width and height of the images, px; any size is valid."""

CSV = "import-pairs pairs.csv --out out"
PARQUET = "import-pairs pairs.parquet --out out"
HEAD = "image," + ",".join(f"taxel_{n}" for n in range(TAXELS))

IMAGES = [encoded(frame(n, SMALL)) for n in range(COUNT)]


def _row(number: int, first: object = None, image: str | None = None) -> str:
    counts = [str(100 * number + n) for n in range(TAXELS)]
    if first is not None:
        counts[0] = str(first)
    return ",".join([f"{number}.png" if image is None else image, *counts])


def _table(head: str = HEAD, end: str = "\n", rows: list[str] | None = None) -> str:
    return end.join([head, *(rows or [_row(n) for n in range(COUNT)]), ""])


def _third(**changed: Any) -> str:
    """A valid table with another third row."""
    return _table(rows=[_row(n, **(changed if n == 2 else {})) for n in range(COUNT)])


def _more(name: str, values: Sequence[object]) -> str:
    """A valid table with one more column."""
    return _table(f"{HEAD},{name}", rows=[f"{_row(n)},{v}" for n, v in enumerate(values)])


def _odd(value: object, other: object) -> list[object]:
    return [value if n == 2 else other for n in range(COUNT)]


IMAGE_FILES: dict[str, Content] = {f"{n}.png": image for n, image in enumerate(IMAGES)}
PAIRS = IMAGE_FILES | {"pairs.csv": _table()}
"""A valid table with its images."""

BAD_CSV: tuple[tuple[str | bytes, str], ...] = (
    (HEAD + "\n", "no pairs"), (_table(_row(99)), ""), (PNG, "pairs.csv"),
    (_table().replace("taxel_3", "taxel\0"), ""), (_table().replace("image", "picture"), "image"),
    (_table().replace(",taxel_19", ",other"), "taxel_0 to taxel_19"),
    (_more("taxel_20", [1] * COUNT), "taxel_0 to taxel_19"),
    (_table().replace("taxel_6", "taxel_5"), "taxel_5"), (_table() + "9.png,1,2\n", "pairs.csv"),
    (_table() + _row(9) + ",1,2,3\n", "pairs.csv"), (_third(image="nowhere.png"), "nowhere.png"),
    *((_third(first=v), "line 4") for v in ("many", "", -1, 40_001, "nan", "inf", "1e300", 2**70)),
    *((_third(image=image), "line 4") for image in ("", ".", "x" * 5000)),
    (_table(rows=[_row(n, image=str(n)) for n in range(COUNT)]), "no file"),
    (_third(image="a\0b.png"), ""), (_third(image="1.png"), "same"),
    (_more("split", _odd("dev", "train")), "dev"), (_more("split", _odd("", "train")), "split"),
    (_more("shape", _odd("a/b", "a-b")), "same"), (_more("shape", _odd("a\0b", "c")), ""),
    (_more("shape", _odd("s" * 300, "c")), "shape"),
    *((_more(name, _odd(value, 0.5)), name) for name, value in (
        ("x_mm", "left"), ("yaw_rad", "inf"), ("y_mm", "-inf"), ("y_mm", "NA"), ("x_mm", "nan"),
        ("force_n", "NaN"))),
    *((_more(name, ["1.0"] * COUNT), says) for name, says in (
        ("froce_n", "force_n"), ("force", "force_n"), ("force_kg", "force_n"), ("Split", "split"),
        ("yaw_deg", "yaw_rad"), ("x_cm", "x_mm"), ("splits", "split"), ("shapes", "shape"),
        ("familly", "family"))),
    *((_more(name, _odd(value, 0.5)), f"line 4: {name}") for name, value in (
        ("force_n", -4), ("force_n", "true"), ("force_n", 5000), ("yaw_rad", 90))),
    *((_third(first=v), "line 4: taxel_0") for v in ("true", "1_000", '"a, b"', "2024-01-01")),
    (_table(rows=[_row(n, "true") for n in range(COUNT)]), "line 2: taxel_0 is True"),
    (_table(rows=[",".join([f"{n}.png"] + ["0.5"] * TAXELS) for n in range(COUNT)]), "0 and 1"),
    (_more("note,note", ["a,b"] * COUNT), "note"), (_table().replace("3.png", '"3.png'), "csv"),
)  # fmt: skip
"""Content, and part of the sentence."""

NAMES = ("../../x", "$\\foo_{$", "<b>", "a b", "ü", ".", "..", "-x", "con", "%s")
GOOD_CSV: tuple[str, ...] = (
    _table(), "\ufeff" + _table(), _table().replace(",", ";"), _table().replace(",", "\t"),
    _table(end="\r\n"), _table(end="\n\n"), _table().rstrip(), _third(first="12.4"),
    _table().replace("3.png", '"3.png"'), _more("note", ["mine"] * COUNT), _more("shape", NAMES),
    _more("x_mm", _odd("", 0.5)), _more("split", ["train"] * 8 + ["val", "test"]),
    _third(image="./2.png"), _table().replace(",", ", "),
    '"' + _table().replace(",", '" , "').replace("\n", '"\n"')[:-1],
    _more(" split", ["train"] * 8 + ["val", "test"]), _more("shape", range(COUNT)),
    "\ufeff" + _table(end="\r\n").replace(",", " ; "), _more("force_n", _odd("0", 12.5)),
    "\n".join(",".join(reversed(line.split(","))) for line in _table().splitlines()),
)  # fmt: skip


def _parquet(change: Callable[[dict[str, Any]], object]) -> Callable[[Path], object]:
    def write(path: Path) -> None:
        columns: dict[str, Any] = {
            "image": [{"bytes": image, "path": None} for image in IMAGES],
            "taxels": [[100 * n + k for k in range(TAXELS)] for n in range(COUNT)],
        }
        change(columns)
        pq.write_table(pa.table(columns), path)

    return write


def _repeated(path: Path) -> None:
    """One image of 4 MB in 500 rows, which Parquet stores once."""
    indices = pa.array([0] * 500, pa.int32())
    images = pa.DictionaryArray.from_arrays(indices, pa.array([b"\0" * 4_000_000]))
    table = pa.table({"image": images, "taxels": [[1] * TAXELS] * 500})
    pq.write_table(table, path, compression="zstd", store_schema=False)


def _whole() -> bytes:
    file = io.BytesIO()
    pq.write_table(pa.table({"image": IMAGES, "taxels": [[1] * TAXELS] * COUNT}), file)
    return file.getvalue()


def _empty(columns: dict[str, Any]) -> None:
    for name in columns:
        columns[name] = columns[name][:0]


THIRD: tuple[tuple[str, Any], ...] = (
    ("image", None), *(("image", {"bytes": b, "path": None}) for b in (
        b"", b"hello", PNG[:300], bomb(), PNG)),
    ("taxels", None), ("taxels", [1, 2, 3]), ("taxels", [None] * TAXELS),
    ("taxels", [10**12] * TAXELS), ("taxels", [-1] * TAXELS),
)  # fmt: skip
"""Bad values of row 3."""

COLUMNS: tuple[tuple[str, list, str], ...] = (
    ("image", list(range(COUNT)), "row 1"), ("image", [[1, 2]] * COUNT, "row 1"),
    ("taxels", list(range(COUNT)), "row 1"), ("taxels", [["many"] * TAXELS] * COUNT, "row 1"),
    ("taxels", [[float("nan")] * TAXELS] * COUNT, "row 1"), ("x_mm", ["left"] * COUNT, "x_mm"),
    ("taxels", [[[1]] * TAXELS] * COUNT, "row 1"), ("split", list(range(COUNT)), ""),
    ("taxels", [["1"] * TAXELS] * COUNT, "row 1: taxels[0] is '1'"),
    ("taxels", [[True] * TAXELS] * COUNT, "row 1: taxels[0] is True"),
    ("force_n", ["3.0"] * COUNT, "row 1: force_n"), ("force_n", [-3.0] * COUNT, "row 1: force_n"),
    ("split", [False] * COUNT, "row 1: split"), ("shape", [[1]] * COUNT, "row 1: shape"),
    ("taxel_0", list(range(COUNT)), "both"), ("force_N", [1.0] * COUNT, "force_n"),
    ("splt", ["train"] * COUNT, "split"), ("x_mm", [float("nan")] * COUNT, "x_mm"),
    ("force_n", [float("inf")] * COUNT, "force_n"), ("x_mm", [[1.0]] * COUNT, "x_mm"),
)  # fmt: skip
"""Bad columns, and part of the sentence."""

GOOD_COLUMNS: tuple[tuple[str, Any], ...] = (
    ("image", IMAGES), ("taxels", [[float(n)] * TAXELS for n in range(COUNT)]),
    ("taxels", [np.full(TAXELS, n, np.uint8) for n in range(COUNT)]),
    ("shape", list(range(COUNT))), ("note", ["mine"] * COUNT), ("x_mm", [None] * COUNT),
    ("digit_depth_mm", [1.0] * COUNT),
)  # fmt: skip

BAD_PARQUET: tuple[tuple[Content, str], ...] = (
    (_whole()[:2000], "parquet"), (_whole()[2000:], "parquet"), (_repeated, "MB of rows"),
    (_parquet(lambda columns: columns.pop("image")), "image"), (_parquet(_empty), ""),
    (_parquet(lambda columns: columns.pop("taxels")), "taxel"),
)  # fmt: skip


def cases() -> Iterator[Case]:
    for number, (content, says) in enumerate(BAD_CSV):
        yield Case(f"pairs.csv {number}, {says}", CSV, laid(PAIRS | {"pairs.csv": content}), says)
    for number, content in enumerate(GOOD_CSV):
        files = PAIRS | {"pairs.csv": content}
        yield Case(f"valid pairs.csv {number}", CSV, laid(files), fine=True)
    bad = [*BAD_PARQUET]
    bad += [(_parquet(lambda c, n=n, v=v: c[n].__setitem__(2, v)), "row 3") for n, v in THIRD]
    bad += [(_parquet(lambda c, n=n, v=v: c.update({n: v})), says) for n, v, says in COLUMNS]
    for number, (content, says) in enumerate(bad):
        yield Case(f"parquet {number}, {says}", PARQUET, laid({"pairs.parquet": content}), says)
    for name, values in GOOD_COLUMNS:
        write = _parquet(lambda columns, name=name, values=values: columns.update({name: values}))
        yield Case(f"parquet, {name}", PARQUET, laid({"pairs.parquet": write}), fine=True)
    for content in (b"", b"x", IMAGES[2][:200], bomb(), JPEG, encoded(frame(2, SMALL), "GIF")):
        yield Case(f"image {content[:4]}", CSV, laid(PAIRS | {"2.png": content}), "line 4")
    pipe = instead(os.mkfifo)
    yield Case("an image is a pipe", CSV, laid(PAIRS | {"2.png": pipe}), "line 4")
    for kind in ("BMP", "TIFF", "WEBP", "JPEG"):
        files = PAIRS | {"2.png": encoded(frame(2, SMALL), kind)}
        yield Case(f"an image is {kind}", CSV, laid(files), fine=True)
    empty: dict[str, Content] = {"pairs/notes.txt": "x"}
    yield Case("no table", CSV.replace("pairs.csv", "pairs"), laid(empty), "no CSV or Parquet")
    two: dict[str, Content] = {"pairs/a.csv": "x", "pairs/b.csv": "x"}
    yield Case("two tables", CSV.replace("pairs.csv", "pairs"), laid(two), "2 CSV")
    yield Case("a folder", CSV.replace("pairs.csv", "."), laid(PAIRS), fine=True)
