"""Imports and checks a user's pairs.

The input is a table: a CSV file next to its images, or Parquet. A row has an image, one count per
taxel, and optional columns:

    image           CSV: the image's file, relative to the CSV; Parquet: the same, or the image's
                    bytes, alone or as {bytes, path}
    taxel_0, ...    CSV: the counts, in the layout's order
    taxels          Parquet: a list of counts, in the layout's order
    split           train, val or test; without it, pairs are split randomly
    shape, family   names; default "own"
    x_mm, y_mm, yaw_rad, force_n    the press

Other columns are ignored. An unknown name that is similar to one of these is an error. Numbers are
numbers, not text or booleans; only CSV has no other way to write them.
"""

import hashlib
import math
import os
import re
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from t2twin.core import arguments
from t2twin.core.arguments import check_seed
from t2twin.core.errors import T2TwinError
from t2twin.core.files import new_folder, open_regular, read_file
from t2twin.core.images import MAX_FILE_BYTES, decode_image, encode_png
from t2twin.core.records import check_names
from t2twin.sim.dataset.card import write_card
from t2twin.sim.dataset.columns import COUNTS, IMAGE, POSE, column, schema_of
from t2twin.sim.dataset.info import (
    FORMAT,
    MAX_COUNTS,
    SPLITS,
    DatasetInfo,
    SensorInfo,
    Shard,
    versions,
)
from t2twin.sim.dataset.store import write_info, write_shard
from t2twin.sim.sampling.plan import file_stem, shard_path
from t2twin.sim.sensors.pair import SensorPair
from t2twin.sim.tables import ERRORS, read_csv, row_labels
from t2twin.sim.taxels.layout import Layout

ORIGIN = "imported"
SHARES = (0.8, 0.1, 0.1)
"""Shares of train, val and test in a random split."""

FORMATS = ("PNG", "JPEG", "BMP", "TIFF", "WEBP")
"""Formats of images."""

LONGEST_NAME = 220
"""Longest name of a shape, bytes: it becomes a file name, of at most 255 bytes."""

VALUES = {"source": IMAGE, "target": COUNTS}
"""Values of the two sensors."""

COLUMNS = ["image", "taxels", "split", "shape", "family", "index", *POSE]
"""Columns of tables of pairs. All but the index are read."""

OWN = "own"
"""Shape and family of pairs without a name."""

LIMITS = {"yaw_rad": (-4 * math.pi, 4 * math.pi), "force_n": (0.0, 1000.0)}
"""Range of columns of the press, rad and N (assumed: larger angles are in degrees). The places have
none, since they may be those of a robot."""

NUMBER = re.compile(r"[-+]?(\d+[.,]?\d*|[.,]\d+)([eE][-+]?\d+)?", re.ASCII)
"""A number in a column of CSV that also has other text."""


SUFFIXES = (".csv", ".parquet")

TEXTS = ("image", "split", "shape", "family")
"""Columns of CSV that are text, also where they look like numbers."""

MAX_PARQUET_BYTES = 1_000_000_000
"""Largest Parquet file, also when decoded, bytes (assumed: 10,000 images of 100 kB)."""

BATCH_ROWS = 64
"""Rows that are decoded together (assumed: some MB)."""


@dataclass(frozen=True)
class Pair:
    """One row, its image not yet read. place: its file and line or row, for messages."""

    place: str
    image: str | bytes
    counts: tuple[int, ...]
    split: str
    shape: str
    family: str
    pose: tuple[float | None, ...]


def import_pairs(
    source: str | Path,
    folder: str | Path,
    layout: Layout,
    full_scale: int | None = None,
    seed: int = 0,
    sensors: SensorPair | None = None,
) -> DatasetInfo:
    """Write a user's pairs as a dataset, atomically; returns its info.

    source: a CSV or Parquet file, or a folder with one. layout: the user's taxels. full_scale:
    count at which they saturate; None for the target's. seed: of a random split. sensors: a gel
    camera with the view of the images, and an array like the user's; None for the default ones.
    Raises T2TwinError, with the row, for an image that is missing, unreadable, of another size or a
    duplicate, for a wrong number of counts, and for counts outside 0 to full_scale.
    """
    table_path = _find_table(arguments.path(source, "source"))
    folder = arguments.path(folder, "folder").absolute()
    arguments.instance(layout, "layout", Layout)
    sensors = (
        SensorPair() if sensors is None else arguments.instance(sensors, "sensors", SensorPair)
    )
    full_scale = sensors.array.full_scale if full_scale is None else full_scale
    if not 0 < arguments.whole_number(full_scale, "full_scale") <= MAX_COUNTS:
        raise T2TwinError(f"full scale is {full_scale} counts; it must lie in 1 to {MAX_COUNTS}")
    check_seed(seed)
    with new_folder(folder) as temporary:
        pairs = _with_splits(_read(table_path, layout, full_scale), seed)
        return _write(pairs, table_path.parent, temporary, layout, full_scale, sensors)


