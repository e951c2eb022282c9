"""Making one shard: all presses of one shape."""

import multiprocessing
import os
import threading
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from primitives_cad import catalogue
from primitives_cad.errors import T2TwinError
from sim import protocol
from sim.bench import Bench
from sim.dataset import row, shard_path, write_shard


@dataclass(frozen=True)
class Task:
    """One shard: a shape, the presses to make of it, and where it goes."""

    shape: str
    split: str
    indices: tuple[int, ...]
    seed: int
    folder: str
    cache: str | None

    @property
    def path(self) -> str:
        return shard_path(self.split, self.shape)


def make_shard(task: Task, bench: Bench, progress: Callable[[], object]) -> str:
    """Press, look, feel and write; returns the shard's sha256. Calls progress after each pair."""
    shape = catalogue.load(task.shape, task.cache)
    family = task.shape.split("/")[0] if "/" in task.shape else task.shape.rpartition("-")[0]
    place = catalogue.NAMES.index(task.shape)
    rows = []
    for index in task.indices:
        command = protocol.press_at(shape, index)
        sample = bench.take(shape, command, np.random.default_rng((task.seed, place, index)))
        if not (sample.digit.settled and sample.cyskin.settled):
            raise T2TwinError(
                f"press {index} of {task.shape} did not come to rest; take a finer or coarser grid"
            )
        rows.append(row(sample, index, family, task.split))
        progress()
    return write_shard(Path(task.folder) / task.path, rows)


_bench: Bench
_made = None


def start_worker(bench: Bench, made) -> None:
    """Give a pool's process its bench and the counter of pairs that all of them share."""
    global _bench, _made
    _bench, _made = bench, made
    threading.Thread(target=_end_with_parent, daemon=True).start()


def _end_with_parent() -> None:
    """A killed run takes its workers with it; they would wait for tasks for ever."""
    parent = multiprocessing.parent_process()
    if parent is not None:
        parent.join()
        os._exit(1)


def work(task: Task) -> str:
    """make_shard in a pool's process."""
    return make_shard(task, _bench, _count)


def _count() -> None:
    assert _made is not None
    with _made.get_lock():
        _made.value += 1
