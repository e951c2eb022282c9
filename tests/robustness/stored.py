"""Datasets and runs that are damaged or were tampered with, for every command that reads them."""

import hashlib
import io
import json
import pickle
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from cases import NOISE, Case, Content, Copy, Unpickled, edit, json_edit, laid, put, wrong_fields
from files import DATA, RUN, SHARD
from pictures import JPEG, PNG, bomb
from safetensors.numpy import load_file, save

from t2twin.sim.dataset.columns import SCHEMA

OUT = "--out out"
READERS = (
    f"train resnet18 --data data --preset smoke --epochs 1 {OUT}",
    f"evaluate {{touch2touch}} --data data --split both {OUT}",
    f"report --data data {OUT}",
    f"report --data data --runs {{resnet18}} {OUT}",
    "simdata --verify data",
)
"""Commands that read a dataset, in turn."""

USERS = (
    f"translate --run run x.png {OUT}",
    f"evaluate run --data {{data}} --split val {OUT}",
    "export --run run --out x.onnx",
    f"report --data {{data}} --runs run {OUT}",
    "train resnet18 --data {data} --preset smoke --epochs 1 --out run",
)
"""Commands that read a run, in turn."""

NAME = "train/circle-1.parquet"
INFO_FIELDS = {
    "int": f"format pairs>train full_scale_counts shards>{NAME}>pairs", "bool": "complete",
    "dict": f"pairs versions shards shards>{NAME} parameters>cyskin parameters>shapes",
    "str": f"layout versions>numpy shards>{NAME}>sha256",
    "list": "layout_x_mm layout_y_mm parameters>cyskin>pad_diameter_mm parameters>shapes>circle-1",
    "float": "layout_x_mm>3 parameters>cyskin>gain_counts parameters>digit>thickness_mm",
}  # fmt: skip
INFO_OPTIONAL = "format versions>numpy parameters>shapes>circle-1"
INFO_VALUES: tuple[tuple[str, Any], ...] = (
    *(("full_scale_counts", value) for value in (-1, 0, 10**12)), ("pairs>train", -1),
    (f"shards>{NAME}>pairs", 10**30), ("format", 99), ("image_shape", [10**12, 240, 3]),
    ("image_shape", [0, 240, 3]), ("image_shape", [320, 240]), ("layout_x_mm", [0.0] * 19),
    ("layout_x_mm", []), ("seed", -1), ("seed", 2**70), (f"shards>{NAME}>sha256", ""),
    ("pairs", {"train": 1, "val": 1, "test": 1, "more": 1}), ("pairs", {"train": 1, "val": 1}),
    ("parameters>digit>young_mpa", -1),
)  # fmt: skip
SHARD_NAMES = ("../../etc/passwd", "/etc/passwd", "train/../../x.parquet", "train/a/b.parquet",
               "train/", "", "train/x.txt", "other/x.parquet", "train/\0.parquet")  # fmt: skip
TEXTS: tuple[Callable[[bytes], bytes], ...] = (
    lambda text: text[:200], lambda text: b"null", lambda text: b"[]", lambda text: b"3",
    lambda text: b'{"pairs":' * 100_000, lambda text: text.replace(b"{", b"{,", 1),
    lambda text: text.replace(b"-9.7428", b"NaN", 1),
    lambda text: text.replace(b"40000", b"4" * 400, 1),
    lambda text: text.replace(b'"complete": true', b'"complete": false'),
)  # fmt: skip
"""Changes of the text of info.json."""

CONFIG_FIELDS = {
    "str": "model preset>schedule data>info_sha256 data>layout", "dict": "preset data",
    "int": "preset>size preset>filters preset>batch seed planned_epochs processes",
    "float": "preset>learning_rate data>full_scale_counts", "bool": "preset>grey bf16",
    "list": "data>layout_x_mm data>layout_y_mm",
}  # fmt: skip
CONFIG_OPTIONAL = "preset>schedule preset>grey"
CONFIG_VALUES: tuple[tuple[str, Any], ...] = (
    ("model", "gpt"), ("model", "touch2touch"), ("preset>schedule", "linear"), ("format", 99),
    *((f"preset>{name}", value) for name, values in {
        "size": (0, 10**9), "filters": (0, 10**9, -16), "batch": (0,), "learning_rate": (0, -1),
        "dropout": (0.5,), "iou_weight": (None, float("nan"), -1)}.items() for value in values),
    ("seed", -1), ("seed", 2**70), ("epochs", 0), ("minutes", 0), ("planned_epochs", 0),
    ("planned_epochs", 2**70), ("processes", 0), ("data>info_sha256", ""),
    *(("data>full_scale_counts", value) for value in (0, -1, 10**12)),
    ("data>layout_x_mm", [0.0] * 19), ("data>layout_x_mm", [0.0] * 20),
    ("data>layout_x_mm>0", 1000.0),
    *(("direction", value) for value in (None, 3, "sideways", "cyskin-to-digit")),
)  # fmt: skip


