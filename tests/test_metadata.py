"""The metadata of a dataset, read by Hugging Face's `datasets` and by `mlcroissant`."""

import json

import numpy as np
import pytest

from t2twin.core.files import sha256_of
from t2twin.core.images import decode_png
from t2twin.sim.dataset.columns import BACKGROUND, schema_of
from t2twin.sim.dataset.import_pairs import import_pairs
from t2twin.sim.dataset.info import SPLITS
from t2twin.sim.dataset.store import CROISSANT, read_info, read_split
from t2twin.sim.taxels.layout import load_layout

KEY = ("split", "shape", "index")
"""Columns that together have another value in every row."""

HUB_NAMES = {"train": "train", "val": "validation", "test": "test"}


@pytest.fixture(scope="module")
def imported(tmp_path_factory):
    """A dataset of a user's pairs, whose columns of the contacts are empty."""
    from test_import_pairs import LAYOUT_CSV, write_csv

    folder = tmp_path_factory.mktemp("imported")
    (folder / "mine.csv").write_text(LAYOUT_CSV)
    source, _ = write_csv(folder / "mine", pairs=10)
    import_pairs(source, folder / "data", load_layout(folder / "mine.csv"), full_scale=1000)
    return folder / "data"


@pytest.fixture(params=["small_dataset", "moving_dataset", "imported"])
def folder(request):
    return request.getfixturevalue(request.param)


def test_datasets_loads_all_splits_without_an_argument(folder, tmp_path, monkeypatch):
    monkeypatch.setenv("HF_HUB_OFFLINE", "1")  # read when the library is imported
    from datasets import Image, load_dataset

    info = read_info(folder)
    loaded = load_dataset(str(folder), cache_dir=str(tmp_path))
    present = {split: pairs for split, pairs in info.pairs.items() if pairs}
    assert {name: len(rows) for name, rows in loaded.items()} == {
        HUB_NAMES[split]: pairs for split, pairs in present.items()
    }
    for split in present:
        rows, table = loaded[HUB_NAMES[split]], read_split(folder, split)
        assert rows.column_names == table.column_names
        assert isinstance(rows.features["source_image"], Image)
        images = ("source_image", f"source_{BACKGROUND}")
        columns = [name for name in rows.column_names if name not in images]
        assert rows.select_columns(columns).to_list() == table.select(columns).to_pylist()
        row = table.slice(0, 1).to_pylist()[0]
        for name in set(images).intersection(rows.column_names):
            assert np.array_equal(np.asarray(rows[0][name]), decode_png(row[name]["bytes"]))


@pytest.mark.filterwarnings("ignore::DeprecationWarning")  # mlcroissant's calls of rdflib, pandas
def test_croissant_is_valid_and_loads_every_pair(folder):
    import mlcroissant

    info = read_info(folder)
    dataset = mlcroissant.Dataset(jsonld=str(folder / CROISSANT))
    issues = dataset.metadata.ctx.issues
    assert not issues.errors
    assert all("datePublished" in issue or info.recipe is None for issue in issues.warnings)
    records = {}
    for record in dataset.records("pairs"):
        place = tuple(_plain(record[f"pairs/{name}"]) for name in KEY)
        records[place] = {name.removeprefix("pairs/"): value for name, value in record.items()}
    rows = [
        row for split in info.pairs if info.pairs[split]
        for row in read_split(folder, split).to_pylist()
    ]  # fmt: skip
    assert len(records) == len(rows)
    for row in rows:
        record = records[tuple(row[name] for name in KEY)]
        assert list(record) == schema_of(info.values, info.recipe).names
        for name, value in row.items():
            if isinstance(value, dict):
                assert np.array_equal(np.asarray(record[name]), decode_png(value["bytes"]))
            else:
                assert _plain(record[name]) == value, name
    names = [_plain(record["splits/name"]) for record in dataset.records("splits")]
    assert names == [split for split in SPLITS if info.pairs[split]]


def _plain(value):
    """Without NumPy's types, and text for the bytes that mlcroissant returns."""
    if isinstance(value, list):
        return [each.item() for each in value]
    return value.decode() if isinstance(value, bytes) else value


def test_croissant_contains_the_checksums_of_all_shards(folder):
    content = json.loads((folder / CROISSANT).read_text("utf-8"))
    files = [each for each in content["distribution"] if each["@type"] == "cr:FileObject"]
    assert {each["contentUrl"] for each in files} == set(read_info(folder).shards)
    for each in files:
        path = folder / each["contentUrl"]
        assert each["sha256"] == sha256_of(path)
        assert each["contentSize"] == f"{path.stat().st_size} B"
