"""Makes a dataset, here or on a Dask cluster, and continues a stopped one."""

import json
import multiprocessing
import os
import pickle
import signal
import threading
import time
from collections import Counter
from collections.abc import Generator, Iterator
from concurrent.futures import Executor, ProcessPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool
from contextlib import closing, contextmanager, suppress
from dataclasses import asdict, dataclass, field, fields, replace
from datetime import UTC, datetime
from pathlib import Path
from types import ModuleType

import pyarrow as pa
import pyarrow.parquet as pq
from msgspec import structs
from msgspec.json import encode

from t2twin.core import arguments
from t2twin.core.arguments import check_seed
from t2twin.core.errors import T2TwinError, counted
from t2twin.core.files import TEMPORARY_NAMES, is_empty, locked, temporary_folder
from t2twin.core.machine import cores
from t2twin.core.progress import Progress
from t2twin.primitives_cad import catalogue
from t2twin.sim.contact.elastomer import elastomer_json
from t2twin.sim.dataset.card import write_card
from t2twin.sim.dataset.info import (
    FORMAT,
    IMAGE,
    SPLITS,
    ArrayInfo,
    CameraInfo,
    DatasetInfo,
    SensorInfo,
    Shard,
    versions,
)
from t2twin.sim.dataset.shard import (
    STAGES,
    ShardContext,
    ShardResult,
    make_shard,
    make_shard_in_worker,
    peak_memory,
    process_name,
)
from t2twin.sim.dataset.store import INFO, LOG, read_info, sha256_of, write_info, write_whole
from t2twin.sim.optical.pyrender_renderer import FRAME_SECONDS
from t2twin.sim.sampling import protocol
from t2twin.sim.sampling.held_out import check_held_out
from t2twin.sim.sampling.plan import Batch, plan
from t2twin.sim.sampling.recipe import NAMED, PAPER, Recipe, checked, load_recipe
from t2twin.sim.sensors.files import Sensor
from t2twin.sim.sensors.pair import SensorPair

STATE = ("shards", "complete")  # fields of info.json that are no parameters of the dataset
MAX_WORKERS = 1000  # processes (assumed: more than any machine has cores)
CONNECT_SECONDS = 20  # timeout of the connection to a Dask scheduler


