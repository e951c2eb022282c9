import errno
import hashlib
import json
import multiprocessing
import os
import shutil
import signal
import subprocess
import sys
import threading
from collections import deque
from dataclasses import replace

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from waiting import wait_until

from t2twin.cli import main
from t2twin.core.errors import T2TwinError
from t2twin.core.images import decode_png
from t2twin.primitives_cad import catalogue
from t2twin.sim.contact.types import PressCommand
from t2twin.sim.dataset import generate, pool
from t2twin.sim.dataset.generate import make_dataset
from t2twin.sim.dataset.info import Shard
from t2twin.sim.dataset.schedule import Schedule
from t2twin.sim.dataset.shard import STAGES, make
from t2twin.sim.dataset.store import (
    GROUPS,
    LOG,
    MADE,
    add_shard,
    lists,
    read_info,
    read_split,
    sha256_of,
    write_info,
)
from t2twin.sim.dataset.verify import verify_dataset
from t2twin.sim.sampling import plan, protocol
from t2twin.sim.sampling.plan import Batch
from t2twin.sim.sampling.recipe import load_recipe
from t2twin.sim.sensors.defaults import ROLES
from t2twin.sim.sensors.pair import SensorPair

SHAPES = ("square-1", "square-3", "circle-2", "pliers/teeth")


def digests(folder):
    """Of all files but the log, which says how long the runs took."""
    return {
        str(path.relative_to(folder)): sha256_of(path)
        for path in sorted(folder.rglob("*"))
        if path.is_file() and path.name != LOG
    }


