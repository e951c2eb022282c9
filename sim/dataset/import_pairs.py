"""A user's own pairs into the dataset's format, checked on the way.

They come as rows: a CSV file beside its pictures, or Parquet. A row has a picture and one count a
taxel, and whatever else is known of the press:

    image           CSV: the picture's file, relative to the CSV; Parquet: the same, or the
                    picture's bytes, alone or as {bytes, path}
    taxel_0, ...    CSV: the counts, in the layout's order
    taxels          Parquet: a list of counts, in the layout's order
    split           train, val or test; drawn at random where no row has one
    shape, family   names; "own" where there are none
    x_mm, y_mm, yaw_rad, force_n    the press; empty where there are none

The other columns of this project's own shards are left out, and so are a user's, unless their name
is near to one of these: then it is probably misspelt, and is refused.
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

from t2twin.core import arguments
from t2twin.core.arguments import check_seed
from t2twin.core.errors import T2TwinError
from t2twin.core.files import created_folder, remove_leftovers, temporary_folder, write_error
from t2twin.core.images import decode_image, encode_png
from t2twin.core.records import check_names
from t2twin.sim.cyskin.layout import Layout
from t2twin.sim.cyskin.taxels import FULL_SCALE_COUNTS
from t2twin.sim.dataset.card import card
from t2twin.sim.dataset.columns import FIELD, POSE, SCHEMA, UNIT, UNTOUCHED
from t2twin.sim.dataset.info import FORMAT, MAX_COUNTS, SPLITS, DatasetInfo, Shard, versions
from t2twin.sim.dataset.pairs_table import find_table, read_table
from t2twin.sim.dataset.store import CARD, write_info, write_shard, write_whole
from t2twin.sim.world.plan import file_stem, shard_path

ORIGIN = "imported"
SHARES = (0.8, 0.1, 0.1)
"""Of train, val and test, where the rows do not say."""

FORMATS = ("PNG", "JPEG", "BMP", "TIFF", "WEBP")
"""Formats that the pictures may have."""

LONGEST_NAME = 220
"""Longest name of a shape, bytes: it becomes a file's, of which systems take 255."""

COLUMNS = [*SCHEMA.names, UNIT, FIELD, UNTOUCHED]
"""Columns of this project's own shards, of which some are read."""

OWN = "own"
"""Shape and family of pairs that name none."""


@dataclass(frozen=True)
class Pair:
    """One row of the user's, its picture not yet read. place: where it stands, for messages."""

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
    full_scale: int = FULL_SCALE_COUNTS,
    seed: int = 0,
) -> DatasetInfo:
    """Write a user's pairs as a dataset; returns its info.

    source: a CSV or Parquet file, or a folder that holds one. layout: the user's taxels.
    full_scale: where they saturate, counts. seed: draws the splits where the rows name none.
    The dataset appears whole or not at all. Raises T2TwinError, naming the row, for a picture that
    is missing, cannot be read, differs in size from the others or comes twice, and for counts that
    are too few, too many, or no numbers from 0 to full_scale.
    """
    table_path = find_table(arguments.path(source, "source"))
    folder = arguments.path(folder, "folder").absolute()
    arguments.instance(layout, "layout", Layout)
    if not 0 < arguments.whole_number(full_scale, "full_scale") <= MAX_COUNTS:
        raise T2TwinError(f"full scale is {full_scale} counts; it must lie in 1 to {MAX_COUNTS}")
    check_seed(seed)
    _check_free(folder)
    pairs = _with_splits(_read(table_path, layout, full_scale), seed)
    with created_folder(folder.parent):
        remove_leftovers(folder.parent, f".{folder.name}.*.part")
        with temporary_folder(folder.parent, folder.name) as temporary:
            info = _write(pairs, table_path.parent, temporary, layout, full_scale)
            try:
                temporary.replace(folder)
            except OSError as error:  # another import into it may just have ended
                _check_free(folder)
                raise write_error(folder, error) from error
    return info


def _check_free(folder: Path) -> None:
    if folder.exists() and (not folder.is_dir() or any(folder.iterdir())):
        raise T2TwinError(f"{folder} is not empty; choose another folder")


