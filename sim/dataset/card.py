"""Writes the metadata of a dataset: its card and its Croissant file.

The card's header declares splits, columns and license to the Hugging Face hub, its viewer and
`datasets`. croissant.json declares the same in the Croissant format 1.1 of MLCommons
(https://docs.mlcommons.org/croissant/docs/croissant-spec-1.1.html).
"""

import json
from pathlib import Path
from typing import Any

import pyarrow as pa

from t2twin.core.templates import render
from t2twin.sim.dataset.columns import IMAGE_TYPE, Stored, columns_of, type_name
from t2twin.sim.dataset.info import SPLITS, DatasetInfo
from t2twin.sim.dataset.store import write_whole

CARD, CROISSANT = "README.md", "croissant.json"

HUB_SPLITS = {"train": "train", "val": "validation", "test": "test"}
"""Names of the splits on the Hugging Face hub."""

CROISSANT_SPLITS = {
    "train": "cr:TrainingSplit",
    "val": "cr:ValidationSplit",
    "test": "cr:TestSplit",
}
"""Kinds of the splits (Croissant 1.1, section ML-specific features)."""

SIZES = ((1e3, "n<1K"), (1e4, "1K<n<10K"), (1e5, "10K<n<100K"), (1e6, "100K<n<1M"))
"""Size categories of the hub, each with the number of rows that it ends at."""

LARGEST_SIZE = "1M<n<10M"

LICENSE_URL = "https://spdx.org/licenses/MIT.html"
"""Of simulated datasets."""

CONFORMS_TO = "http://mlcommons.org/croissant/1.1"

_TERMS = (
    "arrayShape", "citeAs", "column", "containedIn", "equivalentProperty", "extract", "field",
    "fileObject", "fileProperty", "fileSet", "format", "includes", "isArray", "isLiveDataset",
    "jsonPath", "key", "md5", "parentField", "path", "recordSet", "references", "regex", "repeated",
    "replace", "samplingRate", "separator", "source", "subField", "transform",
)  # fmt: skip

CONTEXT = {
    "@language": "en",
    "@vocab": "https://schema.org/",
    "sc": "https://schema.org/",
    "cr": "http://mlcommons.org/croissant/",
    "rai": "http://mlcommons.org/croissant/RAI/",
    "dct": "http://purl.org/dc/terms/",
    "conformsTo": "dct:conformsTo",
    "data": {"@id": "cr:data", "@type": "@json"},
    "dataType": {"@id": "cr:dataType", "@type": "@vocab"},
    "examples": {"@id": "cr:examples", "@type": "@json"},
    "name": {"@container": "@language"},
    "description": {"@container": "@language"},
    **{name: f"cr:{name}" for name in _TERMS},
}
"""The terms of Croissant 1.1."""