def flip_a_bit(path):
    content = bytearray(path.read_bytes())
    content[len(content) // 2] ^= 1
    path.write_bytes(content)


def remade(folder, changes):
    """The dataset with rows changed, and info.json made to fit: only the content gives it away."""
    path = folder / "train/square-1.parquet"
    table = pq.ParquetFile(path).read()
    for name, values in changes.items():
        place = table.schema.get_field_index(name)
        field = table.schema.field(name)
        table = table.set_column(place, field, pa.array(values, field.type))
    pq.write_table(table, path)
    info = read_info(folder)
    shard = {"train/square-1.parquet": Shard(sha256_of(path), len(table))}
    write_info(folder, replace(info, shards=info.shards | shard))
    return verify_dataset(folder)


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


def test_every_shard_is_what_info_says(made):
    info = read_info(made)
    assert info.complete and info.pairs == {"train": 6, "val": 3, "test": 1}
    for path, shard in info.shards.items():
        assert hashlib.sha256((made / path).read_bytes()).hexdigest() == shard.sha256
        assert pq.ParquetFile(made / path).metadata.num_rows == shard.pairs
    features = pq.ParquetFile(made / "train/square-1.parquet").schema_arrow.metadata
    assert (
        json.loads(features[b"huggingface"])["info"]["features"]["source_image"]["_type"] == "Image"
    )


def test_two_workers_and_one_give_the_same_bytes(made, tmp_path, shape_cache, monkeypatch):
    """Also where two workers share the presses of a shard."""
    monkeypatch.setattr(plan, "PRESSES_PER_GROUP", 1)
    make_dataset(tmp_path / "two", "smoke", workers=2, cache=shape_cache, shapes=SHAPES)
    assert digests(tmp_path / "two") == digests(made)


def test_another_seed_gives_other_noise_and_the_same_poses(made, tmp_path, shape_cache):
    make_dataset(
        tmp_path / "other", "smoke", seed=1, workers=1, cache=shape_cache, shapes=SHAPES[:1]
    )
    table = read_split(tmp_path / "other", "train")
    before = pq.ParquetFile(made / "train/square-1.parquet").read()
    assert table.column("x_mm") == before.column("x_mm")
    assert table.column("source_image") != before.column("source_image")


def test_a_stopped_shard_keeps_its_groups(made, tmp_path, shape_cache, monkeypatch):
    """A whole group is used, and one that is damaged made again."""
    monkeypatch.setattr(plan, "PRESSES_PER_GROUP", 1)
    folder, name = tmp_path / "stopped", SHAPES[0]
    with monkeypatch.context() as patch, pytest.raises(ZeroDivisionError):
        patch.setattr(generate, "summary", lambda run: 1 / 0)
        patch.setattr(pool, "run", groups_only)
        make_dataset(folder, "smoke", workers=1, cache=shape_cache, shapes=(name,))
    groups = sorted((folder / GROUPS).iterdir())
    assert [path.name for path in groups] == [f"train-{name}-{row:06d}.arrow" for row in range(3)]
    flip_a_bit(groups[1])
    groups[2].unlink()
    make_dataset(folder, "smoke", workers=1, cache=shape_cache, shapes=(name,))
    path = f"train/{name}.parquet"
    assert sha256_of(folder / path) == sha256_of(made / path)
    (run,) = [json.loads(line) for line in (folder / LOG).read_text().splitlines()]
    assert run["pairs"] == 2 and not (folder / GROUPS).exists()


def groups_only(context, schedule, workers, progress):
    """Makes the groups of the first shard, and not the shard."""
    for group in schedule.shards[0]:
        yield group, make(group, context, lambda: progress(1))


def test_a_shard_follows_its_groups_and_few_are_unfinished():
    """Of 3, 200 and 100 presses with seven workers, the longest shards first."""
    recipe = load_recipe("paper")
    batches = [
        Batch(f"train/{pairs}.parquet", "train", 0, ("square-1",), (0,), (*range(pairs),), pairs)
        for pairs in (3, 200, 100)
    ]
    schedule = Schedule([plan.groups_of(recipe, batch) for batch in batches])
    assert schedule.pairs == 303
    at_work, order = deque(), []
    while True:
        while len(at_work) < 7 and (work := schedule.next()) is not None:
            at_work.append(work)
        if not at_work:
            break
        order.append(at_work.popleft())
        schedule.done(order[-1])
    rows = {batch.path: [] for batch in batches}
    whole = []
    for work in order:
        if isinstance(work, plan.Group):
            assert work.batch.path not in whole
            rows[work.batch.path] += range(work.start, work.stop)
        else:
            path = work[0].batch.path
            assert len(work) == 1 or rows[path] == [*range(work[0].batch.pairs)]
            whole.append(path)
    assert sorted(whole) == sorted(rows)
    assert [work.pairs for work in order[:7]] == [28, 29, 28, 29, 28, 29, 29]
    assert len(order) == len({*order}) == 7 + 1 + 8 + 1 + 1


def test_groups_hold_each_press_once():
    """Paths are not divided, nor the presses of a random shape, whose later attempts depend on the
    earlier ones."""
    for recipe in map(load_recipe, ("paper", "open", "contact", "pretrained-4")):
        for batch in plan.plan(recipe)[::40]:
            groups = plan.groups_of(recipe, batch)
            assert max(group.pairs for group in groups) <= plan.PRESSES_PER_GROUP
            paths = [
                (name, path)
                for group in groups
                for name, _, paths in plan.group_paths(recipe, group)
                for path in paths
            ]
            assert paths == [
                (name, path)
                for name, number in zip(batch.shapes, batch.numbers, strict=True)
                for path in plan.paths_of(recipe, batch, number)
            ]
            if recipe.parts[batch.part].shapes == "random":
                assert all(group.start % batch.presses == 0 for group in groups)


def test_new_shards_are_read_and_a_torn_line_is_not(made, tmp_path):
    shutil.copytree(made, tmp_path / "unfinished")
    info = read_info(made)
    write_info(tmp_path / "unfinished", replace(info, complete=False, shards={}))
    for path, each in info.shards.items():
        add_shard(tmp_path / "unfinished", path, each)
    assert read_info(tmp_path / "unfinished").shards == info.shards
    lines = (tmp_path / "unfinished" / MADE).read_text()
    (tmp_path / "unfinished" / MADE).write_text(lines[:-1])
    assert len(read_info(tmp_path / "unfinished").shards) == len(info.shards) - 1
    (tmp_path / "unfinished" / MADE).write_text(lines.replace('"pairs": 3', '"pairs": 9'))
    with pytest.raises(T2TwinError, match=r"shards\.jsonl: pairs of train is 6"):
        read_info(tmp_path / "unfinished")


@pytest.mark.exhaustive
def test_a_run_killed_again_and_again_ends_with_the_same_bytes(made, tmp_path, shape_cache):
    folder = tmp_path / "killed"
    script = (
        "from t2twin.sim.dataset.generate import make_dataset\n"
        f"make_dataset({str(folder)!r}, 'smoke', workers=1, cache={str(shape_cache)!r}, "
        f"shapes={SHAPES!r})"
    )
    for kill in (1, 2):
        process = subprocess.Popen(
            [sys.executable, "-c", script], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL
        )
        wait_until(lambda kill=kill: len(list(folder.rglob("[a-z]*.parquet"))) >= kill)
        os.kill(process.pid, signal.SIGKILL)
        process.wait()
        assert 0 < len(list(folder.rglob("[a-z]*.parquet"))) < len(SHAPES)
    with pytest.raises(T2TwinError, match="unfinished"):
        read_split(folder, "train")
    assert "info.json: the dataset is unfinished" in [
        str(fault) for fault in verify_dataset(folder)
    ]
    make_dataset(folder, "smoke", workers=1, cache=shape_cache, shapes=SHAPES)
    assert digests(folder) == digests(made)


def test_a_flipped_bit_is_named_and_its_shard_alone_made_anew(made, tmp_path, shape_cache):
    folder = tmp_path / "damaged"
    shutil.copytree(made, folder)
    assert verify_dataset(folder) == []
    flip_a_bit(folder / "train/square-1.parquet")
    assert [fault.part for fault in verify_dataset(folder)] == ["train/square-1.parquet"]
    others = [path for path in folder.rglob("*.parquet") if path.name != "square-1.parquet"]
    before = [path.stat().st_mtime_ns for path in others]
    make_dataset(folder, "smoke", workers=1, cache=shape_cache, shapes=SHAPES)
    assert digests(folder) == digests(made)
    assert [path.stat().st_mtime_ns for path in others] == before


def test_verify_finds_what_a_digest_cannot(made, tmp_path, capsys):
    """Rows that are not the protocol's, though info.json was made to fit them."""
    table = pq.ParquetFile(made / "train/square-1.parquet").read()
    image, counts = table["source_image"].to_pylist(), table["target_counts"].to_pylist()
    index = table["index"].to_pylist()
    for changes, said in (
        ({"index": [index[0], index[0], index[2]]}, "is repeated"),
        ({"x_mm": [99.0, *table["x_mm"].to_pylist()[1:]]}, "x_mm is not the planned one"),
        ({"shape": ["circle-1"] * 3}, "its shape is not the one of its name"),
        ({"split": ["train", "val", "train"]}, "another split"),
        ({"source_image": [{"bytes": b"no picture", "path": ""}, *image[1:]]}, "cannot be decoded"),
        ({"source_image": [None, *image[1:]]}, "cannot be decoded"),
        ({"index": [None, *index[1:]]}, "index has empty rows"),
        ({"target_counts": [None, *counts[1:]]}, "target_counts has empty rows"),
        (
            {"target_counts": [[40_001] * 20, *counts[1:]]},
            "40001 in target_counts, over the full",
        ),
        ({"target_counts": [counts[0][:19], *counts[1:]]}, "19 target_counts"),
    ):
        folder = tmp_path / "changed"
        shutil.copytree(made, folder)
        assert any(said in str(fault) for fault in remade(folder, changes))
        shutil.rmtree(folder)
    shutil.copytree(made, folder)
    (folder / "val/square-3.parquet").unlink()
    (folder / "cache").mkdir()
    (folder / "cache/train.parquet").touch()  # what trainings keep is nobody's business
    shutil.copy(folder / "train/square-1.parquet", folder / "train/mine.parquet")
    with pytest.raises(SystemExit) as stop:
        main(["simdata", "--verify", str(folder)])
    assert stop.value.code == 1
    said = capsys.readouterr().out
    assert "val/square-3.parquet: it is missing" in said and "train/mine.parquet: " in said
    assert "damaged in 2 files" in said


def test_a_full_disk_is_one_sentence_and_the_run_goes_on_once_there_is_room(
    made, tmp_path, shape_cache, monkeypatch
):
    """Held to files of 150 kB, a process writes the shard of one press and not that of three."""
    folder = tmp_path / "full"
    shapes = ("pliers/teeth", "square-1")
    script = (
        "import resource\n"
        "from t2twin.sim.dataset.generate import make_dataset\n"
        "resource.setrlimit(resource.RLIMIT_FSIZE, (150_000, resource.RLIM_INFINITY))\n"
        f"make_dataset({str(folder)!r}, 'smoke', workers=1, cache={str(shape_cache)!r}, "
        f"shapes={shapes!r})"
    )
    ended = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True)
    assert ended.returncode == 1
    assert "T2TwinError: there is no room for" in ended.stderr.splitlines()[-1]
    assert "Exception ignored" not in ended.stderr
    assert [path.name for path in folder.rglob("*.parquet")] == ["pliers-teeth.parquet"]

    def no_space(_):
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    with monkeypatch.context() as patch, pytest.raises(T2TwinError, match="no space left"):
        patch.setattr(os, "fsync", no_space)
        make_dataset(folder, "smoke", workers=1, cache=shape_cache, shapes=shapes)
    make_dataset(folder, "smoke", workers=1, cache=shape_cache, shapes=shapes)
    assert verify_dataset(folder) == []
    for path in ("test/pliers-teeth.parquet", "train/square-1.parquet"):
        assert sha256_of(folder / path) == sha256_of(made / path)


