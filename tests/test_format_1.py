"""Datasets of format 1, which versions up to 0.3 wrote: tests/format_1 was made by version 0.3,
with sliding touches; its images were reduced."""

import json
import shutil
from dataclasses import replace
from pathlib import Path

import msgspec
import numpy as np
import pyarrow.parquet as pq
import pytest

from t2twin.core.errors import T2TwinError
from t2twin.core.images import decode_png
from t2twin.report.dataset_report import write_data_report
from t2twin.sim.dataset.columns import schema_of
from t2twin.sim.dataset.generate import make_dataset
from t2twin.sim.dataset.info import SPLITS
from t2twin.sim.dataset.lerobot import convert_to_lerobot
from t2twin.sim.dataset.store import INFO, iter_images, lists, read_info, read_split, split_shards
from t2twin.sim.dataset.verify import verify_dataset
from t2twin.sim.sensors.pair import SensorPair
from t2twin.sim.taxels.pads import reading_matrix
from t2twin.sim.taxels.spec import Imperfections
from t2twin.translate.data.pairs import load_info, load_pairs
from t2twin.translate.evaluation.evaluate import evaluate
from t2twin.translate.training.train import train

FOLDER = Path(__file__).parent / "format_1"
SHAPE = (16, 12, 3)

OLD = {
    "source_image": "image", "target_counts": "taxels", "source_unit": "unit",
    "source_background": "background", "source_markers": "markers",
    "target_dense_counts": "dense_counts", "target_pressure_kpa": "cover_pressure_kpa",
    "target_shear_y_kpa": "cover_shear_y_kpa", "source_depth_mm": "digit_depth_mm",
    "target_force_n": "cyskin_force_n", "source_friction": "digit_friction",
    "target_slip_share": "cyskin_slip_share", "path": "path", "force_n": "force_n",
}  # fmt: skip
"""Names of columns in the files by those of format 2."""


@pytest.fixture
def data(tmp_path: Path) -> Path:
    """A copy, in which trainings may keep decoded images."""
    shutil.copytree(FOLDER, tmp_path / "data")
    return tmp_path / "data"


def test_info_has_the_names_of_format_2() -> None:
    info, pair = read_info(FOLDER), SensorPair()
    stored = json.loads((FOLDER / INFO).read_text())
    assert info.format == stored["format"] == 1 and info.complete and info.is_simulated
    assert info.values == {"source": "image", "target": "counts"}
    assert (info.camera.name, info.array.name) == ("digit", "cyskin-20")
    assert info.source.image_shape == SHAPE and info.source.spec is None
    assert info.source.optics_sha256 == stored["parameters"]["digit"]["optics_sha256"]
    assert info.source.optics_sha256 == pair.camera.optics_sha256
    assert info.source.view_mm == pytest.approx(pair.camera.camera.seen_half_extent_mm())
    assert list(info.target.x_mm) == stored["layout_x_mm"] == pair.array.layout.x_mm.tolist()
    assert list(info.target.dense_x_mm or ()) == pair.array.dense.layout.x_mm.tolist()
    assert info.target.full_scale_counts == pair.array.full_scale == 40_000
    assert info.target.tactile_image == pair.array.tactile_image_size
    flaws = stored["parameters"]["cyskin"]["imperfections"]
    assert info.target.imperfections == msgspec.convert(flaws, Imperfections)
    assert info.target.elastomer is not None and info.target.elastomer["thickness_mm"] == 2.5
    assert info.recipe is not None and info.recipe.source == "digit" and info.recipe.motion
    assert list(info.shapes or {}) == ["allen-key/long-arm"]


@pytest.mark.parametrize("split", SPLITS)
def test_columns_have_the_names_of_format_2(split: str) -> None:
    info = read_info(FOLDER)
    (path,) = split_shards(info, split)
    table, stored = read_split(FOLDER, split), pq.ParquetFile(FOLDER / path).read()
    assert set(table.column_names) == set(schema_of(info.values, info.recipe).names)
    for name, old in OLD.items():
        assert table[name].to_pylist() == stored[old].to_pylist()
    some = read_split(FOLDER, split, ["target_counts", "source_force_n"])
    assert some.column_names == ["target_counts", "source_force_n"]
    assert lists(some, "target_counts").shape == (len(table), 20)
    for name in ("source_image", "source_background"):
        images = [decode_png(png) for png in iter_images(FOLDER, path, name)]
        assert [image.shape for image in images] == [SHAPE] * len(table)


def test_it_is_verified(data: Path) -> None:
    assert verify_dataset(FOLDER) == []
    path = data / split_shards(read_info(data), "val")[0]
    content = bytearray(path.read_bytes())
    content[len(content) // 2] ^= 1
    path.write_bytes(content)
    assert [fault.part for fault in verify_dataset(data)] == ["val/part-0-00000.parquet"]


def test_it_is_not_continued(data: Path) -> None:
    recipe = read_info(data).recipe
    with pytest.raises(T2TwinError, match="made with another format; choose another folder"):
        make_dataset(data, recipe=recipe, workers=1, shapes=("allen-key/long-arm",))


def test_pairs_are_loaded(data: Path) -> None:
    pairs = load_pairs(data, "train", 16, grey=False, with_dense_counts=True)
    assert pairs.images[:].shape == (8, 16, 16, 3) and pairs.counts.shape == (8, 20)
    assert pairs.dense_counts is not None and pairs.dense_counts.shape == (8, 216)
    assert pairs.shear_n is not None and pairs.shear_n.shape == (8, 2)
    assert pairs.inputs[:].shape == (8, 16, 16, 6)
    info = load_info(data)
    array = info.array
    assert info.camera.image_shape == SHAPE and info.has_shear and array.phi.shape == (396, 240)
    assert replace(array.elastomer, name="cyskin-20") == SensorPair().array.elastomer
    dense = SensorPair().array.dense
    matrix = reading_matrix(dense.layout, array.taxels, dense.cover)
    np.testing.assert_allclose(matrix @ pairs.dense_counts[0], pairs.counts[0], atol=3000.0)


@pytest.mark.parametrize("model", ["resnet18", "field"])
@pytest.mark.filterwarnings("ignore:.*unlike all training images:t2twin.core.errors.T2TwinWarning")
def test_networks_are_trained_and_evaluated(model: str, data: Path, tmp_path: Path) -> None:
    train(model, data, "smoke", tmp_path / "run", steps=2)
    result = evaluate([tmp_path / "run"], data, "val", tmp_path / "out")
    assert result.pairs == 8 and result.models[model].overall.counts > 0
    assert "noise-floor" in result.models


def test_it_is_reported_and_converted(data: Path, tmp_path: Path) -> None:
    assert "cyskin-20" in write_data_report(tmp_path / "report", data).read_text()
    info = convert_to_lerobot(data, tmp_path / "lerobot")
    assert info["total_frames"] == 18
    assert {"observation.images.source", "observation.target_counts"} <= set(info["features"])
