"""Making the dataset: one task a shape, here or on a cluster, continued where it stopped."""

import importlib
import json
import time
from contextlib import closing, suppress
from dataclasses import asdict, fields, replace
from datetime import UTC, datetime
from pathlib import Path

import numpy as np

from t2twin.primitives_cad import catalogue
from t2twin.primitives_cad.errors import T2TwinError
from t2twin.primitives_cad.folder_lock import is_empty, locked
from t2twin.primitives_cad.machine import cores
from t2twin.primitives_cad.progress import Progress
from t2twin.primitives_cad.writing import LEFT_OVERS
from t2twin.sim.dataset import pool, protocol
from t2twin.sim.dataset.card import card
from t2twin.sim.dataset.describe import describe
from t2twin.sim.dataset.info import SPLITS, DatasetInfo, Shard
from t2twin.sim.dataset.shard import Task
from t2twin.sim.dataset.store import CARD, INFO, LOG, read_info, sha256_of, write_info, write_whole
from t2twin.sim.dataset.timing import RunTiming, Stopwatch, in_words, peak_memory, process_name
from t2twin.sim.press.layer import cached_layer
from t2twin.sim.seeds import check_seed
from t2twin.sim.sensors import CySkin, SensorPair

SECONDS_PER_PAIR, SECONDS_PER_SHAPE = 0.083, 0.75
"""Time of one pair, and of preparing one shape, on one core, for the estimate before the start, s
(measured)."""

STATE = ("shards", "complete")
"""Fields of info.json that say how far a dataset is; all others say what it is made with."""

MADE_WITH = {
    "versions": "other versions of its libraries",
    "parameters": "other parameters",
    "pairs": "other pairs",
    "shape_code": "another shape code (what makes the shapes has changed since)",
}
"""How a message names a field of info.json that differs; the rest are "another" and their name."""


def generate(
    folder: str | Path,
    scale: str,
    seed: int = 0,
    workers: int | None = None,
    sensors: SensorPair | None = None,
    cache: str | Path | None = None,
    shapes: tuple[str, ...] = catalogue.NAMES,
    scheduler: str | None = None,
) -> DatasetInfo:
    """Make the dataset of a scale, or end one that was begun with the same parameters.

    Same seed and versions, same bytes, whatever the number of workers. scheduler: address of a Dask
    scheduler whose workers make the shards; folder and cache then lie where all of them see them.
    Returns its info. Raises T2TwinError before anything is written for a number of workers, a seed,
    a layout, a scale, a shape or a scheduler's address that cannot be used, and where the folder
    holds something else or another process is making it; later where there is no room, or a worker
    is lost.
    """
    folder, sensors = Path(folder).absolute(), sensors or SensorPair()
    if workers is not None and workers < 1:
        raise T2TwinError(f"{workers} workers cannot work; allowed are 1 and more")
    check_seed(seed)
    _check_layout(sensors.cyskin)
    if scheduler is not None:
        # Its import says where Dask is missing.
        importlib.import_module("t2twin.sim.dataset.cluster").check_address(scheduler)
    tasks = _tasks(folder, scale, seed, cache, shapes)
    wanted = describe(sensors, scale, seed, tasks)
    with locked(folder):
        return _make_whole(folder, sensors, tasks, wanted, workers or cores(), scheduler)


def _make_whole(
    folder: Path,
    sensors: SensorPair,
    tasks: list[Task],
    wanted: DatasetInfo,
    workers: int,
    scheduler: str | None,
) -> DatasetInfo:
    begun = (folder / INFO).exists()
    info = _begin(folder, wanted)
    try:
        info = _made_whole(folder, sensors, tasks, info, workers, scheduler)
    except BaseException:
        if not begun:
            _leave_nothing(folder)
        raise
    _sweep(folder)
    return info


def _leave_nothing(folder: Path) -> None:
    """Where no shard was made, another command may well be the next one here."""
    _sweep(folder)
    if not any(folder.glob("*/*.parquet")):
        (folder / INFO).unlink(missing_ok=True)
        for split in SPLITS:
            with suppress(OSError):
                (folder / split).rmdir()


def _made_whole(
    folder: Path,
    sensors: SensorPair,
    tasks: list[Task],
    info: DatasetInfo,
    workers: int,
    scheduler: str | None,
) -> DatasetInfo:
    todo = [task for task in tasks if not _is_made(folder, task, info)]
    if todo:
        info = replace(info, complete=False)
        write_info(folder, info)
        info = _make(folder, sensors, todo, info, workers, scheduler)
    info = replace(info, complete=True)
    write_info(folder, info)
    write_whole(folder / CARD, card(info).encode())
    return info


