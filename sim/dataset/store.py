"""The paired dataset on disk: Parquet shards, info.json, and a dataset card.

    DIR/info.json                    what made it, its parameters, a sha256 per shard
    DIR/README.md                    the dataset card
    DIR/log.jsonl                    how long each run of `t2twin simdata` took, and for what
    DIR/cache/                       pictures that trainings have decoded; no part of the dataset
    DIR/{train,val,test}/SHAPE.parquet, or part-PART-NUMBER.parquet of shapes without end

A shard is written to a temporary name and renamed, so it is whole or absent.

What a shard must hold, checked where it is read: whatever else is there was damaged or made by
something else.
"""

import hashlib
import json
import os
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from io import BufferedRandom
from itertools import islice
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from t2twin.core.errors import T2TwinError
from t2twin.core.files import atomic_write
from t2twin.core.records import read_json
from t2twin.sim.dataset.columns import FIELD, IMAGE_TYPE, SCHEMA, UNTOUCHED, hugging_face, schema_of
from t2twin.sim.dataset.info import FORMAT, SPLITS, DatasetInfo, Shard

INFO, CARD, LOG = "info.json", "README.md", "log.jsonl"

ROWS_AT_ONCE = 128
"""Rows written together, a row group: some 9 MB, what a shard in the making takes of memory."""

MAX_DICTIONARY_BYTES = 32_000_000
"""Room for the pictures of a row group's untouched DIGITs, one a row at most."""


def write_shard(path: Path, rows: Iterable[dict[str, Any]], schema: pa.Schema = SCHEMA) -> str:
    """Write rows as one shard, as they come; returns its sha256.

    Raises T2TwinError where it cannot be written; then there is no shard.
    """
    schema = schema.with_metadata({"huggingface": json.dumps(hugging_face(schema))})
    waiting = iter(rows)
    repeated, dictionary_bytes = ["shape", "family", "split"], None
    if UNTOUCHED in schema.names:
        # one picture serves all rows of a DIGIT: a dictionary holds it once a row group
        repeated.append(f"{UNTOUCHED}.bytes")
        dictionary_bytes = MAX_DICTIONARY_BYTES
    with _durable(path) as file:
        # Pictures are compressed already; a dictionary pays for the names only.
        writer = pq.ParquetWriter(
            file,
            schema,
            compression="zstd",
            use_dictionary=repeated,  # pyright: ignore[reportArgumentType]
            dictionary_pagesize_limit=dictionary_bytes,
        )
        try:
            while group := list(islice(waiting, ROWS_AT_ONCE)):
                writer.write_table(pa.Table.from_pylist(group, schema=schema))
            writer.close()
        except BaseException:
            writer.is_open = False  # or it would end the file when collected, after it is gone
            raise
        file.flush()
        file.seek(0)
        return hashlib.file_digest(file, "sha256").hexdigest()


def sha256_of(path: Path) -> str:
    """A file's sha256 in hexadecimal digits."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def write_whole(path: Path, content: bytes) -> None:
    """Write a file so that it is whole or absent, also after a power cut."""
    with _durable(path) as file:
        file.write(content)


@contextmanager
def _durable(path: Path) -> Iterator[BufferedRandom]:
    """A file to write that is on the disk before it gets its name."""
    with atomic_write(path) as temporary, temporary.open("w+b") as file:
        yield file
        file.flush()
        os.fsync(file.fileno())


def write_info(folder: Path, info: DatasetInfo) -> None:
    """Write a dataset's info.json; what is None and may be left out is left out."""
    content = {key: value for key, value in msgspec.to_builtins(info).items() if value is not None}
    text = json.dumps(content, indent=1, sort_keys=True, allow_nan=False)
    write_whole(folder / INFO, f"{text}\n".encode())


def read_info(folder: str | Path) -> DatasetInfo:
    """A dataset's info.json. The only place where it is read.

    Raises T2TwinError where there is no dataset, it is of another format, or a field of its
    info.json is missing or wrong.
    """
    path = Path(folder) / INFO
    if not path.is_file():
        raise T2TwinError(
            f"{folder} holds no dataset (no {INFO}); make one with `t2twin simdata --out {folder}`"
        )
    return read_json(path, DatasetInfo, FORMAT)


def split_shards(info: DatasetInfo, split: str) -> list[str]:
    """Paths of a split's shards below the dataset's folder, in the order of read_split's rows."""
    return sorted(path for path in info.shards if path.startswith(f"{split}/"))


