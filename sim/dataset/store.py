"""Reads and writes a paired dataset.

    DIR/info.json                    recipe, parameters, a sha256 per shard
    DIR/README.md                    the dataset card, with the header of the Hugging Face hub
    DIR/croissant.json               the same for programs: columns, splits, a sha256 per shard
    DIR/log.jsonl                    time and memory of each run of `t2twin simdata`
    DIR/shards.jsonl, DIR/groups/    of an unfinished dataset: shards that info.json does not
                                     contain yet, and groups of rows of unfinished shards
    DIR/cache/                       decoded images of trainings; not part of the dataset
    DIR/{train,val,test}/SHAPE.parquet, or part-PART-NUMBER.parquet of sampled presses

A shard is written to a temporary name and renamed, so it is complete or absent. Its columns and
counts are checked when it is read, and its sha256 when a process first reads it: 2 s per GB on one
core, so 3 s for the scale paper.
"""

import hashlib
import json
import os
from codecs import BOM_UTF8
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from io import BufferedRandom
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from t2twin.core.cached_files import read_checked, write_checked
from t2twin.core.errors import T2TwinError
from t2twin.core.files import atomic_write, read_file, write_error
from t2twin.core.records import convert, decode_json
from t2twin.sim.dataset.columns import (
    BACKGROUND,
    CONTACT_MAPS,
    COUNTS,
    DENSE_COUNTS,
    IMAGE_TYPE,
    TRACTIONS,
    column,
    schema_of,
)
from t2twin.sim.dataset.format_1 import COLUMNS, converted
from t2twin.sim.dataset.info import FORMAT, SPLITS, DatasetInfo, Shard
from t2twin.sim.sensors.defaults import ROLES

INFO, LOG = "info.json", "log.jsonl"

MADE, GROUPS = "shards.jsonl", "groups"
"""File with a line for each new shard, and folder with the rows of unfinished ones."""

BATCH_ROWS = 128
"""Rows of a row group, some 9 MB: the memory of a shard that is being written."""

MAX_DICTIONARY_BYTES = 32_000_000
"""Largest dictionary of background frames in a row group: at most one frame per row."""

_intact: set[tuple[Path, int, int, str]] = set()
"""Shards whose sha256 this process has compared: path, size, time of change, sha256."""

REQUIRED = ("shape", "family", "split", "index", *(column(role, COUNTS) for role in ROLES))
"""Columns with a value in every row; imported pairs may have no value in the others."""


def write_shard(path: Path, rows: Iterable[dict[str, Any]], schema: pa.Schema) -> str:
    """Write rows as one shard, as they come; returns its sha256.

    schema: from schema_of. Raises T2TwinError where the shard cannot be written; then there is
    none.
    """
    with row_writer(path, schema, _repeated(schema)) as write:
        for each in rows:
            write(each)
    return sha256_of(path)


def write_tables(path: Path, tables: Iterable[pa.Table], schema: pa.Schema) -> str:
    """Write tables as one shard, as they come; the bytes are those of write_shard."""
    with _group_writer(path, schema, _repeated(schema)) as write:
        rest = schema.empty_table()
        for each in tables:
            rest = pa.concat_tables([rest, each])
            while len(rest) >= BATCH_ROWS:
                write(rest.slice(0, BATCH_ROWS).combine_chunks())
                rest = rest.slice(BATCH_ROWS)
        if len(rest):
            write(rest.combine_chunks())
    return sha256_of(path)


def _repeated(schema: pa.Schema) -> list[str]:
    """Columns of repeated values. All rows of a unit have one background frame: a dictionary
    stores it once per group."""
    frames = [name for name in schema.names if name.endswith(f"_{BACKGROUND}")]
    return ["shape", "family", "split", *(f"{name}.bytes" for name in frames)]


@contextmanager
def row_writer(
    path: Path, schema: pa.Schema, repeated: list[str]
) -> Iterator[Callable[[dict[str, Any]], None]]:
    """A function that writes one row to a new Parquet file, which is complete after the block.

    repeated: paths of the columns of repeated values. Raises T2TwinError where the file cannot be
    written. After an error there is no new file.
    """
    group: list[dict[str, Any]] = []
    with _group_writer(path, schema, repeated) as write_group:

        def write(row: dict[str, Any]) -> None:
            group.append(row)
            if len(group) == BATCH_ROWS:
                flush()

        def flush() -> None:
            write_group(pa.Table.from_pylist(group, schema=schema))
            group.clear()

        yield write
        if group:
            flush()


@contextmanager
def _group_writer(
    path: Path, schema: pa.Schema, repeated: list[str]
) -> Iterator[Callable[[pa.Table], None]]:
    """As row_writer, for whole row groups."""
    with _durable(path) as file:
        # Images are compressed already; dictionaries are useful for repeated values only.
        writer = pq.ParquetWriter(
            file,
            schema,
            compression="zstd",
            use_dictionary=repeated,  # pyright: ignore[reportArgumentType]
            dictionary_pagesize_limit=(
                MAX_DICTIONARY_BYTES if any(name.endswith(".bytes") for name in repeated) else None
            ),
        )
        try:
            yield writer.write_table
            writer.close()
        except BaseException:
            writer.is_open = False  # its destructor would write to the closed file
            raise


