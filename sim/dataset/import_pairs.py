"""Imports and checks a user's pairs: a CSV file next to its images, or Parquet.

`t2twin import-pairs --help` lists the columns. Others are ignored, unless their name is similar to
one of these.
"""

import hashlib
import math
import re
from pathlib import Path
from typing import Annotated, Any, Literal, cast

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from msgspec import Meta, Struct, defstruct

from t2twin.core import arguments
from t2twin.core.arguments import check_seed
from t2twin.core.errors import T2TwinError, counted, warn
from t2twin.core.files import new_folder, read_file
from t2twin.core.frame_order import UPRIGHT, FrameOrder
from t2twin.core.images import MAX_FILE_BYTES, decode_image, encode_png, fault_of, is_colored
from t2twin.core.records import check_names, convert
from t2twin.sim.contact.elastomer import elastomer_json
from t2twin.sim.dataset.columns import COUNTS, IMAGE, POSE, column, schema_of
from t2twin.sim.dataset.info import (
    MAX_COUNTS,
    SPLITS,
    ArrayInfo,
    CameraInfo,
    DatasetInfo,
    Shard,
    normalized,
    versions,
)
from t2twin.sim.dataset.store import write_card, write_info, write_shard
from t2twin.sim.sampling.plan import file_stem, shard_path
from t2twin.sim.sensors.defaults import SOURCE, TARGET
from t2twin.sim.sensors.pair import SensorPair
from t2twin.sim.tables import read_csv
from t2twin.sim.taxels.layout import Layout, load_layout

SHARES = (0.8, 0.1, 0.1)  # of train, val and test in a random split
FORMATS = ("PNG", "JPEG", "BMP", "TIFF", "WEBP")  # of images
VALUES = {"source": IMAGE, "target": COUNTS}
SUFFIXES = (".csv", ".parquet")
NUMBERS = r"taxel_\d+|x_mm|y_mm|yaw_rad|force_n"  # names of columns
OWN = "own"  # shape and family of pairs without a name

# Names become file names; larger angles are in degrees (assumed).
Name = Annotated[str, Meta(max_length=220, pattern=r"^[^\0]*$")]
Angle = Annotated[float, Meta(ge=-4 * math.pi, le=4 * math.pi)]
Force = Annotated[float, Meta(ge=0.0, le=1000.0)]


class Pair(Struct):
    """A row of the table."""

    taxels: list[float] = []
    place: str = ""  # its file and line or row, for messages
    image: Any = None  # a file next to the table; in Parquet also its bytes, or {bytes, path}
    split: Literal["train", "val", "test"] | None = None
    shape: Name | int | None = None
    family: Name | int | None = None
    index: Any = None
    x_mm: float | None = None
    y_mm: float | None = None
    yaw_rad: Angle | None = None
    force_n: Force | None = None


def import_pairs(
    table: str | Path, folder: str | Path, layout: str | Path | Layout | None = None,
    full_scale: int | None = None, seed: int = 0, order: FrameOrder = UPRIGHT,
    source: str | Path = SOURCE, target: str | Path = TARGET,
) -> DatasetInfo:  # fmt: skip
    """Write a user's pairs as a dataset, atomically; returns its info.

    table: a CSV or Parquet file, or a folder with one. layout: the user's taxels, by name,
    file or Layout. full_scale: count at which they saturate. Both: None for the target's. seed: of
    a random split. order: of the images, which are stored upright; the info has it. source, target:
    sensors by name or file: a gel camera with the view of the images, and an array like the user's.
    Warns with T2TwinWarning of images that are black, overexposed or without color, of a size
    unlike the camera's, and of counts that are all below 1 % of full_scale.
    Raises T2TwinError, with the row, for an image that is missing, unreadable, of another size or a
    duplicate. The same holds for a wrong number of counts, counts outside 0 to full_scale, and
    places off both sensors.
    """
    table = arguments.path(table, "table")
    tables = table.glob("[!.]*") if table.is_dir() else [table]
    tables = [path for path in tables if path.suffix.lower() in SUFFIXES]
    if len(tables) != 1 or not tables[0].is_file():
        raise T2TwinError(
            f"{table} is not a table of pairs; expected a .csv or .parquet file, or a folder with "
            "one such file and its images"
        )
    folder = arguments.path(folder, "folder").absolute()
    sensors = SensorPair.of(source, target)
    layout = sensors.array.layout if layout is None else load_layout(layout)
    full_scale = sensors.array.full_scale if full_scale is None else full_scale
    arguments.whole_number(full_scale, "full_scale", 1, MAX_COUNTS)
    check_seed(seed)
    arguments.instance(order, "order", FrameOrder)
    with new_folder(folder) as temporary:
        pairs = read_pairs(tables[0], layout, full_scale, sensors)
        without = [pair for pair in pairs if pair.split is None]
        if without and len(without) < len(pairs):
            place = without[0].place
            raise T2TwinError(f"{place}: split is empty; expected one in all rows or none")
        ends = np.rint(np.cumsum(SHARES) * len(pairs)).astype(int)
        shuffled = np.random.default_rng(seed).permutation(len(pairs))
        for n, row in enumerate(shuffled if without else ()):
            pairs[row].split = SPLITS[np.searchsorted(ends, n, "right")]
        return _write(pairs, tables[0].parent, temporary, layout, full_scale, sensors, order)


