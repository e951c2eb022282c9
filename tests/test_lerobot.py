"""Conversion to LeRobot's format; `make lerobot-check` reads one with LeRobot's own loader."""

import json

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from moving import digests

from t2twin.core.images import decode_png
from t2twin.sim.dataset import lerobot
from t2twin.sim.dataset.columns import MOTION, POSE, TRACTIONS
from t2twin.sim.dataset.lerobot import QUANTILES, convert_to_lerobot
from t2twin.sim.dataset.store import read_info, read_split
from t2twin.sim.sensors.defaults import ROLES

IMAGE, COUNTS = "observation.images.source", "observation.target_counts"
"""Features of the image and the counts."""

TRACTION_COLUMNS = [f"target_{name}" for name in TRACTIONS]

INFO_TYPES = {
    "codebase_version": str, "robot_type": str, "total_episodes": int, "total_frames": int,
    "total_tasks": int, "chunks_size": int, "data_files_size_in_mb": int,
    "video_files_size_in_mb": int, "fps": int, "splits": dict, "data_path": str,
    "video_path": type(None), "features": dict,
}  # fmt: skip
"""Keys of LeRobot's meta/info.json, v3.0."""

INDEX_TYPES = {
    "timestamp": "float32", "frame_index": "int64", "episode_index": "int64", "index": "int64",
    "task_index": "int64",
}  # fmt: skip
"""Features that LeRobot requires."""

EPISODE_COLUMNS = {
    "episode_index", "tasks", "length", "data/chunk_index", "data/file_index", "dataset_from_index",
    "dataset_to_index", "meta/episodes/chunk_index", "meta/episodes/file_index",
}  # fmt: skip


def rows_of(folder):
    """All rows of a dataset in the order of the frames."""
    pairs = read_info(folder).pairs
    tables = [read_split(folder, split) for split in ("train", "val", "test") if pairs[split]]
    return pa.concat_tables(tables).to_pylist()


def read_all(folder):
    """The frames of all files, the episodes, info.json and stats.json of a conversion."""
    frames = [pq.ParquetFile(path).read() for path in sorted(folder.glob("data/*/*.parquet"))]
    episodes = pq.ParquetFile(folder / "meta/episodes/chunk-000/file-000.parquet").read()
    info, statistics = (json.loads((folder / f"meta/{n}.json").read_text("utf-8"))
                        for n in ("info", "stats"))  # fmt: skip
    return pa.concat_tables(frames), episodes, info, statistics


def rounded(values):
    return np.array(list(values), np.float32).tolist()


@pytest.fixture(scope="module", params=["small_dataset", "moving_dataset"])
def converted(request, tmp_path_factory):
    """A dataset and its conversion."""
    out = tmp_path_factory.mktemp("converted") / "lerobot"
    folder = request.getfixturevalue(request.param)
    convert_to_lerobot(folder, out)
    return folder, out


def test_frames_equal_the_pairs(converted):
    folder, out = converted
    rows, frames = rows_of(folder), read_all(out)[0].to_pylist()
    assert len(frames) == len(rows)
    for number, (row, frame) in enumerate(zip(rows, frames, strict=True)):
        assert frame["index"] == number
        assert frame[IMAGE]["bytes"] == row["source_image"]["bytes"]
        assert frame[COUNTS] == row["target_counts"]
        assert frame["action"] == rounded(row[name] for name in POSE)
        assert frame["press_index"] == row["index"]
        for role in ROLES:
            assert frame[f"{role}_settled"] == row[f"{role}_settled"]
            names = [f"{role}_{n}" for n in ("depth_mm", "force_n", *MOTION)]
            expected = rounded(row[name] for name in names if name in row)
            assert frame[f"observation.{role}_contact"] == expected
        if "source_background" in row:
            name = "observation.images.source_background"
            assert frame[name]["bytes"] == row["source_background"]["bytes"]
            assert frame["observation.target_dense_counts"] == row["target_dense_counts"]
            assert all(frame[f"observation.{name}"] == row[name] for name in TRACTION_COLUMNS)


def test_a_press_or_a_path_is_an_episode(converted):
    folder, out = converted
    frames, episodes, info, _ = read_all(out)
    rows, lengths = rows_of(folder), episodes["length"].to_pylist()
    starts = [n for n, row in enumerate(rows) if row.get("path", row["index"]) == row["index"]]
    assert episodes["dataset_from_index"].to_pylist() == starts
    assert episodes["dataset_to_index"].to_pylist() == [*starts[1:], len(rows)]
    assert sum(lengths) == len(rows) and (max(lengths) > 1) == ("path" in rows[0])
    expected = np.repeat(np.arange(len(lengths)), lengths)
    assert frames["episode_index"].to_pylist() == expected.tolist()
    assert frames["frame_index"].to_pylist() == [n for size in lengths for n in range(size)]
    assert np.allclose(frames["timestamp"], np.array(frames["frame_index"]) / info["fps"])
    for split, range_ in info["splits"].items():
        first, last = map(int, range_.split(":"))
        assert {rows[starts[n]]["split"] for n in range(first, last)} == {split}
    tasks = pd.read_parquet(out / "meta/tasks.parquet")
    assert tasks.index.name == "task" and tasks["task_index"].tolist() == list(range(len(tasks)))
    names = [str(name) for name in tasks.index]
    for number, task_index in enumerate(frames["task_index"].to_pylist()):
        name = names[task_index]
        assert name == episodes["tasks"].to_pylist()[expected[number]][0]
        assert name.endswith(f" {rows[number]['shape']}")


