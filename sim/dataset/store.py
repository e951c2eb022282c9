"""The paired dataset on disk: Parquet shards, info.json, and a dataset card.

    DIR/info.json                    what made it, its parameters, a sha256 per shard
    DIR/README.md                    the dataset card
    DIR/log.jsonl                    how long each run of `t2twin simdata` took, and for what
    DIR/cache/                       pictures that trainings have decoded; no part of the dataset
    DIR/{train,val,test}/SHAPE.parquet

A shard is written to a temporary name and renamed, so it is whole or absent.
"""

import hashlib
import json
import os
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from io import BufferedRandom
from itertools import islice
from pathlib import Path
from typing import TYPE_CHECKING, Any

import msgspec
import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from t2twin.primitives_cad.errors import T2TwinError
from t2twin.primitives_cad.writing import whole_file
from t2twin.sim.dataset.info import FORMAT, SPLITS, DatasetInfo
from t2twin.sim.dataset.shard_table import check_table
from t2twin.sim.typed_json import read_json

if TYPE_CHECKING:  # the sensors take a second to import, and reading a dataset needs none
    from t2twin.sim.sensors import Sample

INFO, CARD, LOG = "info.json", "README.md", "log.jsonl"

POSE = ("x_mm", "y_mm", "yaw_rad", "force_n")
"""Columns that say where and how hard was pressed: those of a PressCommand."""

IMAGE_TYPE = pa.struct([("bytes", pa.binary()), ("path", pa.string())])

SCHEMA = pa.schema(
    [
        ("shape", pa.string()),
        ("family", pa.string()),
        ("split", pa.string()),
        ("index", pa.int32()),
        ("x_mm", pa.float64()),
        ("y_mm", pa.float64()),
        ("yaw_rad", pa.float64()),
        ("force_n", pa.float64()),
        ("image", IMAGE_TYPE),
        ("taxels", pa.list_(pa.uint16())),
        ("digit_depth_mm", pa.float64()),
        ("digit_force_n", pa.float64()),
        ("digit_settled", pa.bool_()),
        ("digit_bottomed", pa.bool_()),
        ("cyskin_depth_mm", pa.float64()),
        ("cyskin_force_n", pa.float64()),
        ("cyskin_settled", pa.bool_()),
        ("cyskin_bottomed", pa.bool_()),
    ]
)

HUGGING_FACE_FEATURES = {
    "info": {
        "features": {
            "image": {"_type": "Image"},
            "taxels": {"feature": {"dtype": "uint16", "_type": "Value"}, "_type": "Sequence"},
            **{
                field.name: {"dtype": _dtype, "_type": "Value"}
                for field in SCHEMA
                if field.name not in ("image", "taxels")
                for _dtype in [str(field.type).replace("double", "float64")]
            },
        }
    }
}
"""Column types as Hugging Face's `datasets` reads them from a Parquet file's metadata.
Its versions 3 to 5 know "Sequence"; "List" is known from 4 on only."""

ROWS_AT_ONCE = 128
"""Rows written together, a row group: some 9 MB, what a shard in the making takes of memory."""


def row(sample: "Sample", picture: bytes, index: int, family: str, split: str) -> dict[str, Any]:
    """A sample as a row of the table. picture: its image as PNG bytes."""
    command = sample.command
    return {
        "shape": command.shape,
        "family": family,
        "split": split,
        "index": index,
        "x_mm": command.x_mm,
        "y_mm": command.y_mm,
        "yaw_rad": command.yaw_rad,
        "force_n": command.force_n,
        "image": {
            "bytes": picture,
            "path": f"{file_stem(command.shape)}-{index}.png",
        },
        "taxels": sample.counts,
        "digit_depth_mm": sample.digit.depth_mm,
        "digit_force_n": sample.digit.force_n,
        "digit_settled": sample.digit.settled,
        "digit_bottomed": sample.digit.bottomed,
        "cyskin_depth_mm": sample.cyskin.depth_mm,
        "cyskin_force_n": sample.cyskin.force_n,
        "cyskin_settled": sample.cyskin.settled,
        "cyskin_bottomed": sample.cyskin.bottomed,
    }


def file_stem(shape: str) -> str:
    return shape.replace("/", "-")


def shard_path(split: str, shape: str) -> str:
    """A shape's shard below the dataset's folder."""
    return f"{split}/{file_stem(shape)}.parquet"


def write_shard(path: Path, rows: Iterable[dict[str, Any]]) -> str:
    """Write rows as one shard, as they come; returns its sha256.

    Raises T2TwinError where it cannot be written; then there is no shard.
    """
    schema = SCHEMA.with_metadata({"huggingface": json.dumps(HUGGING_FACE_FEATURES)})
    waiting = iter(rows)
    with _durable(path) as file:
        # Pictures are compressed already; a dictionary pays for the names only.
        writer = pq.ParquetWriter(
            file,
            schema,
            compression="zstd",
            use_dictionary=["shape", "family", "split"],  # pyright: ignore[reportArgumentType]
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
    with whole_file(path) as temporary, temporary.open("w+b") as file:
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
    tables = []
    for path in shards:
        with _opened(folder, path) as file:
            table = file.read(columns=columns)
        try:
            check_table(table, columns or SCHEMA.names, SCHEMA, info.shards[path], info)
        except ValueError as error:
            raise T2TwinError(
                f"{Path(folder) / path} is damaged: {error}; `t2twin simdata --verify {folder}` "
                "names all that is"
            ) from None
        tables.append(table)
    return pa.concat_tables(tables)


def iter_images(folder: str | Path, shard: str) -> Iterator[bytes]:
    """A shard's pictures as PNG bytes, in the order of its rows; few are in memory at once.

    Raises T2TwinError where the shard cannot be read.
    """
    with _opened(folder, shard) as file:
        if "image" not in file.schema_arrow.names or (
            file.schema_arrow.field("image").type != IMAGE_TYPE
        ):
            raise T2TwinError(f"{Path(folder) / shard} is damaged: it holds no column of pictures")
        for batch in file.iter_batches(ROWS_AT_ONCE, columns=["image"]):
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
    column = table.column("taxels").combine_chunks()
    return column.flatten().to_numpy().reshape(len(column), -1).astype(np.float32)
