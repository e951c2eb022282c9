"""Shards made by the workers of a Dask cluster, and written by them to a path that all share."""

from collections.abc import Callable, Generator
from pathlib import Path
from urllib.parse import urlsplit
from uuid import uuid4

from t2twin.core.errors import T2TwinError
from t2twin.sim.dataset.info import versions
from t2twin.sim.dataset.shard import ShardContext, ShardResult, make_shard
from t2twin.sim.dataset.store import INFO
from t2twin.sim.world.plan import Batch

try:
    from distributed import (
        Client,
        Future,
        KilledWorker,
        WorkerPlugin,
        as_completed,
        get_worker,
    )
    from distributed.comm.addressing import get_address_host
except ImportError as error:
    raise T2TwinError(
        "--scheduler needs Dask; install it with: pip install 't2twin[cluster]'"
    ) from error

CONNECT_SECONDS = 20
"""How long a scheduler is waited for, s."""


def check_address(address: str) -> None:
    """Raises T2TwinError for what distributed does not take as an address.

    Its client would refuse it too, but only let go of it after 40 s.
    """
    try:
        get_address_host(address)
        port = urlsplit(address if "://" in address else f"//{address}").port
        if port == 0:
            raise ValueError("port 0 is nobody's")
    except ValueError as error:
        raise T2TwinError(
            f"{address} is no address of a Dask scheduler; one is like tcp://10.0.0.1:8786"
        ) from error


def run(
    making: ShardContext,
    todo: list[Batch],
    address: str,
    needed: dict[str, str],
    progress: Callable[[int], object],
) -> Generator[tuple[Batch, ShardResult]]:
    """Make the shards on the cluster, each yielded as it is done.

    needed: versions that every worker must have. progress: called with the pairs of each shard.
    A worker that is lost costs only the shards it had in hand; they are made again elsewhere.
    Raises T2TwinError where no scheduler answers, a worker has other versions or does not see the
    dataset's folder, or the cluster is lost.
    """
    client = _connect(address)
    with client:
        plugin = f"t2twin-making-{uuid4().hex}"
        client.register_plugin(_GiveMaking(making), name=plugin)
        batches: dict[Future, Batch] = {}
        for batch in todo:
            future = client.submit(
                _work,
                batch,
                plugin,
                needed,
                key=f"{plugin}/{batch.path}",
                priority=batch.pairs,  # the largest first, so that none is left at the end
            )
            batches[future] = batch
        try:
            for future in as_completed(list(batches), loop=client.loop):
                batch = batches.pop(future)
                made = future.result()
                # Once let go of, it is not made again when the worker that made it is lost.
                future.release()
                progress(batch.pairs)
                yield batch, made
        except KilledWorker as error:
            raise T2TwinError(
                f"the workers given {error.task} died one after the other; see their logs"
            ) from error
        finally:
            client.cancel(list(batches))
            client.unregister_worker_plugin(plugin)


def _connect(address: str) -> Client:
    try:
        return Client(address, timeout=CONNECT_SECONDS, set_as_default=False)
    except (OSError, ValueError, TypeError) as error:
        raise T2TwinError(
            f"no Dask scheduler answers at {address}; an address is like tcp://10.0.0.1:8786"
        ) from error


class _GiveMaking(WorkerPlugin):
    """Carries what shards are made with to each worker once, also to those that come later."""

    def __init__(self, making: ShardContext) -> None:
        self.making = making


def _work(batch: Batch, plugin: str, needed: dict[str, str]) -> ShardResult:
    """One shard on a worker of the cluster."""
    worker = get_worker()
    here = versions()
    for name, version in needed.items():
        if here[name] != version:
            raise T2TwinError(
                f"the worker {worker.address} has {name} {here[name]} and the dataset {version}; "
                "all must have the same"
            )
    given = worker.plugins[plugin]
    assert isinstance(given, _GiveMaking)
    if not (Path(given.making.folder) / INFO).is_file():
        raise T2TwinError(
            f"the worker {worker.address} does not see {given.making.folder}; give a folder "
            "that all share"
        )
    return make_shard(batch, given.making, _nothing)


def _nothing() -> None:
    """A cluster's progress is counted by shards."""
