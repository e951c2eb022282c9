"""Writes the metadata of a dataset from templates: its card and its Croissant file.

The card's header declares splits, columns and license to the Hugging Face hub, its viewer and
`datasets`. croissant.json declares the same in the Croissant format 1.1 of MLCommons
(https://docs.mlcommons.org/croissant/docs/croissant-spec-1.1.html).
"""

from pathlib import Path
from typing import Any

import pyarrow as pa

from t2twin.core.templates import render
from t2twin.sim.dataset.columns import IMAGE, IMAGE_TYPE, Stored, columns_of, type_name
from t2twin.sim.dataset.info import SPLITS, DatasetInfo
from t2twin.sim.dataset.store import write_whole

CARD, CROISSANT = "README.md", "croissant.json"

SPLIT_NAMES = {
    "train": ("train", "cr:TrainingSplit"),
    "val": ("validation", "cr:ValidationSplit"),
    "test": ("test", "cr:TestSplit"),
}
"""Names of the splits on the Hugging Face hub, and their kinds in Croissant."""

SIZES = ((1e3, "n<1K"), (1e4, "1K<n<10K"), (1e5, "10K<n<100K"), (1e6, "100K<n<1M"))
"""Size categories of the hub, each with the number of rows that it ends at."""

LARGEST_SIZE = "1M<n<10M"

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


def write_card(folder: Path, info: DatasetInfo) -> None:
    """Writes README.md and croissant.json of a dataset whose shards exist."""
    sizes = {path: (folder / path).stat().st_size for path in sorted(info.shards)}
    values = {
        "info": info,
        "splits": {split: SPLIT_NAMES[split] for split in SPLITS if info.pairs[split]},
        "columns": [_described(each, info) for each in columns_of(info.values, info.recipe)],
        "size": next((n for end, n in SIZES if sum(info.pairs.values()) < end), LARGEST_SIZE),
        "sizes": sizes,
        "types": CROISSANT_TYPES,
    }
    write_whole(folder / CARD, render("sim/dataset/card.md", **values).encode())
    write_whole(folder / CROISSANT, render("sim/dataset/croissant.json", **values).encode())


def _described(stored: Stored, info: DatasetInfo) -> dict[str, Any]:
    """A column as the templates list it; value_type: of its elements."""
    kind, size = stored.column.type, stored.column.size
    if pa.types.is_list(kind):
        kind = kind.value_type
    return {
        "name": stored.name,
        "value_type": IMAGE if kind == IMAGE_TYPE else type_name(kind),
        "size": None if size is None else size(info.sensors[stored.role]),
        "sensor": info.sensors[stored.role].name if stored.role else None,
        "unit": stored.column.unit,
        "about": stored.column.about,
    }
