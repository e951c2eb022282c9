"""A dataset's shards: their pictures, their row groups, and what is said of damaged ones."""

import shutil

import numpy as np
import pyarrow.parquet as pq
import pytest
from spots import VALUES, write_spots

from t2twin.core.errors import T2TwinError
from t2twin.core.images import decode_png, encode_png
from t2twin.sim.dataset.columns import schema_of
from t2twin.sim.dataset.store import BATCH_ROWS, iter_images, read_split, sha256_of, write_shard

SCHEMA = schema_of(VALUES, None)


@pytest.fixture(scope="module")
def data(tmp_path_factory):
    return write_spots(tmp_path_factory.mktemp("spots"), train=4, val=1, test=1)


def test_png_gives_back_the_picture():
    rng = np.random.default_rng(0)
    for image in (
        rng.integers(0, 256, (320, 240, 3), dtype=np.uint8),
        np.zeros((1, 1, 3), np.uint8),
        np.full((5, 7, 3), 255, np.uint8),
        (256 * rng.random((90, 70, 3)) ** 20).astype(np.uint8),  # of long codes
    ):
        assert (decode_png(encode_png(image)) == image).all()


def test_a_stored_picture_that_is_none_is_one_sentence():
    for content in (b"", b"no picture", np.zeros(100, np.uint8).tobytes()):
        with pytest.raises(T2TwinError, match="an image of the dataset cannot be decoded"):
            decode_png(content)


def test_many_rows_come_in_groups(data, tmp_path):
    table = pq.ParquetFile(data / "train/square-1.parquet").read()
    rows = [table.to_pylist()[0] | {"index": index} for index in range(BATCH_ROWS + 1)]
    digest = write_shard(tmp_path / "long.parquet", rows, SCHEMA)
    assert digest == sha256_of(tmp_path / "long.parquet")
    with pq.ParquetFile(tmp_path / "long.parquet") as file:
        assert file.num_row_groups == 2
        assert file.read(["index"])["index"].to_pylist() == list(range(BATCH_ROWS + 1))


def test_values_that_are_not_finite_are_not_written(data, tmp_path):
    row = pq.ParquetFile(data / "train/square-1.parquet").read().to_pylist()[0]
    with pytest.raises(T2TwinError, match="column force_n has values that are not finite"):
        write_shard(tmp_path / "nan.parquet", [row, row | {"force_n": np.nan}], SCHEMA)
    assert not list(tmp_path.iterdir())


def test_a_shard_of_another_dataset_is_refused_where_it_is_read(data, tmp_path):
    """It has the same columns, rows and pictures' sizes; only its bytes are others."""
    other = write_spots(tmp_path / "other", train=4, val=1, test=1, seed=1)
    shutil.copytree(data, tmp_path / "swapped")
    path = tmp_path / "swapped/train/square-1.parquet"
    assert len(read_split(tmp_path / "swapped", "train")) == 4
    shutil.copyfile(other / "train/square-1.parquet", path)
    for read in (
        lambda: read_split(tmp_path / "swapped", "train", ["target_counts"]),
        lambda: list(iter_images(tmp_path / "swapped", "train/square-1.parquet", "source_image")),
    ):
        with pytest.raises(T2TwinError, match=r"square-1\.parquet is not the shard .* --verify"):
            read()
    shutil.copyfile(data / "train/square-1.parquet", path)
    assert len(read_split(tmp_path / "swapped", "train")) == 4
