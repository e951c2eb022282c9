"""Verifies a dataset: each shard's bytes, rows, presses and images."""

from collections import Counter
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.parquet as pq

from t2twin.core import arguments
from t2twin.core.errors import T2TwinError
from t2twin.core.images import decode_png
from t2twin.core.machine import cores
from t2twin.core.progress import Progress
from t2twin.primitives_cad import catalogue
from t2twin.primitives_cad.random_shapes import seed_of
from t2twin.sim.contact.types import PressCommand
from t2twin.sim.dataset.columns import IMAGE_TYPE, PATH, pose_of, schema_of
from t2twin.sim.dataset.info import SPLITS, DatasetInfo
from t2twin.sim.dataset.store import (
    BATCH_ROWS,
    INFO,
    check_table,
    read_info,
    sha256_of,
    stored_name,
)
from t2twin.sim.sampling.plan import Batch, name_of, paths_of, plan, shard_path
from t2twin.sim.sampling.presses import MotionPath, path_attempts, planned_name
from t2twin.sim.sampling.recipe import RANDOM, Recipe

POSE_TOLERANCE = 1e-9
"""Largest difference between planned and written poses, mm, rad and N: rounding only."""


@dataclass(frozen=True)
class Fault:
    """A fault of a dataset. part: a file below its folder. reason: a message."""

    part: str
    reason: str

    def __str__(self) -> str:
        return f"{self.part}: {self.reason}"


def verify_dataset(folder: str | Path) -> list[Fault]:
    """All faults of a dataset, none if it is complete and undamaged.

    Checks each shard's sha256, columns and number of rows. Checks that it contains each press of
    the recipe once, at its pose; for imported pairs, that no index is repeated. Checks that images
    can be decoded and that counts are between 0 and full scale. Raises T2TwinError without a
    dataset.
    """
    folder = arguments.path(folder, "folder")
    info = read_info(folder)
    planned = planned_shards(info)
    faults = list(_files(folder, info, set(planned)))
    faulty = {fault.part for fault in faults}
    shards = [path for path in sorted(info.shards) if path not in faulty]
    with ThreadPoolExecutor(cores()) as pool:
        found = pool.map(lambda path: list(_shard(folder, path, info, planned)), shards)
        for shard_faults in Progress(found, total=len(shards), desc="verify", unit="shard"):
            faults += shard_faults
    return sorted(faults, key=lambda fault: fault.part)


def _files(folder: Path, info: DatasetInfo, planned: set[str]) -> Iterator[Fault]:
    """Missing shards, and files that are not part of the dataset."""
    for path in sorted(planned | set(info.shards)):
        if path not in info.shards:
            yield Fault(path, "it is not made yet")
        elif not (folder / path).is_file():
            yield Fault(path, "it is missing")
    if not info.complete:
        yield Fault(INFO, "the dataset is unfinished")
    for split in SPLITS:
        for path in sorted((folder / split).glob("*.parquet")):
            name = f"{split}/{path.name}"
            if not path.name.startswith(".") and name not in planned | set(info.shards):
                yield Fault(
                    name,
                    "it is not part of this dataset, but is read with it; remove it",
                )


def planned_shards(info: DatasetInfo) -> dict[str, Batch]:
    """The planned shards of a simulated dataset by path; none of an imported one.

    Of the primitives and tools, those to which info.json restricts it, and on a grid those whose
    presses it lists.
    """
    recipe, shapes = info.recipe, info.shapes
    if recipe is None or shapes is None:
        return {}
    names = info.only
    if names is None:
        on_grid = {part.shapes for part in recipe.parts if part.place == "grid"}
        names = tuple(
            name
            for name in catalogue.NAMES
            if name in shapes
            or ("primitives" if name in catalogue.PRIMITIVES else "tools") not in on_grid
        )
    return {batch.path: batch for batch in plan(recipe, names)}


def _shard(
    folder: Path, path: str, info: DatasetInfo, planned: dict[str, Batch]
) -> Iterator[Fault]:
    if sha256_of(folder / path) != info.shards[path].sha256:
        yield Fault(path, "its bytes are not those that were written (sha256)")
        return
    try:
        yield from _content(folder, path, info, planned)
    except (pa.ArrowException, OSError):
        yield Fault(path, "it cannot be read as Parquet")


