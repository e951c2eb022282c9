"""Makes groups and shards on the workers of a Dask cluster, which write to a shared folder."""

from collections.abc import Callable, Generator
from itertools import count
from pathlib import Path
from time import monotonic
from typing import Any
from urllib.parse import urlsplit
from uuid import uuid4

from t2twin.core.errors import T2TwinError
from t2twin.sim.dataset.info import versions
from t2twin.sim.dataset.schedule import QUEUED, Schedule
from t2twin.sim.dataset.shard import ShardContext, Work, WorkResult, make
from t2twin.sim.dataset.store import INFO

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

MIN_QUEUED = 64
"""Works that are submitted at a time, at least (assumed: threads may join a small cluster)."""

COUNT_SECONDS = 5.0
"""Period at which the threads of the cluster are counted, s: workers may join."""


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
    schedule: Schedule,
    address: str,
    needed: dict[str, str],
    progress: Callable[[int], object],
) -> Generator[tuple[Work, WorkResult]]:
    """Do the work of a schedule on the cluster and yield each as it is finished.

    needed: versions that every worker must have. progress: called with the pairs of each work.
    The unfinished work of a lost worker is done by another one.
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
        works: dict[Future, Work] = {}
        finished = as_completed(loop=client.loop)
        numbers, most, until = count(), 0, 0.0
        try:
            while True:
                if monotonic() >= until:
                    most = max(MIN_QUEUED, QUEUED * _threads(client))
                    until = monotonic() + COUNT_SECONDS
                while len(works) < most and (work := schedule.next()) is not None:
                    number = next(numbers)
                    # Dask starts the work of the highest priority first, so in this order.
                    future = client.submit(
                        _work, work, plugin, needed, key=f"{plugin}/{number}", priority=-number
                    )
                    works[future] = work
                    finished.add(future)
                if not works:
                    return
                future = next(finished)
                work = works.pop(future)
                result = future.result()
                # Released work is not repeated when the worker that did it is lost.
                future.release()
                schedule.done(work)
                progress(result.pairs)
                yield work, result
        except KilledWorker as error:
            raise T2TwinError(f"all workers that ran {error.task} died; see their logs") from error
        finally:
            client.cancel(list(works))
            client.unregister_worker_plugin(plugin)


def _threads(client: Client) -> int:
    """The number of threads of all workers."""
    threads: Any = client.nthreads()
    return sum(threads.values())


class _ShardContextPlugin(WorkerPlugin):
    """Sends the context to each worker once, also to workers that join later."""

    def __init__(self, context: ShardContext) -> None:
        self.context = context


def _work(work: Work, plugin: str, needed: dict[str, str]) -> WorkResult:
    """One work on a worker of the cluster."""
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
    return make(work, sent.context, lambda: None)  # groups are counted, not pairs
