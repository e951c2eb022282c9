import json
import multiprocessing
import os
import shutil
import signal
import sys
import threading

import numpy as np
import pyarrow.parquet as pq
import pytest
from moving import digests
from waiting import wait_until

from t2twin.cli import main
from t2twin.core.errors import T2TwinError
from t2twin.core.images import decode_png
from t2twin.core.progress import Progress
from t2twin.primitives_cad import catalogue
from t2twin.sim.contact.types import PressCommand
from t2twin.sim.dataset.generate import make_dataset
from t2twin.sim.dataset.store import LOG, lists, read_info, read_split, verify_dataset
from t2twin.sim.sampling import protocol
from t2twin.sim.sensors.defaults import ROLES
from t2twin.sim.sensors.pair import SensorPair

SHAPES = ("square-1", "square-3", "circle-2", "pliers/teeth")


def flip_a_bit(path):
    content = bytearray(path.read_bytes())
    content[len(content) // 2] ^= 1
    path.write_bytes(content)


@pytest.fixture(scope="module")
def made(tmp_path_factory, shape_cache):
    folder = tmp_path_factory.mktemp("data") / "smoke"
    make_dataset(folder, "smoke", workers=1, cache=shape_cache, shapes=SHAPES)
    return folder


def test_splits_hold_their_shapes_and_every_press_its_force(made):
    for split, names in (("train", {"square-1", "circle-2"}), ("val", {"square-3"}),
                         ("test", {"pliers/teeth"})):  # fmt: skip
        table = read_split(made, split)
        assert set(table.column("shape").to_pylist()) == names
        for role in ROLES:
            assert np.array(table.column(f"{role}_force_n")) == pytest.approx(8.0, rel=0.01)
            assert all(table.column(f"{role}_settled").to_pylist())
            assert not any(table.column(f"{role}_bottomed").to_pylist())
        counts = lists(table, "target_counts")
        assert counts.shape == (len(table), 20)
        assert (counts.max(axis=1) > 100).all() and counts.max() <= 40_000
        image = decode_png(table.column("source_image")[0].as_py()["bytes"])
        assert image.shape == (320, 240, 3) and image.std() > 5


def test_another_seed_gives_other_noise_and_the_same_poses(made, tmp_path, shape_cache):
    make_dataset(
        tmp_path / "other", "smoke", seed=1, workers=1, cache=shape_cache, shapes=SHAPES[:1]
    )
    table = read_split(tmp_path / "other", "train")
    before = pq.ParquetFile(made / "train/square-1.parquet").read()
    assert table.column("x_mm") == before.column("x_mm")
    assert table.column("source_image") != before.column("source_image")


def test_a_flipped_bit_is_named_and_its_shard_alone_made_anew(made, tmp_path, shape_cache):
    folder = tmp_path / "damaged"
    shutil.copytree(made, folder)
    assert verify_dataset(folder) == []
    flip_a_bit(folder / "train/square-1.parquet")
    assert [path for path, _ in verify_dataset(folder)] == ["train/square-1.parquet"]
    others = [path for path in folder.rglob("*.parquet") if path.name != "square-1.parquet"]
    before = [path.stat().st_mtime_ns for path in others]
    make_dataset(folder, "smoke", workers=1, cache=shape_cache, shapes=SHAPES)
    assert digests(folder) == digests(made)
    assert [path.stat().st_mtime_ns for path in others] == before


def test_an_interrupt_leaves_whole_shards_and_no_processes(made, tmp_path, shape_cache):
    """The next run keeps the shards, though info.json does not list them."""
    folder, children = tmp_path / "stopped", {*multiprocessing.active_children()}
    with pytest.MonkeyPatch.context() as patch, pytest.raises(KeyboardInterrupt):
        # at the first shard
        patch.setattr(Progress, "update", lambda *_: os.kill(os.getpid(), signal.SIGINT))
        make_dataset(folder, "smoke", workers=2, cache=shape_cache, shapes=SHAPES)
    assert {*multiprocessing.active_children()} == children and not list(folder.rglob(".*.part*"))
    whole = {path: path.stat().st_mtime_ns for path in folder.glob("*/*.parquet")}
    assert 0 < len(whole) < len(SHAPES) and read_info(folder).shards == {}
    with pytest.raises(T2TwinError, match="unfinished"):
        read_split(folder, "train")
    assert ("info.json", "the dataset is unfinished") in verify_dataset(folder)
    make_dataset(folder, "smoke", workers=1, cache=shape_cache, shapes=SHAPES)
    assert {path: path.stat().st_mtime_ns for path in whole} == whole
    assert digests(folder) == digests(made)


def test_verify_lists_missing_and_additional_files(made, tmp_path, capsys):
    folder = tmp_path / "changed"
    shutil.copytree(made, folder)
    (folder / "val/square-3.parquet").unlink()
    (folder / "cache").mkdir()
    (folder / "cache/train.parquet").touch()  # of trainings, not part of the dataset
    shutil.copy(folder / "train/square-1.parquet", folder / "train/mine.parquet")
    with pytest.raises(SystemExit) as stop:
        main(["simdata", "--verify", str(folder)])
    assert stop.value.code == 1
    printed = capsys.readouterr().out
    assert "val/square-3.parquet: it is missing" in printed and "train/mine.parquet: " in printed
    assert "damaged in 2 files; the same `t2twin simdata` remakes 1 file\n" in printed
    with pytest.raises(T2TwinError, match=r"square-3\.parquet cannot be read .* makes it again"):
        read_split(folder, "val")


def test_a_killed_worker_is_one_sentence(tmp_path, shape_cache):
    folder = tmp_path / "data"

    def kill() -> None:
        wait_until(lambda: list(folder.rglob(".*.part.parquet")))
        os.kill(multiprocessing.active_children()[0].pid or 0, signal.SIGKILL)

    killer = threading.Thread(target=kill)
    killer.start()
    with pytest.raises(T2TwinError, match="worker was killed"):
        make_dataset(folder, "smoke", workers=2, cache=shape_cache, shapes=SHAPES[:2])
    killer.join()


def test_the_log_says_where_the_time_went(made):
    (record,) = [json.loads(line) for line in (made / LOG).read_text().splitlines()]
    assert record["pairs"] == 10 and record["workers"] == 1
    assert 0 < record["processor_seconds"] < 2 * record["seconds"]
    assert 50e6 < record["peak_memory_bytes"] < 24e9  # the worker has run other tests


def test_pairs_with_notes_are_counted(tmp_path, shape_cache, capsys):
    """Presses near the end of a long line have its middle off the sensor."""
    shapes = ("line-sharp-1",)
    make_dataset(tmp_path / "data", "small", shapes=shapes, workers=1, cache=shape_cache)
    (log,) = [json.loads(line) for line in (tmp_path / "data" / LOG).read_text().splitlines()]
    camera, rows = SensorPair().source, read_split(tmp_path / "data", "train")
    x, y = (np.abs(rows[name].to_numpy()) for name in ("x_mm", "y_mm"))
    contact = camera.press(catalogue.load("line-sharp-1"), PressCommand("", 0.0, 0.0, 0.0, 8.0))
    off = (x > np.abs(contact.x_mm).max()) | (y > np.abs(contact.y_mm).max())
    ((note, count),) = log["notes"].items()
    assert count == off.sum() > 0 and note.startswith(f"{camera.name}: the shape's middle")
    assert f"{count} pairs: {note}\n" in capsys.readouterr().out


def test_a_pair_is_what_the_sensors_take(made, shapes):
    """The row's picture and counts are those of the two sensors under the row's own press."""
    table = pq.ParquetFile(made / "train/square-1.parquet").read()
    index = table["index"][1].as_py()
    sensors = SensorPair().with_imperfections(None)
    command = protocol.press_of(shapes("square-1").name, shapes("square-1").spacing_mm, index)
    rng = np.random.default_rng((0, catalogue.NAMES.index("square-1"), index))
    camera, array = sensors.camera, sensors.array
    image = camera.image(camera.press(shapes("square-1"), command), rng)
    reading = array.read(array.press(shapes("square-1"), command), rng)
    assert (decode_png(table["source_image"][1].as_py()["bytes"]) == image).all()
    assert reading.counts is not None
    assert table["target_counts"][1].as_py() == reading.counts.tolist()


@pytest.mark.parametrize(
    ("asked", "said"),
    [
        ({"shapes": ("square-1", "sphere")}, "sphere"),
        ({"layout": "x_mm,y_mm\n0,0\n5,5\n13.9,0\n"}, "off the cover"),
        ({"scheduler": "tcp://127.0.0.1:9"}, "needs Dask"),
    ],
)
def test_what_is_refused_leaves_nothing(tmp_path, monkeypatch, asked, said):
    monkeypatch.setitem(sys.modules, "distributed", None)
    (tmp_path / "mine.csv").write_text(asked.pop("layout", "x_mm,y_mm\n0,0\n5,0\n0,5\n"))
    with pytest.raises(T2TwinError, match=said):
        sensors = SensorPair.of(layout=tmp_path / "mine.csv")
        make_dataset(tmp_path / "out", **{"scale": "smoke", "sensors": sensors, **asked})
    assert not (tmp_path / "out").exists()