def _find_table(source: Path) -> Path:
    """The table: source, or the only one in that folder. Raises T2TwinError without one."""
    if source.is_dir():
        tables = [
            path
            for path in source.iterdir()
            if path.suffix.lower() in SUFFIXES and not path.name.startswith(".")
        ]
        if not tables:
            raise T2TwinError(
                f"{source} contains no CSV or Parquet file; expected a folder with the table of "
                "pairs and its images"
            )
        if len(tables) > 1:
            raise T2TwinError(
                f"{source} holds {len(tables)} CSV and Parquet files; name the one with the pairs"
            )
        source = tables[0]
    if not source.is_file() or source.suffix.lower() not in SUFFIXES:
        raise T2TwinError(
            f"{source} is not a table of pairs; expected a .csv or .parquet file, or its folder"
        )
    return source


def read_table(path: Path) -> tuple[pa.Table, list[str]]:
    """The table, and the place of each row for messages: "line 2" of CSV, "row 1" of Parquet.

    The separator of CSV is the one of comma, semicolon and tab that is most frequent in the first
    line. Raises T2TwinError for a file that cannot be read, is too large, or has no rows.
    """
    is_csv = path.suffix.lower() == ".csv"
    try:
        if is_csv:
            table, places = read_csv(read_file(path), TEXTS)
        else:
            table = _read_parquet(path)
            places = row_labels(table)
    except (*ERRORS, OSError) as error:
        # Messages of the Parquet reader are not for users.
        reason = f" ({error})" if is_csv else ""
        raise T2TwinError(f"{path} cannot be read as a table of pairs{reason}") from error
    if not len(table):
        raise T2TwinError(f"{path} contains no pairs")
    check_names(table.column_names, COLUMNS + _counts_of(table), path, others=True)
    return table, places


def _read_parquet(path: Path) -> pa.Table:
    """A Parquet file. Raises T2TwinError if its decoded rows are larger than MAX_PARQUET_BYTES."""
    with open_regular(path, MAX_PARQUET_BYTES) as stream, pq.ParquetFile(stream) as file:
        batches, size = [], 0
        for batch in file.iter_batches(BATCH_ROWS):
            size += batch.nbytes
            if size > MAX_PARQUET_BYTES:
                raise T2TwinError(
                    f"{path} holds more than {MAX_PARQUET_BYTES / 1e6:,.0f} MB of rows, the most "
                    "allowed; use a CSV file and separate files of images"
                )
            batches.append(batch)
        return pa.Table.from_batches(batches, file.schema_arrow)


def _read(path: Path, layout: Layout, full_scale: int) -> list[Pair]:
    """All rows, with checked counts."""
    table, places = read_table(path)
    if "image" not in table.column_names:
        names = ", ".join(table.column_names)
        raise T2TwinError(f"{path} has no column image; its columns are {names}")
    is_csv = path.suffix.lower() == ".csv"
    counts = _counts(table, places, path, layout, full_scale).tolist()
    columns = [n for n in ("image", "split", "shape", "family", *POSE) if n in table.column_names]
    pairs = []
    for place, row, own in zip(places, table.select(columns).to_pylist(), counts, strict=True):
        at = f"{path}, {place}"
        split, shape, family = (_name(row.get(n), at, n) for n in ("split", "shape", "family"))
        shape, image = shape or family or OWN, _image(row["image"], at)
        pose = tuple(_pose(row.get(name), at, name, is_csv) for name in POSE)
        pairs.append(Pair(at, image, tuple(own), split, shape, family or shape, pose))
    return pairs


