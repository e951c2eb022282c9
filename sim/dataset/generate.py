"""Makes a dataset, here or on a cluster, and continues a stopped one."""

import importlib
import json
import shutil
import time
from collections import Counter
from collections.abc import Generator
from contextlib import closing, suppress
from dataclasses import asdict, dataclass, field, fields, replace
from datetime import UTC, datetime
from pathlib import Path

from msgspec import structs
from msgspec.json import encode

from t2twin.core import arguments
from t2twin.core.arguments import check_seed
from t2twin.core.errors import T2TwinError
from t2twin.core.files import TEMPORARY_NAMES, is_empty, locked
from t2twin.core.machine import cores
from t2twin.core.progress import Progress
from t2twin.core.words import counted
from t2twin.primitives_cad import catalogue
from t2twin.primitives_cad.shape_cache import code_digest
from t2twin.sim.contact.elastomer import elastomer_json
from t2twin.sim.dataset import pool
from t2twin.sim.dataset.card import write_card
from t2twin.sim.dataset.info import (
    FORMAT,
    SPLITS,
    DatasetInfo,
    SensorInfo,
    Shard,
    versions,
)
from t2twin.sim.dataset.schedule import Schedule
from t2twin.sim.dataset.shard import (
    STAGES,
    ShardContext,
    Stopwatch,
    Work,
    WorkResult,
    peak_memory,
    process_name,
)
from t2twin.sim.dataset.store import (
    GROUPS,
    INFO,
    LOG,
    add_shard,
    read_info,
    sha256_of,
    write_info,
    write_whole,
)
from t2twin.sim.optical.pyrender_renderer import FRAME_SECONDS
from t2twin.sim.sampling import protocol
from t2twin.sim.sampling.held_out import check_held_out
from t2twin.sim.sampling.plan import Batch, Group, groups_of, plan
from t2twin.sim.sampling.recipe import NAMED, PAPER, RANDOM, Recipe, checked, load_recipe
from t2twin.sim.sensors.files import Sensor
from t2twin.sim.sensors.pair import SensorPair

STATE = ("shards", "complete")
"""Fields of info.json that change while a dataset is made; the others are its parameters."""

MADE_WITH = {
    "versions": "other versions of its libraries",
    "source": "another source or options of it",
    "target": "another target or options of it",
    "shapes": "other presses on the grid",
    "only": "other shapes",
    "pairs": "other pairs",
    "recipe": "another recipe",
    "files": "other solids",
    "shape_code": "another shape code (the code that makes the shapes has changed)",
}
"""Text of a message for a field of info.json that differs; other fields are "another" and their
name."""


@dataclass(frozen=True)
class RunTiming:
    """Time and memory of one run of `t2twin simdata`: a line of the dataset's log.jsonl.

    ended: the time, UTC, ISO 8601. seconds: of the whole run. stage_seconds: processor time of all
    pairs by stage. peak_memory_bytes: the sum of all processes' peaks. rejected: attempts at
    presses that were rejected, by reason. notes: pairs with each note of their touch.
    """

    ended: str
    pairs: int
    workers: int
    seconds: float
    stage_seconds: dict[str, float]
    peak_memory_bytes: int
    rejected: dict[str, int] = field(default_factory=dict)
    notes: dict[str, int] = field(default_factory=dict)


def make_dataset(
    folder: str | Path,
    scale: str | None = None,
    seed: int | None = None,
    workers: int | None = None,
    sensors: SensorPair | None = None,
    cache: str | Path | None = None,
    shapes: tuple[str, ...] = catalogue.NAMES,
    scheduler: str | None = None,
    recipe: str | Path | Recipe | None = None,
) -> DatasetInfo:
    """Make a dataset, or continue one that was started with the same parameters.

    scale: of the protocol, pressed into `sensors`. recipe: instead of a scale, a recipe, its name
    or its file, which names the sensors; `sensors` replace them. seed: default 0, or the recipe's.
    shapes: restricts the primitives and tools. scheduler: address of a Dask scheduler whose workers
    make the shards; they must share folder and cache. The same seed and versions give the same
    bytes with any number of workers.

    Returns the dataset's info. Raises T2TwinError before anything is written for an invalid
    argument, for a folder with other content, and for one that another process is writing. Raises
    it later if the disk is full or a worker is lost.
    """
    folder = arguments.path(folder, "folder").absolute()
    pool.check_workers(workers)
    check_seed(0 if seed is None else seed)
    if recipe == PAPER and scale is None:
        scale, recipe = PAPER, None
    recipe, sensors = _recipe(scale, recipe, seed, sensors)
    if scheduler is not None:
        arguments.text(scheduler, "scheduler")
        # The import raises T2TwinError where Dask is missing.
        importlib.import_module("t2twin.sim.dataset.cluster").check_address(scheduler)
    for name in arguments.texts(shapes, "shapes"):
        catalogue.split(name)  # raises for an unknown name
    batches = plan(recipe, shapes)
    check_held_out(recipe, cache)
    kept = catalogue.cache_folder(cache)
    context = ShardContext(
        recipe, sensors, str(folder), None if kept is None else str(kept.absolute())
    )
    only = None if set(shapes) == set(catalogue.NAMES) else tuple(shapes)
    info = build_info(context, scale, batches, only)
    with locked(folder):
        return _make_dataset(context, batches, info, workers or cores(), scheduler)


