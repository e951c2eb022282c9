"""Makes a dataset shard by shard, here or on a cluster; a stopped one continues."""

import importlib
import json
import time
from collections import Counter
from contextlib import closing, suppress
from dataclasses import asdict, fields, replace
from datetime import UTC, datetime
from pathlib import Path

import numpy as np
from msgspec import structs

from t2twin.core import arguments
from t2twin.core.arguments import check_seed
from t2twin.core.errors import T2TwinError
from t2twin.core.files import TEMPORARY_NAMES, is_empty, locked
from t2twin.core.machine import cores
from t2twin.core.progress import Progress
from t2twin.primitives_cad import catalogue
from t2twin.sim.contact.layer import cached_layer
from t2twin.sim.dataset import pool
from t2twin.sim.dataset.build_info import describe
from t2twin.sim.dataset.card import card
from t2twin.sim.dataset.info import SPLITS, DatasetInfo, Shard
from t2twin.sim.dataset.shard import ShardContext
from t2twin.sim.dataset.store import CARD, INFO, LOG, read_info, sha256_of, write_info, write_whole
from t2twin.sim.dataset.timing import RunTiming, Stopwatch, in_words, peak_memory, process_name
from t2twin.sim.digit.optics import NOISE_GREY
from t2twin.sim.digit.rendered import FRAME_SECONDS
from t2twin.sim.sensors import CySkin, Digit, SensorPair
from t2twin.sim.world import protocol
from t2twin.sim.world.held_out import check_held_out
from t2twin.sim.world.plan import Batch, plan
from t2twin.sim.world.recipe import PAPER, RANDOM, Recipe, checked, load_recipe

SECONDS_PER_PAIR, SECONDS_PER_DRAWN_PAIR, SECONDS_PER_SHAPE = 0.015, 0.024, 0.75
"""Time of one pair of the protocol, of one that is drawn or in drawn light, and of preparing one
shape, on one core, for the estimate before the start, s (measured on a core of a server)."""

STATE = ("shards", "complete")
"""Fields of info.json that say how far a dataset is; all others say what it is made with."""

MADE_WITH = {
    "versions": "other versions of its libraries",
    "parameters": "other parameters",
    "pairs": "other pairs",
    "world": "another recipe",
    "files": "other solids",
    "shape_code": "another shape code (what makes the shapes has changed since)",
}
"""How a message names a field of info.json that differs; the rest are "another" and their name."""


def generate(
    folder: str | Path,
    scale: str | None = None,
    seed: int | None = None,
    workers: int | None = None,
    sensors: SensorPair | None = None,
    cache: str | Path | None = None,
    shapes: tuple[str, ...] = catalogue.NAMES,
    scheduler: str | None = None,
    world: str | Path | Recipe | None = None,
) -> DatasetInfo:
    """Make a dataset, or end one that was begun with the same parameters.

    scale: of the protocol, pressed into sensors; or world: a recipe, its name or its file, which
    says itself which sensors. seed: 0, or the recipe's, unless given. shapes: the only primitives
    and tools that are pressed. scheduler: address of a Dask scheduler whose workers make the
    shards; folder and cache then lie where all of them see them.
    Same seed and versions, same bytes, whatever the number of workers.
    Returns its info. Raises T2TwinError before anything is written for a number of workers, a seed,
    a layout, a scale, a world, a shape or a scheduler's address that cannot be used, and where the
    folder holds something else or another process is making it; later where there is no room, or a
    worker is lost.
    """
    folder = arguments.path(folder, "folder").absolute()
    pool.check_workers(workers)
    check_seed(0 if seed is None else seed)
    if world == PAPER and scale is None:
        scale, world = PAPER, None
    recipe, sensors = _recipe(scale, world, seed, sensors)
    _check_layout(sensors.cyskin)
    if scheduler is not None:
        arguments.text(scheduler, "scheduler")
        # Its import says where Dask is missing.
        importlib.import_module("t2twin.sim.dataset.cluster").check_address(scheduler)
    for name in arguments.texts(shapes, "shapes"):
        catalogue.split(name)  # raises for an unknown name
    batches = plan(recipe, shapes)
    check_held_out(recipe, cache)
    kept = catalogue.cache_folder(cache)
    making = ShardContext(
        recipe, sensors, str(folder), None if kept is None else str(kept.absolute())
    )
    wanted = describe(making, scale, batches)
    with locked(folder):
        return _make_whole(making, batches, wanted, workers or cores(), scheduler)


def _recipe(
    scale: str | None,
    world: str | Path | Recipe | None,
    seed: int | None,
    sensors: SensorPair | None,
) -> tuple[Recipe, SensorPair]:
    """The recipe of what is asked for, and its sensors."""
    if (scale is None) == (world is None):
        raise T2TwinError("a dataset is made of a scale of the protocol or of a world, one of both")
    if world is not None:
        recipe = checked(world) if isinstance(world, Recipe) else load_recipe(world)
        if seed is not None:
            recipe = structs.replace(recipe, seed=seed)
        return recipe, sensors_of(recipe)
    assert scale is not None
    protocol.scale_of(arguments.text(scale, "scale"))
    if sensors is not None:
        arguments.instance(sensors, "sensors", SensorPair)
    sensors, paper = sensors or SensorPair(), load_recipe(PAPER)
    return structs.replace(
        paper,
        seed=seed or 0,
        parts=tuple(structs.replace(part, scale=scale) for part in paper.parts),
        layout=sensors.cyskin.layout_source,
        imperfections=sensors.cyskin.imperfections,
        light=structs.replace(
            paper.light, calibration=sensors.digit.calibration, optics=sensors.digit.renderer
        ),
    ), sensors