def _counts(
    table: pa.Table, places: list[str], path: Path, layout: Layout, full_scale: int
) -> np.ndarray:
    """(rows, taxels) int64, rounded."""
    columns = _counts_of(table)
    expected = [f"taxel_{number}" for number in range(layout.size)]
    if "taxels" in table.column_names and columns:
        raise T2TwinError(f"{path} has both columns, taxels and {columns[0]}; remove one of them")
    if "taxels" in table.column_names:
        rows = table["taxels"].to_pylist()
    elif sorted(columns) == sorted(expected):
        rows = list(zip(*(table[name].to_pylist() for name in expected), strict=True))
    else:
        raise T2TwinError(
            f"{path} has {len(columns)} columns taxel_0, taxel_1 ... and no column taxels; layout "
            f"{layout.name} needs taxel_0 to {expected[-1]}"
        )
    is_csv = path.suffix.lower() == ".csv"
    for place, row in zip(places, rows, strict=True):
        if not isinstance(row, list | tuple) or len(row) != layout.size:
            size = len(row) if isinstance(row, list | tuple) else 0
            raise T2TwinError(
                f"{path}, {place}: {size} taxels instead of the {layout.size} of layout "
                f"{layout.name}"
            )
        for taxel, value in enumerate(row):
            if not 0 <= _number(value, is_csv) <= full_scale:
                name = f"taxel_{taxel}" if columns else f"taxels[{taxel}]"
                raise T2TwinError(
                    f"{path}, {place}: {name} is {_shown(value)}; expected a number "
                    f"from 0 to {full_scale}"
                )
    counts = np.array([[_number(value, is_csv) for value in row] for row in rows])
    if counts.max() <= 1.0 and (counts % 1.0).any():
        raise T2TwinError(
            f"{path}: all counts lie between 0 and 1; expected counts, which are rounded to whole "
            f"numbers, from 0 to the full scale of {full_scale}"
        )
    return np.rint(counts).astype(np.int64)


def _counts_of(table: pa.Table) -> list[str]:
    """Columns of single taxels, in the table's order."""
    return [name for name in table.column_names if re.fullmatch(r"taxel_\d+", name)]


def _number(value: Any, is_csv: bool) -> float:
    """A finite number, NaN for other values. A word in a CSV column makes all of it text."""
    if is_csv and isinstance(value, str) and NUMBER.fullmatch(value):
        value = float(value.replace(",", "."))
    if isinstance(value, bool) or not isinstance(value, int | float):
        return math.nan
    return float(value) if math.isfinite(value) else math.nan


def _name(value: Any, location: str, column: str) -> str:
    """A name, empty where there is none."""
    is_name = isinstance(value, str | int) and not isinstance(value, bool)
    text = "" if value is None else str(value)
    if not (is_name or value is None) or "\0" in text or len(os.fsencode(text)) > LONGEST_NAME:
        raise T2TwinError(
            f"{location}: {column} is {_shown(value)}; expected a name of at most "
            f"{LONGEST_NAME} bytes"
        )
    return text


def _image(value: Any, location: str) -> str | bytes:
    if isinstance(value, dict):
        value = value.get("bytes") or value.get("path")
    if not isinstance(value, str | bytes) or not value:
        raise T2TwinError(f"{location}: there is no image; image is a file's name or PNG")
    return value


def _pose(value: Any, location: str, name: str, is_csv: bool) -> float | None:
    if value is None:
        return None
    number, (low, high) = _number(value, is_csv), LIMITS.get(name, (-math.inf, math.inf))
    if not low <= number <= high:
        allowed = f"a number from {low:g} to {high:g}" if name in LIMITS else "a finite number"
        raise T2TwinError(
            f"{location}: {name} is {_shown(value)}; expected {allowed}, or nothing "
            "where it is not known"
        )
    return number


def _shown(value: Any) -> str:
    """A value for a message."""
    return "empty" if value is None else f"{value!r:.40}"