def _check_layout(cyskin: CySkin) -> None:
    """The first press would refuse such a layout too, but then the folder is there already."""
    layout, surface = cyskin.layout, cached_layer(cyskin.cover, cyskin.pitch_mm)
    reach_x, reach_y = surface.x_mm[-1], surface.y_mm[-1]
    if (np.abs(layout.x_mm) > reach_x).any() or (np.abs(layout.y_mm) > reach_y).any():
        raise T2TwinError(
            f"layout {layout.name} has taxels outside the cover, which reaches {reach_x:g} mm in x "
            f"and {reach_y:g} mm in y from its middle"
        )


def _tasks(
    folder: Path, scale: str, seed: int, cache: str | Path | None, shapes: tuple[str, ...]
) -> list[Task]:
    size = protocol.scale_of(scale)
    kept = catalogue.kept_in(cache)
    return [
        Task(
            shape=name,
            split=catalogue.split(name),
            indices=tuple(protocol.indices(name, size)),
            seed=seed,
            folder=str(folder),
            cache=None if kept is None else str(kept.absolute()),
        )
        for name in shapes
    ]


def _begin(folder: Path, wanted: DatasetInfo) -> DatasetInfo:
    """The info to go on from: what stands in the folder if it is of the same making."""
    if (folder / INFO).exists():
        there = read_info(folder)
        _check_same_making(folder, there, wanted)
        _sweep(folder)
        return there
    if not is_empty(folder):
        raise T2TwinError(f"{folder} is not empty and holds no dataset; choose another folder")
    _sweep(folder)
    write_info(folder, wanted)
    return wanted


def _check_same_making(folder: Path, there: DatasetInfo, wanted: DatasetInfo) -> None:
    for name in ("scale", "seed", *(field.name for field in fields(DatasetInfo))):
        if name not in STATE and getattr(there, name) != getattr(wanted, name):
            raise T2TwinError(
                f"{folder} holds a dataset made with {MADE_WITH.get(name, f'another {name}')}; "
                "choose another folder, or remove that one"
            )


def _left_overs(folder: Path) -> list[Path]:
    """What a killed run or worker was writing."""
    places = (folder, *(folder / split for split in SPLITS))
    return [path for place in places for path in place.glob(LEFT_OVERS)]


def _sweep(folder: Path) -> None:
    """Remove what a killed run or worker was writing; what others keep in the folder stays."""
    for left_over in _left_overs(folder):
        left_over.unlink(missing_ok=True)


def _is_made(folder: Path, task: Task, info: DatasetInfo) -> bool:
    path = folder / task.path
    if task.path not in info.shards or not path.is_file():
        return False
    return sha256_of(path) == info.shards[task.path].sha256


def _make(
    folder: Path,
    sensors: SensorPair,
    todo: list[Task],
    info: DatasetInfo,
    workers: int,
    scheduler: str | None,
) -> DatasetInfo:
    """Make the shards, each entered into info.json as it is done. Returns the info with all."""
    workers = min(workers, len(todo))
    pairs = sum(len(task.indices) for task in todo)
    start, watch, peaks = time.monotonic(), Stopwatch(), {}
    with Progress(total=pairs, unit="pair", desc="simdata") as bar:
        if scheduler is None:
            shapes = sum(not catalogue.is_kept(task.shape, task.cache) for task in todo)
            seconds = (pairs * SECONDS_PER_PAIR + shapes * SECONDS_PER_SHAPE) / workers
            minutes = seconds / 60
            bar.write(f"{pairs} pairs to make with {workers} workers: about {minutes:.1f} minutes")
            results = pool.run(sensors, todo, workers, bar.update)
        else:
            from t2twin.sim.dataset import cluster

            bar.write(f"{pairs} pairs to make on the cluster at {scheduler}")
            results = cluster.run(sensors, todo, scheduler, info.versions, bar.update)
        with closing(results):  # a stop while one is entered ends the workers here, not later
            for task, made in results:
                shard = Shard(made.sha256, len(task.indices))
                info = replace(info, shards=info.shards | {task.path: shard})
                write_info(folder, info)
                watch.add(made.watch)
                peaks[made.process] = made.peak_memory
    busy = len(peaks)
    peaks[process_name()] = peak_memory()
    record = RunTiming(
        ended=datetime.now(UTC).isoformat(timespec="seconds"),
        pairs=pairs,
        workers=busy,
        seconds=round(time.monotonic() - start, 2),
        stage_seconds={stage: round(value, 3) for stage, value in watch.seconds.items()},
        peak_memory_bytes=sum(peaks.values()),
    )
    print(in_words(record))
    _log(folder, record)
    return info


def _log(folder: Path, record: RunTiming) -> None:
    """Add a line to the dataset's log, which says how its runs went; no shard depends on it."""
    path = folder / LOG
    before = path.read_text() if path.is_file() else ""
    write_whole(path, (before + json.dumps(asdict(record)) + "\n").encode())
