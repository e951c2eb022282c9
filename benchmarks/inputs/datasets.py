"""Datasets whose info.json or shards are damaged, for every command that reads one."""

import hashlib
import io
import json
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from benchmarks.inputs.case import BROKEN, REFUSED, Base, Case, Make, copied, replaced
from benchmarks.inputs.images import PNG, bomb, encoded, frame
from benchmarks.inputs.json_changes import WRONG, Change, changed
from t2twin.sim.dataset.columns import SCHEMA

OUT = ("--out", "out")
READERS: tuple[tuple[str, ...], ...] = (
    ("train", "resnet18", "--data", "data", "--preset", "smoke", "--epochs", "1", *OUT),
    ("evaluate", "{touch2touch}", "--data", "data", "--split", "both", *OUT),
    ("report", "--data", "data", *OUT),
    ("report", "--data", "data", "--runs", "{resnet18}", *OUT),
    ("simdata", "--verify", "data"),
)
"""Commands that read a dataset; the cases are asked of them in turn."""

FIELDS: dict[str, str] = {
    "format": "int",
    "complete": "bool",
    "pairs": "dict",
    "pairs.train": "int",
    "layout": "str",
    "layout_x_mm": "list",
    "layout_y_mm": "list",
    "layout_x_mm.3": "float",
    "full_scale_counts": "int",
    "versions": "dict",
    "versions.numpy": "str",
    "shards": "dict",
    "shards.train/circle-1.parquet": "dict",
    "shards.train/circle-1.parquet.sha256": "str",
    "shards.train/circle-1.parquet.pairs": "int",
    "parameters.cyskin": "dict",
    "parameters.cyskin.pad_diameter_mm": "list",
    "parameters.cyskin.gain_counts": "float",
    "parameters.digit.thickness_mm": "float",
    "parameters.shapes": "dict",
    "parameters.shapes.circle-1": "list",
}
"""Fields of info.json, and the kind that each is of."""

MAY_LACK = ("format", "versions.numpy", "parameters.shapes.circle-1")
"""Of these, those that a reader does without."""

MORE: tuple[tuple[str, Change], ...] = (
    ("full scale negative", ("full_scale_counts", -1)),
    ("full scale 0", ("full_scale_counts", 0)),
    ("full scale 10^12", ("full_scale_counts", 10**12)),
    ("pairs 10^12", ("shards.train/circle-1.parquet.pairs", 10**30)),
    ("pairs negative", ("pairs.train", -1)),
    ("another format", ("format", 99)),
    ("a picture of 10^12 rows", ("image_shape", [10**12, 240, 3])),
    ("a picture of 0 rows", ("image_shape", [0, 240, 3])),
    ("a picture of two numbers", ("image_shape", [320, 240])),
    ("one taxel fewer in x", ("layout_x_mm", [0.0] * 19)),
    ("no taxels", ("layout_x_mm", [])),
    ("seed negative", ("seed", -1)),
    ("seed 2^70", ("seed", 2**70)),
    ("a sha256 of nothing", ("shards.train/circle-1.parquet.sha256", "")),
    ("a split more", ("pairs", {"train": 1, "val": 1, "test": 1, "more": 1})),
    ("a split fewer", ("pairs", {"train": 1, "val": 1})),
    ("a law that is none", ("parameters.digit.young_mpa", -1)),
)

PATHS = ("../../etc/passwd", "/etc/passwd", "train/../../x.parquet", "train/a/b.parquet", "train/",
         "", "train/x.txt", "other/x.parquet", "train/\0.parquet")  # fmt: skip
"""Names of shards that lie in no split."""


def _info(change: Change | None = None, text: Callable[[str], str] | None = None) -> Make:
    def make(box: Path, base: Base) -> None:
        path = copied(base.data, box / "data") / "info.json"
        content = path.read_text()
        if change is not None:
            content = changed(content, *change)
        replaced(path, text(content) if text else content)

    return make


def _named(name: str) -> Make:
    """The dataset with one shard under another name."""

    def rename(text: str) -> str:
        content = json.loads(text)
        content["shards"][name] = content["shards"].pop("train/circle-1.parquet")
        return json.dumps(content)

    return _info(text=rename)


TEXTS: tuple[tuple[str, Callable[[str], str]], ...] = (
    ("empty", lambda text: ""),
    ("cut", lambda text: text[:200]),
    ("null", lambda text: "null"),
    ("a list", lambda text: "[]"),
    ("a number", lambda text: "3"),
    ("100,000 levels deep", lambda text: '{"pairs":' * 100_000),
    ("a comma too many", lambda text: text.replace("{", "{,", 1)),
    ("a NaN", lambda text: text.replace("-9.7428", "NaN", 1)),
    ("a number of 400 digits", lambda text: text.replace("40000", "4" * 400, 1)),
    ("unfinished", lambda text: text.replace('"complete": true', '"complete": false')),
)


def _shard(change: Callable[[dict[str, list]], Any], honest: bool = True) -> Make:
    """The dataset with one shard's columns changed; honest: info.json has its new sha256."""

    def make(box: Path, base: Base) -> None:
        data = copied(base.data, box / "data")
        path = data / "train/circle-1.parquet"
        columns = pq.read_table(path).to_pydict()
        change(columns)
        table = pa.table({name: _column(name, values) for name, values in columns.items()})
        file = io.BytesIO()
        pq.write_table(table, file)
        _put(data, file.getvalue(), honest)

    return make


def _column(name: str, values: list) -> pa.Array:
    """Of the type that belongs there, if it can be."""
    try:
        return pa.array(values, SCHEMA.field(name).type)
    except (pa.ArrowException, OverflowError, TypeError):
        return pa.array(values)