def _read(path: Path, layout: Layout, full_scale: int) -> list[Pair]:
    """All rows, their counts checked."""
    table, places = read_table(path)
    check_names(table.column_names, COLUMNS + _counts_of(table), path, others=True)
    if "image" not in table.column_names:
        raise T2TwinError(f"{path} has no column image; its columns are {_list(table)}")
    counts = _counts(table, places, path, layout, full_scale)
    columns = {
        name: table[name].to_pylist() if name in table.column_names else [None] * len(table)
        for name in ("image", "split", "shape", "family", *POSE)
    }
    pairs = []
    for row, place in enumerate(places):
        at = f"{path}, {place}"
        shape = str(columns["shape"][row] or columns["family"][row] or OWN)
        if "\0" in shape or len(os.fsencode(shape)) > LONGEST_NAME:
            raise T2TwinError(
                f"{at}: shape is {shape[:30]!r}; it must be a name of at most {LONGEST_NAME} bytes"
            )
        family = str(columns["family"][row] or shape)
        pairs.append(
            Pair(
                place=place,
                image=_image(columns["image"][row], at),
                counts=tuple(counts[row].tolist()),
                split=str(columns["split"][row] or ""),
                shape=shape,
                family=family,
                pose=tuple(_number(columns[name][row], at, name) for name in POSE),
            )
        )
    return pairs


def _counts(
    table: pa.Table, places: list[str], path: Path, layout: Layout, full_scale: int
) -> np.ndarray:
    """(rows, taxels) int64; means of several readings are rounded."""
    columns = _counts_of(table)
    wanted = [f"taxel_{number}" for number in range(layout.size)]
    if "taxels" in table.column_names and columns:
        raise T2TwinError(
            f"{path} has both columns, taxels and {columns[0]}; leave one of them out"
        )
    if "taxels" in table.column_names:
        rows = table["taxels"].to_pylist()
    elif sorted(columns) == sorted(wanted):
        rows = list(zip(*(table[name].to_pylist() for name in wanted), strict=True))
    else:
        raise T2TwinError(
            f"{path} has {len(columns)} columns taxel_0, taxel_1 ... and no column taxels; layout "
            f"{layout.name} wants taxel_0 to {wanted[-1]}"
        )
    for place, row in zip(places, rows, strict=True):
        if not isinstance(row, list | tuple) or len(row) != layout.size:
            there = len(row) if isinstance(row, list | tuple) else 0
            raise T2TwinError(
                f"{path}, {place}: {there} taxels instead of the {layout.size} of layout "
                f"{layout.name}"
            )
        if not all(0 <= _count(value) <= full_scale for value in row):
            raise T2TwinError(f"{path}, {place}: its counts must be numbers from 0 to {full_scale}")
    return np.rint([[_count(value) for value in row] for row in rows]).astype(np.int64)


def _counts_of(table: pa.Table) -> list[str]:
    """Columns with the counts of one taxel each, in the table's order."""
    return [name for name in table.column_names if re.fullmatch(r"taxel_\d+", name)]


def _count(value: Any) -> float:
    """A count, NaN for what is none. One word in a column makes all of a CSV's column text."""
    try:
        return float(value) if isinstance(value, int | float | str) else math.nan
    except (ValueError, OverflowError):
        return math.nan


def _image(value: Any, at: str) -> str | bytes:
    if isinstance(value, dict):
        value = value.get("bytes") or value.get("path")
    if not isinstance(value, str | bytes) or not value:
        raise T2TwinError(f"{at}: there is no picture; image is a file's name or PNG")
    return value


def _number(value: Any, at: str, name: str) -> float | None:
    if value is None:
        return None
    if not isinstance(value, int | float) or not np.isfinite(value):
        raise T2TwinError(f"{at}: {name} is {value!r}; it must be a finite number")
    return float(value)


def _list(table: pa.Table) -> str:
    return ", ".join(table.column_names)


