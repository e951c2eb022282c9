"""Whether a dataset is whole: every shard's bytes, rows, pairing and pictures."""

from collections import Counter
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from t2twin.primitives_cad import catalogue
from t2twin.primitives_cad.errors import T2TwinError
from t2twin.primitives_cad.machine import cores
from t2twin.primitives_cad.progress import Progress
from t2twin.sim.dataset.info import DatasetInfo
from t2twin.sim.dataset.png import decode_png
from t2twin.sim.dataset.protocol import press_of
from t2twin.sim.dataset.store import (
    INFO,
    POSE,
    ROWS_AT_ONCE,
    SCHEMA,
    SPLITS,
    read_info,
    sha256_of,
    shard_path,
)

POSE_TOLERANCE = 1e-9
"""Largest difference of a pose from the protocol's, mm, rad and N: rounding alone."""


@dataclass(frozen=True)
class Fault:
    """What is wrong with a part of a dataset, in words; part: a file below its folder."""

    part: str
    reason: str

    def __str__(self) -> str:
        return f"{self.part}: {self.reason}"


def verify(folder: str | Path) -> list[Fault]:
    """Everything that is wrong with a dataset, nothing where it is whole.

    Checks each shard's sha256, columns and number of rows; that its presses are those of the
    protocol, each once and at its pose (of a user's own pairs, that no index comes twice); that
    pictures decode and counts lie between 0 and full scale. Raises T2TwinError where there is no
    dataset.
    """
    folder = Path(folder)
    info = read_info(folder)
    faults = list(_files(folder, info))
    named = {fault.part for fault in faults}
    shards = [path for path in sorted(info.shards) if path not in named]
    with ThreadPoolExecutor(cores()) as pool:
        checks = pool.map(lambda path: list(_shard(folder, path, info)), shards)
        for of_shard in Progress(checks, total=len(shards), desc="verify", unit="shard"):
            faults += of_shard
    return sorted(faults, key=lambda fault: fault.part)


def _files(folder: Path, info: DatasetInfo) -> Iterator[Fault]:
    """Shards that are missing, and those that nobody knows of."""
    wanted = {shard_path(catalogue.split(name), name) for name in _protocol(info)}
    for path in sorted(wanted | set(info.shards)):
        if path not in info.shards:
            yield Fault(path, "it is not made yet")
        elif not (folder / path).is_file():
            yield Fault(path, "it is missing")
    if not info.complete:
        yield Fault(INFO, "the dataset is unfinished")
    for split in SPLITS:
        for path in sorted((folder / split).glob("*.parquet")):
            name = f"{split}/{path.name}"
            if not path.name.startswith(".") and name not in wanted | set(info.shards):
                yield Fault(name, "no part of this dataset, but read with it; remove it")


def _protocol(info: DatasetInfo) -> dict[str, tuple[int, ...]]:
    """The presses of each shape that `t2twin simdata` was asked for; none of a user's own pairs."""
    return info.parameters.shapes if info.parameters else {}


def _shard(folder: Path, path: str, info: DatasetInfo) -> Iterator[Fault]:
    if sha256_of(folder / path) != info.shards[path].sha256:
        yield Fault(path, "its bytes are not those that were written (sha256)")
        return
    try:
        yield from _content(folder, path, info)
    except (pa.ArrowException, OSError):
        yield Fault(path, "it cannot be read as Parquet")


def _content(folder: Path, path: str, info: DatasetInfo) -> Iterator[Fault]:
    pairs = info.shards[path].pairs
    with pq.ParquetFile(folder / path) as file:
        if not file.schema_arrow.equals(SCHEMA):
            yield Fault(path, "its columns are not the dataset's")
            return
        if file.metadata.num_rows != pairs:
            yield Fault(path, f"it has {file.metadata.num_rows} rows instead of {pairs}")
        scalars = file.read([name for name in SCHEMA.names if name not in ("image", "taxels")])
        yield from (Fault(path, reason) for reason in _pairing(path, scalars, _protocol(info)))
        row = 0
        for batch in file.iter_batches(ROWS_AT_ONCE, columns=["image", "taxels"]):
            for image, counts in zip(*(column.to_pylist() for column in batch), strict=True):
                for reason in _sample(image, counts, info):
                    yield Fault(path, f"row {row}: {reason}")
                row += 1


def _pairing(path: str, rows: pa.Table, protocol: dict[str, tuple[int, ...]]) -> Iterator[str]:
    split = path.split("/")[0]
    if set(rows["split"].to_pylist()) - {split}:
        yield "it holds rows of another split"
    shapes = set(rows["shape"].to_pylist())
    if len(shapes) != 1 or shard_path(split, *shapes) != path:
        yield "it holds another shape than its name says"
        return
    shape, indices = shapes.pop(), rows["index"].to_pylist()
    if None in indices:
        yield "a press has no index"
        return
    twice = [index for index, times in Counter(indices).items() if times > 1]
    if twice:
        yield f"press {twice[0]} comes more than once"
    if not protocol:
        return
    if sorted(set(indices)) != list(protocol.get(shape, ())):
        yield "its presses are not the protocol's"
    if shape not in protocol:
        return
    wanted = [press_of(shape, catalogue.spacing_mm(shape), index) for index in indices]
    for name in POSE:
        off = np.abs(rows[name].to_numpy() - [getattr(press, name) for press in wanted])
        if not (off <= POSE_TOLERANCE).all():
            worst = int(np.argmax(~(off <= POSE_TOLERANCE)))
            yield f"row {worst}: its {name} is not the protocol's for press {indices[worst]}"


def _sample(
    image: dict[str, Any] | None, counts: list[int | None] | None, info: DatasetInfo
) -> Iterator[str]:
    try:
        shape = decode_png(image["bytes"] if image else b"").shape
        if shape != (info.image_shape or shape):
            yield f"its picture is {list(shape)} instead of {list(info.image_shape or ())}"
    except T2TwinError:
        yield "its picture cannot be decoded"
    counts, taxels = counts or [], len(info.layout_x_mm)
    if len(counts) != taxels:
        yield f"it has {len(counts)} taxels instead of {taxels}"
    elif not all(count is not None and 0 <= count <= info.full_scale_counts for count in counts):
        yield f"it has a count outside of 0 to {info.full_scale_counts}"