def _bytes(spoil: Callable[[bytes], bytes], honest: bool) -> Make:
    def make(box: Path, base: Base) -> None:
        data = copied(base.data, box / "data")
        _put(data, spoil((data / "train/circle-1.parquet").read_bytes()), honest)

    return make


def _put(data: Path, content: bytes, honest: bool) -> None:
    replaced(data / "train/circle-1.parquet", content)
    if honest:
        info = json.loads((data / "info.json").read_text())
        info["shards"]["train/circle-1.parquet"]["sha256"] = hashlib.sha256(content).hexdigest()
        replaced(data / "info.json", json.dumps(info))


def _first(name: str, value: Any) -> Callable[[dict[str, list]], Any]:
    return lambda columns: columns[name].__setitem__(0, value)


def _without(name: str) -> Callable[[dict[str, list]], Any]:
    return lambda columns: columns.pop(name)


def _picture(content: bytes) -> Callable[[dict[str, list]], Any]:
    return _first("image", {"bytes": content, "path": "x.png"})


def _none_left(columns: dict[str, list]) -> None:
    for name in columns:
        columns[name] = columns[name][:0]


CONTENTS: tuple[tuple[str, Callable[[dict[str, list]], Any]], ...] = (
    ("no column image", _without("image")),
    ("no column taxels", _without("taxels")),
    ("no column shape", _without("shape")),
    ("no column force_n", _without("force_n")),
    ("picture null", _first("image", None)),
    ("picture empty", _picture(b"")),
    ("picture of text", _picture(b"hello")),
    ("picture cut", _picture(PNG[:500])),
    ("picture a bomb", _picture(bomb())),
    ("picture JPEG", _picture(encoded(frame(), "JPEG"))),
    ("pictures of numbers", lambda columns: columns.update(image=[1, 2, 3])),
    ("taxels null", _first("taxels", None)),
    ("taxels empty", _first("taxels", [])),
    ("taxels short", lambda columns: columns.update(taxels=[t[:19] for t in columns["taxels"]])),
    ("taxels ragged", _first("taxels", [1, 2, 3])),
    ("taxels with a null", lambda columns: columns["taxels"][0].__setitem__(3, None)),
    ("taxels negative", _first("taxels", [-1] * 20)),
    ("taxels over full scale", _first("taxels", [65_000] * 20)),
    ("taxels of text", lambda columns: columns.update(taxels=[["a"] * 20] * 3)),
    ("taxels not numbers", lambda columns: columns.update(taxels=[[float("nan")] * 20] * 3)),
    ("taxels of lists", lambda columns: columns.update(taxels=[[[1]] * 20] * 3)),
    ("no rows", _none_left),
    ("shape null", _first("shape", None)),
    ("shapes of numbers", lambda columns: columns.update(shape=[1, 2, 3])),
    ("x of text", lambda columns: columns.update(x_mm=["a", "b", "c"])),
)

BYTES: tuple[tuple[str, Callable[[bytes], bytes]], ...] = (
    ("empty", lambda content: b""),
    ("text", lambda content: b"hello"),
    ("cut in half", lambda content: content[: len(content) // 2]),
    ("cut by ten bytes", lambda content: content[:-10]),
    ("zeros", lambda content: bytes(len(content))),
    ("its middle random", lambda content: _noisy(content)),
)


def _noisy(content: bytes) -> bytes:
    middle = np.random.default_rng(0).bytes(2000)
    start = len(content) // 3
    return content[:start] + middle + content[start + len(middle) :]


def _missing_shard(box: Path, base: Base) -> None:
    (copied(base.data, box / "data") / "train/circle-1.parquet").unlink()


def _folder_for_shard(box: Path, base: Base) -> None:
    _missing_shard(box, base)
    (box / "data/train/circle-1.parquet").mkdir()


def _link_for_shard(box: Path, base: Base) -> None:
    _missing_shard(box, base)
    (box / "data/train/circle-1.parquet").symlink_to("/dev/zero")


def cases() -> Iterator[Case]:
    turn = 0
    for name, make in _of_info():
        yield _asked(f"info.json: {name}", READERS[turn % len(READERS)], make)
        turn += 1
    for name, make in _of_shards():
        for reader in (READERS[turn % 4], READERS[4]):
            yield _asked(f"shard: {name}", reader, make)
        turn += 1


def _asked(name: str, reader: tuple[str, ...], make: Make) -> Case:
    verify = "--verify" in reader
    statuses = (REFUSED, BROKEN) if verify else (REFUSED,)
    return Case(f"{name} ({' '.join(reader[:2])})", reader, make, statuses=statuses)


def _of_info() -> Iterator[tuple[str, Make]]:
    for field, kind in FIELDS.items():
        for value in WRONG[kind]:
            if not (field in MAY_LACK and value is ...):
                yield f"{field} {value!r}"[:60], _info((field, value))
    for name, change in MORE:
        yield name, _info(change)
    for path in PATHS:
        yield f"a shard at {path!r}", _named(path)
    for name, text in TEXTS:
        yield name, _info(text=text)


def _of_shards() -> Iterator[tuple[str, Make]]:
    for name, change in CONTENTS:
        yield name, _shard(change)
    for name, spoil in BYTES:
        yield name, _bytes(spoil, honest=True)
        yield f"{name}, and another sha256", _bytes(spoil, honest=False)
    yield "missing", _missing_shard
    yield "a folder", _folder_for_shard
    yield "a link to a device", _link_for_shard
