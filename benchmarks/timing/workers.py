"""Use of 16, 64 and 1,000 workers by `t2twin simdata`, simulated from measured times.

    python -m benchmarks.timing.workers

Measured here are processor times: of a sample of groups of presses, of the writing of a shard, and
of the start of a worker. So is the parent's time for each work and each worker. The simulation then
takes the same schedule, with as many cores as workers. Shared disks and memory are not simulated.
The time begins when the parent has imported its modules and planned the dataset.
"""

import heapq
import json
import multiprocessing
import pickle
import subprocess
import sys
import tempfile
import time
from argparse import Namespace
from collections import deque
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from random import Random
from typing import Any

import numpy as np
from msgspec import structs

from benchmarks.evidence.record import Argument, Benchmark, Figure
from benchmarks.evidence.run import main
from t2twin.sim.dataset import pool
from t2twin.sim.dataset.generate import sensors_of
from t2twin.sim.dataset.schedule import QUEUED, Schedule
from t2twin.sim.dataset.shard import ShardContext, Stopwatch, Work, WorkResult, make, process_name
from t2twin.sim.dataset.store import group_path, read_group, write_group
from t2twin.sim.sampling.plan import Group, groups_of, plan
from t2twin.sim.sampling.recipe import Recipe, load_recipe

BENCHMARK = Benchmark(
    module="benchmarks.timing.workers",
    measures="Use of many workers by a dataset, simulated from measured times.",
    minutes=3,
    sources=("primitives_cad", "sim"),
    figures=(
        Figure("measured.parent_ms_a_pair", "ms", most=0.25),
        Figure("measured.*", ""),
        Figure("paper.16.busy_percent", "%", least=92.0),
        Figure("paper.64.busy_percent", "%", least=85.0),
        Figure("paper.*.*", ""),
        Figure("ten_million.*.*", ""),
    ),
    arguments=(
        Argument("--groups", "in the sample; keeps nothing unless 40", int, 40, partial=True),
    ),
)

WORKERS = (16, 64, 1000)

RECIPES: dict[str, tuple[str, dict[str, int]]] = {
    "paper": ("paper", {}),
    "ten_million": ("open", {"count": 1_000_000, "presses": 10}),
}
"""Recipes, and values of their first part that replace the own ones."""

SHARDS = 3
"""Shards whose writing is measured."""

STARTED = 4
"""Workers whose start is measured."""

FIRST_GROUP = """
import json, pickle, sys, time
from pathlib import Path
from t2twin.sim.dataset.shard import make, warm_up
warm_up()
context, group = pickle.loads(Path(sys.argv[1]).read_bytes())
times = [time.process_time()]
for _ in range(2):
    make(group, context, lambda: None)
    Path(sys.argv[2]).unlink()
    times.append(time.process_time())
print(json.dumps(times))
"""
"""Processor time of a new worker after its start, its first and its second group."""

BEGINNING = """
import json, sys, time
from t2twin.cli import dataset, press
import t2twin
from t2twin.sim.dataset import generate
generate._make_dataset = lambda *given: print(json.dumps(time.process_time()))
t2twin.make_dataset(sys.argv[1], recipe=sys.argv[2], workers=1)
"""
"""Processor time of the parent before the first work."""


@dataclass(frozen=True)
class Times:
    """Seconds.

    pair: of the pairs in each sampled group. shard: of the writing of a pair. start: of a worker
    after the beginning of the run. imports: before its first group, most of it earlier. begun: of
    the parent before the run. spawn, work: of the parent for each worker and each work.
    """

    pair: list[float]
    shard: float
    start: float
    imports: float
    begun: float
    spawn: float
    work: float

    def of(self, work: Work, rng: Random) -> float:
        """A work's time; a group's is like that of a sampled one."""
        if isinstance(work, Group):
            return work.pairs * rng.choice(self.pair)
        return work[0].batch.pairs * self.shard


def measure(options: Namespace) -> dict[str, Any]:
    spawn_s, work_s = parent_times()
    content: dict[str, Any] = {}
    measured = {}
    for name, (which, changes) in RECIPES.items():
        recipe = load_recipe(which)
        parts = (structs.replace(recipe.parts[0], **changes), *recipe.parts[1:])
        recipe = structs.replace(recipe, parts=parts)
        shards = [groups_of(recipe, batch) for batch in plan(recipe)]
        times = worker_times(recipe, shards, options.groups, spawn_s, work_s)
        pairs = sum(group.pairs for groups in shards for group in groups)
        works = sum(len(groups) + (len(groups) > 1) for groups in shards)
        content[name] = {
            str(workers): simulated(Schedule(shards), workers, times) for workers in WORKERS
        }
        measured |= {
            f"{name}_pair_ms": 1e3 * float(np.mean(times.pair)),
            f"{name}_group_s_p99_over_median": float(
                np.percentile(times.pair, 99) / np.median(times.pair)
            ),
            f"{name}_shard_ms_a_pair": 1e3 * times.shard,
            f"{name}_start_s": times.start,
            f"{name}_imports_s": times.imports,
            f"{name}_begun_s": times.begun,
            f"{name}_pairs": pairs,
        }
        if name == "paper":
            measured["parent_ms_a_pair"] = 1e3 * work_s * works / pairs
    measured |= {"spawn_ms": 1e3 * spawn_s, "work_ms": 1e3 * work_s}
    return {"measured": measured, **content}