def _content(
    folder: Path, path: str, info: DatasetInfo, planned: dict[str, Batch]
) -> Iterator[Fault]:
    schema = schema_of(info.values, info.recipe)
    stored = pa.schema([field.with_name(stored_name(field.name, info)) for field in schema])
    with pq.ParquetFile(folder / path) as file:
        found = {field.name: field.type for field in file.schema_arrow}
        if found != {field.name: field.type for field in stored}:
            yield Fault(path, "its columns are not the dataset's")
            return
        images = [field.name for field in schema if field.type == IMAGE_TYPE]
        others = [name for name in schema.names if name not in images]
        table = file.read([stored_name(name, info) for name in others]).rename_columns(others)
        try:
            check_table(table, others, schema, info.shards[path], info)
        except ValueError as error:
            yield Fault(path, str(error))
        else:
            yield from (Fault(path, reason) for reason in _pairing(path, table, info, planned))
        roles = {stored_name(name, info): name.split("_")[0] for name in images}
        row = 0
        for batch in file.iter_batches(BATCH_ROWS, columns=list(roles)):
            for values in batch.to_pylist():
                for name, image in values.items():
                    for reason in _image(image, info.sensors[roles[name]].image_shape):
                        yield Fault(path, f"row {row}: {reason}")
                row += 1


def _pairing(
    path: str, rows: pa.Table, info: DatasetInfo, planned: dict[str, Batch]
) -> Iterator[str]:
    """Faults of a shard's presses and their poses."""
    split = path.split("/")[0]
    if set(rows["split"].to_pylist()) - {split}:
        yield "it holds rows of another split"
    presses = list(zip(rows["shape"].to_pylist(), rows["index"].to_pylist(), strict=True))
    batch = planned.get(path)
    shapes = {shape for shape, _ in presses}
    has_own_shard = batch is None or batch.indices is not None
    if has_own_shard and (len(shapes) != 1 or shard_path(split, *shapes) != path):
        yield "its shape is not the one of its name"
        return
    repeated = [press for press, count in Counter(presses).items() if count > 1]
    if repeated:
        yield f"press {repeated[0][1]} of {repeated[0][0]} is repeated"
    if batch is None or info.recipe is None:
        if planned:
            yield "its presses are not the protocol's"
        return
    expected = _planned_presses(info.recipe, batch)
    if info.recipe.parts[batch.part].shapes == RANDOM:
        presses = [(_planned(shape), index) for shape, index in presses]
    if set(presses) != set(expected):
        yield "its presses are not the planned ones"
    pose = pose_of(info.recipe)
    names = [name for name in ("shape", *pose, PATH) if name in rows.column_names]
    for number, row in enumerate(rows.select(names).to_pylist()):
        shape, index = press = presses[number]
        if press not in expected:
            continue
        start, attempts = expected[press]
        if wrong := _wrong(row, pose, attempts()):
            yield f"row {number}: its {wrong} is not the planned one of press {index} of {shape}"
        if row.get(PATH, start) != start:
            yield f"row {number}: its path is not the planned one"


def _planned(shape: str) -> str:
    """The planned random shape of a pressed one; other names unchanged."""
    try:
        return shape if seed_of(shape) is None else planned_name(shape)
    except T2TwinError:
        return shape


def _wrong(
    row: dict[str, Any], pose: tuple[str, ...], attempts: Iterator[PressCommand]
) -> str | None:
    """A column of a row whose shape and pose are those of no attempt at its press, else None.

    pose: the columns of the pose.
    """
    wrong = "shape"
    for command in attempts:
        if command.shape == row["shape"]:
            near = [(row[name], getattr(command, name)) for name in pose]
            equal = [a is not None and abs(a - b) <= POSE_TOLERANCE for a, b in near]
            if all(equal):
                return None
            wrong = pose[equal.index(False)]
    return wrong


def _planned_presses(
    recipe: Recipe, batch: Batch
) -> dict[tuple[str, int], tuple[int, Callable[[], Iterator[PressCommand]]]]:
    """The touches of a shard by shape and index: the index of the path, and the commands of the
    attempts."""

    def commands(name: str, number: int, path: MotionPath, step: int) -> Iterator[PressCommand]:
        attempts = path_attempts(recipe, batch.part, name, number, path)
        return ((each.command, *each.further)[step] for each in attempts)

    return {
        (name, path.index + step): (path.index, partial(commands, name, number, path, step))
        for name, number in zip(map(name_of, batch.shapes), batch.numbers, strict=True)
        for path in paths_of(recipe, batch, number)
        for step in range(1 + path.steps)
    }


def _image(image: dict[str, Any] | None, shape: tuple[int, ...] | None) -> Iterator[str]:
    try:
        found = decode_png(image["bytes"] if image else b"").shape
        if found != shape:
            yield f"its image is {list(found)} instead of {list(shape or ())}"
    except T2TwinError:
        yield "its image cannot be decoded"
