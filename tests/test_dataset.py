import hashlib
import json
import os
import signal
import subprocess
import sys
import time

import numpy as np
import pyarrow.parquet as pq
import pytest

from primitives_cad.errors import T2TwinError
from sim.dataset import decode_png, encode_png, read_info, read_split, taxels
from sim.generate import generate

SHAPES = ("square-1", "square-3", "circle-2", "pliers/teeth")


def digests(folder):
    return {
        str(path.relative_to(folder)): hashlib.sha256(path.read_bytes()).hexdigest()
        for path in sorted(folder.rglob("*"))
        if path.is_file()
    }


@pytest.fixture(scope="module")
def made(tmp_path_factory, shape_cache):
    folder = tmp_path_factory.mktemp("data") / "smoke"
    generate(folder, "smoke", workers=1, cache=shape_cache, shapes=SHAPES)
    return folder


def test_png_gives_back_the_picture():
    image = np.random.default_rng(0).integers(0, 256, (320, 240, 3), dtype=np.uint8)
    assert (decode_png(encode_png(image)) == image).all()


def test_splits_hold_their_shapes_and_every_press_its_force(made):
    for split, names in (("train", {"square-1", "circle-2"}), ("val", {"square-3"}),
                         ("test", {"pliers/teeth"})):  # fmt: skip
        table = read_split(made, split)
        assert set(table.column("shape").to_pylist()) == names
        for sensor in ("digit", "cyskin"):
            assert np.array(table.column(f"{sensor}_force_n")) == pytest.approx(8.0, rel=0.01)
            assert all(table.column(f"{sensor}_settled").to_pylist())
            assert not any(table.column(f"{sensor}_bottomed").to_pylist())
        counts = taxels(table)
        assert counts.shape == (len(table), 20)
        assert (counts.max(axis=1) > 100).all() and counts.max() <= 40_000
        image = decode_png(table.column("image")[0].as_py()["bytes"])
        assert image.shape == (320, 240, 3) and image.std() > 5


def test_every_shard_is_what_info_says(made):
    info = read_info(made)
    assert info["complete"] and info["pairs"] == {"train": 6, "val": 3, "test": 1}
    for path, about in info["shards"].items():
        assert hashlib.sha256((made / path).read_bytes()).hexdigest() == about["sha256"]
        assert pq.ParquetFile(made / path).metadata.num_rows == about["pairs"]
    features = pq.ParquetFile(made / "train/square-1.parquet").schema_arrow.metadata
    assert json.loads(features[b"huggingface"])["info"]["features"]["image"]["_type"] == "Image"


def test_two_workers_and_one_give_the_same_bytes(made, tmp_path, shape_cache):
    generate(tmp_path / "two", "smoke", workers=2, cache=shape_cache, shapes=SHAPES)
    assert digests(tmp_path / "two") == digests(made)


def test_another_seed_gives_other_noise_and_the_same_poses(made, tmp_path, shape_cache):
    generate(tmp_path / "other", "smoke", seed=1, workers=1, cache=shape_cache, shapes=SHAPES[:1])
    table = read_split(tmp_path / "other", "train")
    before = pq.ParquetFile(made / "train/square-1.parquet").read()
    assert table.column("x_mm") == before.column("x_mm")
    assert table.column("image") != before.column("image")


def test_a_killed_run_goes_on_and_ends_with_the_same_bytes(made, tmp_path, shape_cache):
    folder = tmp_path / "killed"
    script = (
        "from sim.generate import generate\n"
        f"generate({str(folder)!r}, 'smoke', workers=1, cache={str(shape_cache)!r}, "
        f"shapes={SHAPES!r})"
    )
    process = subprocess.Popen(
        [sys.executable, "-c", script], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL
    )
    deadline = time.monotonic() + 120
    while not list(folder.rglob("*.parquet")) and time.monotonic() < deadline:
        time.sleep(0.01)
    os.kill(process.pid, signal.SIGKILL)
    process.wait()
    assert list(folder.rglob("*.parquet"))
    with pytest.raises(T2TwinError, match="unfinished"):
        read_split(folder, "train")
    generate(folder, "smoke", workers=1, cache=shape_cache, shapes=SHAPES)
    assert digests(folder) == digests(made)


def test_a_damaged_shard_is_made_anew(made, tmp_path, shape_cache):
    folder = tmp_path / "damaged"
    generate(folder, "smoke", workers=1, cache=shape_cache, shapes=SHAPES[:2])
    before = digests(folder)
    shard = folder / "train/square-1.parquet"
    content = bytearray(shard.read_bytes())
    content[len(content) // 2] ^= 1
    shard.write_bytes(content)
    generate(folder, "smoke", workers=1, cache=shape_cache, shapes=SHAPES[:2])
    assert digests(folder) == before


def test_other_parameters_are_refused(made, shape_cache):
    with pytest.raises(T2TwinError, match="another seed"):
        generate(made, "smoke", seed=5, workers=1, cache=shape_cache, shapes=SHAPES)


def test_a_folder_with_something_else_is_refused(tmp_path):
    (tmp_path / "notes.txt").write_text("mine")
    with pytest.raises(T2TwinError, match="not empty"):
        generate(tmp_path, "smoke", shapes=SHAPES)


def test_reading_what_is_not_there_says_so(made, tmp_path):
    with pytest.raises(T2TwinError, match="holds no dataset"):
        read_info(tmp_path)
    with pytest.raises(T2TwinError, match="train, val, test"):
        read_split(made, "validation")
