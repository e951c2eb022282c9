"""Shards made by processes on this machine."""

import multiprocessing
import os
import pickle
import signal
import tempfile
import threading
from collections.abc import Callable, Generator, Iterator
from concurrent.futures import FIRST_COMPLETED, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from pathlib import Path

from t2twin.core import arguments
from t2twin.core.errors import T2TwinError
from t2twin.sim.dataset.shard import ShardContext, ShardResult, make_shard
from t2twin.sim.world.plan import Batch

LOOK_SECONDS = 0.5
"""How often the number of pairs made is looked at, s."""


MAX_WORKERS = 1000
"""Most processes that may be asked for (assumed: more than any one machine has cores)."""


class _StoppedError(Exception):
    """Another worker has failed."""


def check_workers(workers: int | None) -> None:
    """Raises T2TwinError for a number of processes that cannot be; None is as many as cores."""
    if workers is not None and not 1 <= arguments.whole_number(workers, "workers") <= MAX_WORKERS:
        raise T2TwinError(f"{workers} workers cannot work; allowed are 1 to {MAX_WORKERS}")


def run(
    making: ShardContext, todo: list[Batch], workers: int, progress: Callable[[int], object]
) -> Generator[tuple[Batch, ShardResult]]:
    """Make the shards, each yielded as it is done.

    progress: called with the number of pairs made since the last call. Raises T2TwinError where a
    worker fails, is killed or cannot start; the others then stop after the pair in hand.
    """
    if workers == 1:
        for batch in todo:
            yield batch, make_shard(batch, making, lambda: progress(1))
        return
    # In a file, as a worker that dies while it is handed more than a pipe holds is waited for
    # without end.
    with tempfile.NamedTemporaryFile(prefix="t2twin-making-") as file:
        pickle.dump(making, file)
        file.flush()
        yield from _run(Path(file.name), todo, workers, progress)


def _run(
    making: Path, todo: list[Batch], workers: int, progress: Callable[[int], object]
) -> Generator[tuple[Batch, ShardResult]]:
    """making: the file that the workers read it from."""
    context = multiprocessing.get_context("spawn")
    made, stop, started = context.Value("i", 0), context.Event(), context.Event()
    seen = 0
    others = set(multiprocessing.active_children())
    with ProcessPoolExecutor(
        workers, mp_context=context, initializer=_start, initargs=(making, made, stop, started)
    ) as pool:
        # The largest first, so that no long shard is left alone at the end.
        order = sorted(todo, key=lambda batch: -batch.pairs)
        try:
            with _signals_held():  # what starts here keeps them off for good
                batches = {pool.submit(_work, batch): batch for batch in order}
            waiting = set(batches)
            while waiting:
                done, waiting = wait(waiting, timeout=LOOK_SECONDS, return_when=FIRST_COMPLETED)
                now = made.value
                progress(now - seen)
                seen = now
                for future in done:
                    yield batches[future], future.result()
        except BrokenProcessPool as error:
            # The pool ends the workers that it knows of, and would wait for ever for one that was
            # being started when another one died.
            for child in set(multiprocessing.active_children()) - others:
                child.kill()
            if not started.is_set():
                raise T2TwinError(
                    "no worker could start; a script of your own must be a file that makes the "
                    "dataset below `if __name__ == '__main__':`"
                ) from error
            raise T2TwinError(
                "a worker was killed, as the system does when memory runs out; with fewer "
                "--workers the same command goes on from here"
            ) from error
        except BaseException:
            stop.set()
            # Waited for here: a pool that was once told not to wait does not do so any more.
            pool.shutdown(wait=True, cancel_futures=True)
            raise


@contextmanager
def _signals_held() -> Iterator[None]:
    """Ctrl-C and SIGTERM wait until after the block: the run itself stops its workers, which would
    otherwise be ended by the same signal, some while they are loaded."""
    before = signal.pthread_sigmask(signal.SIG_BLOCK, (signal.SIGINT, signal.SIGTERM))
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


_making: ShardContext
_made = None
_stop = None


def _start(making: Path, made, stop, started) -> None:
    """Give a worker what it makes shards with, the counter of pairs that all of them share, and
    the stop sign."""
    global _making, _made, _stop
    started.set()
    _making, _made, _stop = pickle.loads(making.read_bytes()), made, stop
    threading.Thread(target=_end_with_parent, daemon=True).start()


def _end_with_parent() -> None:
    """A killed run takes its workers with it; they would wait for tasks for ever."""
    parent = multiprocessing.parent_process()
    if parent is not None:
        parent.join()
        os._exit(1)


def _work(batch: Batch) -> ShardResult:
    return make_shard(batch, _making, _count)


def _count() -> None:
    assert _made is not None and _stop is not None
    with _made.get_lock():
        _made.value += 1
    if _stop.is_set():
        raise _StoppedError
