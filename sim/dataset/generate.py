"""Makes a dataset, here or on a Dask cluster, and continues a stopped one."""

import json
import multiprocessing
import os
import pickle
import shutil
import signal
import threading
import time
from collections.abc import Generator, Iterator
from concurrent.futures import Executor, ProcessPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool
from contextlib import closing, contextmanager
from dataclasses import fields, replace
from datetime import UTC, datetime
from functools import cache, partial
from pathlib import Path
from types import ModuleType
from typing import TYPE_CHECKING

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from msgspec import structs
from msgspec.json import encode

from t2twin.core import arguments
from t2twin.core.errors import T2TwinError, counted, warn
from t2twin.core.files import SIGNALS, TEMPORARY_NAMES, is_empty, locked, temporary_folder
from t2twin.core.jit import cached_code
from t2twin.core.machine import cores
from t2twin.core.progress import Progress
from t2twin.primitives_cad import catalogue
from t2twin.sim.contact import solver_loops
from t2twin.sim.contact.elastomer import elastomer_json
from t2twin.sim.dataset.info import (
    IMAGE,
    SPLITS,
    ArrayInfo,
    CameraInfo,
    DatasetInfo,
    SensorInfo,
    Shard,
    versions,
)
from t2twin.sim.dataset.shard import Make, Tally, make_shard, make_shard_in_worker
from t2twin.sim.dataset.store import (
    INFO,
    LOG,
    read_info,
    sha256_of,
    write_card,
    write_info,
    write_whole,
)
from t2twin.sim.optical.gel_camera import GelCamera
from t2twin.sim.optical.pyrender_renderer import FRAME_SECONDS
from t2twin.sim.sampling import protocol
from t2twin.sim.sampling.plan import Batch, load_shape, plan, solids_in
from t2twin.sim.sampling.recipe import NAMED, PAPER, Recipe, checked, for_pair, load_recipe
from t2twin.sim.sensors.files import Sensor
from t2twin.sim.sensors.pair import SensorPair

if TYPE_CHECKING:
    import trimesh

STATE = ("shards", "complete")  # fields of info.json that are no parameters of the dataset
MAX_WORKERS = 1000  # processes (assumed: more than any machine has cores)
CONNECT_SECONDS = 20  # timeout of the connection to a Dask scheduler
SAME_SHARE = 0.02
"""Solids are the same if each invariant differs by less than this share. Assumed: twice the effect
of a coarse mesh. Of 200 random shapes and the 32 primitives the nearest differs by 0.6."""


def make_dataset(
    folder: str | Path, scale: str | None = None, seed: int | None = None,
    workers: int | None = None, sensors: SensorPair | None = None, cache: str | Path | None = None,
    shapes: tuple[str, ...] = catalogue.NAMES, scheduler: str | None = None,
    recipe: str | Path | Recipe | None = None,
) -> DatasetInfo:  # fmt: skip
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
    arguments.check_seed(0 if seed is None else seed)
    if recipe == PAPER and scale is None:
        scale, recipe = PAPER, None
    recipe, sensors = _recipe(scale, recipe, seed, sensors)
    recipe = for_pair(recipe, [sensor.spec.kind for sensor in sensors.by_name.values()])
    for sensor in sensors.by_name.values() if recipe.light.kind == "drawn" else ():
        if isinstance(sensor, GelCamera) and not sensor.is_center:
            sensor.spec.ranges(recipe.light.draw)  # raises for a camera that sees beyond the gel
    if scheduler is not None:
        arguments.text(scheduler, "scheduler")
        if workers is not None:
            raise T2TwinError("workers and a scheduler are both given; its workers make the shards")
        _distributed()
    for name in arguments.objects(shapes, "shapes", str):
        catalogue.split(name)  # raises for an unknown name
    batches = plan(recipe, shapes)
    only = None if set(shapes) == set(catalogue.NAMES) else tuple(shapes)
    if only is not None and not any({*batch.shapes} & {*only} for batch in batches):
        raise T2TwinError("the recipe presses none of `shapes`; name others, or leave them out")
    check_held_out(recipe, cache)
    kept = catalogue.cache_folder(cache)
    make = partial(make_shard, recipe, sensors, folder, kept and kept.absolute())
    info = build_info(recipe, sensors, scale, batches, only)
    with locked(folder):
        return _make_dataset(folder, make, batches, info, workers or cores(), scheduler)


def check_workers(workers: int | None) -> None:
    """Raises T2TwinError for a number of processes out of range; None is the number of cores."""
    if workers is not None:
        arguments.whole_number(workers, "workers", 1, MAX_WORKERS)