def read_split(folder: str | Path, split: str, columns: list[str] | None = None) -> pa.Table:
    """All rows of a split as one table, shards in the order of their names.

    Raises T2TwinError where the dataset is missing or unfinished, the split is unknown or empty, or
    a shard cannot be read or is not as it was written (module shard_table).
    """
    if split not in SPLITS:
        raise T2TwinError(f"no split {split!r}; allowed are {', '.join(SPLITS)}")
    info = read_info(folder)
    if not info.complete:
        raise T2TwinError(
            f"the dataset in {folder} is unfinished; the same `t2twin simdata` command ends it"
        )
    shards = split_shards(info, split)
    missing = [path for path in shards if not (Path(folder) / path).is_file()]
    if missing or not shards:
        what = f"lacks {missing[0]}" if missing else f"has no {split} pairs"
        raise T2TwinError(
            f"the dataset in {folder} {what}; the same `t2twin simdata` makes it whole"
        )
    tables, schema = [], schema_of(info.world)
    for path in shards:
        with _opened(folder, path) as file:
            table = file.read(columns=columns)
        try:
            check_table(table, columns or schema.names, schema, info.shards[path], info)
        except ValueError as error:
            raise T2TwinError(
                f"{Path(folder) / path} is damaged: {error}; `t2twin simdata --verify {folder}` "
                "names all that is"
            ) from None
        tables.append(table)
    return pa.concat_tables(tables)


def iter_images(folder: str | Path, shard: str, column: str = "image") -> Iterator[bytes]:
    """A shard's pictures as PNG bytes, in the order of its rows; few are in memory at once.

    column: UNTOUCHED for those of the DIGITs untouched. Raises T2TwinError where the shard cannot
    be read.
    """
    with _opened(folder, shard) as file:
        if column not in file.schema_arrow.names or (
            file.schema_arrow.field(column).type != IMAGE_TYPE
        ):
            raise T2TwinError(f"{Path(folder) / shard} is damaged: it holds no column of pictures")
        for batch in file.iter_batches(ROWS_AT_ONCE, columns=[column]):
            for image in batch.column(0).to_pylist():
                yield image["bytes"] if image else b""


@contextmanager
def _opened(folder: str | Path, shard: str) -> Iterator[pq.ParquetFile]:
    path = Path(folder) / shard
    try:
        with pq.ParquetFile(path) as file:
            yield file
    except (pa.ArrowException, OSError) as error:
        raise T2TwinError(
            f"{path} cannot be read; `t2twin simdata --verify {folder}` says what is damaged"
        ) from error


def taxels(table: pa.Table) -> np.ndarray:
    """The taxel counts of a table that read_split gave, (n, taxels) float32."""
    return _lists(table, "taxels").astype(np.float32)


def field(table: pa.Table) -> np.ndarray:
    """The field's counts of a table that read_split gave, (n, places) uint16."""
    return _lists(table, FIELD)


def _lists(table: pa.Table, name: str) -> np.ndarray:
    column = table.column(name).combine_chunks()
    return column.flatten().to_numpy().reshape(len(column), -1)


ALWAYS = ("shape", "family", "split", "index", "taxels")
"""Columns that have a value in every row; imported pairs may know nothing of the rest."""


def check_table(
    table: pa.Table, columns: list[str], schema: pa.Schema, shard: Shard, info: DatasetInfo
) -> None:
    """Raises ValueError, with what is wrong, for a shard's table that is not as it was written.

    columns: those that were asked for. schema: the dataset's. shard, info: what info.json says of
    the shard and of the dataset.
    """
    for name in columns:
        if name not in table.column_names:
            raise ValueError(f"it lacks the column {name}")
        kind, wanted = table.schema.field(name).type, schema.field(name).type
        if kind != wanted:
            raise ValueError(f"its column {name} holds {kind} and must hold {wanted}")
        if name in ALWAYS and table[name].null_count:
            raise ValueError(f"its column {name} has empty rows")
        if pa.types.is_floating(kind) and not np.isfinite(table[name].drop_null()).all():
            raise ValueError(f"its column {name} has values that are not finite")
    if table.num_rows != shard.pairs:
        raise ValueError(f"it has {table.num_rows} rows instead of {shard.pairs}")
    for name, places in (("taxels", info.layout_x_mm), (FIELD, info.field_x_mm or ())):
        if name in columns:
            _check_counts(table[name], name, len(places), info.full_scale_counts)


def _check_counts(column: pa.ChunkedArray, name: str, places: int, full_scale: int) -> None:
    rows = column.combine_chunks()
    lengths = set(rows.value_lengths().to_pylist())
    if lengths - {places}:
        named = name if name == "taxels" else f"places of its {name}"
        raise ValueError(f"it has rows of {min(lengths - {places})} {named} instead of {places}")
    counts = rows.flatten()
    if counts.null_count:
        raise ValueError(f"it has {name} without a count")
    most = counts.to_numpy().max(initial=0)
    if most > full_scale:
        raise ValueError(f"it has a count of {most}, over the full scale of {full_scale}")
