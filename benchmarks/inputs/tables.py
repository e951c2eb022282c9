"""Tables of pairs for `import-pairs`, CSV and Parquet, with the pictures they name."""

import io
import os
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from benchmarks.inputs.case import Base, Case, Make, holding
from benchmarks.inputs.images import JPEG, PNG, bomb, encoded, frame

TAXELS, PAIRS = 20, 10
SMALL = (24, 32)
"""Width and height of the pictures, px: any size is taken."""

CSV = ("import-pairs", "pairs.csv", "--out", "out")
PARQUET = ("import-pairs", "pairs.parquet", "--out", "out")
HEAD = "image," + ",".join(f"taxel_{n}" for n in range(TAXELS))

PICTURES = [encoded(frame(n, SMALL)) for n in range(PAIRS)]


def _row(number: int, first: object = None, image: str | None = None) -> str:
    counts = [str(100 * number + n) for n in range(TAXELS)]
    if first is not None:
        counts[0] = str(first)
    return ",".join([f"{number}.png" if image is None else image, *counts])


def _table(head: str = HEAD, end: str = "\n", rows: list[str] | None = None) -> str:
    return end.join([head, *(rows or [_row(n) for n in range(PAIRS)]), ""])


def _changed(**third: Any) -> str:
    """A good table whose third row is another."""
    rows = [_row(n) for n in range(PAIRS)]
    rows[2] = _row(2, **third)
    return _table(rows=rows)


def _pictures(box: Path) -> None:
    for number, picture in enumerate(PICTURES):
        (box / f"{number}.png").write_bytes(picture)


def _csv(content: str | bytes) -> Make:
    def make(box: Path, base: Base) -> None:
        _pictures(box)
        (box / "pairs.csv").write_bytes(content.encode() if isinstance(content, str) else content)

    return make


good_pairs = _csv(_table())


def _more(name: str, values: Sequence[object]) -> str:
    rows = [f"{_row(n)},{value}" for n, value in enumerate(values)]
    return _table(f"{HEAD},{name}", rows=rows)


def _third(value: object, other: object) -> list[object]:
    return [value if n == 2 else other for n in range(PAIRS)]


BAD_CSV: tuple[tuple[str, str | bytes, str], ...] = (
    ("empty", "", "pairs.csv"),
    ("head alone", HEAD + "\n", "no pairs"),
    ("no head", _table(_row(99)), ""),
    ("not text", b"\xff\xfe\x00\x01,\x02", "pairs.csv"),
    ("null bytes", _table().replace("taxel_3", "taxel\0"), ""),
    ("a binary file", PNG, "pairs.csv"),
    ("no column image", _table().replace("image", "picture"), "image"),
    ("19 taxels", _table().replace(",taxel_19", ",other"), "taxel_0 to taxel_19"),
    ("21 taxels", _more("taxel_20", [1] * PAIRS), "taxel_0 to taxel_19"),
    ("taxel_5 twice", _table().replace("taxel_6", "taxel_5"), "taxel_5"),
    ("a short row", _table() + "9.png,1,2\n", "pairs.csv"),
    ("a long row", _table() + _row(9) + ",1,2,3\n", "pairs.csv"),
    ("a count of text", _changed(first="many"), "line 4"),
    ("a count missing", _changed(first=""), "line 4"),
    ("a count negative", _changed(first=-1), "line 4"),
    ("a count over full scale", _changed(first=40_001), "line 4"),
    ("a count not a number", _changed(first="nan"), "line 4"),
    ("a count infinite", _changed(first="inf"), "line 4"),
    ("a count of 1e300", _changed(first="1e300"), "line 4"),
    ("a count of 2^70", _changed(first=2**70), "line 4"),
    ("a picture that is not there", _changed(image="nowhere.png"), "nowhere.png"),
    ("a picture without a name", _changed(image=""), "line 4"),
    ("a picture of numbers", _table(rows=[_row(n, image=str(n)) for n in range(PAIRS)]), "line 2"),
    ("a folder as a picture", _changed(image="."), "line 4"),
    ("a name of 5,000 letters", _changed(image="x" * 5000), "line 4"),
    ("a name with a null byte", _changed(image="a\0b.png"), ""),
    ("one picture twice", _changed(image="1.png"), "same picture"),
    ("a split that is none", _more("split", _third("dev", "train")), "dev"),
    ("one split empty", _more("split", _third("", "train")), "split"),
    ("x of text", _more("x_mm", _third("left", 0.5)), "x_mm"),
    ("yaw infinite", _more("yaw_rad", _third("inf", 0.5)), "yaw_rad"),
    ("shapes that differ in / alone", _more("shape", _third("a/b", "a-b")), "same"),
    ("a shape with a null byte", _more("shape", _third("a\0b", "c")), ""),
    ("a shape of 300 letters", _more("shape", _third("s" * 300, "c")), "shape"),
    ("a misspelt force", _more("froce_n", [1.0] * PAIRS), "force_n"),
    ("a force without its unit", _more("force", [1.0] * PAIRS), "force_n"),
    ("a force in kg", _more("force_kg", [1.0] * PAIRS), "force_n"),
    ("a turn in degrees", _more("yaw_deg", [1.0] * PAIRS), "yaw_rad"),
    ("a place in cm", _more("x_cm", [1.0] * PAIRS), "x_mm"),
    ("Split", _more("Split", ["train"] * PAIRS), "split"),
    ("splits", _more("splits", ["train"] * PAIRS), "split"),
    ("shapes", _more("shapes", ["a"] * PAIRS), "shape"),
    ("familly", _more("familly", ["a"] * PAIRS), "family"),
    ("a space before split", _more(" split", ["train"] * PAIRS), "split"),
    ("note twice", _more("note,note", ["a,b"] * PAIRS), "note"),
    ("y infinite", _more("y_mm", _third("-inf", 0.5)), "y_mm"),
    ("a place of NA", _more("y_mm", _third("NA", 0.5)), "y_mm"),
    ("x not a number", _more("x_mm", _third("nan", 0.5)), "x_mm"),
    ("a force not a number", _more("force_n", _third("NaN", 0.5)), "force_n"),
    ("an open quote", _table().replace("3.png", '"3.png'), "pairs.csv"),
)

