"""Runs whose config.json, weights, state or log were tampered with or damaged."""

import json
import pickle
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
from safetensors.numpy import load_file, save

from benchmarks.inputs.case import Base, Case, LeavesFile, Make, copied, replaced
from benchmarks.inputs.images import PNG
from benchmarks.inputs.json_changes import WRONG, Change, changed

OUT = ("--out", "out")
USERS: tuple[tuple[str, ...], ...] = (
    ("translate", "--run", "run", "x.png", *OUT),
    ("evaluate", "run", "--data", "{data}", "--split", "val", *OUT),
    ("export", "--run", "run", "--out", "x.onnx"),
    ("report", "--data", "{data}", "--runs", "run", *OUT),
    ("train", "resnet18", "--data", "{data}", "--preset", "smoke", "--epochs", "1", "--out", "run"),
)
"""Commands that read a run; the cases are asked of them in turn."""

FIELDS = {
    "model": "str",
    "preset": "dict",
    "preset.size": "int",
    "preset.filters": "int",
    "preset.batch": "int",
    "preset.learning_rate": "float",
    "preset.schedule": "str",
    "preset.grey": "bool",
    "seed": "int",
    "planned_epochs": "int",
    "bf16": "bool",
    "processes": "int",
    "data": "dict",
    "data.info_sha256": "str",
    "data.layout": "str",
    "data.layout_x_mm": "list",
    "data.layout_y_mm": "list",
    "data.full_scale_counts": "float",
}
"""Fields of config.json, and the kind that each is of."""

MAY_LACK = ("preset.schedule", "preset.grey")
"""Of these, those with a default."""

MORE: tuple[tuple[str, Change], ...] = (
    ("a model that is none", ("model", "gpt")),
    ("another model", ("model", "touch2touch")),
    ("size 0", ("preset.size", 0)),
    ("size 10^9", ("preset.size", 10**9)),
    ("filters 0", ("preset.filters", 0)),
    ("filters 10^9", ("preset.filters", 10**9)),
    ("filters -16", ("preset.filters", -16)),
    ("batch 0", ("preset.batch", 0)),
    ("learning rate 0", ("preset.learning_rate", 0)),
    ("learning rate negative", ("preset.learning_rate", -1)),
    ("a schedule that is none", ("preset.schedule", "linear")),
    ("a setting more", ("preset.dropout", 0.5)),
    ("seed negative", ("seed", -1)),
    ("seed 2^70", ("seed", 2**70)),
    ("epochs 0", ("epochs", 0)),
    ("minutes 0", ("minutes", 0)),
    ("planned epochs 0", ("planned_epochs", 0)),
    ("planned epochs 2^70", ("planned_epochs", 2**70)),
    ("processes 0", ("processes", 0)),
    ("full scale 0", ("data.full_scale_counts", 0)),
    ("full scale negative", ("data.full_scale_counts", -1)),
    ("full scale 10^12", ("data.full_scale_counts", 10**12)),
    ("one taxel fewer", ("data.layout_x_mm", [0.0] * 19)),
    ("all taxels in one place", ("data.layout_x_mm", [0.0] * 20)),
    ("a taxel a metre off", ("data.layout_x_mm.0", 1000.0)),
    ("another format", ("format", 99)),
    ("a sha256 of nothing", ("data.info_sha256", "")),
    ("direction null", ("direction", None)),
    ("direction a number", ("direction", 3)),
    ("a direction that is none", ("direction", "sideways")),
    ("a ResNet18 the other way", ("direction", "cyskin-to-digit")),
    ("shape weight null", ("preset.iou_weight", None)),
    ("shape weight not a number", ("preset.iou_weight", float("nan"))),
    ("shape weight negative", ("preset.iou_weight", -1)),
)

TEXTS: tuple[tuple[str, str | bytes], ...] = (
    ("empty", ""),
    ("cut", '{"format": 1, "model": "resn'),
    ("not text", b"\xff\xfe"),
    ("null", "null"),
    ("a list", "[]"),
    ("100,000 levels deep", "[" * 100_000),
)


def _run(box: Path, base: Base) -> Path:
    (box / "x.png").write_bytes(PNG)
    return copied(base.resnet18, box / "run")


def _config(change: Change) -> Make:
    def make(box: Path, base: Base) -> None:
        path = _run(box, base) / "config.json"
        replaced(path, changed(path.read_text(), *change))

    return make


def _file(name: str, content: str | bytes | None) -> Make:
    """content: None takes the file away."""

    def make(box: Path, base: Base) -> None:
        path = _run(box, base) / name
        path.unlink()
        if content is not None:
            replaced(path, content)

    return make


def _tensors(name: str, change: Callable[[dict[str, np.ndarray]], Any]) -> Make:
    def make(box: Path, base: Base) -> None:
        path = _run(box, base) / name
        tensors = load_file(path)
        change(tensors)
        replaced(path, save(tensors))

    return make


def _spoiled(name: str, spoil: Callable[[bytes], bytes]) -> Make:
    def make(box: Path, base: Base) -> None:
        path = _run(box, base) / name
        replaced(path, spoil(path.read_bytes()))

    return make


def _first(value: Callable[[np.ndarray], np.ndarray]) -> Callable[[dict[str, np.ndarray]], Any]:
    def change(tensors: dict[str, np.ndarray]) -> None:
        key = sorted(key for key, tensor in tensors.items() if tensor.ndim == 4)[0]
        tensors[key] = value(tensors[key])

    return change


def _filled(number: float) -> Callable[[dict[str, np.ndarray]], Any]:
    return _first(lambda tensor: np.full_like(tensor, number))


