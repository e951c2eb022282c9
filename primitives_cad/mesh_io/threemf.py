"""Reads 3MF: a ZIP archive of XML models with parts and a unit (3MF Core Specification 1.3).

Uses Python's ZIP and XML modules, never opens other files, and limits the amount of data. trimesh's
reader (5.2) is not used: it unpacks an archive without a limit, and requires the library lxml.
"""

import zipfile
import zlib
from array import array
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
import trimesh

from t2twin.primitives_cad.mesh_io.bodies import (
    MAX_PLACES,
    Body,
    check_corners,
    check_triangles,
    merged,
    transformed,
)

UNITS_MM = {
    "micron": 0.001,
    "millimeter": 1.0,
    "centimeter": 10.0,
    "inch": 25.4,
    "foot": 304.8,
    "meter": 1000.0,
}
"""Allowed units of a model, mm; the default is millimeter."""

MAX_UNPACKED_BYTES = 300_000_000
"""Limit on the unpacked bytes of an archive's models (assumed: 2 million triangles)."""

MAX_PARTS = 10_000
"""Limit on the parts and their placements (assumed)."""

CHUNK_BYTES = 1 << 20
"""Bytes that are unpacked and parsed at a time (assumed)."""

CORE = "{http://schemas.microsoft.com/3dmanufacturing/core/2015/02}"
PRODUCTION = "http://schemas.microsoft.com/3dmanufacturing/production/2015/06"
ELSEWHERE = f"{{{PRODUCTION}}}path"
"""Attribute with the name of another model in the archive."""

KNOWN_EXTENSIONS = (
    PRODUCTION,
    "http://schemas.microsoft.com/3dmanufacturing/material/2015/02",
    "http://schemas.microsoft.com/3dmanufacturing/trianglesets/2021/07",
)
"""Extensions that a model may require: the others change its triangles."""

PRESSED = ("model", "surface")
"""Types of objects that are pressed; supports and the like are not part of the shape."""

START = "/3D/3dmodel.model"
"""Default name of the model with the build instructions."""

RELATIONSHIPS = "_rels/.rels"
"""File with the name of that model (Open Packaging Conventions, 9.3)."""

RELATIONSHIP = "{http://schemas.openxmlformats.org/package/2006/relationships}Relationship"
START_TYPE = "http://schemas.microsoft.com/3dmanufacturing/2013/01/3dmodel"
"""The element with the name, and its type (3MF Core Specification 1.3, 2.1)."""


@dataclass(frozen=True)
class _Place:
    """A placed part. part: its model and number. transform: (4, 4)."""

    part: tuple[str, str]
    transform: np.ndarray


@dataclass
class _Part:
    """A part's triangles and components. corners: flat x, y, z. faces: flat corner indices."""

    corners: array = field(default_factory=lambda: array("d"))
    faces: array = field(default_factory=lambda: array("q"))
    places: list[_Place] = field(default_factory=list)


@dataclass
class _Counts:
    """Numbers of elements in all models of an archive."""

    corners: int = 0
    triangles: int = 0
    parts: int = 0

    def count_part(self) -> None:
        self.parts += 1
        if self.parts > MAX_PARTS:
            raise ValueError(
                f"it has more than the {MAX_PARTS:,} parts and places that are allowed"
            )


class _Xml:
    """Target of an XML parser."""

    def doctype(self, name: str, public: str, system: str) -> None:
        raise ValueError("its XML declares a document type, which 3MF does not allow")


class _Start(_Xml):
    """Parses the archive's relationships for the name of the start model."""

    name: str = START

    def start(self, tag: str, attributes: dict[str, str]) -> None:
        if tag == RELATIONSHIP and attributes.get("Type") == START_TYPE:
            self.name = "/" + attributes["Target"].removeprefix("/")


