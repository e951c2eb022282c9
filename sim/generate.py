"""Making the dataset: one task a shape, on a pool of processes, continued where it stopped."""

import hashlib
import multiprocessing
import os
from collections.abc import Iterator
from concurrent.futures import FIRST_COMPLETED, ProcessPoolExecutor, wait
from dataclasses import asdict
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np
from tqdm import tqdm

from primitives_cad import catalogue
from primitives_cad.errors import T2TwinError
from sim import protocol
from sim.bench import Bench
from sim.card import card
from sim.cyskin import reading, taxels
from sim.dataset import (
    FORMAT,
    INFO,
    SPLITS,
    read_info,
    write_info,
    write_whole,
)
from sim.shard import Task, make_shard, start_worker, work

SECONDS_PER_PAIR = 0.09
"""Time of one pair on one core, for the estimate before the start, s."""

BAR_SECONDS = 0.5
"""How often the progress bar looks at the workers, s."""


def generate(
    folder: str | Path,
    scale: str,
    seed: int = 0,
    workers: int | None = None,
    bench: Bench | None = None,
    cache: str | Path | None = None,
    shapes: tuple[str, ...] = catalogue.NAMES,
) -> dict[str, Any]:
    """Make the dataset of a scale, or end one that was begun with the same parameters.

    Same seed and versions, same bytes, whatever the number of workers. Returns its info. Raises
    T2TwinError where the folder holds something else.
    """
    folder, bench = Path(folder), bench or Bench()
    if workers is not None and workers < 1:
        raise T2TwinError(f"{workers} workers cannot work; allowed are 1 and more")
    tasks = _tasks(folder, scale, seed, cache, shapes)
    info = _begin(folder, _describe(bench, scale, seed, tasks))
    todo = [task for task in tasks if not _is_made(folder, task, info)]
    if todo:
        _make(folder, bench, todo, info, workers or os.cpu_count() or 1)
    info["complete"] = True
    write_info(folder, info)
    write_whole(folder / "README.md", card(info).encode())
    return info


def _tasks(
    folder: Path, scale: str, seed: int, cache: str | Path | None, shapes: tuple[str, ...]
) -> list[Task]:
    size = protocol.scale_of(scale)
    return [
        Task(
            shape=name,
            split=catalogue.split(name),
            indices=tuple(protocol.indices(name, size)),
            seed=seed,
            folder=str(folder),
            cache=None if cache is None else str(cache),
        )
        for name in shapes
    ]


def _describe(bench: Bench, scale: str, seed: int, tasks: list[Task]) -> dict[str, Any]:
    layout = bench.cyskin.layout
    pairs = {s: sum(len(t.indices) for t in tasks if t.split == s) for s in SPLITS}
    return {
        "format": FORMAT,
        "scale": scale,
        "seed": seed,
        "pairs": pairs,
        "layout": layout.name,
        "layout_x_mm": layout.x_mm.tolist(),
        "layout_y_mm": layout.y_mm.tolist(),
        "full_scale_counts": taxels.FULL_SCALE_COUNTS,
        "image_shape": [320, 240, 3],
        "parameters": {
            "digit": _plain(asdict(bench.digit.gel))
            | {
                "pitch_mm": bench.digit.pitch_mm,
                "noise_grey": bench.digit.noise_grey,
                "calibration_sha256": bench.digit.calibration_sha256,
            },
            "cyskin": _plain(asdict(bench.cyskin.cover))
            | {
                "pitch_mm": bench.cyskin.pitch_mm,
                "gain_counts": taxels.GAIN_COUNTS,
                "pad_diameter_mm": layout.pad_diameter_mm.tolist(),
                "readings": reading.READINGS,
                "imperfections": _plain(asdict(bench.cyskin.flaws)),
            },
            "shapes": {t.shape: list(t.indices) for t in tasks},
        },
        "versions": {
            name: version(name)
            for name in ("t2twin", "mujoco", "numpy", "scipy", "cadquery", "pillow", "pyarrow")
        },
        "shards": {},
        "complete": False,
    }


def _plain(values: dict[str, Any]) -> dict[str, Any]:
    """JSON has no infinity: a flat side's radius becomes null."""
    return {
        key: None
        if isinstance(value, float) and not np.isfinite(value)
        else list(value)
        if isinstance(value, tuple)
        else value
        for key, value in values.items()
    }


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
        for left_over in folder.rglob(".*.part*"):
            left_over.unlink()  # what a killed run was writing
        return there
    if folder.exists() and any(folder.iterdir()):
        raise T2TwinError(f"{folder} is not empty and holds no dataset; choose another folder")
    folder.mkdir(parents=True, exist_ok=True)
    write_info(folder, wanted)
    return wanted


def _is_made(folder: Path, task: Task, info: dict[str, Any]) -> bool:
    path = folder / task.path
    if task.path not in info["shards"] or not path.is_file():
        return False
    return hashlib.sha256(path.read_bytes()).hexdigest() == info["shards"][task.path]["sha256"]


def _make(folder: Path, bench: Bench, todo: list[Task], info: dict[str, Any], workers: int) -> None:
    workers = min(workers, len(todo))
    pairs = sum(len(task.indices) for task in todo)
    print(
        f"{pairs} pairs to make with {workers} workers: "
        f"about {pairs * SECONDS_PER_PAIR / workers / 60:.1f} minutes"
    )
    with tqdm(total=pairs, unit="pair", desc="simdata") as bar:
        for task, digest in _run(bench, todo, workers, bar):
            info["shards"][task.path] = {"sha256": digest, "pairs": len(task.indices)}
            info["complete"] = False
            write_info(folder, info)


def _run(bench: Bench, todo: list[Task], workers: int, bar: tqdm) -> Iterator[tuple[Task, str]]:
    """Make the tasks' shards; yields each with its sha256 as it is done."""
    if workers == 1:
        for task in todo:
            yield task, make_shard(task, bench, bar.update)
        return
    context = multiprocessing.get_context("spawn")
    made = context.Value("i", 0)
    with ProcessPoolExecutor(
        workers, mp_context=context, initializer=start_worker, initargs=(bench, made)
    ) as pool:
        # The largest first, so that no long shard is left alone at the end.
        order = sorted(todo, key=lambda task: -len(task.indices))
        tasks = {pool.submit(work, task): task for task in order}
        waiting = set(tasks)
        try:
            while waiting:
                done, waiting = wait(waiting, timeout=BAR_SECONDS, return_when=FIRST_COMPLETED)
                bar.update(made.value - bar.n)
                for future in done:
                    yield tasks[future], future.result()
        except BaseException:
            pool.shutdown(wait=False, cancel_futures=True)
            raise