GOOD_CSV: tuple[tuple[str, str | bytes], ...] = (
    ("plain", _table()),
    ("a byte order mark", "\ufeff" + _table()),
    ("semicolons", _table().replace(",", ";")),
    ("tabs", _table().replace(",", "\t")),
    ("lines of Windows", _table(end="\r\n")),
    ("empty lines", _table(end="\n\n")),
    ("no line end at the end", _table().rstrip()),
    ("names in quotes", _table().replace("3.png", '"3.png"')),
    ("counts with decimals", _changed(first="12.4")),
    ("more columns", _more("note", ["mine"] * PAIRS)),
    ("a place unknown", _more("x_mm", _third("", 0.5))),
    ("splits of their own", _more("split", ["train"] * 8 + ["val", "test"])),
    (
        "shapes with odd names",
        _more("shape", ["../../x", "$\\foo_{$", "<b>", "a b", "ü", ".", "..", "-x", "con", "%s"]),
    ),
    ("a path with dots", _changed(image="./2.png")),
    (
        "columns the other way",
        "\n".join(",".join(reversed(line.split(","))) for line in _table().splitlines()),
    ),
)


def _parquet(change: Callable[[dict[str, Any]], object]) -> Make:
    def make(box: Path, base: Base) -> None:
        columns: dict[str, Any] = {
            "image": [{"bytes": picture, "path": None} for picture in PICTURES],
            "taxels": [[100 * n + k for k in range(TAXELS)] for n in range(PAIRS)],
        }
        change(columns)
        pq.write_table(pa.table(columns), box / "pairs.parquet")

    return make


def _set(name: str, value: Any) -> Make:
    return _parquet(lambda columns: columns.update({name: value}))


def _set_third(name: str, value: Any) -> Make:
    return _parquet(lambda columns: columns[name].__setitem__(2, value))


def _repeated(box: Path, base: Base) -> None:
    """One picture of 4 MB in 500 rows, which Parquet keeps once."""
    picture = pa.array([b"\0" * 4_000_000])
    indices = pa.array([0] * 500, pa.int32())
    pictures = pa.DictionaryArray.from_arrays(indices, picture)
    pq.write_table(
        pa.table({"image": pictures, "taxels": [[1] * TAXELS] * 500}),
        box / "pairs.parquet",
        compression="zstd",
        store_schema=False,
    )


def _whole() -> bytes:
    file = io.BytesIO()
    pq.write_table(pa.table({"image": PICTURES, "taxels": [[1] * TAXELS] * PAIRS}), file)
    return file.getvalue()