def _with_splits(pairs: list[Pair], seed: int) -> list[Pair]:
    """The pairs with their splits; a random split if no row has one."""
    if any(pair.split for pair in pairs):
        for pair in pairs:
            if pair.split not in SPLITS:
                raise T2TwinError(
                    f"{pair.place}: split is {_shown(pair.split or None)}; expected "
                    f"{', '.join(SPLITS)}, or no split in any row"
                )
        return pairs
    ends = np.rint(np.cumsum(SHARES) * len(pairs)).astype(int)
    order = np.random.default_rng(seed).permutation(len(pairs))
    sampled = {
        int(row): SPLITS[int(np.searchsorted(ends, n, "right"))] for n, row in enumerate(order)
    }
    return [replace(pair, split=sampled[number]) for number, pair in enumerate(pairs)]


def _write(
    pairs: list[Pair],
    images: Path,
    folder: Path,
    layout: Layout,
    full_scale: int,
    sensors: SensorPair,
) -> DatasetInfo:
    by_shard: dict[tuple[str, str], list[Pair]] = {}
    for pair in pairs:
        by_shard.setdefault((pair.split, pair.shape), []).append(pair)
    paths = {shard_path(*key) for key in by_shard}
    if len(paths) < len(by_shard):
        raise T2TwinError(
            "two names of shapes differ only in / and -; their files would be the same"
        )
    reader, schema = _ImageReader(images), schema_of(VALUES, None)
    shards = {}
    for split, shape in sorted(by_shard):
        own = by_shard[split, shape]
        path = shard_path(split, shape)
        shards[path] = Shard(write_shard(folder / path, _rows(own, reader), schema), len(own))
    assert reader.shape is not None  # there are pairs
    info = DatasetInfo(
        format=FORMAT,
        complete=True,
        pairs={split: sum(p.split == split for p in pairs) for split in SPLITS},
        source=SensorInfo(
            name=sensors.camera.name,
            value=IMAGE,
            image_shape=reader.shape,
            view_mm=sensors.camera.camera.seen_half_extent_mm(),
        ),
        target=SensorInfo(
            name=sensors.array.name,
            value=COUNTS,
            layout=layout.name,
            x_mm=tuple(layout.x_mm.tolist()),
            y_mm=tuple(layout.y_mm.tolist()),
            pad_diameter_mm=tuple(layout.pad_diameter_mm.tolist()),
            full_scale_counts=full_scale,
            tactile_image=sensors.array.tactile_image_size,
        ),
        versions=versions(),
        shards=shards,
        origin=ORIGIN,
    )
    write_card(folder, info)
    write_info(folder, info)
    return info


def _rows(pairs: list[Pair], reader: "_ImageReader") -> Iterator[dict[str, Any]]:
    empty = dict.fromkeys(schema_of(VALUES, None).names)
    for index, pair in enumerate(pairs):
        yield empty | {
            "shape": pair.shape,
            "family": pair.family,
            "split": pair.split,
            "index": index,
            **dict(zip(POSE, pair.pose, strict=True)),
            column("source", IMAGE): {
                "bytes": encode_png(reader.read(pair)),
                "path": f"{file_stem(pair.shape)}-{index}.png",
            },
            column("target", COUNTS): list(pair.counts),
        }


class _ImageReader:
    """Reads images; all must be of one size, and no two equal."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._places: dict[bytes, str] = {}
        self.shape: tuple[int, int, int] | None = None

    def read(self, pair: Pair) -> np.ndarray:
        try:
            content = pair.image
            if not isinstance(content, bytes):
                content = read_file(self._folder / str(content), MAX_FILE_BYTES)
            image = decode_image(content, FORMATS)
            if image.mode[0] in "IF":
                raise T2TwinError("it has more than 8 bits a channel; save it with 8")
        except T2TwinError as error:
            raise T2TwinError(f"{pair.place}: its image cannot be read: {error}") from error
        pixels = np.array(image.convert("RGB"))
        rows, columns, channels = pixels.shape
        self.shape = self.shape or (rows, columns, channels)
        if pixels.shape != self.shape:
            raise T2TwinError(
                f"{pair.place}: its image is {columns} x {rows} pixels and "
                f"those before {self.shape[1]} x {self.shape[0]}; all must be of one size"
            )
        first = self._places.setdefault(hashlib.sha256(pixels.tobytes()).digest(), pair.place)
        if first != pair.place:
            raise T2TwinError(f"{first} and {pair.place} have the same image; remove one")
        return pixels