def read_pairs(path: Path, layout: Layout, full_scale: int, sensors: SensorPair) -> list[Pair]:
    """The rows of a table, checked, without their images; T2TwinError names the line or row."""
    if is_csv := path.suffix.lower() == ".csv":
        names, rows = read_csv(path, NUMBERS)
    else:
        try:
            table = pq.read_table(path)
        except (pa.ArrowException, OSError) as error:
            raise T2TwinError(f"{path}: {error}") from error
        names, cells = table.column_names, enumerate(table.to_pylist(), start=1)
        rows = [(f"row {n}", {k: v for k, v in row.items() if v is not None}) for n, row in cells]
    taxels = [name for name in names if re.fullmatch(r"taxel_\d+", name)]
    check_names(names, [*Pair.__struct_fields__, *taxels], path, others=True)
    expected = [f"taxel_{number}" for number in range(layout.size)]
    is_list, count = "taxels" in names, cast(Any, Annotated[float, Meta(ge=0.0, le=full_scale)])
    of_all: Any = Annotated[list[count], Meta(min_length=layout.size, max_length=layout.size)]
    columns: list[Any] = [("taxels", of_all)] if is_list else [(name, count) for name in expected]
    layers = sensors.camera.elastomer, sensors.array.elastomer
    ends = [(each.width_mm / 2, each.length_mm / 2) for each in layers]
    ends.append(np.abs([layout.x_mm, layout.y_mm]).max(axis=1) + layout.pad_diameter_mm.max())
    for name, end in zip(("x_mm", "y_mm"), np.max(ends, axis=0).tolist(), strict=True):
        on_either: Any = Annotated[float, Meta(ge=-end, le=end)]
        columns.append((name, on_either | None, None))
    kind = cast(type[Pair], defstruct("Row", columns, bases=(Pair,), kw_only=True))
    if "image" not in names or (sorted(taxels) != ([] if is_list else sorted(expected))):
        raise T2TwinError(
            f"{path} has the columns {', '.join(names[:12])}; expected image, and either taxels or "
            f"taxel_0 to {expected[-1]}, of layout {layout.name}"
        )
    pairs = []
    for place, row in rows:
        pair = convert(row, kind, f"{path}, {place}", strict=not is_csv, row=True)
        if not is_list:
            pair.taxels = [getattr(pair, name) for name in expected]
        given = [str(each) for each in (pair.shape, pair.family) if each not in (None, "")] or [OWN]
        pair.place, pair.shape, pair.family = f"{path}, {place}", given[0], given[-1]
        pairs.append(pair)
    if not pairs:
        raise T2TwinError(f"{path} contains no pairs")
    counts = np.array([pair.taxels for pair in pairs])
    if (found := normalized(counts, full_scale)) and counts.max() <= 1.0:
        raise T2TwinError(f"{path}: {found}")
    warn(found and f"{path}: {found}")
    return pairs