def build_info(
    recipe: Recipe,
    sensors: SensorPair,
    scale: str | None,
    batches: list[Batch],
    only: tuple[str, ...] | None = None,
) -> DatasetInfo:
    """The info of a dataset without shards. only: the primitives and tools, None for all."""
    of_files = [batch for batch in batches if recipe.parts[batch.part].shapes not in NAMED]
    solids = sorted({path for batch in of_files for path in batch.shapes})
    on_grid = {batch.shapes[0]: batch.indices for batch in batches if batch.indices is not None}
    optional = bool(recipe.dense_counts), bool(recipe.contact_maps)
    return DatasetInfo(
        complete=False,
        pairs={s: sum(b.pairs for b in batches if b.split == s) for s in SPLITS},
        source=sensor_info(sensors.source, *optional),
        target=sensor_info(sensors.target, *optional),
        versions=versions(),
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
    if recipe is not None:
        recipe = checked(recipe) if isinstance(recipe, Recipe) else load_recipe(recipe)
        if seed is not None:
            recipe = structs.replace(recipe, seed=seed)
    else:
        arguments.choice(scale, "scale", [*protocol.SCALES])
        paper = load_recipe(PAPER)
        parts = tuple(structs.replace(part, scale=scale) for part in paper.parts)
        recipe = structs.replace(paper, seed=seed or 0, parts=parts)
    light = recipe.light
    if sensors is not None:
        arguments.instance(sensors, "sensors", SensorPair)
        options = recipe.layout, recipe.imperfections, light.optics, light.frames
        if any(options) or light.renderer != "baked":
            raise T2TwinError("the recipe has options of its sensors; leave out these or `sensors`")
        names = {"source": sensors.source.name, "target": sensors.target.name}
        return structs.replace(recipe, **names), sensors
    renderer = None if light.renderer == "baked" else light.renderer
    sensors = SensorPair.of(
        recipe.source, recipe.target, layout=recipe.layout, frames=light.frames, renderer=renderer
    )
    if light.optics is not None:
        role = "source" if sensors.camera is sensors.source else "target"
        sensors = replace(sensors, **{role: sensors.camera.with_options({"optics": light.optics})})
    return recipe, sensors.with_imperfections(recipe.imperfections)


def check_held_out(recipe: Recipe, cache_dir: str | Path | None = None) -> None:
    """Prepares a user's solids, warns of their notes, and raises T2TwinError if one of them in
    training or validation is a whole tool, a test object. Solids are compared, not names.
    """
    notes: list[str] = []
    for part in recipe.parts:
        if part.shapes in NAMED:
            continue
        for path in Progress(solids_in(part.shapes), desc="held-out check", unit="solid"):
            shape = load_shape(part, path, cache_dir)
            notes += shape.notes
            if part.split == "test" and not part.val_share:
                continue
            if tool := tool_in(shape.mesh):
                raise T2TwinError(
                    f"{path} is the tool {tool}, which is a test object; remove it, or give its "
                    'part split = "test" and no val_share'
                )
    warn(*dict.fromkeys(notes))


_tool_invariants = cache(lambda tool: invariants(catalogue.tool_mesh(tool)))


def tool_in(mesh: "trimesh.Trimesh") -> str | None:
    """The name of the first tool that a body of a mesh equals, or None."""
    own = invariants(mesh)
    for tool in catalogue.TOOLS:
        known = _tool_invariants(tool)
        if (np.abs(own[:, None] / known - 1.0) < SAME_SHARE).all(axis=-1).any():
            return tool
    return None


def invariants(mesh: "trimesh.Trimesh") -> np.ndarray:
    """(bodies, 4): area^(3/2) / volume and the principal second moments / volume^(5/3), rising, of
    each body with a volume. A mesh ten times as coarse changes them by less than 1 %."""
    rows = []
    for body in mesh.split(only_watertight=False, repair=False):
        if volume := abs(body.volume):
            inertia = np.abs(body.principal_inertia_components)  # about the axes
            second = np.sort(inertia.sum() / 2.0 - inertia)  # along the axes
            rows.append([body.area**1.5 / volume, *second / volume ** (5 / 3)])
    return np.array(rows).reshape(-1, 4)


def _make_dataset(
    folder: Path, make: Make, batches: list[Batch], wanted: DatasetInfo, workers: int,
    scheduler: str | None,
) -> DatasetInfo:  # fmt: skip
    """Make the missing shards; returns the info of the complete dataset."""
    is_new = not (folder / INFO).exists()
    if is_new and not is_empty(folder):
        raise T2TwinError(f"{folder} is not empty and contains no dataset; choose another folder")
    present = wanted if is_new else read_info(folder)
    for name in ("scale", "seed", *(each.name for each in fields(DatasetInfo))):
        if name not in STATE and getattr(present, name) != getattr(wanted, name):
            raise T2TwinError(
                f"{folder} holds a dataset made with another {name.replace('_', ' ')}; choose "
                "another folder, or remove that one"
            )
    try:
        made = {b.path: shard for b in batches if (shard := _made(folder, b, present))}
        todo = [batch for batch in batches if batch.path not in made]
        if todo:
            write_info(folder, replace(present, complete=False))
            if wanted.recipe and wanted.recipe.light.renderer == "pyrender":
                print(f"pyrender takes {FRAME_SECONDS:g} s of all cores for each image")
            made |= _make_shards(folder, make, todo, workers, scheduler)
        info = replace(present, complete=True, shards=made)
        write_info(folder, info)
        write_card(folder, info)
        return info
    except BaseException:
        if is_new and not any(folder.glob("*/[!.]*.parquet")):
            (folder / INFO).unlink(missing_ok=True)
            for split in SPLITS:
                shutil.rmtree(folder / split, ignore_errors=True)
        raise
    finally:  # temporary files of killed workers, also of other machines
        for place in (folder, *(folder / split for split in SPLITS)):
            for left_over in place.glob(TEMPORARY_NAMES):
                left_over.unlink(missing_ok=True)


def _made(folder: Path, batch: Batch, info: DatasetInfo) -> Shard | None:
    """A shard that exists and is whole, also one of an interrupted run; None for another."""
    path, known = folder / batch.path, info.shards.get(batch.path)
    try:
        rows = pq.read_metadata(path).num_rows
    except (OSError, pa.ArrowException):
        return None
    shard = Shard(sha256_of(path), rows)
    return shard if rows == batch.pairs and known in (None, shard) else None


def _make_shards(
    folder: Path, make: Make, todo: list[Batch], workers: int, scheduler: str | None
) -> dict[str, Shard]:
    """Make shards, and log the time; returns them by path."""
    start, made, total = time.monotonic(), {}, Tally()
    # The longest first, so that none is left alone at the end: wide grids are of large shapes.
    grids = {b: catalogue.properties(b.shapes[0])["spacing_mm"] for b in todo if b.indices}
    todo = sorted(todo, key=lambda b: (-b.pairs, -np.prod(grids.get(b, 0.0))))
    pairs = sum(batch.pairs for batch in todo)
    results = _results(folder, make, todo, min(workers, len(todo)), scheduler)
    with (
        Progress(total=pairs, unit="pair", desc="simdata") as bar,
        closing(results),  # an interrupt ends the workers here, not later
    ):
        where = scheduler or counted(min(workers, len(todo)), "worker")
        bar.write(f"{counted(pairs, 'pair')} to make with {where}")
        for batch, (shard, tally) in results:
            made[batch.path] = shard
            total.add(tally)
            bar.update(batch.pairs)
    busy = len(total.peaks)
    total.add_peak_memory()
    _log(folder / LOG, total, pairs, busy, time.monotonic() - start)
    return made


def _log(file: Path, total: Tally, pairs: int, workers: int, seconds: float) -> None:
    """Print time and memory of a run, and add them to a log."""
    peak_bytes, rejected, notes = sum(total.peaks.values()), total.rejected, total.notes
    busy = total.seconds / (workers * seconds)
    print(
        f"{counted(pairs, 'pair')} in {seconds:.0f} s with {counted(workers, 'worker')}: "
        f"{pairs / seconds:.1f} pairs/s, workers busy {100 * busy:.0f} % of the time\n"
        f"processor time of a pair: {1e3 * total.seconds / pairs:.1f} ms"
    )
    for reason, count in sorted(rejected.items()):
        print(f"{counted(count, 'press', 'presses')} rejected and sampled again: {reason}")
    for note, count in sorted(notes.items()):
        print(f"{counted(count, 'pair')}: {note}")
    print(f"peak memory of all processes together: {peak_bytes / 2**30:.2f} GiB")
    line = {
        "ended": datetime.now(UTC).isoformat(timespec="seconds"),  # ISO 8601
        "pairs": pairs,
        "workers": workers,
        "seconds": round(seconds, 2),
        "processor_seconds": round(total.seconds, 3),
        "peak_memory_bytes": peak_bytes,
        "rejected": dict(sorted(rejected.items())),
        "notes": dict(sorted(notes.items())),
    }
    before = file.read_text() if file.is_file() else ""
    write_whole(file, (before + json.dumps(line) + "\n").encode())


def _results(
    folder: Path, make: Make, todo: list[Batch], workers: int, scheduler: str | None
) -> Generator[tuple[Batch, tuple[Shard, Tally]]]:
    """Each shard as it is finished: made in this process, in others, or on a cluster."""
    if scheduler is None and workers == 1:
        for batch in todo:
            yield batch, make(batch)
        return
    # All workers read the rest of the arguments from the folder that they write to.
    with (
        temporary_folder(folder, "context") as place,
        _processes(workers) if scheduler is None else _dask(scheduler) as pool,
    ):
        file = place / "context.pickle"
        file.write_bytes(pickle.dumps((make, versions())))
        if scheduler is None and cached_code(solver_loops.__file__) == []:
            with _processes(1) as first:  # it frees the 0.1 GiB of compiling when it ends
                batch = todo.pop()
                shard, tally = first.submit(make_shard_in_worker, str(file), batch).result()
            tally.peaks.clear()
            yield batch, (shard, tally)
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
            child.join()
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
    for number in SIGNALS:
        signal.signal(number, signal.SIG_IGN)
    parent = multiprocessing.parent_process()
    assert parent is not None

    def end_with_parent() -> None:
        parent.join()
        os._exit(1)

    threading.Thread(target=end_with_parent, daemon=True).start()


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
