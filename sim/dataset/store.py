"""Reads, writes and verifies a paired dataset; docs/reference/file-formats.md lists its files.

A shard's sha256 is compared when a process first reads it: 3 s for the scale paper.
"""

import json
import os
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from functools import cache
from io import BufferedRandom
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from t2twin.core import arguments
from t2twin.core.errors import T2TwinError
from t2twin.core.files import atomic_write, sha256_of
from t2twin.core.machine import cores
from t2twin.core.progress import Progress
from t2twin.core.records import read_json
from t2twin.core.templates import render
from t2twin.sim.dataset.columns import (
    BACKGROUND,
    IMAGE,
    IMAGE_TYPE,
    Column,
    columns_of,
    schema_of,
    type_name,
)
from t2twin.sim.dataset.info import SPLITS, DatasetInfo, plain

INFO, LOG = "info.json", "log.jsonl"
CARD, CROISSANT = "README.md", "croissant.json"

SPLIT_NAMES = {
    "train": ("train", "cr:TrainingSplit"),
    "val": ("validation", "cr:ValidationSplit"),
    "test": ("test", "cr:TestSplit"),
}
"""Names of the splits on the Hugging Face hub, and their kinds in Croissant."""

SIZES = (
    (1e3, "n<1K"), (1e4, "1K<n<10K"), (1e5, "10K<n<100K"), (1e6, "100K<n<1M"), (1e7, "1M<n<10M")
)  # fmt: skip
"""Size categories of the hub, each with the number of rows that it ends at."""

CROISSANT_TYPES = {
    IMAGE: "sc:ImageObject",
    "string": "sc:Text",
    "bool": "sc:Boolean",
    "int16": "cr:Int16",
    "int32": "cr:Int32",
    "int64": "cr:Int64",
    "uint16": "cr:UInt16",
    "uint32": "cr:UInt32",
    "float32": "cr:Float32",
    "float64": "cr:Float64",
}

BATCH_ROWS = 128  # Rows of a row group, some 9 MB: the memory of a shard that is being written
# Largest dictionary of background frames in a row group: at most one frame per row
MAX_DICTIONARY_BYTES = 32_000_000
# Of a file of a size and a time of change, computed once in a process.
_sha256_at = cache(lambda path, size, changed_ns: sha256_of(path))


def write_shard(path: Path, rows: Iterable[dict[str, Any]], schema: pa.Schema) -> str:
    """Write rows as one shard, as they come; returns its sha256.

    Raises T2TwinError where it cannot be written or a value is not finite; then there is none.
    """
    # All rows of a unit have one background frame: a dictionary stores it once per row group.
    frames = [name for name in schema.names if name.endswith(f"_{BACKGROUND}")]
    repeated = ["shape", "family", "split", *(f"{name}.bytes" for name in frames)]
    left = iter(rows)
    with table_writer(path, schema, repeated) as write:
        while group := list(islice(left, BATCH_ROWS)):
            write(pa.Table.from_pylist(group, schema=schema))
    return sha256_of(path)


@contextmanager
def table_writer(
    path: Path, schema: pa.Schema, repeated: list[str]
) -> Iterator[Callable[[pa.Table], None]]:
    """A function that adds a table to a new Parquet file, which is complete after the block.

    repeated: paths of the columns of repeated values. Raises T2TwinError as `write_shard`.
    """
    has_frames = any(name.endswith(".bytes") for name in repeated)
    with _durable(path) as file:
        # Images are compressed already; dictionaries are useful for repeated values only.
        writer = pq.ParquetWriter(
            file,
            schema,
            compression="zstd",
            use_dictionary=repeated,  # pyright: ignore[reportArgumentType]
            dictionary_pagesize_limit=MAX_DICTIONARY_BYTES if has_frames else None,
        )

        def write(table: pa.Table) -> None:
            _check_finite(table, path)
            writer.write_table(table, BATCH_ROWS)

        try:
            yield write
            writer.close()
        except BaseException:
            writer.is_open = False  # its destructor would write to the closed file
            raise