def build_info(
    context: ShardContext,
    scale: str | None,
    batches: list[Batch],
    only: tuple[str, ...] | None = None,
) -> DatasetInfo:
    """The info of a dataset without shards. only: the primitives and tools of the batches, None for
    all."""
    recipe, sensors = context.recipe, context.sensors
    of_files = [batch for batch in batches if recipe.parts[batch.part].shapes not in NAMED]
    solids = sorted({path for batch in of_files for path in batch.shapes})
    on_grid = {batch.shapes[0]: batch.indices for batch in batches if batch.indices is not None}
    has_random = any(part.shapes == RANDOM for part in recipe.parts)
    return DatasetInfo(
        format=FORMAT,
        complete=False,
        pairs={s: sum(b.pairs for b in batches if b.split == s) for s in SPLITS},
        source=sensor_info(sensors.source, recipe),
        target=sensor_info(sensors.target, recipe),
        versions=versions(),
        shards={},
        scale=scale,
        seed=recipe.seed,
        recipe=recipe,
        shapes=on_grid,
        only=only,
        shape_code=code_digest(has_random),
        files={path: sha256_of(Path(path)) for path in solids} or None,
    )


def sensor_info(sensor: Sensor, recipe: Recipe) -> SensorInfo:
    """The record of a sensor in info.json."""
    return SensorInfo(
        name=sensor.name,
        value=sensor.VALUE,
        spec=json.loads(encode(sensor.spec)),
        elastomer=elastomer_json(sensor.elastomer),
        pitch_mm=sensor.pitch_mm,
        **sensor.info(recipe.dense_counts, bool(recipe.contact_maps)),
    )


def _recipe(
    scale: str | None,
    recipe: str | Path | Recipe | None,
    seed: int | None,
    sensors: SensorPair | None,
) -> tuple[Recipe, SensorPair]:
    """The recipe of a scale or of `recipe`, and its sensors."""
    if (scale is None) == (recipe is None):
        raise T2TwinError("expected a scale of the protocol or a recipe, and not both")
    if sensors is not None:
        arguments.instance(sensors, "sensors", SensorPair)
    if recipe is not None:
        recipe = checked(recipe) if isinstance(recipe, Recipe) else load_recipe(recipe)
        if seed is not None:
            recipe = structs.replace(recipe, seed=seed)
    else:
        assert scale is not None
        protocol.scale_of(arguments.text(scale, "scale"))
        paper = load_recipe(PAPER)
        parts = tuple(structs.replace(part, scale=scale) for part in paper.parts)
        recipe = structs.replace(paper, seed=seed or 0, parts=parts)
    if sensors is None:
        return recipe, sensors_of(recipe)
    names = {"source": sensors.source.name, "target": sensors.target.name}
    return structs.replace(recipe, **names), sensors


def sensors_of(recipe: Recipe) -> SensorPair:
    """The sensors of a recipe; the light of gel cameras is replaced where it samples the light."""
    pair, light = SensorPair.of(recipe.source, recipe.target), recipe.light
    pair = pair.with_options(layout=recipe.layout, frames=light.frames)
    if light.renderer != "baked":
        pair = pair.with_options(renderer=light.renderer)
    if light.optics is not None:
        pair = pair.with_optics(light.optics)
    return pair.with_imperfections(recipe.imperfections)


def _make_dataset(
    context: ShardContext,
    batches: list[Batch],
    wanted: DatasetInfo,
    workers: int,
    scheduler: str | None,
) -> DatasetInfo:
    """Make the missing shards; returns the info of the complete dataset."""
    folder = Path(context.folder)
    is_new = not (folder / INFO).exists()
    if is_new and not is_empty(folder):
        raise T2TwinError(f"{folder} is not empty and contains no dataset; choose another folder")
    info = wanted if is_new else read_info(folder)
    _check_same_parameters(folder, info, wanted)
    _sweep(folder)
    try:
        todo = [batch for batch in batches if not _is_made(folder, batch, info)]
        if todo:
            info = replace(info, complete=False)
            write_info(folder, info)
            info = _make_shards(context, todo, info, workers, scheduler)
        info = replace(info, complete=True)
        write_info(folder, info)
        write_card(folder, info)
        shutil.rmtree(folder / GROUPS, ignore_errors=True)
    except BaseException:
        if is_new:
            _remove_empty(folder)
        raise
    _sweep(folder)
    return info


def _remove_empty(folder: Path) -> None:
    """Remove a dataset without rows, so that the folder can be used by another command."""
    _sweep(folder)
    if not any(folder.glob("*/*.parquet")) and not any(folder.glob(f"{GROUPS}/*")):
        (folder / INFO).unlink(missing_ok=True)
        for place in (*SPLITS, GROUPS):
            with suppress(OSError):
                (folder / place).rmdir()