def test_a_killed_worker_is_one_sentence(tmp_path, shape_cache):
    folder = tmp_path / "data"

    def kill() -> None:
        wait_until(lambda: list(folder.rglob(".*.part.parquet")))
        os.kill(multiprocessing.active_children()[0].pid or 0, signal.SIGKILL)

    killer = threading.Thread(target=kill)
    killer.start()
    with pytest.raises(T2TwinError, match="a worker was killed"):
        make_dataset(folder, "smoke", workers=2, cache=shape_cache, shapes=SHAPES[:2])
    killer.join()


def test_workers_that_cannot_start_are_one_sentence(tmp_path, shape_cache):
    """A script that is no file cannot be started again in each worker, as Python does."""
    script = (
        "from t2twin.sim.dataset.generate import make_dataset\n"
        f"make_dataset({str(tmp_path / 'data')!r}, 'smoke', workers=2, cache={str(shape_cache)!r}, "
        f"shapes={SHAPES[:2]!r})"
    )
    ended = subprocess.run(
        [sys.executable], input=script, capture_output=True, text=True, timeout=120
    )
    assert ended.returncode == 1
    assert "T2TwinError: no worker could start" in ended.stderr.splitlines()[-1]


def test_the_log_says_where_the_time_went(made):
    (record,) = [json.loads(line) for line in (made / LOG).read_text().splitlines()]
    assert record["pairs"] == 10 and record["workers"] == 1
    assert list(record["stage_seconds"]) == list(STAGES)
    spent = {stage for stage, seconds in record["stage_seconds"].items() if seconds > 0}
    assert set(STAGES) - spent == {
        "contact maps",
        "dense counts",
        "light",
        "motion",
    }  # which the protocol has not
    assert sum(record["stage_seconds"].values()) < 2 * record["seconds"]
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
    command = protocol.press_at(shapes("square-1"), index)
    rng = np.random.default_rng((0, catalogue.NAMES.index("square-1"), index))
    camera, array = sensors.camera, sensors.array
    image = camera.image(camera.press(shapes("square-1"), command), rng)
    reading = array.read(array.press(shapes("square-1"), command), rng)
    assert (decode_png(table["source_image"][1].as_py()["bytes"]) == image).all()
    assert reading.counts is not None
    assert table["target_counts"][1].as_py() == reading.counts.tolist()