def _check_finite(table: pa.Table, path: Path) -> None:
    """Raises T2TwinError for numbers that are not finite; an empty cell is allowed."""
    for name in table.column_names:
        values = table[name]
        while pa.types.is_list(values.type) or pa.types.is_fixed_size_list(values.type):
            values = pa.chunked_array([chunk.flatten() for chunk in values.chunks])
        if pa.types.is_floating(values.type) and not np.isfinite(values.drop_null()).all():
            raise T2TwinError(f"{path}: the column {name} has values that are not finite")


def write_whole(path: Path, content: bytes) -> None:
    """Write a file atomically; it is on the disk when this returns."""
    with _durable(path) as file:
        file.write(content)


@contextmanager
def _durable(path: Path) -> Iterator[BufferedRandom]:
    """A file to write, which is flushed to the disk before it is renamed to path."""
    with atomic_write(path) as temporary, temporary.open("w+b") as file:
        yield file
        file.flush()
        os.fsync(file.fileno())


def write_info(folder: Path, info: DatasetInfo) -> None:
    """Write a dataset's info.json, without fields that are None."""
    content = {key: value for key, value in plain(info).items() if value is not None}
    text = json.dumps(content, indent=1, sort_keys=True, allow_nan=False)
    write_whole(folder / INFO, f"{text}\n".encode())


def write_card(folder: Path, info: DatasetInfo) -> None:
    """Writes README.md, whose header is for Hugging Face's hub and `datasets`, and croissant.json,
    Croissant 1.1 (https://docs.mlcommons.org/croissant/docs/croissant-spec-1.1.html)."""
    sizes = {path: (folder / path).stat().st_size for path in sorted(info.shards)}
    values = {
        "info": info,
        "splits": {split: SPLIT_NAMES[split] for split in SPLITS if info.pairs[split]},
        "columns": [_described(each, info) for each in columns_of(info.values, info.recipe)],
        "size": next(name for end, name in SIZES if sum(info.pairs.values()) < end),
        "sizes": sizes,
        "types": CROISSANT_TYPES,
    }
    write_whole(folder / CARD, render("sim/dataset/card.md", **values).encode())
    write_whole(folder / CROISSANT, render("sim/dataset/croissant.json", **values).encode())


def _described(stored: Column, info: DatasetInfo) -> dict[str, Any]:
    """A column as the templates list it; value_type: of its elements."""
    kind, size = stored.type, stored.size
    if pa.types.is_list(kind):
        kind = kind.value_type
    return {
        "name": stored.full_name,
        "value_type": IMAGE if kind == IMAGE_TYPE else type_name(kind),
        "size": None if size is None else size(info.sensors[stored.role]),
        "sensor": info.sensors[stored.role].name if stored.role else None,
        "unit": stored.unit,
        "about": stored.about,
    }


def read_info(folder: str | Path) -> DatasetInfo:
    """A dataset's info.json.

    Raises T2TwinError for a folder without a dataset, another format, and an invalid info.json.
    """
    path = Path(folder) / INFO
    if not path.is_file():
        raise T2TwinError(
            f"{folder} contains no dataset (no {INFO}); make one with "
            f"`t2twin simdata --scale small --out {folder}`"
        )
    return read_json(path, DatasetInfo, "`t2twin simdata` or `t2twin import-pairs`")


def split_shards(info: DatasetInfo, split: str) -> list[str]:
    """Paths of a split's shards below the dataset's folder, in the order of read_split's rows."""
    return sorted(path for path in info.shards if path.startswith(f"{split}/"))


def read_split(folder: str | Path, split: str, columns: list[str] | None = None) -> pa.Table:
    """All rows of a split, shards sorted by name. columns: default all.

    Raises T2TwinError for an unfinished dataset, a split or column that it lacks, a damaged shard.
    """
    return pa.concat_tables(list(iter_shards(folder, split, columns)))