CROISSANT_TYPES = {
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
    columns = columns_of(info.values, info.recipe)
    sizes = {path: (folder / path).stat().st_size for path in sorted(info.shards)}
    text = render(
        "sim/dataset/card.md",
        info=info,
        splits={HUB_SPLITS[split]: split for split in _present(info)},
        features=[_hub_feature(each) for each in columns],
        columns=[_described(each, info) for each in columns],
        size=next((name for end, name in SIZES if sum(info.pairs.values()) < end), LARGEST_SIZE),
        download_bytes=sum(sizes.values()),
    )
    write_whole(folder / CARD, text.encode())
    content = json.dumps(croissant(info, sizes), indent=1, ensure_ascii=False)
    write_whole(folder / CROISSANT, f"{content}\n".encode())


def _present(info: DatasetInfo) -> list[str]:
    """The splits that have pairs."""
    return [split for split in SPLITS if info.pairs[split]]


def _hub_feature(stored: Stored) -> dict[str, str]:
    """A column as a card's header lists it."""
    kind = stored.column.type
    if kind == IMAGE_TYPE:
        return {"name": stored.name, "dtype": "image"}
    if pa.types.is_list(kind):
        return {"name": stored.name, "sequence": type_name(kind.value_type)}
    return {"name": stored.name, "dtype": type_name(kind)}


def _described(stored: Stored, info: DatasetInfo) -> dict[str, str]:
    """A column as a card's table lists it."""
    about, feature = stored.column.about, _hub_feature(stored)
    kind = feature.get("dtype") or f"list of {feature['sequence']}"
    if stored.role:
        about = f"{info.sensors[stored.role].name}: {about}"
    return {"name": stored.name, "type": kind, "unit": stored.column.unit, "about": about}


def croissant(info: DatasetInfo, sizes: dict[str, int]) -> dict[str, Any]:
    """The content of croissant.json. sizes: of the shards by path, bytes."""
    title, about, version = "Pairs imported with t2twin", {}, info.versions["t2twin"]
    if info.is_simulated:
        title = f"t2twin {info.recipe_name}"
        cite_as = f"@misc{{t2twin, title={{{title}}}, note={{simulated by t2twin {version}}}}}"
        about = {"license": LICENSE_URL, "citeAs": cite_as}
    return {
        "@context": CONTEXT,
        "@type": "sc:Dataset",
        "conformsTo": CONFORMS_TO,
        "name": title,
        "description": (
            "Readings of two tactile sensors that touch the same shapes. "
            "README.md describes the columns."
        ),
        **about,
        "version": version,
        "keywords": ["tactile", info.source.name, info.target.name],
        "distribution": [_file(path, info, size) for path, size in sizes.items()]
        + [
            {
                "@type": "cr:FileSet",
                "@id": "shards",
                "description": "All shards.",
                "encodingFormat": "application/x-parquet",
                "includes": [f"{split}/*.parquet" for split in _present(info)],
            }
        ],
        "recordSet": [_splits(info), _pairs(info)],
    }


def _file(path: str, info: DatasetInfo, size: int) -> dict[str, Any]:
    return {
        "@type": "cr:FileObject",
        "@id": path,
        "name": path,
        "contentUrl": path,
        "contentSize": f"{size} B",
        "encodingFormat": "application/x-parquet",
        "sha256": info.shards[path].sha256,
    }


def _splits(info: DatasetInfo) -> dict[str, Any]:
    """The record set of the splits."""
    return {
        "@type": "cr:RecordSet",
        "@id": "splits",
        "dataType": "cr:Split",
        "key": {"@id": "splits/name"},
        "field": [
            {"@type": "cr:Field", "@id": "splits/name", "name": "name", "dataType": "sc:Text"},
            {"@type": "cr:Field", "@id": "splits/url", "name": "url", "dataType": "sc:URL"},
        ],
        "data": [{"splits/name": s, "splits/url": CROISSANT_SPLITS[s]} for s in _present(info)],
    }


def _pairs(info: DatasetInfo) -> dict[str, Any]:
    """The record set of the pairs, one field a column."""
    fields = []
    for stored in columns_of(info.values, info.recipe):
        name, kind = stored.name, stored.column.type
        extract = {"fileSet": {"@id": "shards"}, "extract": {"column": name}}
        field: dict[str, Any] = {"@type": "cr:Field", "@id": f"pairs/{name}", "name": name}
        field["description"] = stored.column.about
        if kind == IMAGE_TYPE:
            field["dataType"] = "sc:ImageObject"
            extract["transform"] = {"jsonPath": "bytes"}
        elif stored.column.size is not None:
            size = stored.column.size(info.sensors[stored.role])
            field["dataType"] = CROISSANT_TYPES[type_name(kind.value_type)]
            field |= {"isArray": True, "arrayShape": str(size)}
        else:
            field["dataType"] = CROISSANT_TYPES[type_name(kind)]
        if name == "split":
            field["references"] = {"field": {"@id": "splits/name"}}
        fields.append({**field, "source": extract})
    return {
        "@type": "cr:RecordSet",
        "@id": "pairs",
        "description": "One record a pair of touches.",
        "field": fields,
    }
