"""Records of datasets and runs: what is written is read, and a wrong field is named."""

import json
from dataclasses import replace

import pytest
from kinds import gel_camera, taxel_array
from msgspec import structs

from t2twin.core.errors import T2TwinError
from t2twin.sim.dataset.generate import build_info, sensor_info
from t2twin.sim.dataset.info import DatasetInfo, Shard
from t2twin.sim.dataset.store import INFO, read_info, split_shards, write_info
from t2twin.sim.sampling.plan import Batch
from t2twin.sim.sampling.recipe import load_recipe
from t2twin.sim.sensors.files import load_sensor
from t2twin.sim.sensors.pair import SensorPair
from t2twin.sim.taxels.layout import load_layout
from t2twin.translate.data.pairs import DataInfo
from t2twin.translate.evaluation.records import METRICS, read_evaluation
from t2twin.translate.models.presets import PRESETS
from t2twin.translate.runs.config import (
    CONFIG,
    LOG,
    EpochRecord,
    RunConfig,
    best_epoch,
    load_config,
    read_log,
    write_log,
)

SHARD = "train/square-1.parquet"
GONE = object()
"""Stands for a key that is taken out."""


@pytest.fixture(scope="module")
def info() -> DatasetInfo:
    """A finished dataset's, of one shard."""
    batch = Batch(SHARD, "train", 0, ("square-1",), (0,), (3, 5), 2)
    begun = build_info(load_recipe("paper"), SensorPair(), "smoke", [batch])
    return replace(begun, complete=True, shards={SHARD: Shard("0" * 64, 2)})


@pytest.fixture(scope="module")
def config() -> RunConfig:
    data = DataInfo("0" * 64, sensor_info(gel_camera()), sensor_info(taxel_array()))
    return RunConfig(
        "resnet18", PRESETS["resnet18"]["smoke"], 3, data, None, 2.5, 4, bf16=False, processes=1
    )


@pytest.fixture
def history() -> list[EpochRecord]:
    return [
        EpochRecord(epoch, 1e-3, {"adversarial": 2.5, "l1": 0.5}, rmse / 400, 0.25, rmse)
        for epoch, rmse in ((1, 900.0), (2, 700.0), (3, 800.0))
    ]


def change(path, place, value):
    """Sets one value of a JSON file; place: keys and indices on the way to it."""
    content = json.loads(path.read_text())
    inner = content
    for step in place[:-1]:
        inner = inner[step]
    if value is GONE:
        del inner[place[-1]]
    else:
        inner[place[-1]] = value
    path.write_text(json.dumps(content))


def test_info_comes_back_as_it_was_written(tmp_path, info):
    write_info(tmp_path, info)
    assert read_info(tmp_path) == info
    assert split_shards(info, "train") == [SHARD] and split_shards(info, "val") == []
    text = (tmp_path / INFO).read_text()
    content = json.loads(text)
    assert text == json.dumps(content, indent=1, sort_keys=True) + "\n"
    assert content["target"]["elastomer"]["dome_width_radius_mm"] is None  # flat: no infinity
    assert "only" not in content and "optics_sha256" not in content["target"]


@pytest.mark.parametrize(
    ("place", "value", "named"),
    [
        (["pairs", "all"], 3, r"\$\.pairs|pairs"),
        (["pairs", "val"], -1, r"\$\.pairs"),
        (["seed"], "x", r"\$\.seed"),
        (["source", "image_shape"], GONE, "image_shape"),
        (["target", "rate_hz"], 0, r"\$\.target\.rate_hz"),
        (["target"], GONE, "target"),
        (["shards", SHARD, "sha256"], "ab", "sha"),
        (["shards", "../train/square-1.parquet"], {"sha256": "0" * 64, "pairs": 1}, "shards"),
    ],
)
def test_a_wrong_field_of_info_is_named(tmp_path, info, place, value, named):
    write_info(tmp_path, info)
    change(tmp_path / INFO, place, value)
    with pytest.raises(T2TwinError, match=named) as error:
        read_info(tmp_path)
    assert str(error.value).startswith(str(tmp_path / INFO))