@dataclass(frozen=True)
class RunTiming:
    """Time and memory of one run of `t2twin simdata`: a line of the dataset's log.jsonl.

    ended: UTC, ISO 8601. stage_seconds: processor time of all pairs. peak_memory_bytes: the sum of
    all processes' peaks. rejected: attempts by reason. notes: pairs with each note of their touch.
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
    """Make a dataset, or continue one that was started with the same parameters; returns its info.

    scale: of the protocol, pressed into `sensors`. recipe: instead of a scale, a recipe, its name
    or its file, which names the sensors; `sensors` replace them. seed: default 0, or the recipe's.
    shapes: restricts the primitives and tools. scheduler: address of a Dask scheduler whose workers
    make the shards; they must share folder and cache. The same seed and versions give the same
    bytes with any number of workers. Raises T2TwinError for an invalid argument, for a folder with
    other content or another writer, if the disk is full, and if a worker is lost.
    """
    folder = arguments.path(folder, "folder").absolute()
    check_workers(workers)
    check_seed(0 if seed is None else seed)
    if recipe == PAPER and scale is None:
        scale, recipe = PAPER, None
    recipe, sensors = _recipe(scale, recipe, seed, sensors)
    if scheduler is not None:
        arguments.text(scheduler, "scheduler")
        _distributed()
    for name in arguments.texts(shapes, "shapes"):
        catalogue.split(name)  # raises for an unknown name
    batches = plan(recipe, shapes)
    check_held_out(recipe, cache)
    kept = catalogue.cache_folder(cache)
    context = ShardContext(
        recipe, sensors, str(folder), None if kept is None else str(kept.absolute()), versions()
    )
    only = None if set(shapes) == set(catalogue.NAMES) else tuple(shapes)
    info = build_info(context, scale, batches, only)
    with locked(folder):
        return _make_dataset(context, batches, info, workers or cores(), scheduler)


def check_workers(workers: int | None) -> None:
    """Raises T2TwinError for a number of processes out of range; None is the number of cores."""
    if workers is not None:
        arguments.whole_number(workers, "workers", 1, MAX_WORKERS)


def build_info(
    context: ShardContext,
    scale: str | None,
    batches: list[Batch],
    only: tuple[str, ...] | None = None,
) -> DatasetInfo:
    """The info of a dataset without shards. only: the primitives and tools, None for all."""
    recipe, sensors = context.recipe, context.sensors
    of_files = [batch for batch in batches if recipe.parts[batch.part].shapes not in NAMED]
    solids = sorted({path for batch in of_files for path in batch.shapes})
    on_grid = {batch.shapes[0]: batch.indices for batch in batches if batch.indices is not None}
    optional = recipe.dense_counts, bool(recipe.contact_maps)
    return DatasetInfo(
        format=FORMAT,
        complete=False,
        pairs={s: sum(b.pairs for b in batches if b.split == s) for s in SPLITS},
        source=sensor_info(sensors.source, *optional),
        target=sensor_info(sensors.target, *optional),
        versions=context.versions,
        shards={},
        scale=scale,
        seed=recipe.seed,
        recipe=recipe,
        shapes=on_grid,
        only=only,
        shape_code=catalogue.code_digest(),
        files={path: sha256_of(Path(path)) for path in solids} or None,
    )


def sensor_info(
    sensor: Sensor, dense_counts: bool = True, contact_maps: bool = False
) -> SensorInfo:
    """The record of a sensor in info.json, with what the pairs contain of it."""
    kind = CameraInfo if sensor.VALUE == IMAGE else ArrayInfo
    return kind(
        name=sensor.name,
        spec=json.loads(encode(sensor.spec)),
        elastomer=elastomer_json(sensor.elastomer),
        pitch_mm=sensor.pitch_mm,
        **sensor.info(dense_counts, contact_maps),
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
    present = wanted if is_new else read_info(folder)
    _check_same_parameters(folder, present, wanted)
    try:
        present_shards = {batch.path: _made(folder, batch, present) for batch in batches}
        made = {path: shard for path, shard in present_shards.items() if shard is not None}
        todo = [batch for batch in batches if batch.path not in made]
        if todo:
            write_info(folder, replace(present, complete=False))
            made |= _make_shards(context, todo, workers, scheduler)
        info = replace(present, complete=True, shards=made)
        write_info(folder, info)
        write_card(folder, info)
    except BaseException:
        _remove_temporary(folder)
        if is_new and not any(folder.glob("*/*.parquet")):
            (folder / INFO).unlink(missing_ok=True)
            for split in SPLITS:
                with suppress(OSError):
                    (folder / split).rmdir()
        raise
    _remove_temporary(folder)
    return info


def _check_same_parameters(folder: Path, present: DatasetInfo, wanted: DatasetInfo) -> None:
    for name in ("scale", "seed", *(each.name for each in fields(DatasetInfo))):
        if name not in STATE and getattr(present, name) != getattr(wanted, name):
            raise T2TwinError(
                f"{folder} holds a dataset made with another {name.replace('_', ' ')}; choose "
                "another folder, or remove that one"
            )


def _remove_temporary(folder: Path) -> None:
    """Remove the temporary files of killed workers, also of other machines."""
    for place in (folder, *(folder / split for split in SPLITS)):
        for left_over in place.glob(TEMPORARY_NAMES):
            left_over.unlink(missing_ok=True)


def _made(folder: Path, batch: Batch, info: DatasetInfo) -> Shard | None:
    """A shard that exists and is whole, also one of an interrupted run; None for another."""
    path, known = folder / batch.path, info.shards.get(batch.path)
    try:
        with pq.ParquetFile(path) as file:
            rows = file.metadata.num_rows
    except (OSError, pa.ArrowException):
        return None
    shard = Shard(sha256_of(path), rows)
    return shard if rows == batch.pairs and known in (None, shard) else None


def _make_shards(
    context: ShardContext, todo: list[Batch], workers: int, scheduler: str | None
) -> dict[str, Shard]:
    """Make shards, and log the time; returns them by path."""
    start, made, peaks = time.monotonic(), {}, {}
    seconds: dict[str, float] = dict.fromkeys(STAGES, 0.0)
    rejected, notes = Counter(), Counter()
    # The largest first, so that no long one is left alone at the end.
    todo = sorted(todo, key=lambda batch: -batch.pairs)
    pairs = sum(batch.pairs for batch in todo)
    results = _results(context, todo, min(workers, len(todo)), scheduler)
    with (
        Progress(total=pairs, unit="pair", desc="simdata") as bar,
        closing(results),  # an interrupt ends the workers here, not later
    ):
        where = scheduler or counted(min(workers, len(todo)), "worker")
        bar.write(f"{counted(pairs, 'pair')} to make with {where}")
        if context.recipe.light.renderer == "pyrender":
            bar.write(f"pyrender takes {FRAME_SECONDS:g} s of all cores for each image")
        for batch, result in results:
            made[batch.path] = result.shard
            for stage, value in result.seconds.items():
                seconds[stage] += value
            rejected.update(result.rejected)
            notes.update(result.notes)
            peaks[result.process] = result.peak_memory
            bar.update(batch.pairs)
    busy = len(peaks)
    peaks[process_name()] = peak_memory()
    timing = RunTiming(
        ended=datetime.now(UTC).isoformat(timespec="seconds"),
        pairs=pairs,
        workers=busy,
        seconds=round(time.monotonic() - start, 2),
        stage_seconds={stage: round(value, 3) for stage, value in seconds.items()},
        peak_memory_bytes=sum(peaks.values()),
        rejected=dict(sorted(rejected.items())),
        notes=dict(sorted(notes.items())),
    )
    print(summary(timing))
    log = Path(context.folder) / LOG
    before = log.read_text() if log.is_file() else ""
    write_whole(log, (before + json.dumps(asdict(timing)) + "\n").encode())
    return made


def _results(
    context: ShardContext, todo: list[Batch], workers: int, scheduler: str | None
) -> Generator[tuple[Batch, ShardResult]]:
    """Each shard as it is finished: made in this process, in others, or on a cluster."""
    if scheduler is None and workers == 1:
        for batch in todo:
            yield batch, make_shard(context, batch)
        return
    # All workers read the context from the folder that they write to.
    with (
        temporary_folder(Path(context.folder), "context") as place,
        _processes(workers) if scheduler is None else _dask(scheduler) as pool,
    ):
        file = place / "context.pickle"
        file.write_bytes(pickle.dumps(context))
        futures = {pool.submit(make_shard_in_worker, str(file), batch): batch for batch in todo}
        for future in as_completed(futures):
            yield futures.pop(future), future.result()


@contextmanager
def _processes(number: int) -> Iterator[Executor]:
    """Processes on this machine, killed after an error; T2TwinError where one of them ends."""
    others = {*multiprocessing.active_children()}
    spawn = multiprocessing.get_context("spawn")
    pool = ProcessPoolExecutor(number, mp_context=spawn, initializer=_start_worker)
    try:
        yield pool
    except BaseException as error:
        for child in {*multiprocessing.active_children()} - others:
            child.kill()
        if isinstance(error, BrokenProcessPool):
            raise T2TwinError(
                "a worker was killed, as the system does when memory runs out, or could not start; "
                "repeat the command with fewer --workers, and make the dataset of a script below "
                "`if __name__ == '__main__':`"
            ) from error
        raise
    finally:
        pool.shutdown(wait=True, cancel_futures=True)


def _start_worker() -> None:
    """Initialize a worker: signals are for its parent, which ends it, also when killed."""
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, signal.SIG_IGN)
    threading.Thread(target=_end_with_parent, daemon=True).start()


def _end_with_parent() -> None:
    parent = multiprocessing.parent_process()
    if parent is not None:
        parent.join()
        os._exit(1)


@contextmanager
def _dask(address: str) -> Iterator[Executor]:
    """The workers of a Dask cluster, which repeats the shards of a lost worker."""
    distributed = _distributed()
    try:
        client = distributed.Client(address, timeout=CONNECT_SECONDS, set_as_default=False)
    except (OSError, ValueError, TypeError) as error:
        raise T2TwinError(f"no Dask scheduler answers at {address} ({error})") from error
    with client:
        pool = client.get_executor(pure=False)
        try:
            yield pool
        except distributed.KilledWorker as error:
            raise T2TwinError(f"the workers that ran {error.task} died; see their logs") from error
        finally:
            pool.shutdown(wait=False)


def _distributed() -> ModuleType:
    """Dask's package. Raises T2TwinError where it is not installed."""
    try:
        import distributed
    except ImportError as error:
        raise T2TwinError(
            "--scheduler needs Dask; install it with: pip install 't2twin[cluster]'"
        ) from error
    return distributed


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