WEIGHTS: tuple[tuple[str, Callable[[dict[str, np.ndarray]], Any]], ...] = (
    ("not a number", _filled(np.nan)),
    ("infinite", _filled(np.inf)),
    ("one tensor missing", lambda tensors: tensors.pop(sorted(tensors)[0])),
    ("one tensor more", lambda tensors: tensors.update(more=np.zeros(3, np.float32))),
    ("none", lambda tensors: tensors.clear()),
    ("of another shape", _first(lambda tensor: tensor[:, :, :1])),
    ("one column too many", _first(lambda tensor: np.concatenate([tensor, tensor]))),
)

SPOILED: tuple[tuple[str, Callable[[bytes], bytes]], ...] = (
    ("empty", lambda content: b""),
    ("text", lambda content: b"hello"),
    ("a pickle", lambda content: pickle.dumps(LeavesFile())),
    ("cut in half", lambda content: content[: len(content) // 2]),
    ("cut by one byte", lambda content: content[:-1]),
    ("a head of 2^60 bytes", lambda content: (2**60).to_bytes(8, "little") + content[8:]),
    ("a head of nothing", lambda content: bytes(8) + content[8:]),
    ("one byte more", lambda content: content + b"x"),
    ("a head that is no JSON", lambda content: content[:8] + b"x" * 20 + content[28:]),
)

LOG_LINE = (
    '{"epoch": 1, "learning_rate": 0.002, "val_rmse_counts": 1.0, "val_rmse_percent": 1.0, '
    '"seconds": 1.0}'
)
LOGS: tuple[tuple[str, str | bytes | None], ...] = (
    ("missing", None),
    ("empty", ""),
    ("not text", b"\xff\xfe"),
    ("no JSON", "epoch 1: fine\n"),
    ("a list", "[]\n"),
    ("an empty object", "{}\n"),
    ("epoch 0", LOG_LINE.replace('"epoch": 1', '"epoch": 0')),
    ("epoch of text", LOG_LINE.replace('"epoch": 1', '"epoch": "one"')),
    ("epoch 2 first", LOG_LINE.replace('"epoch": 1', '"epoch": 2')),
    ("RMSE negative", LOG_LINE.replace('counts": 1.0', 'counts": -1.0')),
    ("RMSE not a number", LOG_LINE.replace('counts": 1.0', 'counts": NaN')),
    ("RMSE null", LOG_LINE.replace('counts": 1.0', 'counts": null')),
    ("one line twice", f"{LOG_LINE}\n{LOG_LINE}\n"),
)


def cases() -> Iterator[Case]:
    turn = 0
    for name, make in _configs():
        yield Case(f"config.json: {name}", USERS[turn % len(USERS)], make)
        turn += 1
    for name, change in WEIGHTS:
        for user in USERS[turn % 4], USERS[(turn + 2) % 4]:
            yield Case(f"weights: {name} ({user[0]})", user, _tensors("best.safetensors", change))
        turn += 1
    for name, spoil in SPOILED:
        yield Case(f"weights: {name}", USERS[turn % 4], _spoiled("best.safetensors", spoil))
        turn += 1
        yield Case(f"state: {name}", _go_on(), _unfinished(_spoiled("last.safetensors", spoil)))
    yield Case("weights: missing", USERS[0], _file("best.safetensors", None), "first epoch")
    for name, content in LOGS:
        yield Case(f"log.jsonl: {name}", USERS[3], _file("log.jsonl", content), "log.jsonl")
    for change in (("seed", 1), ("epochs", 3), ("data.info_sha256", "0" * 64), ("minutes", 2.5)):
        yield Case(
            f"train into a run with another {change[0]}", USERS[4], _config(change), "another"
        )
    for user in (*USERS[:4], ("live", "--run", "run", "{data}"), ("studio", "--run", "run")):
        yield Case(f"{user[0]} by a run the other way", user, _turned, "predicts DIGIT images")
    other_model = ("train", "touch2touch", *USERS[4][2:])
    yield Case("train into a run the other way", other_model, _turned, "another direction")
    yield Case("train into a dataset", (*USERS[4][:-1], "data"), _dataset, "holds no run")
    yield Case("translate with all as it should be", USERS[0], _run_alone, fine=True)
    yield Case("train what is finished", USERS[4], _run_alone, fine=True)


def _configs() -> Iterator[tuple[str, Make]]:
    for field, kind in FIELDS.items():
        for value in WRONG[kind]:
            if not (field in MAY_LACK and value is ...):
                yield f"{field} {value!r}"[:60], _config((field, value))
    for name, change in MORE:
        yield name, _config(change)
    for name, content in TEXTS:
        yield name, _file("config.json", content)


def _run_alone(box: Path, base: Base) -> None:
    _run(box, base)


def _turned(box: Path, base: Base) -> None:
    """A touch2touch that says it goes from the CySkin to the DIGIT."""
    (box / "x.png").write_bytes(PNG)
    path = copied(base.touch2touch, box / "run") / "config.json"
    replaced(path, changed(path.read_text(), "direction", "cyskin-to-digit"))


def _dataset(box: Path, base: Base) -> None:
    copied(base.data, box / "data")


def _go_on() -> tuple[str, ...]:
    """A training of two epochs, of which the Base's run has one."""
    return tuple("2" if word == "1" else word for word in USERS[4])


def _unfinished(spoil: Make) -> Make:
    def make(box: Path, base: Base) -> None:
        spoil(box, base)
        path = box / "run/config.json"
        content = json.loads(path.read_text()) | {"epochs": 2, "planned_epochs": 2}
        replaced(path, json.dumps(content))

    return make