def _check_same_parameters(folder: Path, present: DatasetInfo, wanted: DatasetInfo) -> None:
    for name in ("scale", "seed", *(each.name for each in fields(DatasetInfo))):
        if name not in STATE and getattr(present, name) != getattr(wanted, name):
            raise T2TwinError(
                f"{folder} holds a dataset made with {MADE_WITH.get(name, f'another {name}')}; "
                "choose another folder, or remove that one"
            )


def _sweep(folder: Path) -> None:
    """Remove the temporary files of killed runs and workers, and no other files."""
    for place in (folder, *(folder / name for name in (*SPLITS, GROUPS))):
        for left_over in place.glob(TEMPORARY_NAMES):
            left_over.unlink(missing_ok=True)


def _is_made(folder: Path, batch: Batch, info: DatasetInfo) -> bool:
    path = folder / batch.path
    if batch.path not in info.shards or not path.is_file():
        return False
    return sha256_of(path) == info.shards[batch.path].sha256


def _make_shards(
    context: ShardContext,
    todo: list[Batch],
    info: DatasetInfo,
    workers: int,
    scheduler: str | None,
) -> DatasetInfo:
    """Make the shards and enter each into the dataset; returns the info with all of them."""
    folder = Path(context.folder)
    made = {path.name for path in (folder / GROUPS).glob("*")}
    schedule = Schedule([groups_of(context.recipe, batch) for batch in todo], made)
    start, new = time.monotonic(), {}
    watch, peaks, rejected, notes, pairs = Stopwatch(), {}, Counter(), Counter(), 0
    with Progress(total=schedule.pairs, unit="pair", desc="simdata") as bar:
        results = _results(context, schedule, workers, scheduler, info, bar)
        with closing(results):  # an interrupt ends the workers here, not later
            for work, result in results:
                if result.sha256 is not None and not isinstance(work, Group):
                    batch = work[0].batch
                    new[batch.path] = Shard(result.sha256, batch.pairs)
                    add_shard(folder, batch.path, new[batch.path])
                watch.add(result.watch)
                pairs += result.pairs
                rejected.update(result.rejected)
                notes.update(result.notes)
                peaks[result.process] = result.peak_memory
    busy = len(peaks)
    peaks[process_name()] = peak_memory()
    timing = RunTiming(
        ended=datetime.now(UTC).isoformat(timespec="seconds"),
        pairs=pairs,
        workers=busy,
        seconds=round(time.monotonic() - start, 2),
        stage_seconds={stage: round(value, 3) for stage, value in watch.seconds.items()},
        peak_memory_bytes=sum(peaks.values()),
        rejected=dict(sorted(rejected.items())),
        notes=dict(sorted(notes.items())),
    )
    print(summary(timing))
    _log(folder, timing)
    return replace(info, shards=info.shards | new)


def _results(
    context: ShardContext,
    schedule: Schedule,
    workers: int,
    scheduler: str | None,
    info: DatasetInfo,
    bar: Progress,
) -> Generator[tuple[Work, WorkResult]]:
    """Each finished work, here or on the cluster."""
    if scheduler is not None:
        from t2twin.sim.dataset import cluster

        bar.write(f"{counted(schedule.pairs, 'pair')} to make on the cluster at {scheduler}")
        return cluster.run(context, schedule, scheduler, info.versions, bar.update)
    workers = min(workers, schedule.length)
    bar.write(f"{counted(schedule.pairs, 'pair')} to make with {counted(workers, 'worker')}")
    if context.recipe.light.renderer == "pyrender":
        bar.write(f"pyrender takes {FRAME_SECONDS:g} s of all cores for each image")
    return pool.run(context, schedule, workers, bar.update)


def summary(run: RunTiming) -> str:
    """The text printed after a run: pairs per second, stages of a pair, memory."""
    stages = ", ".join(
        f"{stage} {1e3 * run.stage_seconds[stage] / max(run.pairs, 1):.1f}"
        for stage in STAGES
        if stage != "shape" and run.stage_seconds[stage]
    )
    busy = sum(run.stage_seconds.values()) / (run.workers * run.seconds)
    rejected = "".join(
        f"{counted(count, 'press', 'presses')} rejected and sampled again: {reason}\n"
        for reason, count in run.rejected.items()
    )
    notes = "".join(f"{counted(count, 'pair')}: {note}\n" for note, count in run.notes.items())
    return (
        f"{counted(run.pairs, 'pair')} in {run.seconds:.0f} s with "
        f"{counted(run.workers, 'worker')}: "
        f"{run.pairs / run.seconds:.1f} pairs/s, workers busy {100 * busy:.0f} % of the time\n"
        f"processor time of a pair, ms: {stages}; and {run.stage_seconds['shape']:.1f} s to load "
        f"the shapes\n{rejected}{notes}"
        f"peak memory of all processes together: {run.peak_memory_bytes / 2**30:.2f} GiB"
    )


def _log(folder: Path, timing: RunTiming) -> None:
    """Add a line to the dataset's log of runs, which no shard depends on."""
    path = folder / LOG
    before = path.read_text() if path.is_file() else ""
    write_whole(path, (before + json.dumps(asdict(timing)) + "\n").encode())
