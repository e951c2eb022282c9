"""A Dask cluster on loopback: a scheduler and two worker processes, one killed in the middle."""

import os
import signal
import socket
import subprocess
import sys
import threading
from contextlib import contextmanager

import pytest
from waiting import wait_until

from t2twin.core.errors import T2TwinError
from t2twin.sim.dataset import cluster
from t2twin.sim.dataset.generate import make_dataset
from t2twin.sim.dataset.schedule import Schedule
from t2twin.sim.dataset.shard import ShardContext
from t2twin.sim.dataset.store import GROUPS, INFO, LOG, read_info
from t2twin.sim.dataset.verify import verify_dataset
from t2twin.sim.sampling import plan
from t2twin.sim.sampling.plan import Batch, Group
from t2twin.sim.sampling.recipe import load_recipe
from t2twin.sim.sensors.pair import SensorPair

SHAPES = ("square-1", "square-3", "circle-2", "square-2", "circle-1", "pliers/teeth")


@contextmanager
def started(*arguments):
    """A process of Dask, ended with the block."""
    process = subprocess.Popen(
        [sys.executable, "-m", *arguments], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL
    )
    try:
        yield process
    finally:
        process.kill()
        process.wait()


@contextmanager
def scheduler():
    """Yields its address."""
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    with started("distributed.cli.dask_scheduler", "--host", "127.0.0.1", "--port", str(port),
                 "--no-dashboard"):  # fmt: skip
        wait_until(lambda: answers(port))
        yield f"tcp://127.0.0.1:{port}"


def answers(port):
    with socket.socket() as probe:
        return probe.connect_ex(("127.0.0.1", port)) == 0


def worker(address, folder):
    """Two threads each: presses do not wait for one another."""
    return started("distributed.cli.dask_worker", address, "--nthreads", "2", "--no-nanny",
                   "--no-dashboard", "--local-directory", str(folder))  # fmt: skip


def digests(folder):
    return {path: shard.sha256 for path, shard in read_info(folder).shards.items()}


@pytest.mark.exhaustive
def test_a_cluster_that_loses_a_worker_gives_the_same_bytes(tmp_path, shape_cache, monkeypatch):
    monkeypatch.setattr(plan, "PRESSES_PER_GROUP", 1)
    make_dataset(tmp_path / "here", "smoke", workers=1, cache=shape_cache, shapes=SHAPES)
    data = tmp_path / "there"
    killed_at, kept = [], {}

    def kill(process):
        """After the first shard is whole, with groups of another one."""

        def is_next():
            whole = len(list(data.glob("*/[a-z]*.parquet")))
            return list(data.glob(f"{GROUPS}/[a-z]*")) and whole

        whole = wait_until(is_next)
        os.kill(process.pid, signal.SIGKILL)
        killed_at.append(whole)
        for path in read_info(data).shards:
            kept[path] = (data / path).stat().st_mtime_ns

    with scheduler() as address, worker(address, tmp_path) as first, worker(address, tmp_path):
        killer = threading.Thread(target=kill, args=(first,))
        killer.start()
        make_dataset(data, "smoke", cache=shape_cache, shapes=SHAPES, scheduler=address)
        killer.join()
        assert killed_at and killed_at[0] < len(SHAPES)
    assert {path: (data / path).stat().st_mtime_ns for path in kept} == kept
    assert digests(data) == digests(tmp_path / "here")
    assert verify_dataset(data) == []
    assert not list(data.rglob(".*.part*")) and not (data / GROUPS).exists()
    assert (data / INFO).read_bytes() == (tmp_path / "here" / INFO).read_bytes()
    assert (data / LOG).is_file()


def test_what_a_cluster_lacks_is_said(tmp_path, shape_cache, monkeypatch):
    monkeypatch.setattr(cluster, "CONNECT_SECONDS", 1)
    with pytest.raises(T2TwinError, match="no Dask scheduler answers"):
        make_dataset(tmp_path / "none", "smoke", cache=shape_cache, shapes=SHAPES[:1],
                 scheduler="tcp://127.0.0.1:9")  # fmt: skip
    for address in ("foo", "http://127.0.0.1:8786", "tcp://127.0.0.1", ""):
        with pytest.raises(T2TwinError, match="not the address of a Dask scheduler"):
            make_dataset(tmp_path / "refused", "smoke", cache=shape_cache, shapes=SHAPES[:1],
                     scheduler=address)  # fmt: skip
    assert not (tmp_path / "refused").exists()
    batch = Batch("train/square-1.parquet", "train", 0, ("square-1",), (0,), (0,), 1)
    elsewhere = str(tmp_path / "elsewhere")
    making = ShardContext(load_recipe("paper"), SensorPair(), elsewhere, str(shape_cache))
    with scheduler() as address, worker(address, tmp_path):
        for needed, said in (({"numpy": "1.0"}, "numpy"), ({}, "cannot read")):
            with pytest.raises(T2TwinError, match=said):
                schedule = Schedule([(Group(batch, 0, 1),)])
                list(cluster.run(making, schedule, address, needed, lambda pairs: None))