def _shard(change: Callable[[dict[str, list]], Any]) -> Callable[[bytes], bytes]:
    """Changes columns of a shard."""

    def changed(content: bytes) -> bytes:
        columns = pq.read_table(io.BytesIO(content)).to_pydict()
        change(columns)
        file = io.BytesIO()
        pq.write_table(pa.table({name: _column(name, v) for name, v in columns.items()}), file)
        return file.getvalue()

    return changed


def _column(name: str, values: list) -> pa.Array:
    """Of the column's type where that is possible."""
    try:
        return pa.array(values, SCHEMA.field(name).type)
    except (pa.ArrowException, OverflowError, TypeError):
        return pa.array(values)


def _empty(columns: dict[str, list]) -> None:
    for name in columns:
        columns[name] = columns[name][:0]


FIRST: dict[str, tuple[Any, ...]] = {
    "image": (None, *({"bytes": b, "path": "x"} for b in (b"", b"text", PNG[:500], bomb(), JPEG))),
    "taxels": (None, [], [1, 2, 3], [None] * 20, [-1] * 20, [65_000] * 20), "shape": (None,),
}  # fmt: skip
"""Bad values of a shard's first row."""

COLUMNS: dict[str, tuple[list, ...]] = {
    "image": ([1, 2, 3],), "shape": ([1, 2, 3],), "x_mm": (["a", "b", "c"],),
    "taxels": tuple([row] * 3 for row in ([1] * 19, ["a"] * 20, [float("nan")] * 20, [[1]] * 20)),
}  # fmt: skip


def shard_changes() -> Iterator[tuple[str, Callable[[bytes], bytes]]]:
    for name in ("image", "taxels", "shape", "force_n"):
        yield f"no {name}", _shard(lambda columns, name=name: columns.pop(name))
    for name, value in ((name, value) for name, values in FIRST.items() for value in values):
        yield f"{name} {str(value)[:30]}", _shard(lambda c, n=name, v=value: c[n].__setitem__(0, v))
    for name, value in ((name, value) for name, values in COLUMNS.items() for value in values):
        yield f"{name} {str(value)[:30]}", _shard(lambda c, n=name, v=value: c.update({n: v}))
    yield "no rows", _shard(_empty)
    yield "cut by ten bytes", lambda content: content[:-10]
    yield "noise within", lambda content: content[:3000] + NOISE[:2000] + content[5000:]


def _with_digest(change: Callable[[bytes], bytes]) -> Callable[[Path], object]:
    """Changes a shard, and its SHA-256 in info.json."""

    def write(path: Path) -> None:
        edit(change)(path)
        digest = hashlib.sha256(path.read_bytes()).hexdigest()
        json_edit(f"shards>{NAME}>sha256", digest)(path.parents[1] / "info.json")

    return write


def _renamed_shard(name: str) -> Callable[[Path], object]:
    def write(path: Path) -> None:
        content = json.loads(path.read_text())
        content["shards"][name] = content["shards"].pop(NAME)
        put(path, json.dumps(content))

    return write


def _tensors(change: Callable[[dict[str, np.ndarray]], Any]) -> Callable[[Path], object]:
    def write(path: Path) -> None:
        tensors = load_file(path)
        change(tensors)
        put(path, save(tensors))

    return write


def _first(value: Callable[[np.ndarray], np.ndarray]) -> Callable[[dict[str, np.ndarray]], Any]:
    def change(tensors: dict[str, np.ndarray]) -> None:
        key = min(key for key, tensor in tensors.items() if tensor.ndim == 4)
        tensors[key] = value(tensors[key])

    return change


WEIGHTS: tuple[Callable[[dict[str, np.ndarray]], Any], ...] = (
    *(_first(lambda tensor, v=v: np.full_like(tensor, v)) for v in (np.nan, np.inf)),
    lambda tensors: tensors.pop(min(tensors)), lambda tensors: tensors.clear(),
    lambda tensors: tensors.update(more=np.zeros(3, np.float32)),
    _first(lambda tensor: tensor[:, :, :1]), _first(lambda tensor: np.concatenate([tensor] * 2)),
)  # fmt: skip
SPOILED: tuple[Callable[[bytes], bytes], ...] = (
    lambda content: pickle.dumps(Unpickled()), lambda content: content[:-1],
    lambda content: content + b"x", lambda content: bytes(8) + content[8:],
    lambda content: (2**60).to_bytes(8, "little") + content[8:],
    lambda content: content[:8] + b"x" * 20 + content[28:],
)  # fmt: skip
LINE = ('{"epoch": 1, "learning_rate": 0.002, "val_rmse_counts": 1.0, "val_rmse_percent": 1.0, '
        '"seconds": 1.0}')  # fmt: skip
