"""The paired dataset on disk: Parquet shards, info.json, and a dataset card.

    DIR/info.json                    what made it, its parameters, a sha256 per shard
    DIR/README.md                    the dataset card
    DIR/{train,val,test}/SHAPE.parquet

A shard is written to a temporary name and renamed, so it is whole or absent.
"""

import hashlib
import io
import json
import os
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from PIL import Image

from primitives_cad.errors import T2TwinError
from primitives_cad.writing import whole_file
from sim.records import Press, Sample

SPLITS = ("train", "val", "test")
INFO = "info.json"
FORMAT = 1
"""Version of this layout of folders and columns."""

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
            "taxels": {"feature": {"dtype": "uint16", "_type": "Value"}, "_type": "List"},
            **{
                field.name: {"dtype": _dtype, "_type": "Value"}
                for field in SCHEMA
                if field.name not in ("image", "taxels")
                for _dtype in [str(field.type).replace("double", "float64")]
            },
        }
    }
}
"""Column types as Hugging Face's `datasets` reads them from a Parquet file's metadata."""

PNG_LEVEL = 1
"""zlib level of the pictures: at 6 they are 5 to 10 % smaller and take several times as long."""


def encode_png(image: np.ndarray) -> bytes:
    """PNG bytes of a (rows, columns, 3) uint8 picture."""
    buffer = io.BytesIO()
    Image.fromarray(image).save(buffer, format="PNG", compress_level=PNG_LEVEL)
    return buffer.getvalue()


def decode_png(content: bytes) -> np.ndarray:
    """The (rows, columns, 3) uint8 picture in PNG bytes."""
    return np.asarray(Image.open(io.BytesIO(content)).convert("RGB"))


def row(sample: Sample, index: int, family: str, split: str) -> dict[str, Any]:
    """A sample as a row of the table."""
    press: Press = sample.press
    return {
        "shape": press.shape,
        "family": family,
        "split": split,
        "index": index,
        "x_mm": press.x_mm,
        "y_mm": press.y_mm,
        "yaw_rad": press.yaw_rad,
        "force_n": press.force_n,
        "image": {
            "bytes": encode_png(sample.image),
            "path": f"{file_stem(press.shape)}-{index}.png",
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
    """Write rows as one shard; returns its sha256."""
    schema = SCHEMA.with_metadata({"huggingface": json.dumps(HUGGING_FACE_FEATURES)})
    buffer = pa.BufferOutputStream()
    # Pictures are compressed already; a dictionary pays for the names only.
    pq.write_table(
        pa.Table.from_pylist(list(rows), schema=schema),
        buffer,
        compression="zstd",
        use_dictionary=["shape", "family", "split"],  # pyright: ignore[reportArgumentType]
    )
    content = buffer.getvalue().to_pybytes()
    write_whole(path, content)
    return hashlib.sha256(content).hexdigest()


def write_whole(path: Path, content: bytes) -> None:
    """Write a file so that it is whole or absent, also after a power cut."""
    with whole_file(path) as temporary, temporary.open("wb") as file:
        file.write(content)
        file.flush()
        os.fsync(file.fileno())


def write_info(folder: Path, info: dict[str, Any]) -> None:
    write_whole(folder / INFO, (json.dumps(info, indent=1, sort_keys=True) + "\n").encode())


def read_info(folder: str | Path) -> dict[str, Any]:
    """A dataset's info.json. Raises T2TwinError where there is no dataset."""
    path = Path(folder) / INFO
    if not path.is_file():
        raise T2TwinError(
            f"{folder} holds no dataset (no {INFO}); make one with `t2twin simdata --out {folder}`"
        )
    try:
        info = json.loads(path.read_text())
        if info["format"] != FORMAT:
            raise T2TwinError(
                f"{folder} is a dataset of format {info['format']}; this version reads {FORMAT}"
            )
    except (ValueError, KeyError, TypeError) as error:
        raise T2TwinError(f"{path} is no dataset's {INFO}; make the dataset anew") from error
    return info


def read_split(folder: str | Path, split: str, columns: list[str] | None = None) -> pa.Table:
    """All rows of a split as one table, shards in the order of their names.

    Raises T2TwinError where the dataset is missing or unfinished, or the split is unknown or empty.
    """
    if split not in SPLITS:
        raise T2TwinError(f"no split {split!r}; allowed are {', '.join(SPLITS)}")
    info = read_info(folder)
    if not info["complete"]:
        raise T2TwinError(
            f"the dataset in {folder} is unfinished; the same `t2twin simdata` command ends it"
        )
    shards = sorted(path for path in info["shards"] if path.startswith(f"{split}/"))
    missing = [path for path in shards if not (Path(folder) / path).is_file()]
    if missing or not shards:
        what = f"lacks {missing[0]}" if missing else f"has no {split} pairs"
        raise T2TwinError(
            f"the dataset in {folder} {what}; the same `t2twin simdata` makes it whole"
        )
    return pa.concat_tables(
        [pq.ParquetFile(Path(folder) / path).read(columns=columns) for path in shards]
    )


def taxels(table: pa.Table) -> np.ndarray:
    """A table's taxel counts, (n, taxels) float32."""
    column = table.column("taxels").combine_chunks()
    return column.flatten().to_numpy().reshape(len(column), -1).astype(np.float32)