class _Model(_Xml):
    """Parses one model."""

    def __init__(self, name: str, counts: _Counts) -> None:
        self.name = name
        self.counts = counts
        self.unit_mm = 1.0
        self.parts: dict[tuple[str, str], _Part] = {}
        self.built: list[_Place] = []
        self.part = _Part()
        self.namespaces: dict[str, str] = {}

    def start_ns(self, prefix: str, uri: str) -> None:
        self.namespaces[prefix] = uri

    def start(self, tag: str, attributes: dict[str, str]) -> None:
        if not tag.startswith(CORE):
            return
        match tag[len(CORE) :]:
            case "vertex":
                self.counts.corners += 1
                check_corners(self.counts.corners)
                self.part.corners.extend(
                    (float(attributes["x"]), float(attributes["y"]), float(attributes["z"]))
                )
            case "triangle":
                self.counts.triangles += 1
                check_triangles(self.counts.triangles)
                self.part.faces.extend(
                    (int(attributes["v1"]), int(attributes["v2"]), int(attributes["v3"]))
                )
            case "object":
                self.counts.count_part()
                self.part = _Part()
                pressed = attributes.get("type", "model") in PRESSED
                self.parts[self.name, attributes["id"]] = self.part if pressed else _Part()
            case "component":
                self.part.places.append(self._place(attributes))
            case "item":
                self.built.append(self._place(attributes))
            case "model":
                unit = attributes.get("unit", "millimeter")
                if unit not in UNITS_MM:
                    raise ValueError(f"its unit {unit!r} is not one of {', '.join(UNITS_MM)}")
                self.unit_mm = UNITS_MM[unit]
                for prefix in attributes.get("requiredextensions", "").split():
                    if (name := self.namespaces.get(prefix, prefix)) not in KNOWN_EXTENSIONS:
                        raise ValueError(
                            f"it requires the extension {name}, which is not read; export it "
                            "without"
                        )

    def _place(self, attributes: dict[str, str]) -> _Place:
        self.counts.count_part()
        transform = np.eye(4)
        if "transform" in attributes:
            try:
                numbers = np.array(attributes["transform"].split(), dtype=np.float64)
                transform[:3] = numbers.reshape(4, 3).T
            except ValueError:
                raise ValueError("it places a part by other than 12 numbers") from None
        return _Place((attributes.get(ELSEWHERE, self.name), attributes["objectid"]), transform)


def read(path: Path) -> tuple[trimesh.Trimesh, float]:
    """The built parts of a 3MF file, and its unit in mm; see this package."""
    try:
        with zipfile.ZipFile(path) as archive:
            start, models = _models(archive)
    except (zipfile.BadZipFile, zlib.error, EOFError) as error:
        raise ValueError("it is not a whole ZIP archive, which 3MF is") from error
    except ElementTree.ParseError as error:
        raise ValueError("its model is not whole XML") from error
    except KeyError as error:
        raise ValueError(f"it lacks {error.args[0]}") from error
    except OverflowError as error:
        raise ValueError("its faces name corners that it lacks") from error
    parts = {name: part for model in models for name, part in model.parts.items()}
    return merged(_bodies(start.built, parts)), start.unit_mm


def _models(archive: zipfile.ZipFile) -> tuple[_Model, list[_Model]]:
    """The start model and all models of the archive.

    zipfile unpacks no more of each file than its header declares.
    """
    files = {f"/{each.filename}": each for each in archive.infolist()}
    relationships = files.get(f"/{RELATIONSHIPS}")
    models = {name: each for name, each in files.items() if name.lower().endswith(".model")}
    start = _Start()
    read = [*models.values(), *([] if relationships is None else [relationships])]
    if sum(each.file_size for each in read) > MAX_UNPACKED_BYTES:
        raise ValueError(
            f"its models are larger than the {MAX_UNPACKED_BYTES / 1e6:,.0f} MB that are allowed"
        )
    if relationships is not None:
        _parse(archive, relationships, start)
        models |= {name: each for name, each in files.items() if name == start.name}
    named = next((name for name in models if name.lower() == start.name.lower()), None)
    if named is None:
        raise ValueError(f"it lacks {start.name[1:]}")
    counts = _Counts()
    made = {name: _Model(name, counts) for name in models}
    for name, model in made.items():
        _parse(archive, models[name], model)
    return made[named], list(made.values())


def _parse(archive: zipfile.ZipFile, file: zipfile.ZipInfo, target: Any) -> None:
    parser = ElementTree.XMLParser(target=target)
    with archive.open(file) as unpacked:
        while chunk := unpacked.read(CHUNK_BYTES):
            parser.feed(chunk)
    parser.close()


def _bodies(built: list[_Place], parts: dict[tuple[str, str], _Part]) -> Iterator[Body]:
    """The triangles of all built parts, in the frame of the start model."""
    waiting, seen = list(built), 0
    while waiting:
        place = waiting.pop()
        seen += 1
        if seen > MAX_PLACES:
            raise ValueError(f"its parts stand at more than the {MAX_PLACES:,} allowed places")
        if place.part not in parts:
            raise ValueError(f"it builds part {place.part[1]}, which it lacks")
        part = parts[place.part]
        with np.errstate(over="ignore", invalid="ignore"):
            waiting += [_Place(of.part, place.transform @ of.transform) for of in part.places]
        corners = np.array(part.corners, dtype=np.float64).reshape(-1, 3)
        faces = np.array(part.faces, dtype=np.int64).reshape(-1, 3)
        yield transformed((corners, faces), place.transform)