LOGS = (
    None, "", "epoch 1: fine\n", "[]\n", "{}\n", f"{LINE}\n{LINE}\n",
    *(LINE.replace('epoch": 1', f'epoch": {value}') for value in ("0", '"one"', "2")),
    *(LINE.replace('counts": 1.0', f'counts": {value}') for value in ("-1.0", "NaN", "null")),
)  # fmt: skip


def cases() -> Iterator[Case]:
    info = [*wrong_fields(INFO_FIELDS, INFO_OPTIONAL, INFO_VALUES)]
    info += [(f"a shard at {name!r}", _renamed_shard(name)) for name in SHARD_NAMES]
    info += [(f"text {number}", edit(change)) for number, change in enumerate(TEXTS)]
    for number, (name, change) in enumerate(info):
        yield _of_dataset(f"info.json: {name}", number, DATA | {"data/./info.json": change})
    for number, (name, change) in enumerate(shard_changes()):
        files = DATA | {SHARD: _with_digest(change)}
        for reader in (number % 4, 4):
            yield _of_dataset(f"shard: {name}", reader, files)
    yield _of_dataset("shard: missing", 4, DATA | {SHARD: None})
    config: list[tuple[str, Content]] = [
        *wrong_fields(CONFIG_FIELDS, CONFIG_OPTIONAL, CONFIG_VALUES),
        *((text[:9], text) for text in ('{"model": "resn', "null", "[]", "[" * 100_000)),
    ]
    for number, (name, change) in enumerate(config):
        files = RUN | {"run/./config.json": change}
        yield Case(f"config.json: {name}", USERS[number % 5], laid(files))
    yield from _of_weights()
    for content in LOGS:
        files = RUN | {"run/log.jsonl": content}
        yield Case(f"log.jsonl: {str(content)[:40]}", USERS[3], laid(files), "log.jsonl")
    for field, value in (("seed", 1), ("epochs", 3), ("data>info_sha256", "0" * 64),
                         ("minutes", 2.5)):  # fmt: skip
        files = RUN | {"run/./config.json": json_edit(field, value)}
        yield Case(f"train into a run with another {field}", USERS[4], laid(files), "another")
    yield from _reversed()
    into = USERS[4].replace("--out run", "--out data")
    yield Case("train into a dataset", into, laid(DATA), "contains no run")
    for user in (USERS[0], USERS[4]):
        yield Case(f"valid: {user}", user, laid(RUN), fine=True)


def _of_dataset(name: str, reader: int, files: dict) -> Case:
    command = READERS[reader % 5]
    return Case(f"{name} ({command[:9]})", command, laid(files))


def _of_weights() -> Iterator[Case]:
    weights, state = "run/best.safetensors", "run/last.safetensors"
    for number, change in enumerate(WEIGHTS):
        for user in (USERS[number % 4], USERS[(number + 2) % 4]):
            yield Case(f"tensors {number}", user, laid(RUN | {weights: _tensors(change)}))
    unfinished = RUN | {"run/config.json": json_edit("epochs", 2),
                        "run/./config.json": json_edit("planned_epochs", 2)}  # fmt: skip
    two_epochs = USERS[4].replace("--epochs 1", "--epochs 2")
    for number, change in enumerate(SPOILED):
        yield Case(f"weights {number}", USERS[number % 4], laid(RUN | {weights: edit(change)}))
        yield Case(f"state {number}", two_epochs, laid(unfinished | {state: edit(change)}))
    yield Case("no weights", USERS[0], laid(RUN | {weights: None}), "first epoch")


def _reversed() -> Iterator[Case]:
    """A touch2touch run that predicts DIGIT images."""
    turned = laid({"x.png": PNG, "run": Copy("touch2touch"), "run/./config.json": json_edit(
        "direction", "cyskin-to-digit")})  # fmt: skip
    for user in (*USERS[:4], "live --run run {data}", "studio --run run"):
        yield Case(f"{user[:9]} with a reverse run", user, turned, "predicts DIGIT images")
    yield Case("train into a reverse run", USERS[4].replace("resnet18", "touch2touch"), turned,
               "another direction")  # fmt: skip