BAD_PARQUET: tuple[tuple[str, Make, str], ...] = (
    ("empty", holding("pairs.parquet", b""), "pairs.parquet"),
    ("text", holding("pairs.parquet", b"image,taxel_0\n"), "pairs.parquet"),
    ("cut", holding("pairs.parquet", _whole()[:2000]), "pairs.parquet"),
    ("no head", holding("pairs.parquet", _whole()[2000:]), "pairs.parquet"),
    ("no image", _parquet(lambda c: c.pop("image")), "image"),
    ("no taxels", _parquet(lambda c: c.pop("taxels")), "taxel"),
    ("no rows", _parquet(lambda c: [c.update({k: v[:0]}) for k, v in list(c.items())]), ""),
    ("picture null", _set_third("image", None), "row 3"),
    ("picture empty", _set_third("image", {"bytes": b"", "path": None}), "row 3"),
    ("picture of text", _set_third("image", {"bytes": b"hello", "path": None}), "row 3"),
    ("picture cut", _set_third("image", {"bytes": PNG[:300], "path": None}), "row 3"),
    ("picture a bomb", _set_third("image", {"bytes": bomb(), "path": None}), "row 3"),
    ("picture of another size", _set_third("image", {"bytes": PNG, "path": None}), "row 3"),
    ("pictures numbers", _set("image", list(range(PAIRS))), "row 1"),
    ("pictures lists", _set("image", [[1, 2]] * PAIRS), "row 1"),
    ("taxels null", _set_third("taxels", None), "row 3"),
    ("taxels ragged", _set_third("taxels", [1, 2, 3]), "row 3"),
    ("taxels with a null", _set_third("taxels", [None] * TAXELS), "row 3"),
    ("taxels one number", _set("taxels", list(range(PAIRS))), "row 1"),
    ("taxels of text", _set("taxels", [["many"] * TAXELS] * PAIRS), "row 1"),
    ("taxels not numbers", _set("taxels", [[float("nan")] * TAXELS] * PAIRS), "row 1"),
    ("taxels of lists", _set("taxels", [[[1]] * TAXELS] * PAIRS), "row 1"),
    ("taxels of 1e12", _set_third("taxels", [10**12] * TAXELS), "row 3"),
    ("split of numbers", _set("split", list(range(PAIRS))), ""),
    ("both kinds of counts", _set("taxel_0", list(range(PAIRS))), "both"),
    ("a misspelt force", _set("force_N", [1.0] * PAIRS), "force_n"),
    ("a misspelt split", _set("splt", ["train"] * PAIRS), "split"),
    ("x not a number", _set("x_mm", [float("nan")] * PAIRS), "x_mm"),
    ("a force of infinity", _set("force_n", [float("inf")] * PAIRS), "force_n"),
    ("rows of 2 GB in a small file", _repeated, "MB of rows"),
    ("a FIFO", lambda box, base: os.mkfifo(box / "pairs.parquet"), "pairs.parquet"),
    ("x of text", _set("x_mm", ["left"] * PAIRS), "x_mm"),
    ("x of lists", _set("x_mm", [[1.0]] * PAIRS), "x_mm"),
)

GOOD_PARQUET: tuple[tuple[str, Make], ...] = (
    ("plain", _parquet(lambda columns: None)),
    ("pictures as bytes", _set("image", PICTURES)),
    ("counts as floats", _set("taxels", [[float(n)] * TAXELS for n in range(PAIRS)])),
    ("counts of 8 bits", _set("taxels", [np.full(TAXELS, n, np.uint8) for n in range(PAIRS)])),
    ("shapes of numbers", _set("shape", list(range(PAIRS)))),
    ("more columns", _set("note", ["mine"] * PAIRS)),
    ("columns of a dataset", _set("digit_depth_mm", [1.0] * PAIRS)),
    ("poses null", _set("x_mm", [None] * PAIRS)),
)


def _two_tables(box: Path, base: Base) -> None:
    (box / "pairs").mkdir()
    (box / "pairs/a.csv").write_text("x")
    (box / "pairs/b.csv").write_text("x")


def _fifo_picture(box: Path, base: Base) -> None:
    good_pairs(box, base)
    (box / "2.png").unlink()
    os.mkfifo(box / "2.png")


def _other_pictures(content: bytes) -> Make:
    def make(box: Path, base: Base) -> None:
        good_pairs(box, base)
        (box / "2.png").write_bytes(content)

    return make


PICTURES_BESIDE: tuple[tuple[str, Make, str], ...] = (
    ("a FIFO", _fifo_picture, "line 4"),
    ("empty", _other_pictures(b""), "line 4"),
    ("text", _other_pictures(b"hello"), "line 4"),
    ("cut", _other_pictures(PICTURES[2][:200]), "line 4"),
    ("a bomb", _other_pictures(bomb()), "line 4"),
    ("of another size", _other_pictures(JPEG), "line 4"),
    ("GIF", _other_pictures(encoded(frame(2, SMALL), "GIF")), "line 4"),
)


def cases() -> Iterator[Case]:
    for name, content, says in BAD_CSV:
        yield Case(f"pairs.csv: {name}", CSV, _csv(content), says)
    for name, content in GOOD_CSV:
        yield Case(f"pairs.csv: {name}", CSV, _csv(content), fine=True)
    for name, make, says in BAD_PARQUET:
        yield Case(f"pairs.parquet: {name}", PARQUET, make, says)
    for name, make in GOOD_PARQUET:
        yield Case(f"pairs.parquet: {name}", PARQUET, make, fine=True)
    for name, make, says in PICTURES_BESIDE:
        yield Case(f"pairs, a picture: {name}", CSV, make, says)
    for kind in ("BMP", "TIFF", "WEBP", "JPEG"):
        make = _other_pictures(encoded(frame(2, SMALL), kind))
        yield Case(f"pairs, a picture: {kind}", CSV, make, fine=True)
    yield Case("pairs, two tables", ("import-pairs", "pairs", "--out", "out"), _two_tables, "2 CSV")
    yield Case("pairs, a folder", ("import-pairs", ".", "--out", "out"), good_pairs, fine=True)