def group_path(folder: str | Path, shard: str, start: int) -> Path:
    """The file of the rows of an unfinished shard from `start` on."""
    return Path(folder) / GROUPS / group_name(shard, start)


def group_name(shard: str, start: int) -> str:
    """Name of that file."""
    return f"{shard.removesuffix('.parquet').replace('/', '-')}-{start:06d}.arrow"


def write_group(path: Path, table: pa.Table) -> None:
    """Write the rows of a group. Raises T2TwinError where that fails."""
    sink = pa.BufferOutputStream()
    with pa.ipc.new_stream(sink, table.schema) as writer:
        writer.write_table(table)
    write_checked(path, sink.getvalue().to_pybytes())


def read_group(path: Path) -> pa.Table | None:
    """The rows of a group; None where the file is missing or damaged."""
    content = read_checked(path)
    return None if content is None else pa.ipc.open_stream(content).read_all()


def sha256_of(path: Path) -> str:
    """A file's sha256 in hexadecimal digits."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


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
    """Write a dataset's info.json, without fields that are None, and remove shards.jsonl."""
    content = _given(msgspec.to_builtins(info))
    content |= {role: _given(content[role]) for role in ROLES}
    text = json.dumps(content, indent=1, sort_keys=True, allow_nan=False)
    write_whole(folder / INFO, f"{text}\n".encode())
    (folder / MADE).unlink(missing_ok=True)


def add_shard(folder: Path, path: str, shard: Shard) -> None:
    """Enter a new shard of an unfinished dataset, at the same cost for any number of shards."""
    line = json.dumps({"path": path, **msgspec.to_builtins(shard)})
    try:
        with (folder / MADE).open("a") as file:
            file.write(f"{line}\n")
    except OSError as error:
        raise write_error(folder / MADE, error) from error


def _with_added(info: DatasetInfo, path: Path) -> DatasetInfo:
    """The info with the shards of shards.jsonl. A line that is not complete is ignored."""
    if not path.is_file():
        return info
    entries = [decode_json(line, _AddedShard, path) for line in read_file(path).split(b"\n")[:-1]]
    added = {each.path: Shard(each.sha256, each.pairs) for each in entries}
    try:
        return replace(info, shards=info.shards | added)
    except ValueError as error:
        raise T2TwinError(f"{path}: {error}") from None


def _given(content: dict[str, Any]) -> dict[str, Any]:
    return {key: value for key, value in content.items() if value is not None}


def read_info(folder: str | Path) -> DatasetInfo:
    """A dataset's info.json with the shards of shards.jsonl; one of format 1 with the names of
    format 2.

    Raises T2TwinError for a folder without a dataset, another format, and an invalid info.json.
    """
    path = Path(folder) / INFO
    if not path.is_file():
        raise T2TwinError(
            f"{folder} contains no dataset (no {INFO}); make one with "
            f"`t2twin simdata --out {folder}`"
        )
    content = read_file(path).removeprefix(BOM_UTF8)
    found = decode_json(content, _FormatNumber, path).format
    if found == FORMAT:
        return _with_added(decode_json(content, DatasetInfo, path), Path(folder) / MADE)
    if found == 1:
        return convert(converted(decode_json(content, dict[str, Any], path)), DatasetInfo, path)
    raise T2TwinError(
        f"{path} is of format {found}; this version of t2twin reads formats 1 and {FORMAT}"
    )


@dataclass(frozen=True)
class _AddedShard(Shard):
    """A line of shards.jsonl."""

    path: str


@dataclass(frozen=True)
class _FormatNumber:
    """The format number of info.json."""

    format: int


def split_shards(info: DatasetInfo, split: str) -> list[str]:
    """Paths of a split's shards below the dataset's folder, in the order of read_split's rows."""
    return sorted(path for path in info.shards if path.startswith(f"{split}/"))