def _with_splits(pairs: list[Pair], seed: int) -> list[Pair]:
    """As the rows say; drawn at random where none says anything."""
    if any(pair.split for pair in pairs):
        for pair in pairs:
            if pair.split not in SPLITS:
                raise T2TwinError(
                    f"{pair.place}: no split {pair.split!r}; allowed are {', '.join(SPLITS)}"
                )
        return pairs
    ends = np.rint(np.cumsum(SHARES) * len(pairs)).astype(int)
    order = np.random.default_rng(seed).permutation(len(pairs))
    drawn = {
        int(row): SPLITS[int(np.searchsorted(ends, n, "right"))] for n, row in enumerate(order)
    }
    return [replace(pair, split=drawn[number]) for number, pair in enumerate(pairs)]


def _write(
    pairs: list[Pair], beside: Path, folder: Path, layout: Layout, full_scale: int
) -> DatasetInfo:
    by_shard: dict[tuple[str, str], list[Pair]] = {}
    for pair in pairs:
        by_shard.setdefault((pair.split, pair.shape), []).append(pair)
    paths = {shard_path(*key) for key in by_shard}
    if len(paths) < len(by_shard):
        raise T2TwinError("two shapes differ only in / and -; their files would be the same")
    pictures = _Pictures(beside)
    shards = {}
    for split, shape in sorted(by_shard):
        own = by_shard[split, shape]
        path = shard_path(split, shape)
        shards[path] = Shard(write_shard(folder / path, _rows(own, pictures)), len(own))
    info = DatasetInfo(
        format=FORMAT,
        complete=True,
        pairs={split: sum(p.split == split for p in pairs) for split in SPLITS},
        layout=layout.name,
        layout_x_mm=tuple(layout.x_mm.tolist()),
        layout_y_mm=tuple(layout.y_mm.tolist()),
        full_scale_counts=full_scale,
        versions=versions(),
        shards=shards,
        image_shape=pictures.shape,
        origin=ORIGIN,
        pad_diameter_mm=tuple(layout.pad_diameter_mm.tolist()),
    )
    write_whole(folder / CARD, card(info).encode())
    write_info(folder, info)
    return info


def _rows(pairs: list[Pair], pictures: "_Pictures") -> Iterator[dict[str, Any]]:
    unknown = {field.name: None for field in SCHEMA}
    for index, pair in enumerate(pairs):
        yield unknown | {
            "shape": pair.shape,
            "family": pair.family,
            "split": pair.split,
            "index": index,
            **dict(zip(POSE, pair.pose, strict=True)),
            "image": {
                "bytes": encode_png(pictures.read(pair)),
                "path": f"{file_stem(pair.shape)}-{index}.png",
            },
            "taxels": list(pair.counts),
        }


class _Pictures:
    """Reads pictures one by one; all must be of one size, and no two the same."""

    def __init__(self, beside: Path) -> None:
        self._beside = beside
        self._places: dict[bytes, str] = {}
        self.shape: tuple[int, int, int] | None = None

    def read(self, pair: Pair) -> np.ndarray:
        source = pair.image if isinstance(pair.image, bytes) else self._file(pair)
        try:
            image = decode_image(source, FORMATS)
            if image.mode[0] in "IF":
                raise T2TwinError("it has more than 8 bits a channel; save it with 8")
        except T2TwinError as error:
            raise T2TwinError(f"{pair.place}: its picture cannot be read: {error}") from error
        pixels = np.array(image.convert("RGB"))
        rows, columns, channels = pixels.shape
        self.shape = self.shape or (rows, columns, channels)
        if pixels.shape != self.shape:
            raise T2TwinError(
                f"{pair.place}: its picture is {columns} x {rows} pixels and "
                f"those before {self.shape[1]} x {self.shape[0]}; all must be of one size"
            )
        first = self._places.setdefault(hashlib.sha256(pixels.tobytes()).digest(), pair.place)
        if first != pair.place:
            raise T2TwinError(f"{first} and {pair.place} have the same picture; leave one out")
        return pixels

    def _file(self, pair: Pair) -> Path:
        path = self._beside / str(pair.image)
        if not os.path.isfile(path):  # noqa: PTH113 - Path's raises for a name too long
            raise T2TwinError(f"{pair.place}: there is no picture {path}")
        return path