def worker_times(
    recipe: Recipe, shards: list[tuple[Group, ...]], groups: int, spawn_s: float, work_s: float
) -> Times:
    """Times of a sample of a recipe's groups and shards, and of a worker's start."""
    rng = np.random.default_rng(0)
    every = [group for shard in shards for group in shard]
    with tempfile.TemporaryDirectory(prefix="t2twin-workers-") as folder:
        context = ShardContext(recipe, sensors_of(recipe), folder, None)
        of_pair = []
        make(every[0], context, lambda: None)  # loads the compiled code
        for nth in rng.choice(len(every), groups, replace=False):
            started = time.process_time()
            make(every[nth], context, lambda: None)
            of_pair.append((time.process_time() - started) / every[nth].pairs)
        table = read_group(group_path(folder, every[0].batch.path, every[0].start))
        assert table is not None
        of_shard = []
        for shard in shards[:SHARDS]:
            for group in shard:  # the same rows in each group are enough to write them
                write_group(group_path(folder, group.batch.path, group.start), table)
            started = time.process_time()
            make(shard, context, lambda: None)
            of_shard.append((time.process_time() - started) / (len(table) * len(shard)))
        imports, first = started_s(context, every[1], Path(folder))
    # The workers import while the parent imports and plans.
    begun = begun_s(recipe.name)
    start = max(0.0, first) + max(0.0, imports - begun)
    return Times(of_pair, float(np.median(of_shard)), start, imports, begun, spawn_s, work_s)


def started_s(context: ShardContext, group: Group, folder: Path) -> tuple[float, float]:
    """Processor times of a worker: its imports, and what its first group takes longer than later
    ones."""
    (folder / "context").write_bytes(pickle.dumps((context, group)))
    made = group_path(folder, group.batch.path, group.start)
    made.unlink(missing_ok=True)
    imports, first, second = _told(FIRST_GROUP, str(folder / "context"), str(made))
    return imports, (first - imports) - (second - first)


def begun_s(recipe: str) -> float:
    """Processor time of the parent before the first work."""
    with tempfile.TemporaryDirectory() as folder:
        return _told(BEGINNING, str(Path(folder) / "data"), recipe)


def _told(program: str, *arguments: str) -> Any:
    """What a new process prints as JSON."""
    command = [sys.executable, "-c", program, *arguments]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    return json.loads(done.stdout.splitlines()[-1])


def parent_times() -> tuple[float, float]:
    """Processor time of the parent to start a worker, and for each work."""
    recipe = load_recipe(RECIPES["paper"][0])
    schedule = Schedule([groups_of(recipe, batch) for batch in plan(recipe)])
    spawn = multiprocessing.get_context("spawn")
    made = spawn.Value("i", 0)
    with _Answers(STARTED, mp_context=spawn) as workers:
        started = time.process_time()
        for future in [workers.submit(None, ()) for _ in range(STARTED)]:
            future.result()
        spawned, number, watch = time.process_time(), 0, Stopwatch()
        most = QUEUED * STARTED
        for _, result in pool.results(workers, "", schedule, most, made, lambda pairs: None):
            watch.add(result.watch)
            number += 1
        return (spawned - started) / STARTED, (time.process_time() - spawned) / number


class _Answers(ProcessPoolExecutor):
    """Workers that do no work and return a result as if they had."""

    def submit(self, fn: Callable | None, *given: Any) -> Any:  # pyright: ignore
        return super().submit(_answer, *given)


def _answer(*given: Any) -> WorkResult:
    return WorkResult("0" * 64, 1, Stopwatch(), process_name(), 0, {}, {})


def simulated(schedule: Schedule, workers: int, times: Times) -> dict[str, float]:
    """The run of a schedule with as many cores as workers.

    busy_percent: time of the works over that of all workers. starting_percent, waiting_percent:
    time in which workers start, and in which they wait for the parent or for the others at the end.
    parent_percent: time in which the parent works.
    """
    rng, parent = Random(0), 0.0
    free = []  # the times at which workers become free
    for _ in range(workers):
        parent += times.spawn
        free.append(parent + times.start)
    starting = sum(free)
    queue: deque[tuple[float, Work]] = deque()
    ends: list[tuple[float, int, Work]] = []
    busy = end = 0.0
    submitted = number = 0
    while True:
        while submitted < QUEUED * workers and (work := schedule.next()) is not None:
            queue.append((parent, work))
            submitted += 1
        while queue and free:
            submitted_s, work = queue.popleft()
            takes = times.of(work, rng)
            end = max(heapq.heappop(free), submitted_s) + takes
            busy += takes
            heapq.heappush(ends, (end, number, work))
            number += 1
        if not ends:
            break
        end, _, work = heapq.heappop(ends)
        heapq.heappush(free, end)
        parent = max(parent, end) + times.work
        submitted -= 1
        schedule.done(work)
    whole = workers * parent
    return {
        "seconds": parent,
        "busy_percent": 100 * busy / whole,
        "starting_percent": 100 * starting / whole,
        "waiting_percent": 100 * (1 - (busy + starting) / whole),
        "parent_percent": 100 * (workers * times.spawn + number * times.work) / parent,
    }


if __name__ == "__main__":
    main(BENCHMARK)