@pytest.mark.parametrize(
    ("name", "read", "way"),
    [
        (INFO, read_info, "t2twin simdata"), (CONFIG, load_config, "t2twin train"),
        (METRICS, read_evaluation, "t2twin evaluate"),
        ("own.toml", load_recipe, "remove this key"), ("own.toml", load_sensor, "remove this key"),
        ("own.json", load_layout, "remove this key"),
    ],
)  # fmt: skip
def test_a_file_of_another_version_is_refused(tmp_path, name, read, way):
    path = tmp_path / name
    path.write_text("format = 2" if path.suffix == ".toml" else '{"format": 2}')
    with pytest.raises(T2TwinError, match=rf"{path} is of another version .* 2, .*; .*{way}"):
        read(path if name.startswith("own") else tmp_path)


@pytest.mark.parametrize(
    "content", [b"", b"{", b"\xff\xfe", b"[" * 100_000, b"[]", b'{"seed": NaN}']
)
def test_a_file_that_is_no_record_is_refused(tmp_path, content):
    (tmp_path / INFO).write_bytes(content)
    (tmp_path / CONFIG).write_bytes(content)
    for read, name in ((read_info, INFO), (load_config, CONFIG)):
        with pytest.raises(T2TwinError, match=name):
            read(tmp_path)


def test_config_comes_back_as_it_was_written(tmp_path, config):
    config = structs.replace(config, steps=90, epoch_steps=9)
    config.save(tmp_path)
    again = load_config(tmp_path)
    assert structs.replace(again, data=config.data) == config
    assert again.data.sha256 == config.data.sha256
    own, other = again.data.array, config.data.array
    assert own.x_mm.dtype == float and (own.x_mm == other.x_mm).all()
    assert (own.y_mm == other.y_mm).all()


@pytest.mark.parametrize(
    ("place", "value", "named"),
    [
        (["format"], GONE, "format is missing, expected 1.0"),
        (["model"], "unet", r"\$\.model"),
        (["minutes"], 0, r"\$\.minutes"),
        (["epoch_steps"], 2**70, "epoch_steps"),
        (["preset", "schedule"], "steep", "schedule"),
        (["data", "target", "pad_diameter_mm"], [0.0] * 20, "not larger than 0"),
        (["data", "target", "x_mm"], [], r"shape \(20,\)"),
        (["data", "target", "elastomer", "young_mpa"], -1, "young_mpa"),
    ],
)
def test_a_wrong_field_of_config_is_named(tmp_path, config, place, value, named):
    config.save(tmp_path)
    change(tmp_path / CONFIG, place, value)
    with pytest.raises(T2TwinError, match=named) as error:
        load_config(tmp_path)
    assert str(error.value).startswith(str(tmp_path / CONFIG))


def test_the_log_has_a_line_for_every_epoch(tmp_path, history):
    write_log(tmp_path, history)
    first = json.loads((tmp_path / LOG).read_text().splitlines()[0])
    assert first["train"] == {"adversarial": 2.5, "l1": 0.5} and first["val_rmse_counts"] == 900.0
    assert read_log(tmp_path) == history
    assert best_epoch(history).epoch == 2


@pytest.mark.parametrize(("key", "value"), [("epoch", GONE), ("seconds", "x")])
def test_a_wrong_line_of_the_log_is_named(tmp_path, history, key, value):
    write_log(tmp_path, history)
    lines = (tmp_path / LOG).read_text().splitlines()
    record = {k: v for k, v in (json.loads(lines[1]) | {key: value}).items() if v is not GONE}
    lines[1] = json.dumps(record)
    (tmp_path / LOG).write_text("\n".join(lines))
    with pytest.raises(T2TwinError, match="line 2"):
        read_log(tmp_path)


def test_a_log_that_is_missing_or_empty_is_refused(tmp_path, history):
    for _ in range(2):
        with pytest.raises(T2TwinError, match=r"has no epoch in log\.jsonl"):
            read_log(tmp_path)
        (tmp_path / LOG).touch()
