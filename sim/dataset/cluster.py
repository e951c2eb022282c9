"""Makes shards on the workers of a Dask cluster, which write them to a shared folder."""

from collections.abc import Callable, Generator
from pathlib import Path
from urllib.parse import urlsplit
from uuid import uuid4

from t2twin.core.errors import T2TwinError
from t2twin.sim.dataset.info import versions
from t2twin.sim.dataset.shard import ShardContext, ShardResult, make_shard
from t2twin.sim.dataset.store import INFO
from t2twin.sim.sampling.plan import Batch

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
"""Timeout of the connection to a scheduler, s."""


def check_address(address: str) -> None:
    """Raises T2TwinError for an address that distributed refuses; its client does so after 40 s."""
    try:
        get_address_host(address)
        port = urlsplit(address if "://" in address else f"//{address}").port
        if port == 0:
            raise ValueError("port 0")
    except ValueError as error:
        raise T2TwinError(
            f"{address} is not the address of a Dask scheduler; expected one like "
            "tcp://10.0.0.1:8786"
        ) from error


def run(
    context: ShardContext,
    todo: list[Batch],
    address: str,
    needed: dict[str, str],
    progress: Callable[[int], object],
) -> Generator[tuple[Batch, ShardResult]]:
    """Make the shards on the cluster and yield each as it is finished.

    needed: versions that every worker must have. progress: called with the pairs of each shard.
    The unfinished shards of a lost worker are made by another one.
    Raises T2TwinError where no scheduler answers, a worker has other versions or cannot read the
    dataset's folder, or the cluster is lost.
    """
    try:
        client = Client(address, timeout=CONNECT_SECONDS, set_as_default=False)
    except (OSError, ValueError, TypeError) as error:
        raise T2TwinError(
            f"no Dask scheduler answers at {address}; expected an address like tcp://10.0.0.1:8786"
        ) from error
    with client:
        plugin = f"t2twin-context-{uuid4().hex}"
        client.register_plugin(_ShardContextPlugin(context), name=plugin)
        batches: dict[Future, Batch] = {}
        for batch in todo:
            future = client.submit(
                _work,
                batch,
                plugin,
                needed,
                key=f"{plugin}/{batch.path}",
                priority=batch.pairs,  # the largest first, so that none runs alone at the end
            )
            batches[future] = batch
        try:
            for future in as_completed(list(batches), loop=client.loop):
                batch = batches.pop(future)
                result = future.result()
                # A released shard is not made again when the worker that made it is lost.
                future.release()
                progress(batch.pairs)
                yield batch, result
        except KilledWorker as error:
            raise T2TwinError(f"all workers that ran {error.task} died; see their logs") from error
        finally:
            client.cancel(list(batches))
            client.unregister_worker_plugin(plugin)


class _ShardContextPlugin(WorkerPlugin):
    """Sends the context to each worker once, also to workers that join later."""

    def __init__(self, context: ShardContext) -> None:
        self.context = context


def _work(batch: Batch, plugin: str, needed: dict[str, str]) -> ShardResult:
    """One shard on a worker of the cluster."""
    worker = get_worker()
    installed = versions()
    for name, version in needed.items():
        if installed[name] != version:
            raise T2TwinError(
                f"the worker {worker.address} has {name} {installed[name]} and the dataset "
                f"{version}; all must have the same"
            )
    sent = worker.plugins[plugin]
    assert isinstance(sent, _ShardContextPlugin)
    if not (Path(sent.context.folder) / INFO).is_file():
        raise T2TwinError(
            f"the worker {worker.address} cannot read {sent.context.folder}; use a folder that all "
            "workers share"
        )
    return make_shard(batch, sent.context, lambda: None)  # shards are counted, not pairs
