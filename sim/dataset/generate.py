"""Making the dataset: one task a shape, here or on a cluster, continued where it stopped."""

import json
import os
import time
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from tqdm import tqdm

from t2twin.primitives_cad import catalogue
from t2twin.primitives_cad.errors import T2TwinError
from t2twin.sim.dataset import pool, protocol
from t2twin.sim.dataset.card import card
from t2twin.sim.dataset.info import describe
from t2twin.sim.dataset.shard import Task
from t2twin.sim.dataset.store import (
    CARD,
    INFO,
    LOG,
    SPLITS,
    read_info,
    sha256_of,
    write_info,
    write_whole,
)
from t2twin.sim.dataset.timing import Stopwatch, in_words, peak_memory, process_name
from t2twin.sim.sensors import SensorPair

SECONDS_PER_PAIR = 0.083
"""Time of one pair on one core, for the estimate before the start, s."""


def generate(
    folder: str | Path,
    scale: str,
    seed: int = 0,
    workers: int | None = None,
    bench: SensorPair | None = None,
    cache: str | Path | None = None,
    shapes: tuple[str, ...] = catalogue.NAMES,
    scheduler: str | None = None,
) -> dict[str, Any]:
    """Make the dataset of a scale, or end one that was begun with the same parameters.

    Same seed and versions, same bytes, whatever the number of workers. scheduler: address of a Dask
    scheduler whose workers make the shards; folder and cache then lie where all of them see them.
    Returns its info. Raises T2TwinError where the folder holds something else, there is no room,
    or a worker is lost.
    """
    folder, bench = Path(folder).absolute(), bench or SensorPair()
    if workers is not None and workers < 1:
        raise T2TwinError(f"{workers} workers cannot work; allowed are 1 and more")
    tasks = _tasks(folder, scale, seed, cache, shapes)
    info = _begin(folder, describe(bench, scale, seed, tasks))
    todo = [task for task in tasks if not _is_made(folder, task, info)]
    if todo:
        info["complete"] = False
        write_info(folder, info)
        _make(folder, bench, todo, info, workers or os.cpu_count() or 1, scheduler)
    info["complete"] = True
    write_info(folder, info)
    write_whole(folder / CARD, card(info).encode())
    _sweep(folder)
    return info


def _tasks(
    folder: Path, scale: str, seed: int, cache: str | Path | None, shapes: tuple[str, ...]
) -> list[Task]:
    size = protocol.scale_of(scale)
    kept = Path(cache) if cache is not None else catalogue.CACHE_DIR
    return [
        Task(
            shape=name,
            split=catalogue.split(name),
            indices=tuple(protocol.indices(name, size)),
            seed=seed,
            folder=str(folder),
            cache=str(kept.absolute()),
        )
        for name in shapes
    ]


def _begin(folder: Path, wanted: dict[str, Any]) -> dict[str, Any]:
    """The info to go on from: what stands in the folder if it is of the same making."""
    if (folder / INFO).exists():
        there = read_info(folder)
        ignored = ("shards", "complete")
        for key in wanted:
            if key not in ignored and there.get(key) != wanted[key]:
                raise T2TwinError(
                    f"{folder} holds a dataset made with another {key}; choose another folder, "
                    "or remove that one"
                )
        _sweep(folder)
        return there
    _sweep(folder)
    if folder.exists() and any(folder.iterdir()):
        raise T2TwinError(f"{folder} is not empty and holds no dataset; choose another folder")
    folder.mkdir(parents=True, exist_ok=True)
    write_info(folder, wanted)
    return wanted


def _sweep(folder: Path) -> None:
    """Remove what a killed run or worker was writing; what others keep in the folder stays."""
    for place in (folder, *(folder / split for split in SPLITS)):
        for left_over in place.glob(".*.part*"):
            left_over.unlink(missing_ok=True)


def _is_made(folder: Path, task: Task, info: dict[str, Any]) -> bool:
    path = folder / task.path
    if task.path not in info["shards"] or not path.is_file():
        return False
    return sha256_of(path) == info["shards"][task.path]["sha256"]


def _make(
    folder: Path,
    bench: SensorPair,
    todo: list[Task],
    info: dict[str, Any],
    workers: int,
    scheduler: str | None,
) -> None:
    workers = min(workers, len(todo))
    pairs = sum(len(task.indices) for task in todo)
    start, watch, peaks = time.monotonic(), Stopwatch(), {}
    with tqdm(total=pairs, unit="pair", desc="simdata") as bar:
        if scheduler is None:
            minutes = pairs * SECONDS_PER_PAIR / workers / 60
            bar.write(f"{pairs} pairs to make with {workers} workers: about {minutes:.1f} minutes")
            results = pool.run(bench, todo, workers, bar.update)
        else:
            from t2twin.sim.dataset import cluster

            bar.write(f"{pairs} pairs to make on the cluster at {scheduler}")
            results = cluster.run(bench, todo, scheduler, info["versions"], bar.update)
        for task, made in results:
            info["shards"][task.path] = {"sha256": made.sha256, "pairs": len(task.indices)}
            write_info(folder, info)
            watch.add(made.watch)
            peaks[made.process] = made.peak_memory
    busy = len(peaks)
    peaks[process_name()] = peak_memory()
    seconds, memory = time.monotonic() - start, sum(peaks.values())
    print(in_words(pairs, seconds, busy, watch, memory))
    _log(
        folder,
        {
            "ended": datetime.now(UTC).isoformat(timespec="seconds"),
            "pairs": pairs,
            "workers": busy,
            "seconds": round(seconds, 2),
            "stage_seconds": {stage: round(value, 3) for stage, value in watch.seconds.items()},
            "peak_memory_bytes": memory,
        },
    )


def _log(folder: Path, record: dict[str, Any]) -> None:
    """Add a line to the dataset's log, which says how its runs went; no shard depends on it."""
    path = folder / LOG
    before = path.read_text() if path.is_file() else ""
    write_whole(path, (before + json.dumps(record) + "\n").encode())
