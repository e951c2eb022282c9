"""A Dask cluster on loopback: a scheduler and two worker processes, one killed in the middle."""

import os
import signal
import socket
import subprocess
import sys
import threading
from contextlib import contextmanager
from functools import partial

import pytest
from waiting import wait_until

from t2twin.core.errors import T2TwinError
from t2twin.sim.dataset import generate
from t2twin.sim.dataset.generate import make_dataset
from t2twin.sim.dataset.shard import make_shard_in_worker
from t2twin.sim.dataset.store import INFO, LOG, read_info, verify_dataset
from t2twin.sim.sampling.plan import plan
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
def test_a_cluster_that_loses_a_worker_gives_the_same_bytes(tmp_path, shape_cache):
    make_dataset(tmp_path / "here", "smoke", workers=1, cache=shape_cache, shapes=SHAPES)
    data = tmp_path / "there"

    def kill(process):
        wait_until(lambda: list(data.glob("*/[a-z]*.parquet")))
        os.kill(process.pid, signal.SIGKILL)

    with scheduler() as address, worker(address, tmp_path) as first, worker(address, tmp_path):
        killer = threading.Thread(target=kill, args=(first,))
        killer.start()
        make_dataset(data, "smoke", cache=shape_cache, shapes=SHAPES, scheduler=address)
        killer.join()
    assert digests(data) == digests(tmp_path / "here")
    assert verify_dataset(data) == [] and not list(data.rglob(".*.part*"))
    assert (data / INFO).read_bytes() == (tmp_path / "here" / INFO).read_bytes()
    assert (data / LOG).is_file()


def test_what_a_cluster_lacks_is_named(tmp_path, shape_cache, monkeypatch):
    monkeypatch.setattr(generate, "CONNECT_SECONDS", 1)
    for address in ("tcp://127.0.0.1:9", "http://127.0.0.1:8786"):
        with pytest.raises(T2TwinError, match="no Dask scheduler answers"):
            make_dataset(tmp_path / "none", "smoke", cache=shape_cache, shapes=SHAPES[:1],
                         scheduler=address)  # fmt: skip
        assert not (tmp_path / "none").exists()
    recipe = load_recipe("paper")
    batches = plan(recipe, SHAPES[:1])
    monkeypatch.setattr(generate, "versions", lambda: {"numpy": "1.0"})
    make = partial(generate.make_shard, recipe, SensorPair(), tmp_path, shape_cache)
    with (
        scheduler() as address,
        worker(address, tmp_path),
        pytest.raises(T2TwinError, match="has numpy"),
    ):
        list(generate._results(tmp_path, make, batches, 1, address))
    with pytest.raises(T2TwinError, match="use a folder that all workers share"):
        make_shard_in_worker(str(tmp_path / "elsewhere"), batches[0])