def read_split(folder: str | Path, split: str, columns: list[str] | None = None) -> pa.Table:
    """All rows of a split, shards sorted by name. columns: default all.

    Raises T2TwinError for a missing or unfinished dataset, an unknown or empty split, and a damaged
    shard.
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
    missing = [path for path in shards if not (Path(folder) / path).is_file()]
    if missing:
        raise T2TwinError(f"the dataset in {folder} lacks {missing[0]}; {_repair(info)}")
    schema = schema_of(info.values, info.recipe)
    for path in shards:
        with _opened(folder, path) as file:
            stored = None if columns is None else [stored_name(each, info) for each in columns]
            table = file.read(columns=stored)
        if info.format == 1:
            names = {old: new for new, old in COLUMNS.items()}
            table = table.rename_columns([names.get(each, each) for each in table.column_names])
        try:
            check_table(table, columns or schema.names, schema, info.shards[path], info)
        except ValueError as error:
            raise T2TwinError(
                f"{Path(folder) / path} is damaged: {error}; `t2twin simdata --verify {folder}` "
                "lists all damage"
            ) from None
        _check_bytes(folder, path, info)
        yield table


def check_table(
    table: pa.Table, columns: list[str], schema: pa.Schema, shard: Shard, info: DatasetInfo
) -> None:
    """Raises ValueError with the reason for a damaged table of a shard.

    columns: those that were read. schema: the dataset's. shard, info: of the shard and the dataset.
    """
    for name in columns:
        if name not in table.column_names:
            raise ValueError(f"it lacks the column {name}")
        kind, expected = table.schema.field(name).type, schema.field(name).type
        if kind != expected:
            raise ValueError(f"its column {name} holds {kind} and must hold {expected}")
        if name in REQUIRED and table[name].null_count:
            raise ValueError(f"its column {name} has empty rows")
        if pa.types.is_floating(kind) and not np.isfinite(table[name].drop_null()).all():
            raise ValueError(f"its column {name} has values that are not finite")
    if table.num_rows != shard.pairs:
        raise ValueError(f"it has {table.num_rows} rows instead of {shard.pairs}")
    for name, (size, largest) in list_limits(info).items():
        if name in columns:
            _check_lists(table[name].combine_chunks(), name, size, largest)


def list_limits(info: DatasetInfo) -> dict[str, tuple[int, float]]:
    """The size of each list in the sensors' columns, and its largest value."""
    limits: dict[str, tuple[int, float]] = {}
    for role, sensor in info.sensors.items():
        if sensor.full_scale_counts is not None:
            places, most = len(sensor.dense_x_mm or ()), sensor.full_scale_counts
            limits[column(role, COUNTS)] = len(sensor.x_mm), most
            limits[column(role, DENSE_COUNTS)] = places, most
            limits |= {column(role, name): (places, np.inf) for name in TRACTIONS}
        elif sensor.contact_grid is not None:
            rows, columns = sensor.contact_grid
            limits |= {column(role, name): (rows * columns, np.inf) for name in CONTACT_MAPS}
    return limits


def stored_name(name: str, info: DatasetInfo) -> str:
    """The name of a column in the dataset's files."""
    return COLUMNS.get(name, name) if info.format == 1 else name


def _check_lists(rows: pa.ListArray, name: str, size: int, largest: float) -> None:
    """Raises ValueError for lists of another size, and for values that are missing, not finite or
    too large."""
    lengths = set(rows.value_lengths().fill_null(0).to_pylist()) - {size}
    if lengths:
        raise ValueError(f"it has rows of {min(lengths)} {name} instead of {size}")
    values = rows.flatten()
    if values.null_count or not np.isfinite(values.to_numpy()).all():
        raise ValueError(f"its {name} has values that are missing or not finite")
    found = values.to_numpy().max(initial=0)
    if found > largest:
        raise ValueError(f"it has {found} in {name}, over the full scale of {largest}")


def lists(table: pa.Table, name: str) -> np.ndarray:
    """(n, size): a column of lists of a table of read_split, such as counts."""
    rows = table.column(name).combine_chunks()
    return rows.flatten().to_numpy().reshape(len(rows), -1)


def iter_images(folder: str | Path, shard: str, name: str) -> Iterator[bytes]:
    """A shard's images as PNG bytes, row by row, with little memory.

    name: of a column of images or background frames. Raises T2TwinError for a damaged shard.
    """
    info = read_info(folder)
    stored = stored_name(name, info)
    with _opened(folder, shard) as file:
        if stored not in file.schema_arrow.names or (
            file.schema_arrow.field(stored).type != IMAGE_TYPE
        ):
            raise T2TwinError(f"{Path(folder) / shard} is damaged: it contains no column of images")
        _check_bytes(folder, shard, info)
        for batch in file.iter_batches(BATCH_ROWS, columns=[stored]):
            for image in batch.column(0).to_pylist():
                yield image["bytes"] if image else b""


def _check_bytes(folder: str | Path, shard: str, info: DatasetInfo) -> None:
    """Raises T2TwinError for a readable shard that is not the one of info.json."""
    path, sha256 = (Path(folder) / shard).absolute(), info.shards[shard].sha256
    about = path.stat()
    key = (path, about.st_size, about.st_mtime_ns, sha256)
    if key not in _intact and sha256_of(path) != sha256:
        raise T2TwinError(
            f"{path} is not the shard that was written, by its SHA-256; `t2twin simdata --verify "
            f"{folder}` lists all damage, and {_repair(info)}"
        )
    _intact.add(key)


def _repair(info: DatasetInfo) -> str:
    """How to replace a shard."""
    if info.is_simulated:
        return "the same `t2twin simdata` makes it again"
    return "`t2twin import-pairs` into a new folder makes it again"


@contextmanager
def _opened(folder: str | Path, shard: str) -> Iterator[pq.ParquetFile]:
    path = Path(folder) / shard
    try:
        with pq.ParquetFile(path) as file:
            yield file
    except (pa.ArrowException, OSError) as error:
        raise T2TwinError(
            f"{path} cannot be read; `t2twin simdata --verify {folder}` lists all damage"
        ) from error