def test_a_pair_takes_at_most_80_kb(made):
    """1.5 GiB for the 20,076 pairs of the paper."""
    sizes = [len(cell.as_py()["bytes"]) for cell in read_split(made, "train")["source_image"]]
    assert np.mean(sizes) < 75_000


def test_other_parameters_are_refused(made, shape_cache):
    with pytest.raises(T2TwinError, match="another seed"):
        make_dataset(made, "smoke", seed=5, workers=1, cache=shape_cache, shapes=SHAPES)


@pytest.mark.parametrize("code", ["0123456789abcdef", None])
def test_shapes_of_another_code_are_not_mixed(made, tmp_path, shape_cache, code):
    """A dataset begun with other shapes, or before datasets named what makes the shapes."""
    shutil.copytree(made, tmp_path / "older")
    write_info(tmp_path / "older", replace(read_info(made), shape_code=code))
    with pytest.raises(T2TwinError, match="made with another shape code"):
        make_dataset(tmp_path / "older", "smoke", workers=1, cache=shape_cache, shapes=SHAPES)
    assert verify_dataset(tmp_path / "older") == []
    assert len(read_split(tmp_path / "older", "train")) == 6


@pytest.mark.parametrize(
    ("asked", "said"),
    [
        ({"shapes": ("square-1", "sphere")}, "sphere"),
        ({"layout": "x_mm,y_mm\n0,0\n5,0\n13.9,0\n"}, "off the cover"),
        ({"scheduler": "tcp://127.0.0.1:9"}, "needs Dask"),
    ],
)
def test_what_is_refused_leaves_nothing(tmp_path, monkeypatch, asked, said):
    monkeypatch.delitem(sys.modules, "t2twin.sim.dataset.cluster", raising=False)
    monkeypatch.setitem(sys.modules, "distributed", None)
    (tmp_path / "mine.csv").write_text(asked.pop("layout", "x_mm,y_mm\n0,0\n5,0\n0,5\n"))
    with pytest.raises(T2TwinError, match=said):
        sensors = SensorPair.of(layout=tmp_path / "mine.csv")
        make_dataset(tmp_path / "out", **{"scale": "smoke", "sensors": sensors, **asked})
    assert not (tmp_path / "out").exists()


def test_a_folder_with_something_else_is_refused(tmp_path):
    (tmp_path / "notes.txt").write_text("mine")
    with pytest.raises(T2TwinError, match="not empty"):
        make_dataset(tmp_path, "smoke", shapes=SHAPES)
    with pytest.raises(T2TwinError, match=r"notes\.txt is a file"):
        make_dataset(tmp_path / "notes.txt", "smoke", shapes=SHAPES)