def sensors_of(recipe: Recipe) -> SensorPair:
    """The sensors of a world; where its light is drawn, the DIGIT is but where the draws begin."""
    noise_grey = float(NOISE_GREY / np.sqrt(recipe.light.frames))
    return SensorPair(
        Digit(
            calibration=recipe.light.calibration,
            renderer=recipe.light.optics,
            noise_grey=noise_grey,
        ),
        CySkin(layout_source=recipe.layout, imperfections=recipe.imperfections),
    )


def _make_whole(
    making: ShardContext,
    batches: list[Batch],
    wanted: DatasetInfo,
    workers: int,
    scheduler: str | None,
) -> DatasetInfo:
    folder = Path(making.folder)
    begun = (folder / INFO).exists()
    info = _begin(folder, wanted)
    try:
        info = _go_on(making, batches, info, workers, scheduler)
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


def _go_on(
    making: ShardContext,
    batches: list[Batch],
    info: DatasetInfo,
    workers: int,
    scheduler: str | None,
) -> DatasetInfo:
    """Make the shards that are not there; returns the info of the whole dataset."""
    folder = Path(making.folder)
    todo = [batch for batch in batches if not _is_made(folder, batch, info)]
    if todo:
        info = replace(info, complete=False)
        write_info(folder, info)
        info = _make(making, todo, info, workers, scheduler)
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


def _begin(folder: Path, wanted: DatasetInfo) -> DatasetInfo:
    """The info to go on from: what stands in the folder if it is of the same making."""
    if (folder / INFO).exists():
        there = read_info(folder)
        if there.world is None and wanted.is_protocol:  # older versions did not name it
            there = replace(there, world=wanted.world)
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


def _sweep(folder: Path) -> None:
    """Remove what a killed run or worker was writing; what others keep in the folder stays."""
    for place in (folder, *(folder / split for split in SPLITS)):
        for left_over in place.glob(TEMPORARY_NAMES):
            left_over.unlink(missing_ok=True)


def _is_made(folder: Path, batch: Batch, info: DatasetInfo) -> bool:
    path = folder / batch.path
    if batch.path not in info.shards or not path.is_file():
        return False
    return sha256_of(path) == info.shards[batch.path].sha256


def _make(
    making: ShardContext, todo: list[Batch], info: DatasetInfo, workers: int, scheduler: str | None
) -> DatasetInfo:
    """Make the shards, each entered into info.json as it is done. Returns the info with all."""
    workers, folder = min(workers, len(todo)), Path(making.folder)
    pairs = sum(batch.pairs for batch in todo)
    start, watch, peaks, redrawn = time.monotonic(), Stopwatch(), {}, Counter()
    with Progress(total=pairs, unit="pair", desc="simdata") as bar:
        if scheduler is None:
            minutes = _seconds(todo, making, workers) / 60
            bar.write(f"{pairs} pairs to make with {workers} workers: about {minutes:.1f} minutes")
            if making.recipe.light.optics == "pyrender":
                bar.write(f"pyrender takes {FRAME_SECONDS:g} s of all cores for each picture")
            results = pool.run(making, todo, workers, bar.update)
        else:
            from t2twin.sim.dataset import cluster

            bar.write(f"{pairs} pairs to make on the cluster at {scheduler}")
            results = cluster.run(making, todo, scheduler, info.versions, bar.update)
        with closing(results):  # a stop while one is entered ends the workers here, not later
            for batch, made in results:
                shard = Shard(made.sha256, batch.pairs)
                info = replace(info, shards=info.shards | {batch.path: shard})
                write_info(folder, info)
                watch.add(made.watch)
                redrawn.update(made.redrawn)
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
        redrawn=dict(sorted(redrawn.items())),
    )
    print(in_words(record))
    _log(folder, record)
    return info


def _seconds(todo: list[Batch], making: ShardContext, workers: int) -> float:
    """About how long so many workers take, s."""
    named = [
        name
        for batch in todo
        if making.recipe.parts[batch.part].shapes != RANDOM
        for name in batch.shapes
    ]
    files = sum(name not in catalogue.NAMES for name in named)
    drawn_light = making.recipe.light.kind == "drawn"
    seconds = files * SECONDS_PER_SHAPE
    for batch in todo:
        drawn = drawn_light or batch.indices is None
        seconds += batch.pairs * (SECONDS_PER_DRAWN_PAIR if drawn else SECONDS_PER_PAIR)
    seconds /= workers
    if making.recipe.light.optics == "pyrender":
        seconds += sum(batch.pairs for batch in todo) * FRAME_SECONDS
    return seconds


def _log(folder: Path, record: RunTiming) -> None:
    """Add a line to the dataset's log, which says how its runs went; no shard depends on it."""
    path = folder / LOG
    before = path.read_text() if path.is_file() else ""
    write_whole(path, (before + json.dumps(asdict(record)) + "\n").encode())