def iter_shards(
    folder: str | Path, split: str, columns: list[str] | None = None
) -> Iterator[pa.Table]:
    """The tables that read_split concatenates, shard by shard. Raises as read_split does."""
    if split not in SPLITS:
        raise T2TwinError(f"no split {split!r}; allowed are {', '.join(SPLITS)}")
    info = read_info(folder)
    if not info.complete:
        raise T2TwinError(
            f"the dataset in {folder} is unfinished; the same `t2twin simdata` command ends it"
        )
    shards = split_shards(info, split)
    if not shards:
        raise T2TwinError(
            f"the dataset in {folder} has no {split} pairs; its recipe or its table must have some"
        )
    for path in shards:
        with _opened(folder, path, info) as file:
            if lacking := {*(columns or ())} - {*file.schema_arrow.names}:
                raise T2TwinError(f"{folder} has no column {min(lacking)}")
            yield file.read(columns=columns)


def lists(table: pa.Table, name: str) -> np.ndarray:
    """(n, size): a column of lists of a table of read_split, such as counts."""
    rows = table.column(name).combine_chunks()
    return rows.flatten().to_numpy().reshape(len(rows), -1)


def iter_images(folder: str | Path, shard: str, name: str) -> Iterator[bytes]:
    """A shard's images as PNG bytes, row by row, with little memory.

    name: of a column of images or background frames. Raises T2TwinError for a damaged shard.
    """
    with _opened(folder, shard, read_info(folder)) as file:
        for batch in file.iter_batches(BATCH_ROWS, columns=[name]):
            for image in batch.column(0).to_pylist():
                yield image["bytes"] if image else b""


@contextmanager
def _opened(folder: str | Path, shard: str, info: DatasetInfo) -> Iterator[pq.ParquetFile]:
    """A shard. Raises T2TwinError where its bytes are not those of info.json."""
    path = (Path(folder) / shard).absolute()
    repair = "`t2twin import-pairs` into a new folder makes it again"
    if info.recipe:
        repair = "the same `t2twin simdata` makes it again"
    try:
        about = path.stat()
        found = _sha256_at(path, about.st_size, about.st_mtime_ns)
    except OSError as error:
        raise T2TwinError(f"{path} cannot be read ({error.strerror}); {repair}") from error
    if found != info.shards[shard].sha256:
        raise T2TwinError(
            f"{path} is not the shard that was written, by its SHA-256; `t2twin simdata --verify "
            f"{folder}` lists all damage, and {repair}"
        )
    with pq.ParquetFile(path) as file:
        yield file


def verify_dataset(folder: str | Path) -> list[tuple[str, str]]:
    """All faults of a dataset, by sha256, columns and rows of each shard; none if it is complete.

    A fault is a file below the folder, and what is wrong. LOG has durations only and is not
    checked. Raises T2TwinError without a dataset.
    """
    folder = arguments.path(folder, "folder")
    info = read_info(folder)
    faults = [] if info.complete else [(INFO, "the dataset is unfinished")]
    lacking = [name for name in (CARD, CROISSANT) if not (folder / name).is_file()]
    faults += [(name, "it is missing") for name in lacking if info.complete]
    for split, pairs in info.pairs.items():
        found = sum(info.shards[path].pairs for path in split_shards(info, split))
        if info.complete and found != pairs:
            faults.append((INFO, f"it lists shards of {found} {split} pairs, not of {pairs}"))
        present = {f"{split}/{path.name}" for path in (folder / split).glob("[!.]*.parquet")}
        if info.complete:
            faults += [
                (path, "it is not part of this dataset; remove it")
                for path in present - {*info.shards}
            ]
    with ThreadPoolExecutor(cores()) as pool:
        checked = pool.map(lambda path: (path, _fault_of(folder, path, info)), info.shards)
        bar = Progress(checked, total=len(info.shards), desc="verify", unit="shard")
        faults += [(path, reason) for path, reason in bar if reason]
    return sorted(faults, key=lambda fault: fault[0])


def _fault_of(folder: Path, path: str, info: DatasetInfo) -> str:
    """The first fault of a shard; empty without one."""
    shard, schema = info.shards[path], schema_of(info.values, info.recipe)
    if not (folder / path).is_file():
        return "it is missing"
    if sha256_of(folder / path) != shard.sha256:
        return "its bytes are not those that were written (sha256)"
    with pq.ParquetFile(folder / path) as file:
        if not file.schema_arrow.equals(schema):
            return "its columns are not the dataset's"
        if file.metadata.num_rows != shard.pairs:
            return f"it has {file.metadata.num_rows} rows instead of {shard.pairs}"
    return ""