def test_the_files_have_the_schema_of_lerobot(converted):
    _, out = converted
    frames, episodes, info, statistics = read_all(out)
    assert {name: type(value) for name, value in info.items()} == INFO_TYPES
    assert info["codebase_version"] == "v3.0" and info["total_episodes"] == len(episodes)
    assert info["total_frames"] == len(frames)
    features = info["features"]
    assert list(features) == frames.column_names and "/" not in "".join(features)
    assert {name: features[name]["dtype"] for name in INDEX_TYPES} == INDEX_TYPES
    for name, feature in features.items():
        kind, shape = frames.schema.field(name).type, feature["shape"]
        if feature["dtype"] == "image":
            assert kind.names == ["bytes", "path"]
            assert shape == list(decode_png(frames[name][0].as_py()["bytes"]).shape)
            continue
        if shape != [1]:
            assert kind.list_size == shape[0]
            kind = kind.value_type
        assert kind == pa.type_for_alias(feature["dtype"])
        assert feature["names"] is None or len(feature["names"]) == shape[0]
    keys = {"min", "max", "mean", "std", "count", *QUANTILES}
    assert {name: set(each) for name, each in statistics.items()} == dict.fromkeys(features, keys)
    assert set(episodes.column_names) == EPISODE_COLUMNS | {
        f"stats/{name}/{key}" for name in features for key in keys
    }


def test_statistics_are_those_of_all_frames(converted):
    frames, episodes, _, statistics = read_all(converted[1])
    name = IMAGE
    images = [decode_png(each["bytes"]) / 255 for each in frames[name].to_pylist()]
    cases = {name: np.stack(images).reshape(-1, 3)}
    for feature in (COUNTS, "action"):
        cases[feature] = np.array(frames[feature].to_pylist())
    for feature, values in cases.items():
        found = {key: np.ravel(value) for key, value in statistics[feature].items()}
        for key in ("min", "max", "mean", "std"):
            assert found[key] == pytest.approx(getattr(values, key)(0), rel=1e-6, abs=1e-9)
        for key, share in QUANTILES.items():
            method = "inverted_cdf" if feature == name else "linear"
            expected = np.quantile(values, share, axis=0, method=method)
            assert found[key] == pytest.approx(expected, rel=1e-6)
        assert found["count"] == [len(frames)]
    length = episodes["length"][0].as_py()
    taxels = np.array(frames[COUNTS].to_pylist()[:length])
    own = episodes[f"stats/{COUNTS}/mean"][0].as_py()
    assert own == pytest.approx(taxels.mean(0), rel=1e-6)


def test_the_same_dataset_gives_the_same_bytes(converted, tmp_path):
    folder, out = converted
    convert_to_lerobot(folder, tmp_path / "again")
    assert digests(tmp_path / "again") == digests(out)


def test_datasets_loads_the_frames_without_an_argument(converted, tmp_path, monkeypatch):
    monkeypatch.setenv("HF_HUB_OFFLINE", "1")  # read when the library is imported
    from datasets import load_dataset

    rows = load_dataset(str(converted[1]), cache_dir=str(tmp_path))["train"]
    frames = read_all(converted[1])[0]
    assert rows.column_names == frames.column_names
    assert rows[COUNTS][:] == frames[COUNTS].to_pylist()


def test_an_episode_lies_in_one_file(moving_dataset, tmp_path, monkeypatch):
    monkeypatch.setattr(lerobot, "FILES_PER_CHUNK", 1)
    convert_to_lerobot(moving_dataset, tmp_path / "out")
    frames, episodes, info, _ = read_all(tmp_path / "out")
    files = set()
    for row in episodes.to_pylist():
        place = {name: row[f"data/{name}"] for name in ("chunk_index", "file_index")}
        table = pq.ParquetFile(tmp_path / "out" / info["data_path"].format(**place)).read()
        assert table["episode_index"].to_pylist().count(row["episode_index"]) == row["length"]
        files.add(tuple(place.values()))
    assert files == {(0, 0), (1, 0)}
    assert frames["index"].to_pylist() == list(range(len(frames)))


def test_features_without_values_are_left_out(tmp_path):
    from spots import write_spots

    folder = write_spots(tmp_path / "data", train=3, val=0, test=2, scale=None)
    info = convert_to_lerobot(folder, tmp_path / "out")
    names = set(info["features"]) - set(INDEX_TYPES)
    assert {IMAGE, COUNTS, "action"} <= names
    assert "observation.target_dense_counts" not in names and info["splits"] == {
        "train": "0:3",
        "test": "3:5",
    }