def _write(
    pairs: list[Pair], images: Path, folder: Path, layout: Layout, full_scale: int,
    sensors: SensorPair, order: FrameOrder,
) -> DatasetInfo:  # fmt: skip
    by_shard: dict[str, list[Pair]] = {}
    for pair in sorted(pairs, key=lambda pair: (str(pair.split), str(pair.shape))):
        own = by_shard.setdefault(shard_path(str(pair.split), str(pair.shape)), [])
        if own and own[0].shape != pair.shape:
            raise T2TwinError(
                "two names of shapes differ only in / and -; their files would be the same"
            )
        own.append(pair)
    schema, shards = schema_of(VALUES, None), {}
    known: dict[bytes, str] = {}
    size: list[tuple[int, int, int]] = []
    faults: dict[str, list[str]] = {}
    colored = is_colored(sensors.camera.background_frame())
    for path, own in by_shard.items():
        rows = (_row(p, n, images, known, size, faults, colored, order) for n, p in enumerate(own))
        shards[path] = Shard(write_shard(folder / path, rows, schema), len(own))
    (high, wide, _), own = size[0], sensors.camera.camera
    is_small = high < own.rows / 16  # assumed, as the next limit
    if is_small or abs(wide * own.rows / (high * own.columns) - 1.0) > 0.1:
        other = f"those of {sensors.camera.name}, upright, are {own.columns} x {own.rows}"
        warn(f"the images are {wide} x {high} pixels; {other}")
    for fault, places in faults.items():
        found = f"{counted(len(places), 'image')} of {len(pairs)} are {fault}, first {places[0]}"
        warn(f"{found}; expected images of {sensors.camera.name} in its own light")
    info = DatasetInfo(
        complete=True,
        pairs={split: sum(p.split == split for p in pairs) for split in SPLITS},
        source=CameraInfo(
            name=sensors.camera.name,
            image_shape=size[0],
            view_mm=sensors.camera.camera.seen_half_extent_mm(),
        ),
        target=ArrayInfo(
            name=sensors.array.name,
            elastomer=elastomer_json(sensors.array.elastomer),
            layout=layout.name,
            x_mm=layout.x_mm,
            y_mm=layout.y_mm,
            pad_diameter_mm=layout.pad_diameter_mm,
            full_scale_counts=full_scale,
            tactile_image=sensors.array.tactile_image_size,
        ),
        versions=versions(),
        shards=shards,
        order=None if order == UPRIGHT else order,
    )
    write_card(folder, info)
    write_info(folder, info)
    return info


def _row(
    pair: Pair, index: int, folder: Path, known: dict[bytes, str],
    size: list[tuple[int, int, int]], faults: dict[str, list[str]], colored: bool,
    order: FrameOrder,
) -> dict[str, Any]:  # fmt: skip
    """A row of a shard; columns that it lacks are empty.

    known: places of the earlier images by hash. size: theirs, if any. faults: receives the place
    of an image with a fault, by its name. colored: whether the sensor has colors.
    """
    content = pair.image
    if isinstance(content, dict):
        content = content.get("bytes") or content.get("path")
    try:
        if not isinstance(content, str | bytes) or not content:
            raise T2TwinError("there is none; image is a file's name or PNG")
        if isinstance(content, str):
            content = read_file(folder / content, MAX_FILE_BYTES)
        image = decode_image(content, FORMATS)
        if image.mode[0] in "IF":
            raise T2TwinError("it has more than 8 bits a channel; save it with 8")
    except T2TwinError as error:
        raise T2TwinError(f"{pair.place}: its image cannot be read: {error}") from error
    pixels = order.upright(np.array(image.convert("RGB")))
    rows, columns, channels = pixels.shape
    size[:] = size or [(rows, columns, channels)]
    if pixels.shape != size[0]:
        raise T2TwinError(
            f"{pair.place}: its image is {columns} x {rows} pixels and those before {size[0][1]} x "
            f"{size[0][0]}; all must be of one size"
        )
    first = known.setdefault(hashlib.sha256(pixels.tobytes()).digest(), pair.place)
    if first != pair.place:
        raise T2TwinError(f"{first} and {pair.place} have the same image; remove one")
    if fault := fault_of(pixels, colored):
        faults.setdefault(fault, []).append(pair.place)
    name = f"{file_stem(str(pair.shape))}-{index}.png"
    return {
        "shape": pair.shape,
        "family": pair.family,
        "split": pair.split,
        "index": index,
        **{name: getattr(pair, name) for name in POSE},
        column("source", IMAGE): {"bytes": encode_png(pixels), "path": name},
        column("target", COUNTS): np.rint(pair.taxels).astype(np.uint16),
    }
