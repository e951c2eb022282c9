"""3MF: a ZIP archive of XML models with parts, places and a unit (3MF Core Specification 1.3).

Read with Python's own ZIP and XML: nothing outside the archive, and no more than is allowed here.
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
    joined,
    moved,
)

UNITS_MM = {
    "micron": 0.001,
    "millimeter": 1.0,
    "centimeter": 10.0,
    "inch": 25.4,
    "foot": 304.8,
    "meter": 1000.0,
}
"""The units that a model may name, mm; millimeter where it names none."""

MAX_UNPACKED_BYTES = 300_000_000
"""Most bytes of models in an archive, unpacked (assumed: what 2 million triangles take)."""

MAX_PARTS = 10_000
"""Most parts, and most places that they name (assumed)."""

CHUNK_BYTES = 1 << 20
"""Bytes that are unpacked and read at once (assumed)."""

CORE = "{http://schemas.microsoft.com/3dmanufacturing/core/2015/02}"
ELSEWHERE = "{http://schemas.microsoft.com/3dmanufacturing/production/2015/06}path"
"""The attribute that names another model of the archive."""

START = "/3D/3dmodel.model"
"""The model that says what is built, where the archive does not name another."""

RELATIONSHIPS = "_rels/.rels"
"""The file that names it (Open Packaging Conventions, 9.3)."""

RELATIONSHIP = "{http://schemas.openxmlformats.org/package/2006/relationships}Relationship"
START_TYPE = "http://schemas.microsoft.com/3dmanufacturing/2013/01/3dmodel"
"""The element that does so, and its type (3MF Core Specification 1.3, 2.1)."""


@dataclass(frozen=True)
class _Place:
    """A part, by the model that holds it and its number, and where it stands, (4, 4)."""

    part: tuple[str, str]
    transform: np.ndarray


@dataclass
class _Part:
    """A part's own triangles, and the parts that it is made of. corners: x, y, z in turn. faces:
    three numbers of corners in turn."""

    corners: array = field(default_factory=lambda: array("d"))
    faces: array = field(default_factory=lambda: array("q"))
    places: list[_Place] = field(default_factory=list)


@dataclass
class _Counts:
    """How much the models of an archive hold together."""

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
    """What takes up XML as it is parsed."""

    def start(self, tag: str, said: dict[str, str]) -> None:
        raise NotImplementedError

    def doctype(self, name: str, public: str, system: str) -> None:
        raise ValueError("its XML declares a document type, which 3MF does not allow")

    def close(self) -> None:
        pass


class _Start(_Xml):
    """The name of the model that says what is built, from the archive's relationships."""

    name: str = START

    def start(self, tag: str, said: dict[str, str]) -> None:
        if tag == RELATIONSHIP and said.get("Type") == START_TYPE:
            self.name = "/" + said["Target"].removeprefix("/")


class _Model(_Xml):
    """What one model says, taken up as the XML is parsed."""

    def __init__(self, name: str, counts: _Counts) -> None:
        self.name = name
        self.counts = counts
        self.unit_mm = 1.0
        self.parts: dict[tuple[str, str], _Part] = {}
        self.built: list[_Place] = []
        self.part = _Part()

    def start(self, tag: str, said: dict[str, str]) -> None:
        if not tag.startswith(CORE):
            return
        match tag[len(CORE) :]:
            case "vertex":
                self.counts.corners += 1
                check_corners(self.counts.corners)
                self.part.corners.extend((float(said["x"]), float(said["y"]), float(said["z"])))
            case "triangle":
                self.counts.triangles += 1
                check_triangles(self.counts.triangles)
                self.part.faces.extend((int(said["v1"]), int(said["v2"]), int(said["v3"])))
            case "object":
                self.counts.count_part()
                self.part = _Part()
                # Supports and the like are not the solid: they stay empty.
                solid = said.get("type", "model") == "model"
                self.parts[self.name, said["id"]] = self.part if solid else _Part()
            case "component":
                self.part.places.append(self._place(said))
            case "item":
                self.built.append(self._place(said))
            case "model":
                unit = said.get("unit", "millimeter")
                if unit not in UNITS_MM:
                    raise ValueError(f"its unit {unit!r} is not one of {', '.join(UNITS_MM)}")
                self.unit_mm = UNITS_MM[unit]

    def _place(self, said: dict[str, str]) -> _Place:
        self.counts.count_part()
        transform = np.eye(4)
        if "transform" in said:
            try:
                numbers = np.array(said["transform"].split(), dtype=np.float64)
                transform[:3] = numbers.reshape(4, 3).T
            except ValueError:
                raise ValueError("it places a part by other than 12 numbers") from None
        return _Place((said.get(ELSEWHERE, self.name), said["objectid"]), transform)


def read(path: Path) -> tuple[trimesh.Trimesh, float]:
    """What a 3MF file builds and its unit in mm; see this package."""
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
    return joined(_bodies(start.built, parts)), start.unit_mm


def _models(archive: zipfile.ZipFile) -> tuple[_Model, list[_Model]]:
    """The model that says what is built, and every model of the archive; what is unpacked of each
    is what it announces."""
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
    """The triangles of all that is built, part by part, each where it stands."""
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
        yield moved((corners, faces), place.transform)
