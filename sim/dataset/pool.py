"""Makes groups and shards in processes on this machine."""

import multiprocessing
import os
import pickle
import signal
import tempfile
import threading
from collections.abc import Callable, Generator
from concurrent.futures import Future, ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from contextlib import suppress
from pathlib import Path
from queue import Empty, SimpleQueue

from t2twin.core import arguments
from t2twin.core.errors import T2TwinError
from t2twin.sim.dataset.schedule import Schedule
from t2twin.sim.dataset.shard import ShardContext, Work, WorkResult, make

POLL_SECONDS = 0.5
"""Period at which the number of finished pairs is read, s."""

QUEUED = 2
"""Work that waits for a worker, as a multiple of their number: none of them waits for the parent,
and few shards are unfinished at a time."""

MAX_WORKERS = 1000
"""Largest number of processes (assumed: more than any machine has cores)."""


class _StoppedError(Exception):
    """Another worker has failed."""


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
        yield from _run(Path(file.name), schedule, workers, progress)


def _run(
    context_file: Path, schedule: Schedule, workers: int, progress: Callable[[int], object]
) -> Generator[tuple[Work, WorkResult]]:
    """context_file: the pickled ShardContext."""
    spawn = multiprocessing.get_context("spawn")
    made, stop, started = spawn.Value("i", 0), spawn.Event(), spawn.Event()
    others = set(multiprocessing.active_children())
    with ProcessPoolExecutor(
        workers,
        mp_context=spawn,
        initializer=_start,
        initargs=(context_file, made, stop, started),
    ) as pool:
        try:
            yield from _results(pool, schedule, QUEUED * workers, made, progress)
        except BrokenProcessPool as error:
            # The pool ends its registered workers, but waits forever for one that was starting when
            # another died.
            for child in set(multiprocessing.active_children()) - others:
                child.kill()
            if not started.is_set():
                raise T2TwinError(
                    "no worker could start; a script must make the dataset below "
                    "`if __name__ == '__main__':`"
                ) from error
            raise T2TwinError(
                "a worker was killed, as the system does when memory runs out; repeat the command "
                "with fewer --workers to continue"
            ) from error
        except BaseException:
            stop.set()
            # Wait here: __exit__ does not wait after a shutdown without waiting.
            pool.shutdown(wait=True, cancel_futures=True)
            raise


def _results(
    pool: ProcessPoolExecutor,
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
        # Workers inherit that SIGINT and SIGTERM are blocked: the run stops its workers; the same
        # signal would end them too, some of them while they start.
        before = signal.pthread_sigmask(signal.SIG_BLOCK, (signal.SIGINT, signal.SIGTERM))
        try:
            while len(works) < most and (work := schedule.next()) is not None:
                future = pool.submit(_work, work)
                works[future] = work
                future.add_done_callback(finished.put)
        finally:
            signal.pthread_sigmask(signal.SIG_SETMASK, before)
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


_context: ShardContext
_made = None
_stop = None


def _start(context_file: Path, made, stop, started) -> None:
    """Initializes a worker: its context, the shared counter of pairs, and the event to stop."""
    global _context, _made, _stop
    started.set()
    _context, _made, _stop = pickle.loads(context_file.read_bytes()), made, stop
    threading.Thread(target=_end_with_parent, daemon=True).start()


def _end_with_parent() -> None:
    """Ends a worker whose parent was killed; it would wait for tasks forever."""
    parent = multiprocessing.parent_process()
    if parent is not None:
        parent.join()
        os._exit(1)


def _work(work: Work) -> WorkResult:
    return make(work, _context, _count)


def _count() -> None:
    assert _made is not None and _stop is not None
    with _made.get_lock():
        _made.value += 1
    if _stop.is_set():
        raise _StoppedError
