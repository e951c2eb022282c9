"""Makes groups and shards in processes on this machine."""

import pickle
import tempfile
from collections.abc import Callable, Generator
from concurrent.futures import Executor, Future
from contextlib import suppress
from functools import cache
from pathlib import Path
from queue import Empty, SimpleQueue

from t2twin.core import arguments
from t2twin.core.errors import T2TwinError
from t2twin.sim.dataset import workers as processes
from t2twin.sim.dataset.schedule import QUEUED, Schedule
from t2twin.sim.dataset.shard import ShardContext, Work, WorkResult, make

POLL_SECONDS = 0.5
"""Period at which the number of finished pairs is read, s."""

MAX_WORKERS = 1000
"""Largest number of processes (assumed: more than any machine has cores)."""


def check_workers(workers: int | None) -> None:
    """Raises T2TwinError for a number of processes out of range; None is the number of cores."""
    if workers is not None and not 1 <= arguments.whole_number(workers, "workers") <= MAX_WORKERS:
        raise T2TwinError(f"workers is {workers}; allowed are 1 to {MAX_WORKERS}")


def run(
    context: ShardContext, schedule: Schedule, workers: int, progress: Callable[[int], object]
) -> Generator[tuple[Work, WorkResult]]:
    """Do the work of a schedule and yield each as it is finished.

    progress: called with the number of pairs finished since the last call. Raises T2TwinError where
    a worker fails, is killed or cannot start; the others then stop after their current pair.
    """
    if workers == 1:
        for groups in schedule.shards:
            yield groups, make(groups, context, lambda: progress(1))
        return
    # Passed as a file: writing more than a pipe holds to a worker that has died blocks forever.
    with tempfile.NamedTemporaryFile(prefix="t2twin-context-") as file:
        pickle.dump(context, file)
        file.flush()
        started = processes.take(workers)
        with started.at_work():
            most = QUEUED * started.number
            yield from results(started.pool, file.name, schedule, most, started.made, progress)


def results(
    pool: Executor,
    context_file: str,
    schedule: Schedule,
    most: int,
    made,
    progress: Callable[[int], object],
) -> Generator[tuple[Work, WorkResult]]:
    """Each work of the schedule with its result. most: works that are submitted at a time."""
    finished: SimpleQueue[Future[WorkResult]] = SimpleQueue()
    works: dict[Future[WorkResult], Work] = {}
    seen = 0
    while True:
        with processes.blocked_signals():
            while len(works) < most and (work := schedule.next()) is not None:
                future = pool.submit(_work, context_file, work)
                works[future] = work
                future.add_done_callback(finished.put)
        if not works:
            return
        future = None
        with suppress(Empty):
            future = finished.get(timeout=POLL_SECONDS)
        now = made.value
        progress(now - seen)
        seen = now
        if future is not None:
            work = works.pop(future)
            result = future.result()
            schedule.done(work)
            yield work, result


@cache
def _context(file: str) -> ShardContext:
    """The context of a worker's only run."""
    return pickle.loads(Path(file).read_bytes())


def _work(context_file: str, work: Work) -> WorkResult:
    return make(work, _context(context_file), processes.count_pair)
